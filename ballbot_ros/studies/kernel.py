"""A whole run as one function on numbers, which a compiler takes as it is.

The laws are those of the plant, the devices, the world and the control program; here is the order
in which a tick calls them, that of `ClosedLoop.tick`, `Plant.tick` and `ControlProgram.run`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.brick.battery_monitor import battery_mv
from ballbot_ros.brick.dead_time import drawn_delay, newest_effective, sample_age
from ballbot_ros.brick.encoder import encoder_reading
from ballbot_ros.brick.gyro import gyro_reading
from ballbot_ros.brick.noise import device_number, noise_bits, noise_key
from ballbot_ros.brick.sonar import sonar_reading
from ballbot_ros.brick.units import NO_ECHO_CM
from ballbot_ros.controllers.document.axis import (
    ZERO,
    calibrated_offset,
    constants_of,
    control,
    in_control,
)
from ballbot_ros.controllers.document.constants import Single
from ballbot_ros.controllers.document.program import (
    ControlMode,
    averaged_battery,
    held_distance,
    max_motor_voltage,
    next_mode,
    speed_command,
)
from ballbot_ros.numerics.random_numbers import normal, uniform
from ballbot_ros.parameters import PlantParameters, SonarParameters
from ballbot_ros.plant.actuator import motor_current, motor_voltage, supply_current
from ballbot_ros.plant.battery import capacity_slope, discharge
from ballbot_ros.plant.integration import (
    advance_linear,
    advance_nonlinear,
    discrete_matrices,
    equations_of,
)
from ballbot_ros.plant.model import gear_ratio, mass_matrix, torque_per_volt
from ballbot_ros.plant.plant import (
    add_push_forces,
    has_fallen,
    is_release,
    released,
    shaft_angle,
    state_after_fall,
    wheel_angle,
)
from ballbot_ros.plant.wall_contact import ball_position, planes_at_wall, state_after_impact
from ballbot_ros.scenario.signal import signal_value
from ballbot_ros.studies.rows import choice
from ballbot_ros.timing import (
    BATTERY_PERIOD_NS,
    FIRST_TICK_NS,
    MILLISECOND_NS,
    SECOND_NS,
    SLOW_PERIOD_NS,
    STEP_NS,
    STEPS_PER_TICK,
    TICK_NS,
)
from ballbot_ros.world.floor_map import CELL_M, map_point
from ballbot_ros.world.sonar_beam import beam_directions, nearest_echo
from ballbot_ros.world.world import Footprint, half_cells, is_blocked

STEP_S = STEP_NS * 1e-9
NEVER_NS = 2**62

LINEAR = choice(PlantParameters, 'plant_model', 'linear')
DRAINING = choice(PlantParameters, 'battery_model', 'draining')
STOP_AT_HIT = choice(PlantParameters, 'on_wall_hit', 'stop')
EXACT = choice(SonarParameters, 'distance_model', 'exact')

GYRO, GYRO_DRIFT, SONAR = (device_number(name) for name in ('gyro', 'gyro drift', 'sonar'))
GYRO_DELAY, ENCODER_DELAY, SONAR_DELAY, ACTUATOR_DELAY = (
    device_number(f'{name} delay') for name in ('gyro', 'encoder', 'sonar', 'actuator')
)


class Floor(NamedTuple):
    """The floor of all runs.

    Attributes
    ----------
    has_map : bool
        Whether there is a map; without one, the others are empty.
    sides, walls_before : ndarray of int32
        As in :class:`~ballbot_ros.world.world.Footprint`.
    """

    has_map: bool
    sides: Any
    walls_before: Any


class Events(NamedTuple):
    """Pushes and stick signals of a run.

    Attributes
    ----------
    push_times : ndarray of int64, shape (p, 2)
        Start and end of each push [ns].
    push_forces : ndarray of float64, shape (p, 2)
        Force on planes x and y [N].
    vertical, horizontal : ndarray of float64, shape (k, 2)
        Times [s] and values of the points of both stick signals, see
        :func:`~ballbot_ros.scenario.signal.signal_value`.
    """

    push_times: Any
    push_forces: Any
    vertical: Any
    horizontal: Any


class Log(NamedTuple):
    """Where a run is written, tick by tick; the columns are planes x and y.

    Attributes
    ----------
    position : ndarray of float64, shape (n, 2)
        Ball centre [m].
    psi : ndarray of float64, shape (n, 2)
        Body pitch [rad].
    duty : ndarray of int8, shape (n, 2)
        Duty [%].
    """

    position: Any
    psi: Any
    duty: Any


END = np.dtype([
    ('ticks', 'i8'),
    ('planes', 'f8', (2, 4)),
    ('shaft', 'f8', (2,)),
    ('voltage', 'f8', (2,)),
    ('charge', 'f8'),
    ('battery_voltage', 'f8'),
    ('fallen', '?'),
    ('stopped', '?'),
    ('in_contact', '?'),
])  # fmt: skip
"""The state at the end of a run: number of ticks, then as in `PlantState`."""


class Inputs(NamedTuple):
    """The newest samples at a tick, as in :class:`~ballbot_ros.brick.brick.DeviceInputs`."""

    gyro: Any
    revolutions: Any
    sonar_cm: Any
    battery_mv: Any
    sticks: Any


class ProgramState(NamedTuple):
    """The state of the control program that the duties depend on, see `ControlProgram`.

    Attributes
    ----------
    x, y : AxisState
        Of the planes.
    errors : tuple of Single
        theta_diff and psi_diff of plane x, then of plane y.
    ts2_ms, ts3_ms : int
        When these tasks are due [ms]: a comparison is faster than a remainder.
    """

    x: Any
    y: Any
    errors: Any
    control_mode: Any
    battery: Any
    distance_cm: Any
    echo_time: Any
    flag_avoid: Any
    flag_auto: Any
    timer_stop: Any
    sonar_reply: Any
    ts2_ms: Any
    ts3_ms: Any


def run_tasks(
    program: Any, constants: Any, state: Any, inputs: Any, elapsed_ms: int, now_ms: int
) -> Any:
    """Run the tasks due `elapsed_ms` after the start; return the state and the duties [%].

    The start is a whole second, so that the program's time since its start is `elapsed_ms`.

    Parameters
    ----------
    program : row
        Constants of the program.
    constants : tuple
        Those of its law.
    """
    (
        x, y, errors, control_mode, battery, distance_cm, echo_time,
        flag_avoid, flag_auto, timer_stop, sonar_reply, ts2_ms, ts3_ms,
    ) = state  # fmt: skip
    gyro_x, gyro_y = inputs.gyro
    if elapsed_ms == 0:  # task_init
        battery = Single(inputs.battery_mv)
        x = (Single(gyro_x), x[1], x[2], x[3], x[4], x[5])
        y = (Single(gyro_y), y[1], y[2], y[3], y[4], y[5])

    # task_ts1
    duty_x = duty_y = 0
    if control_mode == ControlMode.CONTROL:
        # A packet waits until it is read, so the newest one counts.
        stick_x, stick_y = speed_command(
            program.autonomous, flag_avoid, flag_auto, inputs.sticks, program.gp_max
        )
        volts = max_motor_voltage(battery)
        revolution_x, revolution_y = inputs.revolutions
        x, estimates_x, percent_x = control(
            constants, x, Single(gyro_x), Single(revolution_x), Single(stick_x), volts
        )
        y, estimates_y, percent_y = control(
            constants, y, Single(gyro_y), Single(revolution_y), Single(stick_y), volts
        )
        errors = estimates_x[5], estimates_x[6], estimates_y[5], estimates_y[6]
        duty_x, duty_y = int(percent_x), int(percent_y)
    elif control_mode == ControlMode.CALIBRATION:
        x = (calibrated_offset(x[0], gyro_x, program.a_gc), x[1], x[2], x[3], x[4], x[5])
        y = (calibrated_offset(y[0], gyro_y, program.a_gc), y[1], y[2], y[3], y[4], y[5])

    if elapsed_ms == ts2_ms:  # task_ts2
        ts2_ms += program.ts2_period
        sonar_cm, sonar_reply = sonar_reply, inputs.sonar_cm
        distance_cm, echo_time = held_distance(
            distance_cm, echo_time, sonar_cm, now_ms, program.sonar_hold
        )
        flag_avoid = distance_cm <= program.dst_thr

    if elapsed_ms == ts3_ms:  # task_ts3
        ts3_ms += program.ts3_period
        battery = averaged_battery(battery, inputs.battery_mv, program.a_b)
        flag_auto = elapsed_ms >= program.time_auto
        theta_limit, psi_limit = program.theta_diff_thr, program.psi_diff_thr
        is_in_control = in_control(errors[0], errors[1], theta_limit, psi_limit) and in_control(
            errors[2], errors[3], theta_limit, psi_limit
        )
        control_mode, timer_stop = next_mode(
            elapsed_ms, timer_stop, is_in_control,
            elapsed_ms >= program.time_start, program.time_stop,
        )  # fmt: skip

    state = ProgramState(
        x, y, errors, control_mode, battery, distance_cm, echo_time,
        flag_avoid, flag_auto, timer_stop, sonar_reply, ts2_ms, ts3_ms,
    )  # fmt: skip
    return state, duty_x, duty_y


def sample_bits(device: Any, key: Any, index: int) -> Any:
    """Return the random bits of sample `index`, see :func:`~ballbot_ros.brick.noise.noise_bits`."""
    low, high = noise_bits(np.uint64(index & 0xFFFFFFFF), np.uint64(index >> 32), device, key)
    return np.int64(low), np.int64(high)


def delay_of(delay: int, jitter: int, device: Any, key: Any, index: int) -> int:
    """Return the dead time [steps] of sample or duty `index`, as `DeadTime.delay` does."""
    if not jitter:
        return delay
    return drawn_delay(delay, jitter, uniform(sample_bits(device, key, index)[0]))


def age_of(
    delay: int, jitter: int, device: Any, key: Any, stamp_ns: int, period_ns: int, drawn: Any
) -> int:
    """Return the age [steps] of a sample, as `DeadTime.age` does; `drawn` is overwritten."""
    period = period_ns // STEP_NS
    index = stamp_ns // period_ns
    earlier = jitter // period + 1
    for each in range(earlier):
        drawn[each] = delay_of(delay, jitter, device, key, index - each)
    return sample_age(drawn[:earlier], period)


def push_forces(
    events: Any, now_ns: int, plane: int, psi: float, ball_radius: float, body_height: float
) -> Any:
    """Return the generalised forces [N·m] of the active pushes on theta and psi of a plane."""
    force_theta = force_psi = 0.0
    for each in range(len(events.push_times)):
        if events.push_times[each, 0] <= now_ns < events.push_times[each, 1]:
            force_theta, force_psi = add_push_forces(
                force_theta, force_psi, events.push_forces[each, plane], 0.0,
                psi, ball_radius, body_height,
            )  # fmt: skip
    return force_theta, force_psi


def simulate_run(
    plant: Any,
    gyro: Any,
    encoder: Any,
    sonar: Any,
    program: Any,
    floor: Any,
    events: Any,
    log: Any,
    end: Any,
) -> None:
    """Run a robot under the document's control program to its end.

    Parameters
    ----------
    plant, gyro, encoder, sonar : row
        The parameters of the nodes.
    program : row
        The constants of the program.
    floor : Floor
        The walls.
    events : Events
        Pushes and sticks.
    log : Log
        Where the run is written; long enough.
    end : row of END
        Where its end is written.
    """
    start_ns = FIRST_TICK_NS
    key = noise_key(plant.seed)

    linear = plant.plant_model == LINEAR
    transition, force_coefficients = discrete_matrices(plant, STEP_S)
    equations, alpha, mass = equations_of(plant), torque_per_volt(plant), mass_matrix(plant)
    ratio, radius, height = gear_ratio(plant), plant.ball_radius, plant.body_height
    back_emf, ohms = plant.back_emf_constant * ratio, plant.motor_resistance
    dead_zone = plant.dead_zone
    volt_slope, volt_offset = plant.voltage_slope, plant.voltage_offset
    start = plant.start_position_x, plant.start_position_y
    start_psi_x, start_psi_y = plant.start_pitch_x, plant.start_pitch_y
    hold_until = start_ns + round(plant.hold_time * 1e9)
    fall_angle, half_play = plant.fall_angle, plant.backlash / 2.0
    stops_at_hit = plant.on_wall_hit == STOP_AT_HIT
    rows, columns = floor.sides.shape
    footprint = Footprint(
        floor.sides, floor.walls_before, half_cells(plant.body_depth), half_cells(plant.body_width)
    )
    draining = plant.battery_model == DRAINING
    charge_slope = capacity_slope(plant.battery_capacity)
    pushes = len(events.push_times)

    drift_x, drift_y = sample_bits(GYRO_DRIFT, key, 0)
    drift_period_ns = round(gyro.drift_period * 1e9)
    gyro_x = (
        gyro.zero_rate_offset_x, gyro.rate_limit, gyro.noise, gyro.drift, drift_period_ns,
        uniform(drift_x),
    )  # fmt: skip
    gyro_y = (
        gyro.zero_rate_offset_y, gyro.rate_limit, gyro.noise, gyro.drift, drift_period_ns,
        uniform(drift_y),
    )  # fmt: skip

    x, y = (0.0, start_psi_x, 0.0, 0.0), (0.0, start_psi_y, 0.0, 0.0)
    shaft_x = shaft_y = 0.0
    voltage_x = voltage_y = 0.0
    charge, battery_voltage = 0.0, plant.battery_voltage
    fallen = stopped = False
    since_sample = in_contact = False

    # Dead times: the latest steps, and the latest duties, each in a ring.
    longest = max(
        gyro.delay + gyro.delay_jitter, encoder.delay + encoder.delay_jitter,
        sonar.delay + sonar.delay_jitter,
    )  # fmt: skip
    kept = longest + 1
    steps = np.zeros((kept, 6))
    newest = 0
    steps[:, 4], steps[:, 5] = start
    drawn = np.zeros(32, np.int64)
    delayed = plant.actuator_delay + plant.actuator_delay_jitter > 0
    waiting = -(-(plant.actuator_delay + plant.actuator_delay_jitter) // STEPS_PER_TICK) + 1
    effects_ns = np.full(waiting, NEVER_NS)
    waiting_duties = np.zeros((waiting, 2), np.int64)

    directions = beam_directions(sonar.cone_angle, sonar.cone_rays)
    sonar_cm, reading_mv, sticks = NO_ECHO_CM, 0, (0, 0)
    rest = (ZERO, ZERO, ZERO, ZERO, ZERO, ZERO)
    state = ProgramState(
        rest, rest, (ZERO, ZERO, ZERO, ZERO), ControlMode.CALIBRATION, ZERO, NO_ECHO_CM, 0,
        False, False, 0, 0, 0, 0,
    )  # fmt: skip
    constants = constants_of(program)

    ticks = round(plant.duration * SECOND_NS) // TICK_NS
    done = 0
    for tick in range(ticks):
        now_ns = start_ns + tick * TICK_NS
        position = ball_position(start, radius, x[0], y[0])
        log.position[tick, 0], log.position[tick, 1] = position
        log.psi[tick, 0], log.psi[tick, 1] = x[1], y[1]

        # The samples of the devices
        rate_x, rate_y = x[3], y[3]
        angle_x = shaft_x if half_play else wheel_angle(ratio, x[0], x[1], start_psi_x)
        angle_y = shaft_y if half_play else wheel_angle(ratio, y[0], y[1], start_psi_y)
        if longest:
            age = age_of(gyro.delay, gyro.delay_jitter, GYRO_DELAY, key, now_ns, TICK_NS, drawn)
            at = (newest - age) % kept
            rate_x, rate_y = steps[at, 2], steps[at, 3]
            age = age_of(
                encoder.delay, encoder.delay_jitter, ENCODER_DELAY, key, now_ns, TICK_NS, drawn
            )
            at = (newest - age) % kept
            angle_x, angle_y = steps[at, 0], steps[at, 1]
        error_x = error_y = 0.0
        if gyro.noise:
            bits_x, bits_y = sample_bits(GYRO, key, now_ns // TICK_NS)
            error_x, error_y = normal(bits_x), normal(bits_y)
        if now_ns % SLOW_PERIOD_NS == 0:
            distance_m = np.inf
            if floor.has_map:
                if longest:
                    age = age_of(
                        sonar.delay, sonar.delay_jitter, SONAR_DELAY, key, now_ns,
                        SLOW_PERIOD_NS, drawn,
                    )  # fmt: skip
                    at = (newest - age) % kept
                    position = steps[at, 4], steps[at, 5]
                sensor = map_point(
                    columns, rows, (position[0] + sonar.body_depth / 2.0, position[1])
                )
                distance_m = CELL_M * nearest_echo(
                    floor.sides, sensor, directions, sonar.distance_model == EXACT
                )
            chance, error = sample_bits(SONAR, key, now_ns // SLOW_PERIOD_NS)
            sonar_cm = sonar_reading(
                distance_m, uniform(chance), uniform(error), sonar.noise_cm,
                sonar.dropout_probability, sonar.min_range_cm, sonar.max_range_cm,
            )  # fmt: skip
            elapsed_s = (now_ns - start_ns) * 1e-9
            sticks = (
                signal_value(events.vertical[:, 0], events.vertical[:, 1], elapsed_s),
                signal_value(events.horizontal[:, 0], events.horizontal[:, 1], elapsed_s),
            )
        if now_ns % BATTERY_PERIOD_NS == 0:
            # In its message the voltage has single precision.
            reading_mv = battery_mv(float(np.float32(battery_voltage)))
        inputs = Inputs(
            (
                gyro_reading(gyro_x, rate_x, error_x, now_ns),
                gyro_reading(gyro_y, rate_y, error_y, now_ns),
            ),
            (encoder_reading(angle_x), encoder_reading(angle_y)),
            sonar_cm, reading_mv, sticks,
        )  # fmt: skip

        # The control program
        elapsed_ms = (now_ns - start_ns) // MILLISECOND_NS
        state, duty_x, duty_y = run_tasks(
            program, constants, state, inputs, elapsed_ms, now_ns // MILLISECOND_NS
        )
        log.duty[tick, 0], log.duty[tick, 1] = duty_x, duty_y
        done = tick + 1

        # The plant
        if delayed:
            for each in range(waiting - 1, 0, -1):
                effects_ns[each] = effects_ns[each - 1]
                waiting_duties[each, 0] = waiting_duties[each - 1, 0]
                waiting_duties[each, 1] = waiting_duties[each - 1, 1]
            effects_ns[0] = now_ns + STEP_NS * delay_of(
                plant.actuator_delay, plant.actuator_delay_jitter, ACTUATOR_DELAY, key,
                now_ns // TICK_NS,
            )  # fmt: skip
            waiting_duties[0, 0], waiting_duties[0, 1] = duty_x, duty_y
        if not (delayed or draining):
            voltage_x = motor_voltage(duty_x, battery_voltage, dead_zone, volt_slope, volt_offset)
            voltage_y = motor_voltage(duty_y, battery_voltage, dead_zone, volt_slope, volt_offset)
        for _ in range(STEPS_PER_TICK):
            if delayed:
                number = newest_effective(effects_ns, now_ns)
                duty_x = waiting_duties[number, 0] if number >= 0 else 0
                duty_y = waiting_duties[number, 1] if number >= 0 else 0
            if delayed or draining:
                voltage_x = motor_voltage(
                    duty_x, battery_voltage, dead_zone, volt_slope, volt_offset
                )
                voltage_y = motor_voltage(
                    duty_y, battery_voltage, dead_zone, volt_slope, volt_offset
                )
            if draining:
                current = supply_current(
                    duty_x, duty_y,
                    motor_current(voltage_x, x[2], x[3], back_emf, ohms),
                    motor_current(voltage_y, y[2], y[3], back_emf, ohms),
                )  # fmt: skip
                charge, battery_voltage = discharge(
                    charge, current, STEP_S, plant.idle_current,
                    plant.battery_voltage, charge_slope, plant.battery_resistance,
                )  # fmt: skip
            if now_ns >= hold_until and not fallen:
                if is_release(now_ns, hold_until):
                    x = released(x, plant.start_pitch_rate_x)
                    y = released(y, plant.start_pitch_rate_y)
                before = x, y
                force_x = force_y = (0.0, 0.0)
                if pushes:
                    force_x = push_forces(events, now_ns, 0, x[1], radius, height)
                    force_y = push_forces(events, now_ns, 1, y[1], radius, height)
                if linear:
                    x = advance_linear(
                        transition, force_coefficients, x, voltage_x, force_x[0], force_x[1]
                    )
                    y = advance_linear(
                        transition, force_coefficients, y, voltage_y, force_y[0], force_y[1]
                    )
                else:
                    x = advance_nonlinear(
                        equations, alpha, STEP_S, x, voltage_x, force_x[0], force_x[1]
                    )
                    y = advance_nonlinear(
                        equations, alpha, STEP_S, y, voltage_y, force_y[0], force_y[1]
                    )
                if floor.has_map and is_blocked(
                    footprint, ball_position(start, radius, x[0], y[0])
                ):
                    stopped_x = state_after_impact(before[0], x, mass, linear)
                    stopped_y = state_after_impact(before[1], y, mass, linear)
                    x, y = planes_at_wall(
                        (x, y),
                        (stopped_x, stopped_y),
                        not is_blocked(footprint, ball_position(start, radius, x[0], stopped_y[0])),
                        not is_blocked(footprint, ball_position(start, radius, stopped_x[0], y[0])),
                    )
                    since_sample = True
                if has_fallen(x[1], y[1], fall_angle):
                    fallen = True
                    x, y = state_after_fall(x, fall_angle), state_after_fall(y, fall_angle)
                if half_play:
                    shaft_x = shaft_angle(
                        shaft_x, wheel_angle(ratio, x[0], x[1], start_psi_x), half_play
                    )
                    shaft_y = shaft_angle(
                        shaft_y, wheel_angle(ratio, y[0], y[1], start_psi_y), half_play
                    )
            now_ns += STEP_NS
            if longest:
                newest = (newest + 1) % kept
                steps[newest, 0] = (
                    shaft_x if half_play else wheel_angle(ratio, x[0], x[1], start_psi_x)
                )
                steps[newest, 1] = (
                    shaft_y if half_play else wheel_angle(ratio, y[0], y[1], start_psi_y)
                )
                steps[newest, 2], steps[newest, 3] = x[3], y[3]
                steps[newest, 4], steps[newest, 5] = ball_position(start, radius, x[0], y[0])
        if floor.has_map and now_ns % SLOW_PERIOD_NS == 0:
            in_contact, since_sample = since_sample, False
            if in_contact and stops_at_hit:
                stopped = True
                voltage_x = voltage_y = 0.0
                break

    end.ticks = done
    for each in range(4):
        end.planes[0, each], end.planes[1, each] = x[each], y[each]
    end.shaft[0], end.shaft[1] = shaft_x, shaft_y
    end.voltage[0], end.voltage[1] = voltage_x, voltage_y
    end.charge, end.battery_voltage = charge, battery_voltage
    end.fallen, end.stopped, end.in_contact = fallen, stopped, in_contact


def simulate_runs(
    plants: Any,
    gyros: Any,
    encoders: Any,
    sonars: Any,
    programs: Any,
    floor: Any,
    events: Any,
    log: Any,
    ends: Any,
) -> None:
    """Simulate a run for each row of the tables.

    The arrays of `events` and `log` have one dimension more, the first: that of the runs. If it
    has a length of one, all runs have the same events.
    """
    for run in range(len(plants)):
        own = run if len(events.vertical) > 1 else 0
        at = Events(
            events.push_times[own], events.push_forces[own],
            events.vertical[own], events.horizontal[own],
        )  # fmt: skip
        to = Log(log.position[run], log.psi[run], log.duty[run])
        simulate_run(
            plants[run], gyros[run], encoders[run], sonars[run], programs[run], floor, at, to,
            ends[run],
        )  # fmt: skip
