"""The examples: a policy is learned, and balances as a controller in every arrangement."""

import json
import subprocess
import sys

import pytest
import yaml
from graph import call
from policies import EXAMPLES, LEARNED

import ballbot_ros as bb

CONTROLLER = f'{EXAMPLES}/learned_policy.py:LearnedPolicy'


@pytest.mark.slow
def test_the_cross_entropy_method_learns_to_balance(tmp_path):
    output = tmp_path / 'policy.yaml'
    words = ['--profile=ideal', '--duration=4', '--generations=6', '--population=20']
    done = subprocess.run(
        [sys.executable, EXAMPLES / 'cross_entropy.py', *words, '--output', output],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = done.stdout.splitlines()
    assert [line.startswith(f'generation {n:2}: ') for n, line in enumerate(lines, 1)] == (
        [True] * 6 + [False]
    )
    weights = yaml.safe_load(output.read_text())['/**/controller']['ros__parameters']
    assert all(abs(weight) > 1e-3 for weight in weights.values())
    for profile in ('ideal', 'hardware'):
        run = bb.simulate(
            'stationary',
            CONTROLLER,
            profile=profile,
            parameters={f'controller.{name}': value for name, value in weights.items()},
        )
        assert run.metrics['peak_pitch_deg'] < 8.0, profile
        assert run.metrics['peak_position_m'] < 0.3, profile


def test_the_learned_policy_stands_for_a_minute():
    values = yaml.safe_load(LEARNED.read_text())['/**/controller']['ros__parameters']
    parameters = {f'controller.{name}': value for name, value in values.items()}
    parameters['plant_sim.duration'] = 60.0
    run = bb.simulate('hardware_standing', CONTROLLER, parameters=parameters)
    assert run.passed, run.reason


@pytest.mark.graph
def test_the_learned_policy_runs_in_the_graph(start_run):
    """The command of the page; one process for all: run/test_own_controllers.py."""
    words = ['stationary', '--controller', CONTROLLER, '--params', LEARNED]
    words += ['--no-record', '--json', '--set=plant_sim.duration=5']
    run = start_run(*words)
    assert run.finish() == 0, run.stderr
    assert run.result['outcome'] == 'passed'
    without_nodes = call('run', *words, '--processes=none')
    assert json.loads(without_nodes.stdout)['duty_sha256'] == run.result['duty_sha256']


def test_the_learned_network_stays_within_5_cm_for_a_minute():
    """That of the example with stable-baselines3."""
    values = yaml.safe_load((EXAMPLES / 'network.yaml').read_text())
    weights = values['/**/controller']['ros__parameters']['user.weights']
    reference = f'{EXAMPLES}/network_policy.py:NetworkPolicy'
    parameters = {'controller.user.weights': weights, 'plant_sim.duration': 60.0}
    run = bb.simulate('hardware_standing', reference, parameters=parameters)
    assert run.passed, run.reason
    assert run.metrics['peak_position_m'] < 0.05
