"""A node that dies or hangs in the run: who, how soon, and what is left of the recording."""

import os
import signal
import time

import pytest
from graph import NODES, alive, bound_s, wait_for

from ballbot_ros.recording.reader import RecordingReader

pytestmark = pytest.mark.graph

SIM_TIME_S = 60.0


def first_ticks_are_recorded(path):
    """Whether seconds of sim time are in the file, so that everybody has found everybody."""
    return path.exists() and path.stat().st_size > 300_000


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP], ids=lambda n: n.name)
@pytest.mark.parametrize('victim', NODES)
def test_a_lost_node_is_named_within_3_s(start_run, tmp_path, victim, number):
    recording = tmp_path / 'stationary.mcap'
    run = start_run('stationary', '--output', tmp_path, '--set', f'plant_sim.duration={SIM_TIME_S}')
    pids = run.nodes()
    wait_for(lambda: first_ticks_are_recorded(recording), what='the recording')

    os.kill(pids[victim], number)
    at = time.monotonic()
    line = ''
    while victim not in line:
        line = run.process.stderr.readline()
        assert line, 'the run ended without naming the node'
    assert time.monotonic() - at < bound_s(3.0)
    assert run.finish(timeout=60.0) == 1
    verdict = next(line for line in run.stdout.splitlines() if line.startswith('failed: '))
    assert victim in verdict
    assert 'Traceback' not in run.stderr + run.stdout
    assert not any(alive(pid) for pid in pids.values())

    with RecordingReader(recording) as reader:
        assert reader.complete == (victim != 'recorder')
        duties = [
            (message.vector.x, message.vector.y)
            for _, _, message in reader.messages(['/motor_duty'])
        ]
        stamps = [stamp for _, stamp, _ in reader.messages(['/plant/imu'])]
    assert len(duties) > 10
    assert len(stamps) > 10
