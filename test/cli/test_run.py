"""`ballbot run` as a user types it: outcome, files, errors, signals."""

import itertools
import json
import math
import os
import resource
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from graph import BALLBOT, NODES, alive, await_recording, call, wait_for
from matplotlib.image import imread

from ballbot_ros.cli.result import print_table
from ballbot_ros.engine.golden import duty_sha256
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.nodes.middleware import DomainLock
from ballbot_ros.parameters import GYRO, PLANT, ParameterSet, PlantParameters, ViewerParameters
from ballbot_ros.parameters.files import assign
from ballbot_ros.process import STOP_SIGNALS
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunOptions, RunSpec
from campaign.site import descendants


def test_a_run_leaves_a_recording_a_picture_and_a_verdict(tmp_path):
    run = call('run', 'stationary', '--json', '--processes=none', '--output', tmp_path)
    assert run.returncode == 0
    result = json.loads(run.stdout)
    assert result['outcome'] == 'passed'
    assert result['ticks'] == 2500
    assert len(result['duty_sha256']) == 64
    assert all(each['holds'] for each in result['expectations'])
    assert {'settling_time_s', 'peak_pitch_deg', 'position_rms_m'} <= set(result['metrics'])
    picture = imread(result['figure'])
    assert picture.shape[0] >= 600
    assert np.unique(picture[..., :3].reshape(-1, 3), axis=0).shape[0] > 10


def test_the_table_names_metrics_verdict_and_files(tmp_path):
    run = call('run', 'stationary', '--processes=none', '--output', tmp_path)
    assert run.returncode == 0
    for words in (
        'settling time',
        'peak pitch',
        'distance from start rms',
        'duty rms',
        'real-time factor',
        'late ticks',
        'passed',
        'stationary.mcap',
        'stationary.png',
    ):
        assert words in run.stdout
    assert run.stderr == ''


def test_a_missed_expectation_is_exit_status_1(tmp_path):
    scenario = tmp_path / 'strict.yaml'
    scenario.write_text(
        'purpose: cannot be met\nduration: 2\nexpectations:\n  peak_pitch_deg: {min: 50}\n'
    )
    run = call('run', scenario, '--processes=none', '--no-record', '--json')
    assert run.returncode == 1
    result = json.loads(run.stdout)
    assert result['outcome'] == 'expectations not met'
    assert 'peak_pitch_deg' in result['reason']


def test_a_fallen_robot_misses_every_expectation():
    run = call('run', 'stationary', '--processes=none', '--no-record', '--json',
               '--set=plant_sim.start_pitch_x=0.5')  # fmt: skip
    assert run.returncode == 1
    assert json.loads(run.stdout)['metrics']['settling_time_s'] is None


def _full_folder(tmp_path):
    (tmp_path / 'stationary.mcap').write_text('an older recording')
    return ['--output', tmp_path, '--processes=none']


MISTAKES = {
    'not an assignment': (lambda tmp_path: ['stationary', '--set=gravity'], 'node.param=value'),
    'unknown option': (lambda tmp_path: ['stationary', '--nosuch'], '--nosuch'),
    'unknown way': (lambda tmp_path: ['stationary', '--processes=two'], 'separate'),
    'negative factor': (lambda tmp_path: ['stationary', '--real-time-factor=-1'], '-1'),
    'start off the map': (
        lambda tmp_path: [
            'stationary',
            '--set=plant_sim.map=track',
            '--set=plant_sim.start_position_y=3',
            '--output=/dev/null/no',
        ],
        'x 0 m, y -3 m (map) is off the map, which spans x ±1 m, y ±1 m',
    ),
    'existing recording': (lambda tmp_path: ['stationary', *_full_folder(tmp_path)], 'exists'),
    'folder is a file': (lambda tmp_path: ['stationary', '--output', '/dev/null'], '/dev/null'),
}


def test_a_mistake_is_one_line_and_exit_status_2(command, tmp_path):
    for mistake, (arguments, hint) in MISTAKES.items():
        status, output, errors = command('run', *arguments(tmp_path))
        assert (status, output) == (2, ''), mistake
        assert len(errors.splitlines()) == 1, (mistake, errors)
        assert hint in errors, mistake


def test_a_mistake_is_the_exit_status_of_the_process(start_run):
    run = start_run('nosuch')
    assert run.finish() == 2
    assert len(run.stderr.splitlines()) == 1, run.stderr
    assert run.stdout == ''


