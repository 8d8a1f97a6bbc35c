"""Decisions of the controller's node, without the graph."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.nodes.controller import Controller


@pytest.mark.parametrize(('now_ns', 'stops'), [(0, []), (1_000_000_000, [1_000_000_000])])
def test_only_a_controller_that_has_driven_switches_off_the_motors(now_ns, stops):
    stopped = []
    controller = SimpleNamespace(
        now_ns=now_ns,
        _messages=SimpleNamespace(stop_motors=stopped.append),
        flush=lambda *topics: None,
    )
    Controller.close(controller)
    assert stopped == stops
