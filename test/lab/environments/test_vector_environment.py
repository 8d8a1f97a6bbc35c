"""Many robots in one call of compiled code are those of single environments, to the last bit."""

import copy
import pickle
import subprocess
import sys
from collections import Counter

import gymnasium
import numpy as np
import pytest

pytest.importorskip('numba')

from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from ballbot_ros.environments import (
    BalanceEnv,
    BalanceVectorEnv,
    DriveEnv,
    DriveVectorEnv,
    EnvironmentConfigurationError,
)
from ballbot_ros.lab.environments import episode

COUNT = 5
DEAD_TIMES = {
    'plant_sim.actuator_delay': 6,
    'plant_sim.actuator_delay_jitter': 30,
    'gyro_driver.delay': 3,
    'encoder_driver.delay_jitter': 9,
}
NEAR_A_WALL = {'plant_sim.map': 'track', 'plant_sim.start_position_x': 0.85}
SHORT = {'step_ms': 20, 'duration': 0.4}
PAIRS = ((BalanceEnv, BalanceVectorEnv), (DriveEnv, DriveVectorEnv))


def single_environments(cls, mode=AutoresetMode.NEXT_STEP, **arguments):
    """Return environments that the interpreter moves one after the other."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(episode, 'has_compiled_code', lambda: False)
        return SyncVectorEnv([lambda: cls(**arguments)] * COUNT, autoreset_mode=mode)


def assert_same(one, other):
    """Compare what environments return: arrays, infos with their masks, numbers."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            assert_same(one[name], other[name])
    elif isinstance(one, tuple):
        for each in zip(one, other, strict=True):
            assert_same(*each)
    else:
        assert one.dtype == other.dtype
        if one.dtype == object:
            for each in zip(one, other, strict=True):
                np.testing.assert_array_equal(*each)
        else:
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize('mode', AutoresetMode)
@pytest.mark.parametrize(
    'arguments',
    [
        {'profile': 'hardware', **SHORT},
        {'observation': 'state', 'duration': 0.1},
        {'profile': 'hardware', 'parameters': DEAD_TIMES, **SHORT},
        {'parameters': NEAR_A_WALL, 'step_ms': 20, 'duration': 2.0},
    ],
)
@pytest.mark.parametrize(('single', 'vector'), PAIRS)
def test_they_return_what_single_environments_do(single, vector, arguments, mode):
    one = single_environments(single, mode, **arguments)
    many = vector(COUNT, **arguments, autoreset_mode=mode)
    assert_same(one.reset(seed=3), many.reset(seed=3))
    generator = np.random.default_rng(1)
    ends = 0
    for _ in range(60):
        actions = generator.uniform(-1.0, 1.0, (COUNT, 2)).astype(np.float32)
        found = one.step(actions)
        assert_same(found, many.step(actions))
        over = found[2] | found[3]
        ends += over.sum()
        if mode is AutoresetMode.DISABLED and over.any():
            begun = (
                one.reset(options={'reset_mask': over})[1],
                many.reset(options={'reset_mask': over})[1],
            )
            assert_same(*begun)
    assert ends > 3


def test_seeds_and_options_are_those_of_each_robot():
    one, many = single_environments(DriveEnv), DriveVectorEnv(COUNT)
    commands = [(0.0, 100, 0), (0.2, 0, -50), (0.3, 10, 10), (0.4, 0, 0)]
    for arguments in (
        {'seed': [5, 4, 3, 3, 9], 'options': {'seed': 4}},
        {'seed': [None, 4, None, None, 2]},  # the others go on
        {'options': {'start_pitch_x': 0.02, 'commands': commands}},
        {'seed': 8},
    ):
        assert_same(one.reset(**arguments), many.reset(**arguments))
    assert len(set(many.reset()[1]['seed'].tolist())) == COUNT


