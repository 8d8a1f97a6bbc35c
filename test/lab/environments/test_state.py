"""Saved states: the continuation is the same, here and in another process."""

import copy
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from ballbot_ros.environments import BalanceEnv, DriveEnv, EnvironmentConfigurationError

ARGUMENTS = {'step_ms': 20, 'profile': 'hardware'}
DEAD_TIMES = {
    'plant_sim.actuator_delay': 6,
    'plant_sim.actuator_delay_jitter': 30,
    'gyro_driver.delay': 3,
    'encoder_driver.delay_jitter': 9,
}
ACTIONS = np.random.default_rng(1).uniform(-0.3, 0.3, (12, 2)).tolist()

CONTINUATION = """\
import pickle
import sys

from ballbot_ros.environments import DriveEnv

arguments, state, actions = pickle.load(sys.stdin.buffer)
env = DriveEnv(**arguments)
env.restore_state(state)
found = []
for action in actions:
    observation, *rest, info = env.step(action)
    found.append((observation.tolist(), *rest, info['state'].tolist()))
pickle.dump(found, sys.stdout.buffer)
"""


def continuation(env, actions):
    found = []
    for action in actions:
        observation, *rest, info = env.step(action)
        found.append((observation.tolist(), *rest, info['state'].tolist()))
    return found


def started(cls=DriveEnv, seed=4, **arguments):
    env = cls(**{**ARGUMENTS, **arguments})
    env.reset(seed=seed)
    continuation(env, ACTIONS[:4])
    return env


@pytest.mark.parametrize('parameters', [None, {'plant_sim.map': 'track'}, DEAD_TIMES])
@pytest.mark.parametrize('observation', ['devices', 'state'])
def test_the_continuation_of_a_restored_state_is_the_same(observation, parameters):
    env = started(observation=observation, parameters=parameters)
    state = env.save_state()
    first = continuation(env, ACTIONS)
    other = DriveEnv(observation=observation, parameters=parameters, **ARGUMENTS)
    other.reset(seed=99)
    for each in (env, other):
        each.restore_state(state)
        assert continuation(each, ACTIONS) == first
    env.reset()
    env.restore_state(state)
    assert continuation(env, ACTIONS) == first


def test_the_continuation_is_the_same_in_another_process():
    env = started()
    data = pickle.dumps((ARGUMENTS, env.save_state(), ACTIONS))
    expected = continuation(env, ACTIONS)
    done = subprocess.run(
        [sys.executable, '-c', CONTINUATION], input=data, capture_output=True, check=True
    )
    assert pickle.loads(done.stdout) == expected


def test_a_saved_state_keeps_the_random_numbers_of_the_next_episodes():
    env = started()
    state = env.save_state()
    seeds = [env.reset()[1]['seed'] for _ in range(3)]
    env.restore_state(state)
    assert [env.reset()[1]['seed'] for _ in range(3)] == seeds


def test_restoring_returns_the_last_observation():
    env = started()
    observation, _, _, _, info = env.step(ACTIONS[0])
    state = env.save_state()
    continuation(env, ACTIONS)
    again, again_info = env.restore_state(state)
    assert again.tolist() == observation.tolist()
    assert again_info['time_s'] == info['time_s']
    assert again_info['state'].tolist() == info['state'].tolist()


def test_the_state_of_an_ended_episode_is_that_of_an_ended_episode():
    env = started(duration=0.1)
    continuation(env, ACTIONS[:1])
    state = env.save_state()
    env.reset()
    env.restore_state(state)
    with pytest.raises(ResetNeeded):
        env.step(ACTIONS[0])


@pytest.mark.parametrize(
    ('cls', 'arguments', 'message'),
    [
        (BalanceEnv, {}, r"task is 'Drive' there, 'Balance' here"),
        (DriveEnv, {'observation': 'state'}, r"observation is 'devices' there, 'state' here"),
        (DriveEnv, {'step_ms': 4}, r'step_ms is 20 there, 4 here'),
        (DriveEnv, {'profile': 'ideal'}, r'plant_sim.link is True there, False here'),
        (DriveEnv, {'duration': 9}, r'duration is 20.0 there, 9.0 here'),
    ],
)
def test_the_state_of_another_environment_is_refused(cls, arguments, message):
    state = started().save_state()
    env = cls(**{**ARGUMENTS, **arguments})
    with pytest.raises(EnvironmentConfigurationError, match=message):
        env.restore_state(state)


def test_something_else_is_no_state():
    env = started()
    with pytest.raises(EnvironmentConfigurationError, match='3 is not a state that save_state ret'):
        env.restore_state(3)
    state = env.save_state()
    with pytest.raises(EnvironmentConfigurationError, match='another version'):
        env.restore_state(replace(state, configuration=state.configuration[:-1]))


def test_there_is_no_state_before_the_first_episode():
    with pytest.raises(ResetNeeded):
        BalanceEnv().save_state()


@pytest.mark.parametrize('duplicate', [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize(
    'arguments', [{}, {'parameters': {'plant_sim.map': 'track'}}, {'parameters': DEAD_TIMES}]
)
def test_a_copy_continues_alike_and_by_itself(duplicate, arguments):
    env = started(**arguments)
    again = duplicate(env)
    expected = continuation(env, ACTIONS)
    assert continuation(again, ACTIONS) == expected
    assert again.reset()[1]['seed'] == env.reset()[1]['seed']
    assert duplicate(DriveEnv()).reset(seed=1)[1]['seed'] == DriveEnv().reset(seed=1)[1]['seed']
