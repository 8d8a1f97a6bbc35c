"""The free-running mode: wall-clock timers, newest sample wins."""

import pytest

from ballbot_ros.simulation.trajectory import load_trajectory

pytestmark = pytest.mark.graph


def test_the_robot_balances_on_wall_clock_timers(start_node, tmp_path):
    for name in ('gyro_driver', 'encoder_driver', 'sonar_driver'):
        start_node(name)
    start_node('gamepad_teleop', lockstep='false')
    start_node('controller', lockstep='false')
    plant = start_node(
        'plant_sim',
        lockstep='false',
        duration=4.0,
        start_pitch_x=0.02,
        real_time_factor=1.0,
        trajectory_file=tmp_path / 'trajectory.npz',
    )
    assert plant.finish() == 0, plant.output
    trajectory, summary = load_trajectory(tmp_path / 'trajectory.npz')
    assert abs(trajectory.psi).max() < 0.2
    assert summary['ticks'] == 1000
    assert 0.5 < summary['real_time_factor'] < 1.1


def test_without_a_controller_the_duty_is_zero(start_node, tmp_path):
    plant = start_node(
        'plant_sim',
        lockstep='false',
        startup_timeout=0.5,
        duration=2.0,
        start_pitch_x=0.02,
        hold_time=0.5,
        trajectory_file=tmp_path / 'trajectory.npz',
    )
    assert plant.finish() == 0, plant.output
    trajectory, _ = load_trajectory(tmp_path / 'trajectory.npz')
    assert not trajectory.duty.any()
    assert abs(trajectory.psi[-1, 0]) > 0.5