@pytest.mark.graph
def test_a_run_that_does_not_begin_leaves_no_folder(start_run, domain, tmp_path):
    lock = DomainLock(domain)
    run = start_run('stationary', cwd=tmp_path)
    assert run.finish() == 2
    lock.release()
    assert 'another plant' in run.stderr
    assert list((tmp_path / 'runs').iterdir()) == []


def test_without_rclpy_the_error_names_an_alternative(start_run, tmp_path, monkeypatch):
    (tmp_path / 'rclpy.py').write_text('raise ImportError("no rclpy here")')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    run = start_run('stationary')
    assert run.finish() == 2
    assert '--processes none' in run.stderr
    assert len(run.stderr.splitlines()) == 1
    run = start_run('stationary', '--no-record', '--processes=none')
    assert run.finish() == 0
    drive = subprocess.run([*BALLBOT, 'drive'], capture_output=True, text=True, check=False)
    assert drive.returncode == 2
    assert drive.stderr.startswith('error: ROS 2 not found (no rclpy here): ')


@pytest.mark.graph
# Each signal with each arrangement: scripts/campaign.
@pytest.mark.parametrize(
    ('processes', 'factor', 'number'),
    [
        ('separate', 1, signal.SIGINT),
        ('one', 0, signal.SIGTERM),
        ('none', 1, signal.SIGHUP),
    ],
)
def test_a_signal_stops_everything(start_run, tmp_path, processes, factor, number):
    recording = tmp_path / 'stationary.mcap'
    run = start_run('stationary', '--json', '--processes', processes, '--output', tmp_path,
                    '--set=plant_sim.duration=600', f'--real-time-factor={factor}')  # fmt: skip
    pids = run.nodes() if processes == 'separate' else {}
    await_recording(recording, run=run)
    run.process.send_signal(number)
    assert run.finish() == 128 + number
    assert not any(alive(pid) for pid in pids.values())
    assert run.result['outcome'] == 'stopped'
    assert {each['holds'] for each in run.result['expectations']} == {None}
    assert 'Traceback' not in run.stderr
    with RecordingReader(recording) as reader:
        assert reader.complete
        assert reader.topics()['/motor_duty'].message_count > 10


@pytest.mark.graph
def test_a_second_run_in_the_domain_is_refused_at_once(start_run, tmp_path):
    first = start_run('stationary', '--json', '--output', tmp_path, '--set=plant_sim.timeout=3600',
                      '--set=plant_sim.duration=6')  # fmt: skip
    pid = first.nodes()[GYRO]
    wait_for((tmp_path / 'stationary.mcap').exists, what='recording')
    os.kill(pid, signal.SIGSTOP)  # keeps the first run from ending before the others begin
    attempts = {
        processes: start_run('stationary', '--no-record', '--processes', processes)
        for processes in ('separate', 'one')
    }
    for processes, second in attempts.items():
        assert second.finish() == 2, processes
        assert 'another plant' in second.stderr, processes
        assert len(second.stderr.splitlines()) == 1, (processes, second.stderr)
    os.kill(pid, signal.SIGCONT)
    assert first.finish() == 0, first.stderr
    assert first.result['duty_sha256'] == _undisturbed_sha256()


def _undisturbed_sha256():
    scenario = load_scenario('stationary')
    scenario.parameters.set(PLANT, 'duration', 6.0)
    return duty_sha256(scenario)


def fork_server(run):
    def look():
        return [each for each in descendants(run.process.pid) if name_of(each) == 'fork_server']

    return wait_for(look, what='the fork server')[0]


def name_of(process):
    with suppress(OSError):
        return Path(f'/proc/{process}/comm').read_text().strip()


@pytest.mark.graph
@pytest.mark.parametrize(
    ('moment', 'number'),
    [
        ('before the first fork', None),
        ('before the first fork', signal.SIGHUP),
        ('in mid-run', None),
        ('in mid-run', signal.SIGTERM),
    ],
)
def test_a_run_ends_in_spite_of_a_stopped_fork_server(start_run, tmp_path, moment, number):
    run = start_run('stationary', '--json', '--output', tmp_path, '--real-time-factor=1',
                    '--set=plant_sim.duration=600')  # fmt: skip
    server = fork_server(run)
    nodes = {}
    if moment == 'in mid-run':
        nodes = run.nodes()
        await_recording(tmp_path / 'stationary.mcap', run=run)
    os.kill(server, signal.SIGSTOP)
    if number:
        run.process.send_signal(number)
    status = run.finish()
    if number:
        assert status == 128 + number
    else:
        assert status in (1, 2)
        assert f'fork_server (process {server}) is stopped' in run.stdout + run.stderr
    # They have been killed, but a process needs the processor to end.
    left = [server, *nodes.values()]
    wait_for(lambda: not any(map(alive, left)), what='the end of all processes')


