"""Parameters of the plant and of the run that it conducts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from ballbot_ros.parameters.brick_time import KernelChoice, LinkParameters
from ballbot_ros.parameters.nodes import (
    BrickFaults,
    DeviceSeed,
    Dimensions,
    LockstepChoice,
    MapChoice,
    Masses,
    ScenarioChoice,
)
from ballbot_ros.parameters.parameter import (
    NodeParameters,
    TakesEffect,
    dead_time,
    live,
    path,
    quantity,
    setting,
)


@dataclass(frozen=True, kw_only=True)
class PlantParameters(
    Dimensions,
    Masses,
    MapChoice,
    ScenarioChoice,
    LockstepChoice,
    DeviceSeed,
    BrickFaults,
    KernelChoice,
    LinkParameters,
    NodeParameters,
):
    """The parameters of ``plant_sim``."""

    node: ClassVar[str] = 'plant_sim'

    gravity: float = quantity(9.81, 'm/s²', (0.0, 100.0), 'gravity acceleration g', '3.1')
    motor_inertia: float = quantity(1e-05, 'kg·m²', (0.0, 1.0), 'DC motor inertia Jm', '3.1')
    motor_resistance: float = quantity(6.69, 'Ω', (1e-3, 1000.0), 'DC motor resistance Rm', '3.1')
    back_emf_constant: float = quantity(
        0.468, 'V·s/rad', (0.0, 100.0), 'back EMF constant Kb', '3.1'
    )
    torque_constant: float = quantity(0.317, 'N·m/A', (0.0, 100.0), 'torque constant Kt', '3.1')
    motor_friction: float = quantity(
        0.0022, 'N·m·s/rad', (0.0, 10.0), 'friction body to motor fm', '3.1'
    )
    ball_friction: float = quantity(
        0.0, 'N·m·s/rad', (0.0, 10.0), 'friction ball to floor fs', '3.1'
    )
    plant_model: Literal['linear', 'nonlinear'] = setting(
        'linear', 'equations of motion: (3.20)-(3.21) or (3.11)-(3.12)', '3.2, 3.3'
    )
    start_pitch_x: float = quantity(
        0.0, 'rad', (-1.5, 1.5), 'body pitch at the start, plane x', '8.2'
    )
    start_pitch_y: float = quantity(
        0.0, 'rad', (-1.5, 1.5), 'body pitch at the start, plane y', '8.2'
    )
    start_pitch_rate_x: float = quantity(
        0.0, 'rad/s', (-20.0, 20.0), 'rate of the body pitch at the release, plane x'
    )
    start_pitch_rate_y: float = quantity(
        0.0, 'rad/s', (-20.0, 20.0), 'rate of the body pitch at the release, plane y'
    )
    start_position_x: float = quantity(
        0.0, 'm', (-1000.0, 1000.0), 'ball position at the start, plane x', '3.2'
    )
    start_position_y: float = quantity(
        0.0, 'm', (-1000.0, 1000.0), 'ball position at the start, plane y', '3.2'
    )
    hold_time: float = quantity(
        1.0, 's', (0.0, 1e6), 'time from the start for which the robot is held still', '6.3'
    )
    fall_angle: float = quantity(
        math.pi / 3, 'rad', (0.1, 1.5), 'body pitch beyond which the robot has fallen'
    )
    on_wall_hit: Literal['stop', 'report'] = setting(
        'stop', 'reaction to a wall hit: end the run as failed, or report it and continue', 'B.3'
    )
    dead_zone: float = quantity(0.0, '%', (0.0, 50.0), 'duty lost to friction', '6.2')
    actuator_delay: int = dead_time('time until a duty takes effect')
    actuator_delay_jitter: int = dead_time('largest random addition to the delay')
    backlash: float = quantity(0.0, 'rad', (0.0, 0.5), 'motor gear play, end to end', '2.2')
    voltage_slope: float = quantity(
        0.001089, 'V/mV', (0.0, 1.0), 'motor voltage per battery voltage', '(6.1)'
    )
    voltage_offset: float = quantity(
        -0.625, 'V', (-10.0, 10.0), 'motor voltage at zero battery voltage', '(6.1)'
    )
    battery_model: Literal['constant', 'draining'] = setting(
        'constant', 'constant voltage, or one that sags with current and falls with charge'
    )
    battery_voltage: float = quantity(
        8.0, 'V', (1.0, 12.0), 'open-circuit battery voltage at the start', '6.2'
    )
    battery_resistance: float = quantity(
        0.6, 'Ω', (0.0, 10.0), 'internal resistance, draining model'
    )
    battery_capacity: float = quantity(
        7200.0,
        'C',
        (1.0, 1e6),
        'charge from a fresh battery (9.5 V) to a low one (7 V), draining model',
    )
    idle_current: float = quantity(0.1, 'A', (0.0, 10.0), 'current of the brick, draining model')
    push_duration: float = live(0.1, 's', (1e-3, 10.0), 'duration of a plant/push')
    real_time_factor: float = quantity(
        1.0,
        '1',
        (0.01, 1000.0),
        'pace against the wall clock; 0: as fast as possible',
        or_zero=True,
        takes_effect=TakesEffect.IMMEDIATELY,
    )
    start_paused: bool = setting(
        False, 'true: the first run is paused at its first tick, until plant_sim/start or pause'
    )
    duration: float = quantity(0.0, 's', (0.0, 1e6), 'length of the run; 0: until stopped')
    timeout: float = quantity(2.0, 's', (0.2, 3600.0), 'silence after which the run fails')
    startup_timeout: float = quantity(
        30.0, 's', (0.2, 3600.0), 'silence before the first tick after which the run fails'
    )
    on_timeout: Literal['end', 'wait'] = setting(
        'end', 'reaction to a silence: end with an error, or wait for the participant'
    )
    require_recorder: bool = setting(
        False, 'true: the first tick waits for a recorder, so that it misses nothing'
    )
    trajectory_file: str = path(
        'file for the true trajectory (.npz), written at the end; empty: none'
    )
