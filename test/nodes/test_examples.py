"""The example nodes of docs/examples take the place of the project's own."""

import contextlib
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from graph import Node, environment

pytest.importorskip('rclpy')

from ballbot_ros.parameters import GYRO, EncoderParameters
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

pytestmark = pytest.mark.graph

EXAMPLES = Path(__file__).resolve().parents[2] / 'docs' / 'examples'
ENCODER = EncoderParameters.node
FILES = {GYRO: 'gyro_driver.py', ENCODER: 'cyclonedds_encoder_driver.py'}
SHORT = ['plant_sim.duration=1.2']


@pytest.fixture
def run_with(start_run, domain, tmp_path):
    """Run the scenario `stationary` with the example in a role; return the run.

    The example ends with status 0 and without a word on SIGINT.
    """

    def run(role):
        done = start_run('stationary', '--processes=one', '--json', f'--set={SHORT[0]}',
                         '--external', role, '--output', tmp_path)  # fmt: skip
        process = subprocess.Popen(
            [sys.executable, EXAMPLES / FILES[role]],
            env=environment(domain),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
        )
        with contextlib.closing(_Killed(process)):
            assert done.finish() in (0, 1), done.stderr  # such a short run may miss expectations
            assert done.result['external'] == [role]
            process.send_signal(signal.SIGINT)
            example = Node(role, process)
            assert (example.finish(), example.output) == (0, '')
        return done

    return run


class _Killed:
    def __init__(self, process):
        self._process = process

    def close(self):
        self._process.kill()
        self._process.wait()


def test_a_driver_with_rclpy_takes_part_and_its_run_can_be_replayed(run_with, command):
    result = run_with(GYRO).result
    status, output, notes = command('replay', result['recording'])
    assert status == 0, output
    assert output.count('identical') == 2
    assert "its gyro_driver 'my gyro 1.0' is not part of ballbot_ros: the recorded" in notes


def test_a_driver_on_another_dds_measures_as_the_own_one(run_with):
    options = RunOptions(processes=Processes.NONE, record=False, assignments=SHORT)
    own = execute(RunSpec.of_scenario('stationary', options))
    assert run_with(ENCODER).result['duty_sha256'] == own.duty_sha256
