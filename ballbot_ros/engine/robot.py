"""The constants of the whole robot, and the samples of its devices at a tick.

After them the controller acts, and then the plant moves: the lockstep imposes this order on the
graph, too.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.brick.battery_monitor import battery_mv
from ballbot_ros.brick.brick import NO_SAMPLE, Inputs
from ballbot_ros.engine.devices import (
    ENCODER_DELAY,
    GYRO_DELAY,
    SONAR_DELAY,
    EncoderConstants,
    GyroConstants,
    SonarConstants,
    encoder_constants,
    gyro_constants,
    read_encoder,
    read_gyro,
    read_sonar,
    sample_age,
    sonar_constants,
)
from ballbot_ros.engine.plant_tick import (
    STEP_VALUES,
    PlantConstants,
    PlantState,
    motor_angles,
    position,
)
from ballbot_ros.numerics.compiler_hints import inlined
from ballbot_ros.timing import BATTERY_PERIOD_NS, SLOW_PERIOD_NS, STEP_NS, TICK_NS


class RobotConstants(NamedTuple):
    """What does not change in a run, of the plant and of each device."""

    plant: PlantConstants
    gyro: GyroConstants
    encoder: EncoderConstants
    sonar: SonarConstants


def robot_constants(plant: PlantConstants, gyro: Any, encoder: Any, sonar: Any) -> RobotConstants:
    """Return the constants for those of the plant and the parameters of the devices.

    Parameters
    ----------
    gyro, encoder, sonar : row or namespace
        See :func:`~ballbot_ros.engine.numbers.numbers_of`.
    """
    return RobotConstants(
        plant, gyro_constants(gyro), encoder_constants(encoder), sonar_constants(sonar)
    )


def longest_age(constants: RobotConstants) -> int:
    """Return the longest dead time of all samples [steps]."""
    _, gyro, encoder, sonar = constants
    return max(gyro.delay + gyro.jitter, encoder.delay + encoder.jitter, sonar.delay + sonar.jitter)


@inlined
def sample(
    constants: RobotConstants,
    state: PlantState,
    vertical: int,
    horizontal: int,
    steps: Any,
    sides: Any,
) -> Inputs:
    """Return the samples that are due in a state.

    Parameters
    ----------
    vertical, horizontal : int
        The sticks.
    steps, sides : sequence of float, array of int32
        As in :func:`~ballbot_ros.engine.plant_tick.plant_tick`.
    """
    plant, gyro, encoder, sonar = constants
    now_ns = state.time_ns
    rate_x, rate_y = state.x[3], state.y[3]
    angle_x, angle_y = motor_angles(plant, state)
    if len(steps):
        at = kept_step(gyro.delay, gyro.jitter, gyro.key, GYRO_DELAY, TICK_NS, now_ns, steps)
        rate_x, rate_y = steps[at + 2], steps[at + 3]
        at = kept_step(
            encoder.delay, encoder.jitter, encoder.key, ENCODER_DELAY, TICK_NS, now_ns, steps
        )
        angle_x, angle_y = steps[at], steps[at + 1]
    gyro_x, gyro_y = read_gyro(gyro, rate_x, rate_y, now_ns)
    revolution_x, revolution_y = read_encoder(angle_x, angle_y)
    sonar_cm = reading_mv = NO_SAMPLE
    if now_ns % SLOW_PERIOD_NS == 0:
        x, y = position(plant, state)
        if len(steps):
            at = kept_step(
                sonar.delay, sonar.jitter, sonar.key, SONAR_DELAY, SLOW_PERIOD_NS, now_ns, steps
            )
            x, y = steps[at + 4], steps[at + 5]
        sonar_cm = read_sonar(sonar, x, y, sides, now_ns)
    else:
        vertical = horizontal = NO_SAMPLE
    if now_ns % BATTERY_PERIOD_NS == 0:
        # In its message the voltage has single precision.
        reading_mv = battery_mv(float(np.float32(state.volts)))
    return Inputs(
        gyro_x, gyro_y, revolution_x, revolution_y, sonar_cm, reading_mv, vertical, horizontal
    )


def kept_step(
    delay: int, jitter: int, key: Any, device: Any, period_ns: int, stamp_ns: int, steps: Any
) -> int:
    """Return where the step that a sample measures is in the ring of the kept ones."""
    age = sample_age(delay, jitter, key, device, period_ns, stamp_ns)
    return (stamp_ns // STEP_NS - age) % (len(steps) // STEP_VALUES) * STEP_VALUES
