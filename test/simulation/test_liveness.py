"""The time that a run waits for its participants: tables of processes."""

from types import SimpleNamespace

import pytest
from lockstep_world import WAITING, make_participant

from ballbot_ros.parameters import GYRO
from ballbot_ros.simulation.liveness import LivenessMonitor
from ballbot_ros.simulation.silence_timer import Observation, ThreadTime

JOINED = make_participant(GYRO)
STARTING = JOINED.process + 1


@pytest.mark.parametrize(
    ('siblings', 'starved', 'waited_s'),
    [
        ((JOINED.process, STARTING), (), 10.0),
        ((JOINED.process, STARTING), (JOINED.process,), 10.0),
        ((JOINED.process, STARTING), (STARTING,), 0.0),
        ((JOINED.process,), (JOINED.process,), 10.0),
        ((), (STARTING,), 10.0),
    ],
)
def test_only_a_node_that_is_still_starting_may_need_more_time(siblings, starved, waited_s):
    now_s = 0.0

    def observe(processes):
        threads = {
            process: {1: ThreadTime(1.0, now_s, True)} if process in starved else WAITING
            for process in processes
        }
        return Observation(now_s, threads)

    monitor = LivenessMonitor(
        SimpleNamespace(members={GYRO: JOINED}),
        SimpleNamespace(observe=observe, siblings=lambda: siblings),
        JOINED.host,
    )
    monitor.begin()
    for look in range(101):
        now_s = 0.1 * look
        waited = monitor.waited_s(0.0)
    assert waited == pytest.approx(waited_s, abs=0.21)
