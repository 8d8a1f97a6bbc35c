"""Episodes: seeds, starts, ends, rewards and refused arguments."""

import math
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot_ros.environments import BalanceEnv, DriveEnv, EnvironmentConfigurationError
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import ParameterError

OFF = np.zeros(2, np.float32)
NOISY = {'gyro_driver.noise': 0.7, 'sonar_driver.noise_cm': 3.0}
ACTIONS = st.lists(
    st.tuples(st.floats(-1.0, 1.0, width=32), st.floats(-1.0, 1.0, width=32)), max_size=12
)


def episode(env, actions, **arguments):
    """Return all that an episode gives, exactly comparable."""
    observation, info = env.reset(**arguments)
    found = [(observation.tolist(), info['state'].tolist())]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(np.array(action, np.float32))
        found.append((observation.tolist(), reward, terminated, truncated, info['state'].tolist()))
        if terminated or truncated:
            break
    return found


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**32), ACTIONS, st.sampled_from([BalanceEnv, DriveEnv]))
def test_the_same_seed_and_actions_give_the_same_episode(seed, actions, cls):
    one, other = (cls(step_ms=20, parameters=NOISY) for _ in range(2))
    other.reset(seed=seed + 1)
    assert episode(one, actions, seed=seed) == episode(other, actions, seed=seed)
    assert episode(one, actions) == episode(other, actions)  # so are the next episodes


def test_the_next_episode_has_another_start_and_other_noise():
    env = BalanceEnv(parameters=NOISY)
    one, other = (env.reset(seed=seed) for seed in (1, None))
    assert one[1]['seed'] != other[1]['seed']
    assert one[1]['start_pitch_x'] != other[1]['start_pitch_x']
    pitch = {'start_pitch_x': 0.0, 'start_pitch_y': 0.0}
    actions = [OFF] * 50
    assert episode(env, actions, options=pitch) != episode(env, actions, options=pitch)


def test_a_start_can_be_given():
    env = BalanceEnv(observation='state')
    options = {'start_pitch_x': 0.02, 'start_pitch_y': np.float64(-0.01), 'seed': np.int64(7)}
    observation, info = env.reset(seed=1, options=options)
    assert observation.tolist() == [0.0, 0.0, 0.0, 0.0, 0.02, -0.01, 0.0, 0.0, 8.0]
    assert {name: info[name] for name in options} == options
    again = env.reset(options={name: info[name] for name in options})
    assert again[0].tolist() == observation.tolist()


def test_the_robot_is_held_until_the_gyros_are_calibrated():
    env = BalanceEnv(profile='hardware')
    for _ in range(5):
        observation, info = env.reset()
        assert info['time_s'] == 0.0
        assert info['state'][:4].tolist() == [0.0] * 4
        # The reading of the release, without the offset of about 600 deg/s.
        assert abs(observation[:2]).max() < 5.0
        assert observation[2:4].tolist() == [0.0, 0.0]


def test_a_rate_is_the_mean_of_a_step():
    """In 20 ms there are five readings, so the rate is in fifths of a degree per second."""
    env = BalanceEnv(step_ms=20, parameters=NOISY)
    env.reset(seed=1)
    rates = [env.step(OFF)[0][0] for _ in range(10)]
    offset = env.save_state().episode.observer.offset_x
    fifths = [5.0 * (rate + offset) for rate in rates]
    assert fifths == pytest.approx([round(each) for each in fifths])
    assert any(each % 5.0 > 0.5 for each in fifths)


def test_a_falling_robot_ends_the_episode():
    env = BalanceEnv(step_ms=20)
    env.reset(seed=1)
    found = episode(env, [OFF] * 500, seed=1)
    assert found[-1][2:4] == (True, False)
    assert len(found) < 200
    with pytest.raises(ResetNeeded, match='the episode is over'):
        env.step(OFF)
    env.reset()
    env.step(OFF)


def test_an_episode_is_truncated_after_its_duration():
    env = BalanceEnv(duration=0.1)
    found = episode(env, [OFF] * 500, seed=1)
    assert len(found) == 1 + 25
    assert [each[2:4] for each in found[-2:]] == [(False, False), (False, True)]


def test_a_wall_ends_the_episode():
    place = {'plant_sim.map': 'track', 'plant_sim.start_position_x': 0.85}
    env = DriveEnv(step_ms=20, parameters=place)
    near, _ = env.reset(seed=1, options={'start_pitch_x': 0.15})
    distance = near[env.observation_names.index('distance_cm')]
    assert 0.0 < distance < 255.0
    found = episode(env, [(1.0, 0.0)] * 500, options={'start_pitch_x': 0.15})
    assert found[-1][2] is True
    assert env.save_state().episode.plant.is_stopped


