"""A drive by hand: its settings and its exit status."""

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.parameters import PlantParameters
from ballbot_ros.run import drive
from ballbot_ros.run.drive import DriveOptions, drive_spec


def test_a_drive_is_in_real_time_and_survives_walls():
    """An assignment overrides everything; y in the frame map has the opposite sign of plane y."""
    plant = drive_spec(DriveOptions(start=(1.5, 0.5))).parameters.of(PlantParameters)
    assert (plant.real_time_factor, plant.on_wall_hit) == (1.0, 'report')
    assert (plant.start_position_x, plant.start_position_y) == (1.5, -0.5)
    words = ('plant_sim.real_time_factor=0.5', 'plant_sim.on_wall_hit=stop')
    plant = drive_spec(DriveOptions(assignments=words)).parameters.of(PlantParameters)
    assert (plant.real_time_factor, plant.on_wall_hit) == (0.5, 'stop')


def test_a_mistake_of_the_user_gives_the_exit_status_before_any_other_failure():
    for failure, ends, gamepad, expected in (
        ('', [0, 0], 0, 0),
        ('', [0, 0], 1, 1),
        ('', [0, 1], 0, 1),
        ('', [1, 2], 1, 2),
        ('plant_sim was killed by SIGKILL', [-9, 0], 0, 1),
        ('gyro_driver ended with status 2', [0, 2], 0, 2),
    ):
        found = drive._exit_status(failure, ends, gamepad)
        assert found == expected, (failure, ends, gamepad)
