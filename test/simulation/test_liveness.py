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


def silences_s(observations, since_s):
    """Return the silence of a gyro driver that does not answer, from a roll call on.

    Each of the observations is a time and the thread of the driver; the first is at the call.
    """
    looks = iter(observations)

    def observe(processes):
        now_s, thread = next(looks)
        return Observation(now_s, {JOINED.process: {1: thread}})

    roster = SimpleNamespace(
        members={GYRO: JOINED},
        calls=1,
        silences_s=lambda call, due_ns, silence_s: {GYRO: silence_s(JOINED)},
    )
    monitor = LivenessMonitor(roster, SimpleNamespace(observe=observe, siblings=tuple), JOINED.host)
    monitor.begin()
    monitor.call()
    for _ in observations[1:]:
        found = monitor.silences_s(since_s, 0, awaits_recorder=False)
    return found


def test_a_silence_counts_from_its_first_roll_call_on_and_without_the_wait_for_a_processor():
    waiting = WAITING[1]
    assert silences_s([(10.0, waiting), (10.05, waiting)], 0.0) == {GYRO: pytest.approx(0.05)}
    starved = replace(waiting, queued_s=0.04)
    assert silences_s([(10.0, waiting), (10.05, starved)], 0.0) == {GYRO: pytest.approx(0.01)}
