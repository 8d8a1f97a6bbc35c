"""The recorder's part in the runs, without files and without ROS."""

import pytest

from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.recording_order import Stream
from ballbot_ros.lockstep.run_recording import RunRecording, RunStatus
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_NS


class File:
    """What a recording keeps."""

    def __init__(self):
        self.clock = Stream('/clock', period_ns=TICK_NS, is_clock=True, is_live=True, is_same=same)
        self.duty = Stream('/motor_duty', period_ns=TICK_NS, is_same=same)
        self.kept = []
        self.gyro = Stream('/gyro', period_ns=TICK_NS, is_same=same)
        streams = (('/clock', self.clock), ('motor_duty', self.duty), ('gyro', self.gyro))
        self.recording = RunRecording(self, lambda: streams)

    def keep(self, stream, log_ns, data, sequence):
        self.kept.append((stream.name, log_ns, data, sequence))

    def has_several_publishers(self, stream):
        return False


def same(one, other):
    return one == other


def status(run, **result):
    topics = ('/clock', 'motor_duty', 'gyro')
    return RunStatus(run, True, topics, {'controller': 'it'}, result)


@pytest.mark.parametrize('comes_first', [False, True])
@pytest.mark.parametrize(('run', 'is_noted'), [('1 abc', False), ('2 abc', True), ('2 x', False)])
def test_only_the_status_of_the_current_run_counts(run, is_noted, comes_first):
    recording = File().recording
    if comes_first:
        recording.note_status(status(run, outcome='failed'))
    recording.join(RunIdentity('2 abc', FIRST_TICK_NS))
    if not comes_first:
        recording.note_status(status(run, outcome='failed'))
    assert recording.outcome == ({'outcome': 'failed'} if is_noted else {})
    assert recording.members == ({'controller': 'it'} if is_noted else {})


def test_a_run_is_announced_once_and_begins_the_first_recording():
    recording = File().recording
    first, second = RunIdentity('1 abc', FIRST_TICK_NS), RunIdentity('2 abc', 2 * FIRST_TICK_NS)
    assert [recording.announces(run) for run in (first, first, second)] == [True, False, True]
    assert recording.run == '1 abc'
    assert not recording.gate.takes_part
    recording.join(second)
    assert recording.run == '2 abc'
    assert recording.gate.takes_part


@pytest.mark.parametrize('outcome', ['completed', 'failed', None])
def test_the_first_motor_stop_is_recorded_unless_the_run_completes(outcome):
    file = File()
    file.recording.join(RunIdentity('1 abc', FIRST_TICK_NS))
    for stamp_ns in (5, 9):
        file.recording.hold_stop(file.duty, stamp_ns, b'stop', stamp_ns)
    if outcome:
        file.recording.note_status(status('1 abc', outcome=outcome))
    file.recording.write_stop()
    assert file.kept == ([] if outcome == 'completed' else [('/motor_duty', 5, b'stop', 5)])


def test_a_run_is_under_way_from_its_first_tick_to_its_end():
    file = File()
    recording = file.recording
    recording.join(RunIdentity('1 abc', FIRST_TICK_NS))
    assert not recording.is_under_way
    recording.gate.take(file.clock, FIRST_TICK_NS, b'', 1)
    assert recording.is_under_way
    recording.note_status(status('1 abc', outcome='completed'))
    assert not recording.is_under_way


def test_a_stopped_run_is_under_way_until_the_samples_of_its_last_duty_are_there():
    file = File()
    recording = file.recording
    recording.join(RunIdentity('1 abc', FIRST_TICK_NS))
    recording.note_status(status('1 abc', outcome='stopped'))
    for stream in (file.clock, file.duty):
        recording.gate.take(stream, FIRST_TICK_NS, b'', 1)
    recording.gate.take(file.clock, FIRST_TICK_NS + TICK_NS, b'', 2)  # without a duty
    assert recording.is_under_way
    recording.hold_stop(file.duty, FIRST_TICK_NS + TICK_NS, b'', 2)
    assert recording.is_under_way
    recording.gate.take(file.gyro, FIRST_TICK_NS, b'', 1)
    recording.ticks.advance()
    assert not recording.is_under_way


def test_a_run_without_lockstep_is_under_way_until_its_stop():
    file = File()
    recording = file.recording
    recording.join(RunIdentity('1 abc', FIRST_TICK_NS))
    recording.note_status(RunStatus('1 abc', False, (), {}))
    for stream in (file.clock, file.duty):
        recording.gate.take(stream, FIRST_TICK_NS, b'', 1)
    assert recording.is_under_way
    recording.hold_stop(file.duty, FIRST_TICK_NS, b'', 2)
    assert not recording.is_under_way
