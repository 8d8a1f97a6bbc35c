"""The bare relay graph, the reference for the robot's graph."""

import pytest

pytest.importorskip('rclpy')

from benchmark.runs import run_relay


@pytest.mark.graph
def test_the_relay_runs_to_its_end():
    run = run_relay(0.1)
    assert run.real_time_factor > 0.0
    assert run.duty_sha256 is None
