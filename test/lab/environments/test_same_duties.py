"""A policy gives the same duties in an environment and as a controller, bit for bit."""

import gymnasium
import numpy as np
import pytest
import yaml
from policies import DrivingPolicy, SlowPolicy, learned_policy

import ballbot_ros as bb
import ballbot_ros.environments

DURATION_S = 3.0


def run_episode(env_id, controller, **arguments):
    """Return the duties and states of an episode, and the info of its reset."""
    env = gymnasium.make(env_id, step_ms=controller.step_ms, duration=DURATION_S, **arguments)
    policy = controller.make_policy()
    observation, start = env.reset(seed=11)
    duties, states, over = [], [start['state']], False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy(observation.tolist()))
        duties.append(info['duty_percent'])
        states.append(info['state'])
        over = terminated or truncated
    return np.array(duties), np.array(states), start


def check_run(scenario, controller, duties, states, start, parameters=None, **arguments):
    """Compare an episode with the run of the controller from the same start."""
    names = ('start_pitch_x', 'start_pitch_y')
    run = bb.simulate(
        scenario,
        controller,
        seed=start['seed'],
        parameters={
            'plant_sim.duration': 1.0 + DURATION_S,
            **{f'plant_sim.{name}': start[name] for name in names},
            **(parameters or {}),
        },
        **arguments,
    )
    ticks = controller.step_ms // 4
    moved = run.trajectory.duty[250:]
    expected = np.repeat(duties, ticks, axis=0)
    assert len(np.unique(expected)) > 5
    np.testing.assert_array_equal(moved[: len(expected)], expected)
    pitch = run.trajectory.psi[250::ticks][: len(duties)]
    # A recorded pitch has been a quaternion.
    np.testing.assert_allclose(pitch, states[: len(duties), 4:6], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize('profile', ['ideal', 'hardware'])
@pytest.mark.parametrize('make', [learned_policy, SlowPolicy])
def test_balancing(make, profile):
    controller = make()
    found = run_episode('ballbot_ros/Balance-v0', controller, profile=profile)
    check_run('hardware_standing', controller, *found, profile=profile)


def test_balancing_with_dead_times():
    dead_times = {
        'plant_sim.actuator_delay': 1,
        'plant_sim.actuator_delay_jitter': 2,
        'gyro_driver.delay_jitter': 3,
        'encoder_driver.delay': 2,
    }
    controller = learned_policy()
    arguments = {'profile': 'hardware', 'parameters': dead_times}
    found = run_episode('ballbot_ros/Balance-v0', controller, **arguments)
    check_run('hardware_standing', controller, *found, **arguments)


@pytest.mark.parametrize('tick_us', [900.0, 3400.0])
def test_balancing_on_a_brick_whose_time_counts(tick_us):
    """A tick of 3.4 ms, and longer at random, is often not finished at the next one."""
    controller = learned_policy()
    time = {
        'plant_sim.kernel': True,
        'plant_sim.link': True,
        'controller.tick_time': tick_us,
        'controller.time_variation': 0.15,
        'controller.bus_cycles': 0.0,
    }
    found = run_episode('ballbot_ros/Balance-v0', controller, parameters=time)
    check_run('hardware_standing', controller, *found, profile='ideal', parameters=time)


def test_driving_with_sonar(tmp_path):
    place = {'plant_sim.map': 'track', 'plant_sim.start_position_x': 0.3}
    found = run_episode(
        'ballbot_ros/Drive-v0', DrivingPolicy(), profile='hardware', parameters=place
    )
    commands = found[-1]['commands']
    assert len(commands) == 1
    scenario = {
        'purpose': 'the commands of an episode',
        'duration': 4.0,
        'mode': 'remote',
        'sticks': {
            'vertical': [segment(each.time_s, -each.x_percent) for each in commands],
            'horizontal': [segment(each.time_s, each.y_percent) for each in commands],
        },
    }
    file = tmp_path / 'commands.yaml'
    file.write_text(yaml.safe_dump(scenario))
    check_run(file, DrivingPolicy(), *found, profile='hardware', parameters=place)


def segment(time_s, percent):
    return {'name': 'command', 'from': 1.0 + time_s, 'value': percent}
