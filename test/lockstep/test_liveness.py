"""The time that a run waits for its participants: tables of processes."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from lockstep_world import WAITING, make_participant

from ballbot_ros.lockstep.liveness import LivenessMonitor, Observation, ThreadTime
from ballbot_ros.lockstep.participants import LocalNode
from ballbot_ros.parameters import CONTROLLER, DRIVERS, GYRO, RECORDER

JOINED = make_participant(GYRO)
ENCODER = 'encoder_driver'
MS = 1_000_000


def waited_s(awaited, starved):
    """Return the wait for processes after 10 s in which some got no processor."""
    now_s = 0.0

    def observe(processes):
        threads = {
            process: {1: ThreadTime(1.0, now_s, True)} if process in starved else WAITING
            for process in processes
        }
        return Observation(now_s, threads)

    monitor = LivenessMonitor(
        SimpleNamespace(awaited_nodes=lambda: [LocalNode(GYRO, each) for each in awaited]),
        SimpleNamespace(observe=observe),
        JOINED.host,
    )
    monitor.reset()
    for look in range(101):
        now_s = 0.1 * look
        waited = monitor.waited_s(0.0)
    return waited


@pytest.mark.parametrize(
    ('awaited', 'starved', 'expected_s'),
    [
        ((3, 4), (), 10.0),
        ((3, 4), (4,), 0.0),
        ((), (4,), 10.0),
    ],
)
def test_a_node_that_is_still_starting_may_need_more_time(awaited, starved, expected_s):
    assert waited_s(awaited, starved) == pytest.approx(expected_s, abs=0.21)


class Silence:
    """The silence of participants after a roll call; those in `silent` do not answer.

    Attributes
    ----------
    due_ns : dict of str to int
        The stamps that the roster was asked for [ns].
    """

    def __init__(self, members, silent, called_s=10.0):
        self.threads, self.now_s, self.silent = {}, called_s, silent
        for member in members.values():
            self.threads[member.process] = {1: WAITING[1]}
        self.answered_ns = 0
        roster = SimpleNamespace(
            members=members,
            calls=1,
            silences_s=self._silences_s,
            has_answered=lambda role, stamp_ns: self.answered_ns >= stamp_ns,
        )
        observer = SimpleNamespace(observe=self._observe)
        self.monitor = LivenessMonitor(roster, observer, JOINED.host)
        self.monitor.reset()
        self.monitor.call()

    def _observe(self, processes):
        living = {each: self.threads[each] for each in processes if each in self.threads}
        return Observation(self.now_s, living)

    def _silences_s(self, call, due_ns, silence_s, *, heeds_awaited):
        self.due_ns, self.heeds_awaited = due_ns, heeds_awaited
        return {role: silence_s(member) for role, member in self.silent.items()}

    def after(self, seconds, tick_ms=1000, *, awaits_recorder=False):
        self.now_s += seconds
        return self.monitor.silences_s(0.0, tick_ms * MS, awaits_recorder=awaits_recorder)


def test_a_silence_counts_from_its_first_roll_call_on_and_without_the_wait_for_a_processor():
    assert Silence({GYRO: JOINED}, {GYRO: JOINED}).after(0.05) == {GYRO: pytest.approx(0.05)}
    busy = Silence({GYRO: JOINED}, {GYRO: JOINED})
    busy.threads[JOINED.process] = {1: replace(WAITING[1], queued_s=0.04)}
    assert busy.after(0.05) == {GYRO: pytest.approx(0.01)}


def test_an_answer_ends_the_silence():
    silence = Silence({GYRO: JOINED}, {GYRO: JOINED})
    assert silence.after(0.1)
    silence.monitor.reset()
    assert silence.after(0.1) == {}


def test_only_drivers_with_a_sample_at_the_tick_owe_it():
    silence = Silence({}, {})
    for tick_ms, owing in ((1000, set(DRIVERS)), (1004, {GYRO, ENCODER})):
        silence.after(0.1, tick_ms)
        expected = {role: tick_ms * MS if role in owing else 0 for role in (*DRIVERS, CONTROLLER)}
        assert silence.due_ns == expected
        silence.after(0.1, tick_ms, awaits_recorder=True)
        assert silence.due_ns == {**expected, RECORDER: 0}


def test_if_all_answer_the_one_that_the_plant_waits_for_is_silent():
    silence = Silence({}, {})
    assert silence.after(0.1) == {CONTROLLER: pytest.approx(0.1)}
    assert silence.after(0.1, awaits_recorder=True) == {RECORDER: pytest.approx(0.2)}


def test_a_controller_that_has_answered_the_tick_awaits_the_samples_of_the_next():
    silence = Silence({}, {})
    for answered_ms, heeds in ((996, True), (1000, False)):
        silence.answered_ns = answered_ms * MS
        silence.after(0.1)
        assert silence.heeds_awaited is heeds
    silence.answered_ns = 0
    silence.after(0.1, awaits_recorder=True)
    assert not silence.heeds_awaited


@pytest.mark.parametrize('silent', [{}, {GYRO: JOINED}])
def test_a_tick_is_confirmed_when_nobody_is_silent(silent):
    silence = Silence({}, silent)
    assert silence.monitor.have_confirmed(1, 1004 * MS) is not bool(silent)
    owed = {role for role, due_ns in silence.due_ns.items() if due_ns == 1004 * MS}
    assert owed == {GYRO, ENCODER, CONTROLLER}


def test_a_dead_participant_is_named_before_those_that_may_wait_for_it():
    remote = replace(make_participant(ENCODER), host='there')
    controller = make_participant(CONTROLLER)
    members = {GYRO: JOINED, ENCODER: remote, CONTROLLER: controller}
    silence = Silence(members, members)
    assert set(silence.after(0.1)) == set(members)
    del silence.threads[JOINED.process]
    assert set(silence.after(0.1)) == {GYRO}
