"""The events that the plant's node passes to the master of the run."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.messages.topics import PARTICIPANTS
from ballbot_ros.nodes.plant_events import PlantEvents


def test_an_unreadable_announcement_is_logged_and_reveals_its_sender():
    events, warnings = [], []
    plant = SimpleNamespace(
        _node=SimpleNamespace(
            dispatch=events.append,
            warn_malformed=lambda topic, error: warnings.append(topic.name),
        ),
        _master=SimpleNamespace(on_unreadable_announcement='note it'),
    )
    PlantEvents._on_announcement(plant, b'no announcement')
    assert events == ['note it']
    assert warnings == [PARTICIPANTS.name]
