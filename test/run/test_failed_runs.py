"""Runs whose recording or folder can't be written: the verdict gives the reason, once."""

import json
import subprocess
import tempfile

import pytest
from graph import BALLBOT, environment

from ballbot_ros.analysis.metrics import Verdict
from ballbot_ros.cli.result import execute_and_print
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.errors import BallbotError, RecordingError
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.run import execution, spec
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunOptions, RunSpec

FULL = 'No space left on device'


def options(output, processes, *assignments):
    return RunOptions(processes=Processes(processes), output=output, assignments=assignments)


def stationary(*arguments):
    return execute(RunSpec.of_scenario('stationary', options(*arguments)))


def test_a_recorder_that_fails_at_the_start_is_the_only_reason(tmp_path, monkeypatch, capsys):
    reason = f'recorder: [/red]/stationary.mcap: {FULL}'
    failed = RunResult(Outcome.FAILED, reason, 2, trajectory=TrajectoryLog().trajectory())
    monkeypatch.setattr(execution, '_carry_out', lambda *_, **__: failed)
    run = RunSpec.of_scenario('stationary', options(tmp_path / 'output', 'separate'))
    assert execute_and_print(run, as_json=True).exit_status == 2
    result = json.loads(capsys.readouterr().out)
    assert result['reason'] == reason
    assert result['figure'] is None
    assert list(tmp_path.iterdir()) == []
    run = RunSpec.of_scenario('stationary', options(tmp_path, 'separate'))
    assert execute_and_print(run, as_json=False).exit_status == 2
    assert f'failed: {reason}' in capsys.readouterr().out.splitlines()


def test_a_path_that_can_not_be_passed_to_the_nodes_is_refused_for_a_recording(tmp_path):
    pytest.importorskip('rclpy')
    with pytest.raises(BallbotError, match=r"^recorder\.output: '.*\\udcff/.*' is not UTF-8$"):
        stationary(tmp_path / 'a\udcff', 'one')
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('words', [(), ('controller.implementation=c',)], ids=len)
def test_without_a_folder_for_temporary_files_there_is_no_run(tmp_path, monkeypatch, words):
    pytest.importorskip('rclpy')
    monkeypatch.setattr(spec, 'compose_controller', lambda *_: None)
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path / 'no'))
    with pytest.raises(BallbotError, match=f'^{tmp_path}/no: No such file or directory'):
        stationary(tmp_path / 'output', 'none' if words else 'one', *words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('processes', ['separate', 'one'])
def test_without_a_folder_for_the_logs_of_ros_there_is_one_line(tmp_path, domain, processes):
    home = tmp_path / 'home'
    home.touch()
    given = {name: value for name, value in environment(domain).items() if name != 'ROS_LOG_DIR'}
    done = subprocess.run(
        [*BALLBOT, 'run', 'stationary', f'--processes={processes}', '--no-record'],
        env={**given, 'HOME': str(home), 'ROS_HOME': ''},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == ''
    assert done.stderr == (
        f'error: {home}/.ros/log: Not a directory; set ROS_LOG_DIR to a folder that can be written '
        'to\n'
    )


@pytest.mark.parametrize('processes', ['separate', 'one'])
def test_a_peer_that_can_not_be_resolved_is_one_line(domain, processes):
    pytest.importorskip('rclpy')
    done = subprocess.run(
        [*BALLBOT, 'run', 'stationary', f'--processes={processes}', '--no-record'],
        env={**environment(domain), 'ROS_STATIC_PEERS': '127.0.0.1;offline.invalid'},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.startswith('error: ROS_STATIC_PEERS: offline.invalid: ')
    assert len(done.stderr.splitlines()) == 1


def test_a_file_that_does_not_fit_in_the_temporary_folder_is_named(tmp_path):
    pytest.importorskip('rclpy')
    from ballbot_ros.run.graph import graph_parameters

    path = tmp_path / 'attachments' / 'parameters.yaml'
    path.parent.mkdir()
    path.symlink_to('/dev/full')
    with pytest.raises(BallbotError, match=f'^{path}: {FULL}'):
        graph_parameters(RunSpec(Scenario()), None, tmp_path)


@pytest.mark.graph
@pytest.mark.parametrize('lockstep', ['true', 'false'])
def test_a_disk_that_is_full_when_the_file_is_closed_fails_the_run(
    tmp_path, monkeypatch, domain, lockstep
):
    pytest.importorskip('rclpy')

    def fail(writer):
        raise RecordingError(f'{writer.path}: {FULL}')

    monkeypatch.setattr(RecordingWriter, 'close', fail)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    nodes = ('plant_sim', 'controller', 'gamepad_teleop')
    modes = [f'{node}.lockstep={lockstep}' for node in nodes]
    result = stationary(tmp_path, 'one', 'plant_sim.duration=0.2', *modes)
    assert result.exit_status == 1
    assert result.verdict is Verdict.FAILED
    assert result.reason == f'recorder: {tmp_path}/stationary.mcap: {FULL}'
