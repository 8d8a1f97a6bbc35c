"""The force of the pushes at a time, from its announcements, a recording and the graph."""

import pytest

from ballbot_ros.parameters import Dimensions
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.robot import grip
from ballbot_ros.viewer.snapshot import acting_force

START_AND_END = [(1.0, 'push 1', (2.0, 0.0)), (1.5, 'push 1', (0.0, 0.0))]
OVERLAPPING = [*START_AND_END, (1.2, 'push 2', (0.5, -1.0)), (1.3, 'push 2', (0.0, 0.0))]


@pytest.mark.parametrize(
    ('events', 'time', 'force'),
    [
        ([], 1.0, (0.0, 0.0)),
        (START_AND_END, 0.996, (0.0, 0.0)),
        (START_AND_END, 1.0, (2.0, 0.0)),
        (START_AND_END, 1.496, (2.0, 0.0)),
        (START_AND_END, 1.5, (0.0, 0.0)),
        (OVERLAPPING, 1.25, (2.5, -1.0)),
        (OVERLAPPING, 1.3, (2.0, 0.0)),
        (list(reversed(OVERLAPPING)), 1.3, (2.0, 0.0)),
    ],
)
def test_a_force_acts_from_its_start_to_its_end(events, time, force):
    assert acting_force(events, time) == force


def test_the_force_of_a_recorded_push_is_found(tmp_path, command):
    words = ['--processes=none', '--set=plant_sim.duration=8', '--output', tmp_path]
    command('run', 'push', *words)
    run = PlaybackRun(tmp_path / 'push.mcap')
    for time, force in (
        (2.996, (0.0, 0.0)), (3.0, (1.0, 0.0)), (3.096, (1.0, 0.0)), (3.1, (0.0, 0.0)),
        (7.05, (0.0, 1.0)),
    ):  # fmt: skip
        assert run.snapshot(time).force == force, time


def test_an_arrow_begins_at_the_side_of_the_body():
    dimensions = Dimensions()
    front = dimensions.body_depth / 2.0
    right = dimensions.body_width / 2.0
    assert grip(dimensions, (3.0, 0.0)) == (front, 0.0, dimensions.body_height)
    assert grip(dimensions, (0.0, -0.5)) == (0.0, -right, dimensions.body_height)
    x, y, _ = grip(dimensions, (1.0, 1.0))
    assert x == y == pytest.approx(min(front, right))