@pytest.mark.parametrize('duplicate', [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_continues_alike_and_by_itself(duplicate):
    env = DriveVectorEnv(2, step_ms=20, duration=0.1, profile='hardware')
    env.reset(seed=3)
    env.step(np.zeros((2, 2)))
    again = duplicate(env)
    for _ in range(8):
        actions = np.full((2, 2), 0.2)
        assert_same(env.step(actions), again.step(actions))


def test_the_registry_makes_them():
    made = gymnasium.make_vec('ballbot_ros/Drive-v0', num_envs=3, step_ms=20, duration=0.1)
    assert isinstance(made.unwrapped, DriveVectorEnv)
    statistics = RecordEpisodeStatistics(made)
    observation, info = statistics.reset(seed=3)
    assert observation in made.observation_space
    assert len(set(info['seed'].tolist())) == 3
    for _ in range(6):
        observation, reward, *_, info = statistics.step(made.action_space.sample())
        assert observation in made.observation_space
        assert ((reward >= 0.0) & (reward <= 1.0)).all()
        if 'episode' in info:
            break
    assert info['episode']['l'].tolist() == [5, 5, 5]
    made.close()


def test_a_refused_option_or_action_leaves_the_robots_as_they_were():
    env, other = BalanceVectorEnv(2), BalanceVectorEnv(2)
    for each in (env, other):
        each.reset(seed=1)
    with pytest.raises(EnvironmentConfigurationError, match="unknown 'pitch'"):
        env.reset(seed=7, options={'pitch': 1.0})
    for bad in ([[0.0, np.nan]] * 2, [0.0, 0.0], 'x', np.zeros((3, 2))):
        with pytest.raises(InvalidAction, match=r'not two finite numbers for each of 2 robots$'):
            env.step(bad)
    actions = np.full((2, 2), 0.3)
    assert_same(env.step(actions), other.step(actions))


def test_a_step_needs_a_reset():
    env = BalanceVectorEnv(2, step_ms=20, duration=0.02, autoreset_mode='Disabled')
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((2, 2)))
    env.reset()
    env.step(np.zeros((2, 2)))
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((2, 2)))
    env.reset(options={'reset_mask': np.array([True, False])})
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((2, 2)))


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'num_envs': 0}, r'num_envs: 0 is not a whole number from 1 on'),
        ({'num_envs': 2.0}, r'num_envs: 2.0 is not a whole number'),
        ({'autoreset_mode': 'never'}, r"autoreset_mode: 'never' is not one of NextStep, SameStep"),
        ({'render_mode': 'rgb_array'}, r'no pictures; use one environment or vectoriz'),
        ({'step_ms': 5}, r'step_ms: 5 is not 4 or 20'),
    ],
)  # fmt: skip
def test_an_invalid_argument_is_told_in_one_line(arguments, message):
    with pytest.raises(EnvironmentConfigurationError, match=message) as told:
        BalanceVectorEnv(**arguments)
    assert '\n' not in str(told.value)


@pytest.mark.parametrize(
    'arguments',
    [
        {'seed': [1, 2, 3]},
        {'seed': 1.5},
        {'options': 3},
        {'options': {'reset_mask': [1, 0]}},
        {'options': {'reset_mask': np.zeros(2, bool)}},
        {'options': {'reset_mask': np.ones(3, bool)}},
    ],
)
def test_an_invalid_reset_is_told_in_one_line(arguments):
    with pytest.raises(
        EnvironmentConfigurationError, match=r'^(seed|options): .*(list of 2|bool|no mapping)'
    ):
        BalanceVectorEnv(2).reset(**arguments)


def test_many_ticks_of_the_interpreter_let_the_code_be_compiled(monkeypatch):
    started = []
    with monkeypatch.context() as patch:
        patch.setattr(episode, 'has_compiled_code', lambda: False)
        patch.setattr(episode, 'compile_in_background', lambda *what: started.append(what))
        patch.setattr(episode, '_interpreted', Counter())
        patch.setattr(episode, 'MANY_TICKS', 300)
        env = BalanceEnv()
        env.reset()
        env.reset()
        assert not started
        env.reset()
    assert started == [(episode.move_robots.__qualname__, episode.compile_moves)]
    episode.compile_moves()
    assert episode.has_compiled_code()


def test_without_numba_it_says_what_to_install():
    code = (
        "import sys; sys.modules['numba'] = None\n"
        'import gymnasium, ballbot_ros.environments\n'
        "env = gymnasium.make('ballbot_ros/Balance-v0')\n"
        'env.reset()\n'
        "gymnasium.make_vec('ballbot_ros/Balance-v0', num_envs=2)\n"
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)
    assert done.stderr.splitlines()[-1].endswith("need numba: pip install 'ballbot_ros[study]'")


@pytest.mark.parametrize('parameters', [None, NEAR_A_WALL, DEAD_TIMES])
def test_a_state_that_the_interpreter_saves_continues_in_compiled_code(parameters, monkeypatch):
    arguments = {'profile': 'hardware', 'step_ms': 20, 'parameters': parameters}
    made = {}
    for is_compiled in (False, True):
        monkeypatch.setattr(episode, 'has_compiled_code', lambda: is_compiled)  # noqa: B023
        made[is_compiled] = DriveEnv(**arguments)
    actions = np.random.default_rng(1).uniform(-0.3, 0.3, (12, 2))
    for saves, continues in ((False, True), (True, False)):
        one, other = made[saves], made[continues]
        one.reset(seed=4)
        for action in actions[:4]:
            one.step(action)
        other.reset(seed=99)
        other.restore_state(one.save_state())
        for action in actions:
            found, again = one.step(action), other.step(action)
            assert found[0].tolist() == again[0].tolist()
            assert found[1:4] == again[1:4]
            assert one.save_state() == other.save_state()
