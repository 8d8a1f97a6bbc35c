"""Sample of the simulated campaign, and proof that its judgement notices what is broken."""

import os
import subprocess
import sys
from pathlib import Path

import protocol_trials
import protocol_world
import pytest
from protocol_trials import FAULTS, Trial, Violation

from ballbot_ros.lockstep.liveness import LivenessMonitor
from ballbot_ros.lockstep.lockstep import GivenAnswers
from ballbot_ros.lockstep.lockstep_master import LockstepMaster
from ballbot_ros.lockstep.recording_order import RecorderFlow, RecordingGate, Stream
from ballbot_ros.lockstep.roster import Roster
from ballbot_ros.lockstep.run_participants import RunParticipants
from ballbot_ros.parameters.timing import TICK_NS

SEED = 1
PROJECT = Path(__file__).parents[2]


def first_violation(numbers, **details):
    for number in numbers:
        try:
            Trial(SEED, number, **details).run()
        except Violation as violation:
            return str(violation)
    return ''


def test_no_fault_breaks_what_must_hold():
    """The trials have every kind of fault, and both outcomes."""
    kinds, outcomes = set(), set()
    for number in range(100):
        trial = Trial(SEED, number)
        try:
            trial.run()
        except Violation as violation:
            pytest.fail(f'trial {number}, {[each.what for each in trial.faults]}: {violation}')
        kinds.update(fault.kind for fault in trial.faults)
        outcomes.add(str(trial.summary.outcome))
    assert kinds == set(FAULTS)
    assert outcomes == {'completed', 'failed'}


def test_a_controller_that_leaves_before_the_recorder_knows_it_is_named():
    """It had answered a roll call of an earlier silence."""
    assert Trial(41, 27484).run().summary.reason.startswith('controller silent for 3 s')


def test_a_controller_that_starved_nodes_keep_waiting_must_answer_the_last_tick_itself():
    """A stranger had answered it, and had left."""
    reason = Trial(43, 2170).run().summary.reason
    assert reason.startswith("'motor_duty' has a second duty stamped 1.024 s")


def test_the_silence_of_the_controller_begins_when_the_recorder_has_caught_up():
    """Until then, only the ticks that the recorder lacks are sent again."""
    assert Trial(43, 44675).run().summary.outcome == 'completed'


def test_a_controller_restarted_after_the_last_tick_is_named_even_if_the_recorder_lacks_it():
    """The killed one's last messages were lost, and its successor cannot repeat them."""
    assert 'restarted at 0.052 s of the run' in Trial(44, 9350).run().summary.reason


def test_a_trial_has_the_same_events_in_every_process():
    script = (
        'from protocol_trials import Trial\n'
        f'print(*(Trial({SEED}, number).run().world.log_sha256 for number in range(5)))\n'
    )
    path = os.pathsep.join((str(PROJECT), str(PROJECT / 'test')))
    found = {
        subprocess.run(
            [sys.executable, '-c', script],
            env={**os.environ, 'PYTHONPATH': path, 'PYTHONHASHSEED': seed},
            capture_output=True,
            check=True,
            text=True,
        ).stdout
        for seed in ('1', '2')
    }
    assert len(found) == 1
    assert len(set(found.pop().split())) == 5


# Mutations: each breaks what a guarantee depends on.


def deliver_a_stale_message_as_a_new_one(patch):
    read = protocol_world.DriverNode._on_truth

    def on_truth(node, data):
        source = node._source
        measured = source.measured(data, 0)
        stale = getattr(node, 'measured', measured)
        node.measured = measured
        node._source = source._replace(measured=lambda data, stamp_ns: stale)
        read(node, data)
        node._source = source

    patch.setattr(protocol_world.DriverNode, '_on_truth', on_truth)


def take_any_duty_for_that_of_the_tick(patch):
    take = LockstepMaster._take_duty

    def take_duty(master, stamp_ns, duty, data, *, is_stop):
        take(master, master.time_ns, duty, data, is_stop=is_stop)

    patch.setattr(LockstepMaster, '_take_duty', take_duty)