def test_rewards_are_best_at_rest_and_bounded():
    for cls in (BalanceEnv, DriveEnv):
        env = cls(observation='state')
        env.reset(options={'start_pitch_x': 0.0, 'start_pitch_y': 0.0})
        assert env.step(OFF)[1] == pytest.approx(1.0)
        env.reset(options={'start_pitch_x': 0.1, 'start_pitch_y': 0.0})
        _, reward, _, _, info = env.step([1.0, -1.0])
        assert 0.0 < reward < 0.7
        assert info['reward_calm'] == pytest.approx(0.082, abs=0.001)
        assert info['reward_upright'] == pytest.approx(0.1, abs=0.02)
        assert info['duty_percent'].tolist() == [100, -100]


def test_a_commanded_speed_is_observed_and_rewarded():
    commands = [(0.0, 100, 0), (0.2, 0, -50)]
    env = DriveEnv(observation='state', step_ms=20)
    level = {'start_pitch_x': 0.0, 'start_pitch_y': 0.0, 'commands': commands}
    observation, info = env.reset(options=level)
    full = math.radians(380.0) * 0.026
    assert observation[-2:].tolist() == pytest.approx([full, 0.0])
    assert info['commands'] == tuple(commands)
    assert env.step(OFF)[4]['reward_follow'] == pytest.approx(0.0025 / (0.0025 + full**2))
    for _ in range(9):
        observation, *_ = env.step(OFF)
    assert observation[-2:].tolist() == pytest.approx([0.0, -full / 2.0])
    devices = DriveEnv(step_ms=20).reset(options=level)[0]
    assert devices[-2:].tolist() == [380.0, 0.0]


def test_random_commands_change_every_three_seconds():
    env = DriveEnv(duration=10.0)
    commands = [command for _ in range(20) for command in env.reset()[1]['commands']]
    assert [command.time_s for command in commands[:3]] == [1.0, 4.0, 7.0]
    shares = np.array([command[1:] for command in commands])
    assert abs(shares).max() <= 100
    assert (shares > 50).any()
    assert (shares < -50).any()


def test_actions_beyond_their_bounds_are_clipped_and_duties_are_whole():
    env = BalanceEnv()
    env.reset(seed=1)
    for action, duty in (
        ([3.0, -math.e], [100, -100]),
        ([0.125, -0.125], [13, -12]),  # halves up
        (np.array([0.004, 0.006], np.float32), [0, 1]),
    ):
        assert env.step(action)[4]['duty_percent'].tolist() == duty


