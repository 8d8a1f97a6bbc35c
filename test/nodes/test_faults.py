"""A node that dies or hangs during a run is named, and the recording remains readable."""

import os
import signal

import pytest
from graph import alive, await_recording, wait_for
from terminal import Terminal

from ballbot_ros.parameters import CONTROLLER, GYRO, PLANT, RECORDER, SONAR
from ballbot_ros.recording.messages.conversions import stamp_ns
from ballbot_ros.recording.reader import RecordingReader

pytestmark = pytest.mark.graph

ENDLESS = '--set=plant_sim.duration=600'


def the_motors_are_off(duties):
    """Assert that the last duty, and no other, is a motor stop."""
    *answers, last = duties
    assert (last.header.frame_id, last.vector.x, last.vector.y) == ('stop', 0.0, 0.0)
    assert all(answer.header.frame_id == '' for answer in answers)
    assert stamp_ns(answers[-1]) < stamp_ns(last)


@pytest.fixture
def start(start_run, tmp_path):
    """Start a recorded run; return it with its nodes when the first ticks are on disk.

    Its pace leaves the processor to others while the tests wait.
    """

    def start(*settings, **popen):
        run = start_run('stationary', '--output', tmp_path, ENDLESS, '--real-time-factor=1',
                        *settings, **popen)  # fmt: skip
        pids = run.nodes()
        recording = tmp_path / 'stationary.mcap'
        await_recording(recording, run=run)
        return run, pids, recording

    return start


def size(recording):
    return recording.stat().st_size


def test_a_hanging_or_dead_node_is_named_and_a_waiting_run_continues_after_its_return(start):
    terminal = Terminal()
    run, pids, recording = start(
        '--set=plant_sim.timeout=0.2', '--set=plant_sim.on_timeout=wait', stderr=terminal.side
    )
    for name in (GYRO, CONTROLLER, RECORDER):
        since = len(terminal.screen)
        os.kill(pids[name], signal.SIGSTOP)
        terminal.wait_for_match(rf'{name}[\w, ]* silent for 0\.2 s at sim time', since)
        os.kill(pids[name], signal.SIGCONT)
        before = size(recording)
        wait_for(lambda before=before: size(recording) > before + 20_000, what=f'it without {name}')
    for name in (SONAR, CONTROLLER):
        since = len(terminal.screen)
        os.kill(pids[name], signal.SIGKILL)
        terminal.wait_for_match(rf'{name} was killed by SIGKILL', since)
    run.process.send_signal(signal.SIGINT)
    assert run.finish() == 128 + signal.SIGINT
    assert not any(alive(pid) for pid in pids.values())


def test_the_shortest_timeout_blames_only_the_lost_node(start):
    run, pids, _ = start('--set=plant_sim.timeout=0.2')
    os.kill(pids[GYRO], signal.SIGKILL)
    assert run.finish() == 1
    assert f'\nfailed: {GYRO} silent for 0.2 s at ' in run.stdout


# The other nodes: lockstep/test_lockstep_master.py. A plant that hangs, which takes half a
# minute: run/test_plant_monitor.py and scripts/campaign. A recorder that hangs: above, and the
# command kills it in the end, as this test does.
@pytest.mark.parametrize('victim', [PLANT, RECORDER])
def test_a_lost_node_fails_the_run_and_its_recording_can_be_read(start, victim):
    run, pids, recording = start()
    os.kill(pids[victim], signal.SIGKILL)
    assert run.finish() == 1
    verdict = next(line for line in run.stdout.splitlines() if line.startswith('failed: '))
    assert victim in verdict
    assert victim in run.stderr
    assert 'Traceback' not in run.stdout + run.stderr
    assert not any(alive(pid) for pid in pids.values())
    with RecordingReader(recording) as reader:
        assert (reader.damage is None) == (victim != RECORDER), reader.damage
        duties = [message for _, _, message in reader.messages(['/motor_duty'])]
        stamps = [stamp for _, stamp, _ in reader.messages(['/plant/imu'])]
    assert len(duties) > 10
    assert len(stamps) > 10
    if victim != RECORDER:
        the_motors_are_off(duties)
