"""Gymnasium's own checks pass without a warning."""

import itertools
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import ballbot_ros.environments  # noqa: F401

IDS = ('ballbot_ros/Balance-v0', 'ballbot_ros/Drive-v0')


@pytest.fixture(autouse=True)
def warnings_are_errors():
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        yield


@pytest.mark.parametrize('observation', ['devices', 'state'])
@pytest.mark.parametrize('step_ms', [4, 20])
@pytest.mark.parametrize('env_id', IDS)
def test_the_checker_of_environments_finds_nothing(env_id, step_ms, observation):
    env = gymnasium.make(env_id, observation=observation, step_ms=step_ms, profile='hardware')
    check_env(env.unwrapped)
    unwrapped = env.unwrapped
    assert len(unwrapped.observation_names) == env.observation_space.shape[0]
    assert np.isfinite(env.observation_space.low).all()
    assert np.isfinite(env.observation_space.high).all()


@pytest.mark.parametrize('mode', ['sync', 'async'])
def test_environments_run_side_by_side(mode):
    envs = gymnasium.make_vec(
        'ballbot_ros/Drive-v0', num_envs=2, vectorization_mode=mode, step_ms=20, duration=0.1
    )
    try:
        first, info = envs.reset(seed=3)
        assert first.shape == (2, 8)
        assert info['state'].shape == (2, 9)
        assert len(set(info['seed'].tolist())) == 2
        for _ in range(8):  # longer than an episode
            observation, reward, *_ = envs.step(envs.action_space.sample())
            assert observation in envs.observation_space
            assert ((reward >= 0.0) & (reward <= 1.0)).all()
    finally:
        envs.close()


def test_the_passive_checker_is_silent_for_whole_episodes():
    for env_id, observation in itertools.product(IDS, ('devices', 'state')):
        env = gymnasium.make(env_id, observation=observation, step_ms=20, duration=2.0)
        for _ in range(3):
            env.reset()
            over = False
            while not over:
                _, _, terminated, truncated, _ = env.step(env.action_space.sample())
                over = terminated or truncated


def test_an_environment_is_made_by_the_module_of_its_id():
    env = gymnasium.make('ballbot_ros.environments:ballbot_ros/Balance-v0')
    assert env.spec.id == 'ballbot_ros/Balance-v0'
