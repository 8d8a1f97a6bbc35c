"""The example nodes of docs/examples take part in runs, and end cleanly."""

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest
from graph import Node, environment

pytest.importorskip('rclpy')

from ballbot_ros.parameters import GYRO, NODES, PLANT, RECORDER, EncoderParameters
from ballbot_ros.simulation.trajectory import load_trajectory

pytestmark = pytest.mark.graph

EXAMPLES = Path(__file__).resolve().parents[2] / 'docs' / 'examples'
ENCODER = EncoderParameters.node
OTHERS = [name for name in NODES if name not in (PLANT, RECORDER)]


@pytest.fixture
def start_example(domain):
    """Start an example as a user does; it is ended after the test."""
    with contextlib.ExitStack() as stack:

        def start(file):
            process = subprocess.Popen(
                [sys.executable, EXAMPLES / file],
                env=environment(domain),
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                text=True,
            )
            node = Node(file, process)
            stack.callback(node.kill)
            return node

        yield start


@pytest.fixture
def run_duties(start_node, tmp_path):
    """Return the function that runs a plant, and returns the digest of the run's duties."""

    def run():
        path = tmp_path / 'run.npz'
        plant = start_node(
            PLANT, duration=1.5, start_pitch_x=0.07, real_time_factor=0.0, trajectory_file=path
        )
        assert plant.finish() == 0, plant.output
        trajectory, summary = load_trajectory(path)
        assert trajectory.duty.any()
        return summary['duty_sha256']

    return run


def end(example):
    example.process.terminate()
    assert example.finish() == 0, example.output
    assert example.output == ''


def test_the_gyro_driver_in_rclpy_begins_every_run_in_the_same_state(
    start_example, start_node, run_duties
):
    example = start_example('gyro_driver.py')
    for name in OTHERS:
        if name != GYRO:
            start_node(name)
    assert run_duties() == run_duties()
    end(example)


def test_the_encoder_driver_in_cyclonedds_measures_as_the_project_s_own(
    start_example, start_node, run_duties
):
    example = start_example('cyclonedds_encoder_driver.py')
    for name in OTHERS:
        if name != ENCODER:
            start_node(name)
    duties = run_duties()
    end(example)
    start_node(ENCODER)
    assert run_duties() == duties
