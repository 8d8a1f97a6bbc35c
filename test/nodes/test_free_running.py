"""The free-running mode: wall-clock timers, newest sample wins."""

import pytest

from ballbot_ros.engine.trajectory import load_trajectory

pytestmark = pytest.mark.graph


DURATION_S = 2.5
PACES = (0.3, 0.1, 0.03, 0.01)
"""Real-time factors. If the robot falls, the next one is tried: the dead time that a slow or busy
machine adds counts less at a lower pace."""


def test_the_robot_balances_on_wall_clock_timers(start_node, tmp_path):
    for name in ('gyro_driver', 'encoder_driver', 'sonar_driver'):
        start_node(name)
    start_node('gamepad_teleop', lockstep='false')
    # Reduce the gain: at full gain the loop does not tolerate one more tick of dead time, as a busy
    # machine may add.
    start_node('controller', lockstep='false', pwm_gain=0.75)
    for pace in PACES:
        path = tmp_path / f'{pace}.npz'
        plant = start_node(
            'plant_sim',
            lockstep='false',
            duration=DURATION_S,
            start_pitch_x=0.02,
            real_time_factor=pace,
            trajectory_file=path,
        )
        assert plant.finish() == 0, plant.output
        trajectory, summary = load_trajectory(path)
        assert summary['ticks'] == round(DURATION_S * 250)
        if abs(trajectory.psi).max() < 0.2:
            # Accept a slow run only if ticks were late, on a busy machine.
            assert summary['real_time_factor'] < 1.1 * pace
            assert summary['real_time_factor'] > 0.5 * pace or summary['late_ticks'] > 0
            return
    raise AssertionError(f'it fell at every pace of {PACES}')
