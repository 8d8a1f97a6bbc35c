"""A node that dies or hangs in the run: who, how soon, and what is left of the recording."""

import os
import signal
import time

import pytest
from graph import NODES, alive, bound_s, wait_for
from terminal import Terminal

from ballbot_ros.messages.conversions import stamp_ns
from ballbot_ros.recording.reader import RecordingReader

pytestmark = pytest.mark.graph

SIM_TIME_S = 60.0


def the_motors_are_off(duties):
    """The last duty, and no other, tells that the run has ended and nothing drives."""
    *answers, last = duties
    assert (last.header.frame_id, last.vector.x, last.vector.y) == ('stop', 0.0, 0.0)
    assert all(answer.header.frame_id == '' for answer in answers)
    assert stamp_ns(answers[-1]) < stamp_ns(last)


def first_ticks_are_recorded(path):
    return path.exists() and path.stat().st_size > 20_000


def test_a_lost_node_is_named_by_the_shortest_timeout(start_run, tmp_path):
    recording = tmp_path / 'stationary.mcap'
    run = start_run(
        'stationary', '--output', tmp_path,
        '--set', f'plant_sim.duration={SIM_TIME_S}', '--set', 'plant_sim.timeout=0.2',
    )  # fmt: skip
    pids = run.nodes()
    wait_for(lambda: first_ticks_are_recorded(recording), what='the recording')
    os.kill(pids['gyro_driver'], signal.SIGKILL)
    assert run.finish() == 1
    assert 'gyro_driver' in run.stdout
    assert ' silent for 0.2 s at ' in run.stdout


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP], ids=lambda n: n.name)
@pytest.mark.parametrize('victim', NODES)
def test_a_lost_node_is_named_within_3_s(start_run, tmp_path, victim, number):
    recording = tmp_path / 'stationary.mcap'
    terminal = Terminal()
    run = start_run(
        'stationary', '--output', tmp_path, '--set', f'plant_sim.duration={SIM_TIME_S}',
        stderr=terminal.side,
    )  # fmt: skip
    pids = run.nodes()
    # The bar shows time as soon as the command itself hears the plant.
    terminal.wait_for_text(f' / {SIM_TIME_S:g} s'.encode(), timeout=40.0)
    wait_for(lambda: first_ticks_are_recorded(recording), what='the recording')

    os.kill(pids[victim], number)
    at = time.monotonic()
    terminal.wait_for_text(victim.encode(), timeout=40.0)
    assert time.monotonic() - at < bound_s(3.0)
    assert run.finish(timeout=60.0) == 1
    verdict = next(line for line in run.stdout.splitlines() if line.startswith('failed: '))
    assert victim in verdict
    assert 'Traceback' not in run.stdout
    assert not any(alive(pid) for pid in pids.values())

    with RecordingReader(recording) as reader:
        assert (reader.damage is None) == (victim != 'recorder'), reader.damage
        duties = [message for _, _, message in reader.messages(['/motor_duty'])]
        stamps = [stamp for _, stamp, _ in reader.messages(['/plant/imu'])]
    assert len(duties) > 10
    assert len(stamps) > 10
    if victim != 'recorder':
        the_motors_are_off(duties)
