"""The events that the plant's node passes to the master of the run."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.nodes.plant_events import PlantEvents


def test_an_unreadable_announcement_is_logged_and_reveals_its_sender():
    events, warnings = [], []
    plant = SimpleNamespace(
        _node=SimpleNamespace(
            dispatch=events.append,
            get_logger=lambda: SimpleNamespace(warning=warnings.append),
        ),
        _master=SimpleNamespace(on_unreadable_announcement='note it'),
    )
    PlantEvents._on_announcement(plant, b'no announcement')
    assert events == ['note it']
    (line,) = warnings
    assert line.endswith('; ignored')
