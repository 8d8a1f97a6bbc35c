"""A run as an object: from its specification to its result, without the command."""

import dataclasses
import errno
import logging
import math
import signal
import threading
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from maps import open_floor, save

from ballbot_ros.analysis.assessment import assess
from ballbot_ros.analysis.metrics import Judgement, Verdict
from ballbot_ros.analysis.recorded_scenario import RecordedPush
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.engine.golden import load_golden
from ballbot_ros.engine.scenario.scenario import Expectation
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.errors import BallbotError, RecordingError
from ballbot_ros.lockstep.run_actions import Outcome, ParameterChange
from ballbot_ros.nodes.endpoints import intra_process
from ballbot_ros.parameters import NODES, PLANT, RECORDER
from ballbot_ros.recording.messages.topics import CLOCK
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.world.floor_map import read_map_file
from ballbot_ros.run import execution, offline, requirements
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.result import RoundTrip, RunResult
from ballbot_ros.run.spec import RunOptions, RunSpec


class Notes:
    """Stores the notices of a run."""

    def __init__(self):
        self.times, self.lines = [], []

    def update(self, elapsed_s):
        self.times.append(elapsed_s)

    def notice(self, text):
        self.lines.append(text)


def spec_of(name, *words, processes=Processes.NONE, **options):
    options = RunOptions(processes=processes, assignments=words, **options)
    return RunSpec.of_scenario(name, options)


@pytest.fixture(scope='module')
def stationary(tmp_path_factory):
    notes = Notes()
    spec = spec_of('stationary', output=tmp_path_factory.mktemp('run'))
    return spec, execute(spec, notes), notes


def test_a_run_returns_its_result_and_files(stationary):
    spec, result, notes = stationary
    assert result.passed
    assert (result.verdict, result.reason, result.exit_status) == (Verdict.PASSED, '', 0)
    assert result.duty_sha256 == load_golden().scenarios['stationary']
    assert result.ticks == len(result.trajectory.time) == 2500
    assert result.recording == spec.output / 'stationary.mcap'
    assert result.figure == spec.output / 'stationary.png'
    assert result.figure.read_bytes().startswith(b'\x89PNG')
    assert notes.lines == []
    assert notes.times == sorted(notes.times)
    assert notes.times[-1] == 10.0


def test_a_disk_that_fails_during_the_run_does_not_hide_the_result(tmp_path, monkeypatch):
    def fail(path):
        raise OSError(errno.EBADMSG, 'Bad message', str(path))

    def run_while_it_fails(*_, **options):
        for name in ('exists', 'iterdir'):
            monkeypatch.setattr(Path, name, fail)
        return RunResult(Outcome.FAILED)

    monkeypatch.setattr(execution, '_carry_out', run_while_it_fails)
    result = execute(spec_of('stationary', output=tmp_path / 'run'))
    assert (result.outcome, result.recording) == (Outcome.FAILED, None)


def test_a_floor_without_walls_has_no_clearance_in_run_and_recording(tmp_path):
    floor = save(open_floor(400, 400), tmp_path / 'floor.png')
    words = (f'plant_sim.map={floor}', 'plant_sim.hold_time=0', 'plant_sim.duration=0.1')
    result = execute(spec_of('stationary', *words, output=tmp_path / 'run'))
    for metrics in (result.metrics, assess(read_run(result.recording)).metrics):
        assert not math.isnan(metrics['peak_pitch_deg'])
        assert math.isnan(metrics['wall_clearance_m'])


def test_a_paced_run_lasts_as_long_as_its_pace_says(monkeypatch):
    now_s = 1000.0

    def sleep(delay_s):
        nonlocal now_s
        now_s += delay_s

    monkeypatch.setattr(offline, 'time', SimpleNamespace(monotonic=lambda: now_s, sleep=sleep))
    spec = spec_of('stationary', 'plant_sim.duration=1', record=False, real_time_factor=2.0)
    result = execute(spec)
    assert result.real_time_factor == pytest.approx(2.0, rel=0.01)
    assert result.late_ticks == 0


