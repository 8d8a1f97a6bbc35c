"""Gymnasium's own checks pass without a warning."""

import asyncio
import copy
import itertools
import warnings

import gymnasium
import imageio_ffmpeg
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo

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
    check_env(env.unwrapped, skip_render_check=True)
    unwrapped = env.unwrapped
    assert len(unwrapped.observation_names) == env.observation_space.shape[0]
    assert np.isfinite(env.observation_space.low).all()
    assert np.isfinite(env.observation_space.high).all()


def test_the_checker_finds_nothing_in_the_pictures(needs_browser):
    env = gymnasium.make(IDS[0], step_ms=20)
    assert env.unwrapped.render() is None
    check_env(env.unwrapped)  # makes another one, with pictures


def test_gymnasium_records_a_film(needs_browser, tmp_path):
    """In a thread with an event loop, as that of a notebook."""

    async def record():
        env = gymnasium.make(
            IDS[1], render_mode='rgb_array', step_ms=20, parameters={'plant_sim.map': 'track'}
        )
        with pytest.raises(ResetNeeded):
            env.unwrapped.render()
        film = RecordVideo(env, str(tmp_path / 'films'))
        film.reset(seed=1, options={'start_pitch_x': 0.2})
        first = film.render()
        for _ in range(8):
            film.step([0.0, 0.0])
        last = film.render()
        copied = copy.deepcopy(env.unwrapped)  # a browser can't be copied
        film.close()
        film.close()
        return first, last, copied

    first, last, copied = asyncio.run(record())
    assert (first.shape, first.dtype) == ((528, 960, 3), np.uint8)
    changed = np.abs(first.astype(int) - last).max(axis=2) > 30
    assert 0.002 < changed.mean() < 0.5
    assert copied.render_mode == 'rgb_array'
    [path] = (tmp_path / 'films').iterdir()
    reader = imageio_ffmpeg.read_frames(str(path))
    properties = next(reader)
    reader.close()
    assert (properties['size'], properties['fps']) == ((960, 528), 50.0)
    assert properties['duration'] == pytest.approx(9 / 50, abs=1 / 50)


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
