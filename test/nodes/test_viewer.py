"""The viewer's decisions, without ROS and page."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.messages.conversions import encode_joy
from ballbot_ros.messages.topics import SOUND
from ballbot_ros.nodes import viewer
from ballbot_ros.nodes.viewer import Viewer
from ballbot_ros.timing import MILLISECOND_NS, SECOND_NS


def stub_viewer(**attributes):
    """Return a viewer that has only these attributes."""
    node = Viewer.__new__(Viewer)
    vars(node).update(attributes)
    return node


def test_released_sticks_are_published_as_neutral_once():
    """Other inputs take over at once, and a page at rest does not disturb them."""
    held = iter([None, (0.5, 0.0), None, None])
    sent = []
    node = stub_viewer(
        _controls=SimpleNamespace(drive=lambda now_s: next(held)),
        _joy=SimpleNamespace(publish=sent.append),
        _is_driving=False,
        now_ns=SECOND_NS,
    )
    for _ in range(4):
        node._drive()
    assert sent == [encode_joy(SECOND_NS, sticks) for sticks in ((0.5, 0.0), (0.0, 0.0))]


def test_only_a_new_tone_is_played(monkeypatch):
    monkeypatch.setattr(viewer, 'stamp_ns', lambda message: message)
    monkeypatch.setattr(viewer, 'tone_of', lambda message: message)
    played = []
    for stamp_ns in (SECOND_NS, SECOND_NS - 499 * MILLISECOND_NS, SECOND_NS // 2):
        node = stub_viewer(
            _newest={SOUND: stamp_ns}, _panel=SimpleNamespace(play=played.append), now_ns=SECOND_NS
        )
        node._sound()
    assert played == [SECOND_NS, SECOND_NS - 499 * MILLISECOND_NS]


def test_the_start_is_in_the_frame_map():
    assert viewer._start(SimpleNamespace(position=(1.5, 0.5))) == (1.5, -0.5)
