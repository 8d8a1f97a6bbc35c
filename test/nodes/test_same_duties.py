"""The duties depend on scenario and seed only, in all arrangements of processes."""

import contextlib
import json
import os
import random
import signal
import time

import pytest
from graph import NODES, Node, call, free_domain

from ballbot_ros.engine.golden import duty_sha256
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.engine.trajectory import load_trajectory
from ballbot_ros.parameters import GYRO, PLANT, RECORDER, PlantParameters

pytestmark = pytest.mark.graph

DURATION_S = 1.5
NOISE = 0.7
NOISY_PLANT = {'duration': DURATION_S, 'battery_model': 'draining'}
NOISY = [
    f'--set=gyro_driver.noise={NOISE}',
    *(f'--set=plant_sim.{name}={value}' for name, value in NOISY_PLANT.items()),
]
OTHERS = [name for name in NODES if name not in (PLANT, RECORDER)]
REPETITIONS = 4


@pytest.fixture(scope='session')
def expected_sha256():
    scenario = load_scenario('stationary')
    scenario.parameters.set(GYRO, 'noise', NOISE)
    for name, value in NOISY_PLANT.items():
        scenario.parameters.set(PLANT, name, value)
    return duty_sha256(scenario)


def sha256_of(run):
    assert run.finish() in (0, 1), run.stderr  # such a short run may miss the expectations
    assert run.result['ticks'] == round(DURATION_S * 250)
    return run.result['duty_sha256']


# Runs with a recording: below, and test_recording_of_runs.py.
@pytest.mark.parametrize('processes', ['separate', 'one'])
def test_all_ways_of_running_give_the_same_duties(start_run, expected_sha256, processes):
    run = start_run('stationary', '--processes', processes, '--json', '--no-record', *NOISY)
    assert sha256_of(run) == expected_sha256


def test_another_seed_gives_other_duties(expected_sha256):
    def sha256(*words):
        words = [*words, '--processes=none', '--no-record', '--json', *NOISY]
        return json.loads(call('run', 'stationary', *words).stdout)['duty_sha256']

    assert sha256() == expected_sha256
    assert sha256('--seed=2') != expected_sha256


@pytest.mark.slow
def test_every_repetition_gives_the_same_duties(fork_client, tmp_path, expected_sha256):
    """Run two graphs at a time, each in its own domain, with one plant after the other.

    simulation/test_robot_world.py tests other orders of messages.
    """
    start_pitch_x = load_scenario('stationary').parameters.of(PlantParameters).start_pitch_x
    with contextlib.ExitStack() as stack:
        domains = [stack.enter_context(free_domain()) for _ in range(2)]

        def start(domain, name, **parameters):
            node = Node.fork(fork_client, domain, name, **parameters)
            stack.callback(node.kill)
            return node

        for domain in domains:
            for name in OTHERS:
                start(domain, name, **({'noise': NOISE} if name == GYRO else {}))
        for repetition in range(REPETITIONS // 2):
            paths = [tmp_path / f'{domain}_{repetition}.npz' for domain in domains]
            plants = [
                start(domain, PLANT, start_pitch_x=start_pitch_x, real_time_factor=0.0,
                      trajectory_file=path, **NOISY_PLANT)
                for domain, path in zip(domains, paths, strict=True)
            ]  # fmt: skip
            for each, path in zip(plants, paths, strict=True):
                assert each.finish() == 0, each.output
                assert load_trajectory(path)[1]['duty_sha256'] == expected_sha256


@pytest.mark.slow
def test_delays_in_any_node_change_no_duty(start_run, tmp_path, expected_sha256):
    """Nodes are suspended at random, each for longer than many ticks."""
    choose = random.Random(0)
    run = start_run('stationary', '--json', '--output', tmp_path, *NOISY)
    pids = run.nodes()
    while run.process.poll() is None:
        pid = pids[choose.choice(NODES)]
        try:
            os.kill(pid, signal.SIGSTOP)
            time.sleep(choose.uniform(0.001, 0.25))
            os.kill(pid, signal.SIGCONT)
        except ProcessLookupError:
            break
        time.sleep(choose.uniform(0.0, 0.1))
    assert sha256_of(run) == expected_sha256
