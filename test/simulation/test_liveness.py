"""The time that a run waits for its participants: tables of processes."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from lockstep_world import WAITING, make_participant

from ballbot_ros.parameters import GYRO
from ballbot_ros.simulation.liveness import LivenessMonitor
from ballbot_ros.simulation.silence_timer import Observation, ThreadTime

JOINED = make_participant(GYRO)
STARTING = JOINED.process + 1


def waited_s(siblings, starved, host='here'):
    """Return the wait for participants after 10 s in which some processes got no processor."""
    now_s = 0.0

    def observe(processes):
        threads = {
            process: {1: ThreadTime(1.0, now_s, True)} if process in starved else WAITING
            for process in processes
        }
        return Observation(now_s, threads)

    monitor = LivenessMonitor(
        SimpleNamespace(members={GYRO: replace(JOINED, host=host)}),
        SimpleNamespace(observe=observe, siblings=lambda: siblings),
        JOINED.host,
    )
    monitor.begin()
    for look in range(101):
        now_s = 0.1 * look
        waited = monitor.waited_s(0.0)
    return waited


@pytest.mark.parametrize(
    ('siblings', 'starved', 'expected_s'),
    [
        ((JOINED.process, STARTING), (), 10.0),
        ((JOINED.process, STARTING), (JOINED.process,), 10.0),
        ((JOINED.process, STARTING), (STARTING,), 0.0),
        ((JOINED.process,), (JOINED.process,), 10.0),
        ((), (STARTING,), 10.0),
    ],
)
def test_only_a_node_that_is_still_starting_may_need_more_time(siblings, starved, expected_s):
    assert waited_s(siblings, starved) == pytest.approx(expected_s, abs=0.21)


def test_a_process_of_another_machine_may_have_the_number_of_one_of_this_machine():
    number = JOINED.process
    assert waited_s((number,), (number,), host='there') == pytest.approx(0.0, abs=0.21)