def test_a_specification_is_not_used_up(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    spec = spec_of('stationary', 'plant_sim.duration=1', record=False)
    first, second = execute(spec), execute(spec)
    assert first.duty_sha256 == second.duty_sha256
    assert first.recording is first.figure is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.graph
def test_a_graph_is_run_without_the_command(domain, monkeypatch, tmp_path):
    pytest.importorskip('rclpy')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    word, notes = 'plant_sim.duration=1', Notes()
    spec = spec_of('square', word, processes=Processes.SEPARATE, output=tmp_path)
    result = execute(spec, notes)
    assert (result.outcome, result.failure) == (Outcome.COMPLETED, '')
    assert result.duty_sha256 == execute(spec_of('square', word, record=False)).duty_sha256
    assert next(each['role'] for each in result.participants) == 'plant_sim'
    assert result.recording.exists()
    # A busy machine may hold up a tick.
    waits = [line for line in notes.lines if line.startswith('plant_sim: waiting for ')]
    assert notes.lines == waits


@pytest.mark.graph
def test_a_plant_that_refuses_the_domain_is_a_mistake_of_the_user(domain, monkeypatch):
    pytest.importorskip('rclpy')
    from ballbot_ros.run import one_process

    class Refusing(one_process.PlantSim):
        def stop(self):
            super().stop()
            self.exit_status = 2

    monkeypatch.setattr(one_process, 'PlantSim', Refusing)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    spec = spec_of('square', 'plant_sim.duration=0.1', processes=Processes.ONE, record=False)
    assert execute(spec).failure_status == 2


def test_a_wall_ends_the_run_as_failed(tmp_path):
    words = ('plant_sim.map=track', 'plant_sim.start_position_x=0.7')
    spec = spec_of('forward_backward', *words, output=tmp_path)
    notes = Notes()
    result = execute(spec, notes)
    assert (result.verdict, result.exit_status) == (Verdict.FAILED, 1)
    assert 'wall' in result.reason
    assert notes.lines == [result.reason]
    assert result.recording.exists()
    assert result.figure.exists()


def test_a_picture_that_can_not_be_written_fails_a_run_that_passed(tmp_path):
    (tmp_path / 'stationary.png').mkdir()
    result = execute(spec_of('stationary', output=tmp_path, record=False))
    assert (result.verdict, result.exit_status) == (Verdict.FAILED, 1)
    assert result.reason == f'{tmp_path}/stationary.png: Is a directory'
    assert result.figure is None
    assert not math.isnan(result.metrics['duty_rms_percent'])


def test_a_picture_that_is_written_in_part_is_removed(tmp_path, monkeypatch):
    def write(path, data):
        path.write_text(data.decode('latin-1')[:4])
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(Path, 'write_bytes', write)
    result = execute(spec_of('stationary', 'plant_sim.duration=1', output=tmp_path, record=False))
    assert result.figure_failure == f'{tmp_path}/stationary.png: No space left on device'
    assert not tmp_path.exists()


def test_a_fork_server_that_is_running_already_is_used(monkeypatch):
    pytest.importorskip('rclpy')
    from ballbot_ros.run import separate_processes

    used = []

    def run(client, *_, **options):
        used.append(client)
        return RunResult(Outcome.FAILED)

    monkeypatch.setattr(separate_processes, 'run_in_separate_processes', run)
    monkeypatch.setattr(execution, 'ForkClient', lambda: nullcontext('another one'))
    spec = spec_of('stationary', processes=Processes.SEPARATE, record=False)
    for client in ('given', None):
        execute(spec, client=client)
    assert used == ['given', 'another one']


@pytest.mark.graph
def test_a_graph_takes_the_times_of_its_tasks_from_the_recording(tmp_path, domain, monkeypatch):
    pytest.importorskip('rclpy')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    words = ('plant_sim.kernel=true', 'plant_sim.link=true', 'plant_sim.duration=1.5')
    graph, alone = (
        execute(spec_of('stationary', *words, processes=each, output=tmp_path / each.value)).metrics
        for each in (Processes.ONE, Processes.NONE)
    )
    assert graph == alone | {'wall_clearance_m': graph['wall_clearance_m']}
    assert graph['response_time_ms'] > 0.3


def test_a_middleware_that_does_not_load_is_reported_before_ros_starts(monkeypatch):
    def refuse():
        raise BallbotError('it does not load')

    monkeypatch.setattr(requirements, 'require_middleware', refuse)
    with pytest.raises(BallbotError, match='it does not load'):
        execute(spec_of('stationary', processes=Processes.ONE, record=False))


def test_notices_are_logged_unless_there_is_an_observer(caplog):
    spec = spec_of(
        'forward_backward', 'plant_sim.map=track', 'plant_sim.start_position_x=0.7', record=False
    )
    result = execute(spec)
    assert caplog.record_tuples == [('ballbot_ros.run', logging.WARNING, result.reason)]


def test_the_map_of_a_run_is_the_one_at_its_start(tmp_path):
    """The map's file may be removed or replaced before the metrics are computed."""
    path = tmp_path / 'floor.png'
    path.write_bytes(read_map_file('track'))

    class Remover(Notes):
        def update(self, elapsed_s):
            path.unlink(missing_ok=True)

    words = (f'plant_sim.map={path}', 'plant_sim.start_position_x=0.3')
    spec = spec_of('stationary', *words, output=tmp_path / 'run')
    result = execute(spec, Remover())
    assert not path.exists()
    assert (result.verdict, result.reason) == (Verdict.PASSED, '')
    assert 0.0 < result.metrics['wall_clearance_m'] < 1.0
    assert result.figure.exists()


def test_an_interrupted_run_leaves_its_recording_but_no_picture(tmp_path):
    class Interrupter(Notes):
        def update(self, elapsed_s):
            signal.raise_signal(signal.SIGTERM)

    result = execute(spec_of('stationary', output=tmp_path), Interrupter())
    assert (result.verdict, result.exit_status) == (Verdict.STOPPED, 128 + signal.SIGTERM)
    assert 0 < result.ticks < 5000
    assert [path.name for path in tmp_path.iterdir()] == ['stationary.mcap']


def test_a_wall_hit_is_reported_even_if_the_recording_fails(tmp_path, monkeypatch):
    def fail(writer):
        raise RecordingError(f'{writer.path}: full')

    monkeypatch.setattr(RecordingWriter, 'close', fail)
    words = ('plant_sim.map=track', 'plant_sim.start_position_x=0.7')
    notes = Notes()
    result = execute(spec_of('forward_backward', *words, output=tmp_path), notes)
    assert result.reason == f'{tmp_path}/forward_backward.mcap: full'
    hit, failure = notes.lines
    assert 'wall' in hit
    assert hit != failure
    assert failure == result.reason


MISSED = Judgement(Expectation('duty_rms_percent', maximum=1.0), 2.0)

STATUSES = [
    (RunResult(Outcome.COMPLETED), 'passed', '', 0),
    (RunResult(Outcome.COMPLETED, judgements=[MISSED]), Verdict.NOT_MET, str(MISSED), 1),
    (RunResult(Outcome.FAILED, 'fell'), 'failed', 'fell', 1),
    (RunResult(Outcome.FAILED, 'no map', 2), 'failed', 'no map', 2),
    (RunResult(Outcome.STOPPED, '', 130), 'stopped', '', 130),
    (RunResult(Outcome.STOPPED, '', 0), 'stopped', '', 0),
]
CHANGE = ParameterChange(2.004, 'controller', 'k_i', -0.02)
CHANGED = 'controller.k_i was set to -0.02 at 2.004 s (tick 501)'


@pytest.mark.parametrize(('result', 'verdict', 'reason', 'status'), STATUSES)
def test_verdict_reason_and_status_agree(result, verdict, reason, status):
    assert (result.verdict, result.reason, result.exit_status) == (verdict, reason, status)
    full = dataclasses.replace(result, figure_failure='x.png: full')
    assert full.reason == '; '.join(filter(None, (reason, 'x.png: full')))
    assert full.exit_status == (status or 1)
    assert full.verdict == ('failed' if verdict == 'passed' else verdict)
    changed = dataclasses.replace(result, parameter_changes=(CHANGE,))
    assert changed.reason == '; '.join(filter(None, (reason, CHANGED)))
    assert changed.exit_status == (status or int(result.is_complete))
    assert changed.verdict == ('changed' if verdict == 'passed' else verdict)


SUMMARY = {
    'outcome': 'failed', 'reason': 'fell', 'ticks': 3, 'duty_sha256': 'ab',
    'real_time_factor': 0.5, 'late_ticks': 2, 'resends': 1,
    'round_trip_ms': {'p50': 0.1, 'p99': 0.2, 'max': 0.3}, 'participants': [{'role': 'plant_sim'}],
    'external_pushes': [
        {'start_s': 1.0, 'end_s': 1.1, 'force_n': [0.0, 2.0], 'torque_n_m': [0.0, 0.0]}
    ],
    'parameter_changes': [CHANGE.as_json()],
}  # fmt: skip


def test_a_summary_in_json_gives_the_whole_result():
    trajectory = TrajectoryLog().trajectory()
    result = RunResult(
        Outcome.FAILED, 'fell', 1, 3, 'ab', 0.5, 2, 1, RoundTrip(0.1, 0.2, 0.3),
        [{'role': 'plant_sim'}], trajectory,
        external_pushes=(RecordedPush(1.0, 1.1, (0.0, 2.0), (0.0, 0.0), is_external=True),),
        parameter_changes=(CHANGE,),
    )  # fmt: skip
    assert RunResult.from_summary(SUMMARY, trajectory) == result
    assert RunResult.from_summary(SUMMARY | {'round_trip_ms': None}, trajectory).round_trip is None


class OneProcess:
    """Replaces ROS for a run in one process, whose nodes end when they are spun."""

    def __init__(self, monkeypatch, *, outcome, failure='', exit_status=0, stop=lambda: None):
        from ballbot_ros.run import one_process

        self.events, self._stop = [], stop
        self.plant = self.node(
            PLANT,
            done='done',
            exit_status=exit_status,
            master=SimpleNamespace(log=SimpleNamespace(ticks=2, trajectory=lambda: None)),
            summary=SUMMARY | {'outcome': outcome},
            stop=lambda: self.events.append('stop'),
            create_wall_timer=lambda period_s, report: setattr(self, 'report', report),
        )
        for name, stub in (
            ('ros', nullcontext),
            ('PlantSim', lambda parameters: self.plant),
            ('Recorder', lambda parameters: self.node(RECORDER, failure=failure)),
            ('make_node', lambda parameters: self.node(parameters.node)),
            ('ControllerNode', lambda parameters, _: self.node(parameters.node)),
            ('spin', self.spin),
        ):
            monkeypatch.setattr(one_process, name, stub)
        self.run = one_process.run_in_one_process

    def node(self, name, **attributes):
        return SimpleNamespace(
            name=name,
            role=name,
            close=lambda: self.events.append(f'close {name}'),
            destroy_node=lambda: self.events.append(f'destroy {name}'),
            **{'failure': '', 'logs_failure': True} | attributes,
        )

    def spin(self, nodes, done, stop, within):
        assert done == 'done'
        assert intra_process(CLOCK) is within
        self.events.append([node.name for node in nodes])
        self.report()
        self._stop()


@pytest.mark.parametrize('record', [True, False])
def test_a_run_in_one_process_spins_its_nodes_and_closes_them(monkeypatch, tmp_path, record):
    pytest.importorskip('rclpy')
    graph, notes = OneProcess(monkeypatch, outcome='completed'), Notes()
    recording = tmp_path / 'run.mcap' if record else None
    graph.run(spec_of('stationary', record=record), recording, tmp_path, notes)
    nodes = [name for name in NODES if name != RECORDER] + [RECORDER] * record
    ends = [f'{end} {name}' for name in nodes for end in ('close', 'destroy')]
    assert graph.events == [nodes, 'stop', *ends]
    assert notes.times == [0.008]


def test_the_result_of_a_run_in_one_process_is_that_of_plant_recorder_and_signal(
    monkeypatch, tmp_path
):
    pytest.importorskip('rclpy')
    for outcome, failure, exit_status, signalled, expected in (
        ('completed', '', 0, False, ('completed', 'fell', 1)),
        ('completed', 'full', 0, False, ('failed', 'recorder: full', 1)),
        ('failed', 'full', 1, False, ('failed', 'fell', 1)),
        ('failed', '', 2, False, ('failed', 'fell', 2)),
        ('stopped', '', 0, True, ('stopped', 'fell', 128 + signal.SIGTERM)),
    ):
        graph = OneProcess(
            monkeypatch, outcome=outcome, failure=failure, exit_status=exit_status,
            stop=(lambda: signal.raise_signal(signal.SIGTERM)) if signalled else lambda: None,
        )  # fmt: skip
        result = graph.run(spec_of('stationary'), tmp_path / 'run.mcap', tmp_path, Notes())
        found = result.outcome, result.failure, result.failure_status
        assert found == expected, (outcome, failure, exit_status)


def test_a_run_needs_no_main_thread():
    """Only the main thread gets signals; a run in another thread is stopped by other means."""
    spec = spec_of('stationary', 'plant_sim.duration=0.5', record=False)
    results = []
    thread = threading.Thread(target=lambda: results.append(execute(spec)))
    thread.start()
    thread.join()
    assert results[0].duty_sha256 == execute(spec).duty_sha256