@pytest.mark.parametrize(
    'action', [[math.nan, 0.0], [math.inf, 0.0], [0.0], 0.5, 'x', None, [[0, 0]]]
)
def test_an_action_that_is_none_is_refused(action):
    env = BalanceEnv()
    env.reset(seed=1)
    with pytest.raises(InvalidAction, match=r'^the action .+ is not two finite numbers$'):
        env.step(action)
    env.step(OFF)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'observation': 'pixels'}, r"observation: 'pixels' is not devices or state"),
        ({'step_ms': 5}, r'step_ms: 5 is not 4 or 20'),
        ({'step_ms': True}, r'step_ms: True is not 4 or 20'),
        ({'duration': -1.0}, r'duration: -1.0 is not within 0.004 … 100000 s'),
        ({'duration': math.nan}, r'duration: nan is not within'),
        ({'duration': '9'}, r"duration: '9' is not within"),
        ({'profile': 'real'}, r"unknown profile 'real'; known: ideal, hardware"),
        ({'render_mode': 'human'}, r"render_mode: 'human' is not None or 'rgb_array'"),
        ({'parameters': {'plant_sim.body_mass': -1}}, r'plant_sim.body_mass: -1 is not within'),
        ({'parameters': {'plant_sim.duration': 3}}, r'no effect here: use the argument duration'),
        ({'parameters': {'gyro_driver.seed': 3}}, r'no effect here: use the seed or the options'),
        ({'parameters': {'encoder_driver.seed': 3}}, r'no effect here: use the seed or the opt'),
        ({'parameters': {'viewer.port': 3}}, r'viewer.port has no effect here; only'),
        ({'parameters': {'gyro_driver.faults': 'gyro_x off'}}, r'gyro_x off: environments have no'),
        ({'parameters': {'controller.user.kp': 3}}, r'user.kp has no effect here; of the'),
        ({'parameters': {'plant_sim': 3}}, r"'plant_sim' is not of the form node.param"),
        ({'parameters': {'plant_sim.map': 'moon'}}, r"unknown map 'moon'"),
        ({'parameters': 'missing.yaml'}, r'missing.yaml: No such file'),
        ({'parameters': 3}, r'parameters: 3 is neither a mapping nor a file'),
        ({'parameters': ''}, r"parameters: '' is neither a mapping nor a file"),
        ({'parameters': {'/**.seed': 3}}, r'\.seed has no effect here: use the seed'),
        ({'parameters': {'controller.k_i': 0.1}}, r'k_i has no effect here; of the control'),
        ({'parameters': {'plant_sim.hold_time': 0.0}}, r'held for 0 s, but calibrated for 1 s'),
        ({'parameters': {'controller.time_start': 2000}}, r'held for 1 s, but calibrated for 2 s'),
        ({'observation': np.zeros(2)}, r'observation: .* is not devices or state'),
        ({'step_ms': np.array([4])}, r'step_ms: .* is not 4 or 20'),
        ({'duration': np.array([3.0, 4.0])}, r'duration: .* is not within'),
        ({'duration': np.True_}, r'duration: .* is not within'),
    ],
)  # fmt: skip
def test_an_invalid_argument_is_told_in_one_line(arguments, message):
    with pytest.raises(BallbotError, match=message) as told:
        BalanceEnv(**arguments)
    assert '\n' not in str(told.value)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'pitch': 1.0}, r"options: unknown 'pitch'; known: start_pitch_x, start_pitch_y, seed"),
        ({'start_pitch_x': 2.0}, r'options: start_pitch_x: 2.0 is not within -1.5 … 1.5 rad'),
        ({'start_pitch_y': math.nan}, r'options: start_pitch_y: nan is not within'),
        ({'seed': -1}, r'options: seed: -1 is not within'),
        ({'commands': [(0.0, 1)]}, r'options: commands: .* are not \(time_s, x_percent, y_perc'),
        ({'commands': [(0.0, 1, 101)]}, r'options: commands: .* within ±100'),
        ({'commands': [(0.0, 1, 0.5)]}, r'options: commands: .* within ±100'),
        ({'commands': [(2.0, 1, 1), (1.0, 1, 1)]}, r'options: commands: .* rising times'),
        ({'commands': 3}, r'options: commands: 3 are not'),
        ({'commands': [(0.0, math.inf, 0)]}, r'options: commands: .* are not'),
        ({'commands': [(10**400, 1, 1)]}, r'options: commands: .* are not'),
        (3, r'options: 3 are no mapping'),
    ],
)
def test_an_invalid_option_is_told_in_one_line(options, message):
    with pytest.raises((EnvironmentConfigurationError, ParameterError), match=message) as told:
        DriveEnv().reset(options=options)
    assert '\n' not in str(told.value)


def test_a_refused_option_leaves_the_random_numbers_as_they_were():
    env, other = BalanceEnv(), BalanceEnv()
    for each in (env, other):
        each.reset(seed=1)
    with pytest.raises(EnvironmentConfigurationError):
        env.reset(seed=7, options={'pitch': 1.0})
    assert env.reset()[1]['seed'] == other.reset()[1]['seed']


def test_there_are_no_commands_to_balance():
    with pytest.raises(EnvironmentConfigurationError, match="unknown 'commands'"):
        BalanceEnv().reset(options={'commands': []})


def test_a_step_needs_a_reset():
    with pytest.raises(ResetNeeded):
        BalanceEnv().step(OFF)
    with pytest.raises(ResetNeeded):
        gymnasium.make('ballbot_ros.environments:ballbot_ros/Balance-v0').step(OFF)


def test_parameters_may_come_from_a_file(tmp_path):
    file = tmp_path / 'p.yaml'
    file.write_text('plant_sim:\n  ros__parameters: {battery_voltage: 7.0, duration: 3.0}\n')
    observation, _ = BalanceEnv(observation='state', parameters=file).reset()
    assert observation[-1] == 7.0


def test_every_component_is_on_the_page():
    page = (Path(__file__).parents[3] / 'docs/learning.md').read_text(encoding='utf-8')
    for observation in ('devices', 'state'):
        env = DriveEnv(observation=observation)
        assert [name for name in env.observation_names if f'`{name}`' not in page] == []
        low, high = env.observation_space.low, env.observation_space.high
        assert env.state_names == DriveEnv(observation='state').observation_names[:9]
        assert (low <= high).all()