def let_the_roster_ignore_second_nodes(patch):
    def resolve(roster):
        roster._run.contests.clear()
        return ''

    patch.setattr(Roster, '_resolve_contests', resolve)
    patch.setattr(Roster, '_judge_objections', lambda roster: '')


def let_restarted_controllers_pass(patch):
    patch.setattr(RunParticipants, 'restarted_controller', lambda participants: '')


def lose_a_sample_on_its_way_to_the_recorder(patch):
    take = RecordingGate.take

    def take_most(gate, stream, stamp_ns, data, sequence):
        if stream.name != 'gyro' or stamp_ns % (7 * TICK_NS):
            take(gate, stream, stamp_ns, data, sequence)

    patch.setattr(RecordingGate, 'take', take_most)
    patch.setattr(RecordingGate, '_is_missed_before', lambda gate, message: False)


def acknowledge_too_early(patch):
    patch.setattr(Stream, 'complete_ns', property(lambda stream: stream.newest_ns + 5 * TICK_NS))


def run_ahead_of_the_recorder(patch):
    patch.setattr(RecorderFlow, 'lags', lambda flow, now_ns: False)
    patch.setattr(RecorderFlow, 'has_all', lambda flow, last_ns: True)


def record_what_the_controller_did_not_receive(patch):
    keep = protocol_world.RecorderNode.keep

    def keep_flipped(node, stream, log_ns, data, sequence):
        if stream.name == 'gyro' and log_ns % (5 * TICK_NS) == 0:
            data = protocol_world.DRIVER_NODES['gyro_driver'].encoder(None)(log_ns, (1, 2))
        keep(node, stream, log_ns, data, sequence)

    patch.setattr(protocol_world.RecorderNode, 'keep', keep_flipped)


def wait_for_silent_nodes_for_ever(patch):
    patch.setattr(LivenessMonitor, 'silences_s', lambda *_, **__: {})
    patch.setattr(LivenessMonitor, 'waited_s', lambda *_: 0.0)


def blame_somebody_else(patch):
    patch.setattr(LivenessMonitor, 'silences_s', lambda *_, **__: {'sonar_driver': 99.0})


def answer_a_repeated_request_anew(patch):
    patch.setattr(GivenAnswers, 'at', lambda answers, stamp_ns, select: select())


KILLS, SECOND, STICKS = 'nodes killed or ended', 'a second node in a role', 'sticks moved by hand'
MUTATIONS = (
    (deliver_a_stale_message_as_a_new_one, (), 0, 'instead of'),
    (take_any_duty_for_that_of_the_tick, (), 0, ''),
    (let_the_roster_ignore_second_nodes, (SECOND,), 27, ''),
    (let_restarted_controllers_pass, (KILLS,), 96, 'other duties'),
    (lose_a_sample_on_its_way_to_the_recorder, (), 0, 'gyro'),
    (acknowledge_too_early, (), 0, 'acknowledged'),
    (run_ahead_of_the_recorder, (KILLS,), 36, 'lacks'),
    (record_what_the_controller_did_not_receive, (), 0, 'is not what the controller received'),
    (wait_for_silent_nodes_for_ever, (KILLS,), 0, 'waits for ever'),
    (blame_somebody_else, (KILLS,), 0, 'names'),
    (answer_a_repeated_request_anew, (STICKS, 'slow discovery'), 0, ''),
)
"""What is broken, the kinds of faults, the first trial, which saves time, and what is noticed."""


@pytest.mark.parametrize(
    ('mutation', 'kinds', 'first', 'expected'),
    [pytest.param(*each, id=each[0].__name__) for each in MUTATIONS],
)
def test_the_judgement_notices(mutation, kinds, first, expected, monkeypatch):
    mutation(monkeypatch)
    # Nearly twice as long as the longest of these trials without a mutation.
    monkeypatch.setattr(protocol_trials, 'LIMIT_S', 40.0)
    violation = first_violation(range(first, first + 400), kinds=kinds)
    assert violation
    assert expected in violation