@pytest.mark.graph
def test_further_signals_do_not_kill_a_command(start_run, tmp_path):
    run = start_run('stationary', '--output', tmp_path, '--set=plant_sim.duration=600')
    pids = run.nodes()
    await_recording(tmp_path / 'stationary.mcap', run=run)
    signals = itertools.cycle([signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
    while run.process.poll() is None:
        run.process.send_signal(next(signals))
        time.sleep(0.005)
    assert run.finish() in {128 + number for number in STOP_SIGNALS}
    assert 'Traceback' not in run.stderr
    assert not any(map(alive, pids.values()))


@pytest.mark.graph
def test_nodes_end_with_the_run_that_started_them(start_run, tmp_path):
    run = start_run('stationary', '--output', tmp_path, '--set=plant_sim.duration=600')
    pids = run.nodes()
    recording = tmp_path / 'stationary.mcap'
    wait_for(lambda: recording.exists() and recording.stat().st_size > 20_000, what='the recording')
    run.process.kill()
    wait_for(lambda: not any(alive(pid) for pid in pids.values()), what='the end of all nodes')
    assert set(pids) == set(NODES)
    with RecordingReader(recording) as reader:
        *_, (_, _, last) = reader.messages(['/motor_duty'])
        assert reader.damage is None
    assert last.header.frame_id == 'stop'


@pytest.mark.graph
# With one process it is the same recorder as in a separate one.
@pytest.mark.parametrize('processes', ['separate', 'none'])
def test_a_full_disk_is_one_line_and_a_failed_run(start_run, tmp_path, processes):
    recording = tmp_path / 'stationary.mcap'
    run = start_run('stationary', '--json', '--processes', processes, '--output', tmp_path,
                    '--set=plant_sim.duration=600', '--real-time-factor=1')  # fmt: skip
    pid = run.nodes()['recorder'] if processes == 'separate' else run.process.pid
    await_recording(recording, run=run)
    # Limit the size of files of this process, as if the disk were full.
    full = recording.stat().st_size + 10_000
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (full, full))
    assert run.finish() == 1
    assert 'File too large' in run.stderr
    assert 'Traceback' not in run.stderr
    assert run.result['outcome'] == 'failed'
    # The recording comes first, even if the picture does not fit, either.
    teller = '' if processes == 'none' else 'recorder: '
    assert run.result['reason'].startswith(f'{teller}{recording}: File too large')
    with RecordingReader(tmp_path / 'stationary.mcap') as reader:
        assert sum(1 for _ in reader.messages(['/plant/imu'])) > 10


@pytest.mark.parametrize(('text', 'told'), [('::', '::'), ('', ''), ('on', 'on')])
def test_an_assignment_of_text_is_text_of_every_node(text, told):
    parameters = ParameterSet()
    assign(parameters, f'viewer.host={text}')
    assert parameters.of(ViewerParameters).host == told


def test_a_number_is_assigned_as_it_is_written():
    parameters = ParameterSet()
    assign(parameters, 'plant_sim.duration=2e0')
    assert parameters.of(PlantParameters).duration == 2.0


def test_the_table_has_only_values_that_mean_something(capsys):
    def printed(scenario, outcome, **metrics):
        spec = RunSpec.of_scenario(scenario, RunOptions(processes=Processes.NONE))
        print_table(spec, RunResult(outcome, metrics=metrics))
        return capsys.readouterr().out

    for scenario, is_shown in (
        ('stationary', True), ('forward_backward', False), ('autonomous', False),
    ):  # fmt: skip
        values = {'settling_time_s': 16.4, 'peak_pitch_deg': 1.0, 'lost_jobs': math.nan}
        text = printed(scenario, Outcome.COMPLETED, **values)
        assert 'lost' not in text
        assert ('settling time' in text) == is_shown, scenario
        assert 'peak pitch' in text
    text = printed('stationary', Outcome.FAILED, settling_time_s=math.nan, peak_pitch_deg=math.nan)
    assert 'settling time' not in text
    assert 'ticks' in text
    assert 'lost jobs' in printed('stationary', Outcome.COMPLETED, lost_jobs=0.0)
