"""One tick of the plant: four steps of both planes under held duties."""

from __future__ import annotations

from typing import Any, NamedTuple

from ballbot_ros.engine.devices import choice, uniform_pair
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.timing import (
    BATTERY_PERIOD_NS,
    SLOW_PERIOD_NS,
    STEP_NS,
    STEPS_PER_TICK,
    TICK_NS,
)
from ballbot_ros.robot.arithmetic import Ints, Reals, sine_cosine
from ballbot_ros.robot.brick.link import link_of
from ballbot_ros.robot.brick.sensors import drawn_delay
from ballbot_ros.robot.compiler_hints import inlined
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES, Pair
from ballbot_ros.robot.plant.integration import (
    Equations,
    ForceCoefficients,
    LinearRates,
    PlaneState,
    TransitionCoefficients,
    advance_linear,
    advance_nonlinear,
    discrete_matrices,
    equations_of,
    linear_rates,
    response_to_volt,
    superposed,
)
from ballbot_ros.robot.plant.laws import (
    ball_position,
    capacity_slope,
    discharge,
    motor_current,
    motor_voltage,
    shaft_angle,
    state_after_fall,
    state_after_impact,
    wheel_angle,
)
from ballbot_ros.robot.plant.model import MassMatrix, gear_ratio, mass_matrix, torque_per_volt
from ballbot_ros.robot.random_numbers import Key, device_number, noise_key
from ballbot_ros.robot.world.world import Cells, Footprint, half_cells, is_blocked

STEP_S = STEP_NS * 1e-9
NEVER_NS = 2**62

LINEAR = choice(PlantParameters, 'plant_model', 'linear')
DRAINING = choice(PlantParameters, 'battery_model', 'draining')
STOP_AT_HIT = choice(PlantParameters, 'on_wall_hit', 'stop')
ACTUATOR_DELAY = device_number('actuator delay')

LATEST_DUTY = 20
"""Most steps after its tick after which a duty leaves the brick and acts."""

PUSH_VALUES = 4
"""Numbers of a push: forces [N] and torques [N·m] on planes x and y."""


class PlantConstants(NamedTuple):
    """What does not change in a run; in SI units, times in ns.

    Attributes
    ----------
    transition, force_coefficients : tuple of float
        Of the linear model, see :func:`~ballbot_ros.robot.plant.integration.discrete_matrices`.
    rates : tuple of float
        Of the linear model, see :func:`~ballbot_ros.robot.plant.integration.linear_rates`.
    equations : tuple of float
        Of the nonlinear model, see :func:`~ballbot_ros.robot.plant.integration.equations_of`.
    alpha : float
        Torque of a motor per voltage [N·m/V].
    mass : MassMatrix
        For impacts.
    ratio, radius, height : float
        Gear ratio k, ball radius Rs, and height L of the body's centre.
    back_emf, ohms : float
        k Kb [V·s/rad] and Rm [Ohm].
    dead_zone, volt_slope, volt_offset : float
        As in :func:`~ballbot_ros.robot.plant.laws.motor_voltage`.
    start_x, start_y, start_psi_x, start_psi_y, start_rate_x, start_rate_y : float
        Position, pitch and pitch rate at the start.
    hold_until_ns : int
        Sim time at which the robot is let go.
    fall_angle, half_play : float
        Pitch of a fallen robot, and half of the gear play [rad].
    idle_current, full_volts, charge_slope, battery_ohms : float
        As in :func:`~ballbot_ros.robot.plant.laws.discharge`.
    stops_at_hit : bool
        Whether a wall hit ends the run.
    half_u, half_v : float
        Half of the body's depth and width [cells].
    actuator_delay, actuator_jitter : int
        Dead time of the motors [steps].
    has_late_duties : bool
        Whether duties may take effect later than they are commanded.
    battery_age_ns : int
        Age of the battery's samples.
    """

    is_linear: bool
    transition: TransitionCoefficients
    force_coefficients: ForceCoefficients
    rates: LinearRates
    equations: Equations
    alpha: float
    mass: MassMatrix
    ratio: float
    radius: float
    height: float
    back_emf: float
    ohms: float
    dead_zone: float
    volt_slope: float
    volt_offset: float
    start_x: float
    start_y: float
    start_psi_x: float
    start_psi_y: float
    start_rate_x: float
    start_rate_y: float
    hold_until_ns: int
    fall_angle: float
    half_play: float
    is_draining: bool
    idle_current: float
    full_volts: float
    charge_slope: float
    battery_ohms: float
    stops_at_hit: bool
    half_u: float
    half_v: float
    actuator_delay: int
    actuator_jitter: int
    has_late_duties: bool
    battery_age_ns: int
    key: Key


class PlantState(NamedTuple):
    """Everything in a plant that changes with time, but for its buffers.

    Attributes
    ----------
    shaft_x, shaft_y : float
        Angles of the motor shafts [rad], if the gears have play.
    voltage_x, voltage_y : float
        Motor voltages [V].
    charge, volts : float
        Charge drawn from the battery [A·s], and its terminal voltage without a fault [V].
    measured_volts : float
        The voltage that a sample now has [V].
    pushes : int
        Number of active and pending pushes.
    is_fallen, is_stopped : bool
        Whether the body has fallen; whether a wall hit has ended the run, so that the motors are
        off.
    since_sample, in_contact : bool
        Whether there was a wall hit since the last multiple of 20 ms, and in the 20 ms up to it.
    hit_ns : int
        When the newest contact with a wall began; -1 before the first.
    hit_x, hit_y, tried_x, tried_y : float
        Where the ball was stopped then, and where it would have been without walls [m].
    """

    time_ns: int
    x: PlaneState
    y: PlaneState
    shaft_x: float
    shaft_y: float
    voltage_x: float
    voltage_y: float
    charge: float
    volts: float
    measured_volts: float
    pushes: int
    is_fallen: bool
    is_stopped: bool
    since_sample: bool
    in_contact: bool
    hit_ns: int
    hit_x: float
    hit_y: float
    tried_x: float
    tried_y: float


def initial_state(
    constants: PlantConstants, start_ns: int, pushes: int = 0, drop: float = 0.0
) -> PlantState:
    """Return the state at the first tick, with a number of pushes and a fall of the voltage [V]."""
    return PlantState(
        start_ns,
        (0.0, constants.start_psi_x, 0.0, 0.0),
        (0.0, constants.start_psi_y, 0.0, 0.0),
        0.0, 0.0, 0.0, 0.0, 0.0, constants.full_volts, max(0.0, constants.full_volts - drop),
        pushes, False, False, False, False, -1, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip


@inlined
def plant_tick(
    constants: PlantConstants,
    state: PlantState,
    duty_x: int,
    duty_y: int,
    delay_ns: int,
    push_times: Ints,
    push_forces: Reals,
    effects_ns: Ints,
    waiting_duties: Ints,
    steps: Reals,
    sides: Cells,
    walls_before: Cells,
    drop: float,
    next_drop: float,
) -> PlantState:
    """Return the state 4 ms later, under duties [%] commanded now.

    Parameters
    ----------
    delay_ns : int
        Time until the duties leave the brick. It counts only if `has_late_duties`.
    push_times, push_forces : sequence of int, sequence of float
        Start and end [ns] of each push, and its :data:`PUSH_VALUES`; both are changed.
    effects_ns, waiting_duties : sequence of int
        The newest duties, in rings: when each takes effect, and its two values; both are changed.
    steps : sequence of float
        The newest steps, STEP_VALUES each, in a ring that is changed; empty for none.
    sides, walls_before : array of int32
        As in :class:`~ballbot_ros.robot.world.world.Footprint`; without rows if there are no walls.
    drop, next_drop : float
        By how much a fault lowers the battery's voltage, now and at the next tick [V].
    """
    (
        is_linear, transition, force_coefficients, rates, equations, alpha, mass,
        ratio, radius, height, back_emf, ohms, dead_zone, volt_slope, volt_offset,
        start_x, start_y, start_psi_x, start_psi_y, start_rate_x, start_rate_y,
        hold_until_ns, fall_angle, half_play,
        is_draining, idle_current, full_volts, charge_slope, battery_ohms,
        stops_at_hit, half_u, half_v, actuator_delay, actuator_jitter, has_late_duties,
        battery_age_ns, key,
    ) = constants  # fmt: skip
    (
        time_ns, x, y, shaft_x, shaft_y, voltage_x, voltage_y, charge, volts, measured_volts,
        pushes,
        is_fallen, is_stopped, since_sample, in_contact, hit_ns, hit_x, hit_y, tried_x, tried_y,
    ) = state  # fmt: skip
    has_walls = len(sides) > 0
    kept = len(steps) // STEP_VALUES
    newest = time_ns // STEP_NS
    until_ns = time_ns + TICK_NS
    is_delayed = has_late_duties or actuator_delay + actuator_jitter > 0
    change_ns = NEVER_NS
    if pushes:
        pushes = without_expired(push_times, push_forces, pushes, time_ns)
    if is_delayed:
        delay = actuator_delay
        if actuator_jitter:
            chance, _ = uniform_pair(key, ACTUATOR_DELAY, time_ns // TICK_NS)
            delay = drawn_delay(actuator_delay, actuator_jitter, chance)
        if has_late_duties:
            delay_ns += delay * STEP_NS
        else:
            delay_ns = delay * STEP_NS
        note_duty(effects_ns, waiting_duties, time_ns, delay_ns, duty_x, duty_y)
        change_ns = time_ns
    else:
        voltage_x = motor_voltage(duty_x, volts - drop, dead_zone, volt_slope, volt_offset)
        voltage_y = motor_voltage(duty_y, volts - drop, dead_zone, volt_slope, volt_offset)
    for _ in range(STEPS_PER_TICK):
        start_ns, end_ns = time_ns, time_ns + STEP_NS
        before_x, before_y = x, y
        is_moving = start_ns >= hold_until_ns and not is_fallen
        while time_ns < end_ns:
            before_volts_x, before_volts_y = voltage_x, voltage_y
            if is_draining or time_ns >= change_ns:
                if time_ns >= change_ns:
                    duty_x, duty_y, change_ns = duty_at(
                        effects_ns, waiting_duties, time_ns, until_ns
                    )
                voltage_x = motor_voltage(duty_x, volts - drop, dead_zone, volt_slope, volt_offset)
                voltage_y = motor_voltage(duty_y, volts - drop, dead_zone, volt_slope, volt_offset)
            part_end_ns = min(end_ns, change_ns)
            dt = (part_end_ns - time_ns) * 1e-9
            if is_draining:
                current_x = motor_current(voltage_x, x[2], x[3], back_emf, ohms)
                current_y = motor_current(voltage_y, y[2], y[3], back_emf, ohms)
                # A duty is the share of the time in which the battery gives a motor's current.
                current = duty_x / 100.0 * current_x + duty_y / 100.0 * current_y
                charge, volts = discharge(
                    charge, current, dt, idle_current, full_volts, charge_slope, battery_ohms
                )
            if is_moving:
                if time_ns == start_ns < hold_until_ns + STEP_NS:  # the first step after the hold
                    x = before_x = x[0], x[1], x[2], x[3] + start_rate_x
                    y = before_y = y[0], y[1], y[2], y[3] + start_rate_y
                theta_x = psi_x = theta_y = psi_y = 0.0
                if pushes:
                    theta_x, psi_x = forces_of(
                        push_times, push_forces, pushes, time_ns, 0, x[1], radius, height
                    )
                    theta_y, psi_y = forces_of(
                        push_times, push_forces, pushes, time_ns, 1, y[1], radius, height
                    )
                if not is_linear:
                    x, y = advance_nonlinear(
                        equations, alpha, dt, x, y, voltage_x, voltage_y,
                        theta_x, psi_x, theta_y, psi_y,
                    )  # fmt: skip
                elif time_ns == start_ns:
                    x = advance_linear(transition, force_coefficients, x, voltage_x, theta_x, psi_x)
                    y = advance_linear(transition, force_coefficients, y, voltage_y, theta_y, psi_y)
                else:
                    # The whole step has been taken under the earlier voltages.
                    response = response_to_volt(rates, (end_ns - time_ns) * 1e-9)
                    x = superposed(x, response, voltage_x - before_volts_x)
                    y = superposed(y, response, voltage_y - before_volts_y)
            time_ns = part_end_ns
        if is_moving:
            if has_walls:
                start = start_x, start_y
                outline = Footprint(sides, walls_before, half_u, half_v)
                tried = ball_position(start, radius, x[0], y[0])
                if is_blocked(outline, tried):
                    x, y = stopped_planes(
                        before_x, before_y, x, y, start, radius, mass, is_linear, outline
                    )
                    if not (in_contact or since_sample):
                        hit_ns = end_ns
                        hit_x, hit_y = ball_position(start, radius, x[0], y[0])
                        tried_x, tried_y = tried
                    since_sample = True
            # NaN counts as fallen.
            if not (-fall_angle < x[1] < fall_angle and -fall_angle < y[1] < fall_angle):
                is_fallen = True
                x, y = state_after_fall(x, fall_angle), state_after_fall(y, fall_angle)
            if half_play:
                wheel_x = wheel_angle(ratio, x[0], x[1], start_psi_x)
                wheel_y = wheel_angle(ratio, y[0], y[1], start_psi_y)
                shaft_x = shaft_angle(shaft_x, wheel_x, half_play)
                shaft_y = shaft_angle(shaft_y, wheel_y, half_play)
        if battery_age_ns and (time_ns + battery_age_ns) % BATTERY_PERIOD_NS == 0:
            measured_volts = max(0.0, volts - drop)
        if kept:
            newest += 1
            at = newest % kept * STEP_VALUES
            steps[at] = shaft_x if half_play else wheel_angle(ratio, x[0], x[1], start_psi_x)
            steps[at + 1] = shaft_y if half_play else wheel_angle(ratio, y[0], y[1], start_psi_y)
            steps[at + 2], steps[at + 3] = x[3], y[3]
            steps[at + 4], steps[at + 5] = ball_position((start_x, start_y), radius, x[0], y[0])
    if has_walls and time_ns % SLOW_PERIOD_NS == 0:
        in_contact, since_sample = since_sample, False
        if in_contact and stops_at_hit:
            is_stopped = True
            voltage_x = voltage_y = 0.0
    if not battery_age_ns:
        measured_volts = max(0.0, volts - next_drop)
    return PlantState(
        time_ns, x, y, shaft_x, shaft_y, voltage_x, voltage_y, charge, volts,
        measured_volts, pushes,
        is_fallen, is_stopped, since_sample, in_contact, hit_ns, hit_x, hit_y, tried_x, tried_y,
    )  # fmt: skip


def stopped_planes(
    before_x: PlaneState,
    before_y: PlaneState,
    x: PlaneState,
    y: PlaneState,
    start: Pair,
    radius: float,
    mass: MassMatrix,
    is_linear: bool,
    outline: Footprint,
) -> tuple[PlaneState, PlaneState]:
    """Return the planes at the end of a step that would end in a wall.

    One of them is stopped if that frees the body, y first, or else both.
    """
    stopped_x = state_after_impact(before_x, x, mass, is_linear)
    stopped_y = state_after_impact(before_y, y, mass, is_linear)
    if not is_blocked(outline, ball_position(start, radius, x[0], stopped_y[0])):
        return x, stopped_y
    if not is_blocked(outline, ball_position(start, radius, stopped_x[0], y[0])):
        return stopped_x, y
    return stopped_x, stopped_y


def without_expired(push_times: Ints, push_forces: Reals, pushes: int, time_ns: int) -> int:
    """Remove the pushes that have ended from their buffers; return how many remain.

    The order of the others stays: their forces are added in it.
    """
    remaining = 0
    for each in range(pushes):
        if push_times[2 * each + 1] <= time_ns:
            continue
        if remaining < each:
            for number in range(2):
                push_times[2 * remaining + number] = push_times[2 * each + number]
            for number in range(PUSH_VALUES):
                push_forces[PUSH_VALUES * remaining + number] = push_forces[
                    PUSH_VALUES * each + number
                ]
        remaining += 1
    return remaining


def forces_of(
    push_times: Ints,
    push_forces: Reals,
    pushes: int,
    time_ns: int,
    plane: int,
    psi: float,
    radius: float,
    height: float,
) -> Pair:
    """Return the generalised forces [N·m] of the active pushes on theta and psi of a plane."""
    force_theta = force_psi = 0.0
    for each in range(pushes):
        if push_times[2 * each] <= time_ns < push_times[2 * each + 1]:
            at = PUSH_VALUES * each + plane
            force = push_forces[at]
            _, cosine = sine_cosine(psi)
            force_theta += force * radius
            force_psi += force * height * cosine
            force_psi += push_forces[at + 2]
    return force_theta, force_psi


def note_duty(
    effects_ns: Ints, waiting_duties: Ints, now_ns: int, delay_ns: int, duty_x: int, duty_y: int
) -> None:
    """Note a duty [%] that takes effect after its dead time."""
    at = now_ns // TICK_NS % len(effects_ns)
    effects_ns[at] = now_ns + delay_ns
    waiting_duties[2 * at], waiting_duties[2 * at + 1] = duty_x, duty_y


def duty_at(
    effects_ns: Ints, waiting_duties: Ints, now_ns: int, end_ns: int
) -> tuple[int, int, int]:
    """Return the duty [%] that acts now, and until when, `end_ns` at the latest.

    It is the newest one that has taken effect, or none.
    """
    count = len(effects_ns)
    newest = now_ns // TICK_NS
    for age in range(count):
        at = (newest - age) % count
        effect_ns = effects_ns[at]
        if effect_ns <= now_ns:
            return waiting_duties[2 * at], waiting_duties[2 * at + 1], end_ns
        end_ns = min(end_ns, effect_ns)
    return 0, 0, end_ns


def waiting_count(longest_delay: int, has_late_duties: bool) -> int:
    """Return the size of the ring of duties.

    The dead time of the last of so many duties is over at any time; without one, none wait. That of
    the motors is `longest_delay` [steps]; late duties may leave the brick later than commanded.
    """
    if has_late_duties:
        longest_delay += LATEST_DUTY
    return -(-longest_delay // STEPS_PER_TICK) + 1 if longest_delay else 0


def motor_angles(constants: PlantConstants, state: PlantState) -> Pair:
    """Return the angles of the motor shafts [rad]."""
    if constants.half_play:
        return state.shaft_x, state.shaft_y
    x, y = state.x, state.y
    return (
        wheel_angle(constants.ratio, x[0], x[1], constants.start_psi_x),
        wheel_angle(constants.ratio, y[0], y[1], constants.start_psi_y),
    )


def position(constants: PlantConstants, state: PlantState) -> Pair:
    """Return the position of the ball's centre [m]."""
    start = constants.start_x, constants.start_y
    return ball_position(start, constants.radius, state.x[0], state.y[0])


def plant_constants(p: Any, start_ns: int) -> PlantConstants:
    """Return the constants of a plant whose first tick is at `start_ns`.

    The parameters are a row, or what :func:`~ballbot_ros.engine.devices.numbers_of` returns.
    """
    transition, force_coefficients = discrete_matrices(p, STEP_S)
    ratio = gear_ratio(p)
    has_late_duties = p.kernel or p.link
    return PlantConstants(
        p.plant_model == LINEAR, transition, force_coefficients, linear_rates(p), equations_of(p),
        torque_per_volt(p), mass_matrix(p), ratio, p.ball_radius, p.body_height,
        p.back_emf_constant * ratio, p.motor_resistance,
        p.dead_zone, p.voltage_slope, p.voltage_offset,
        p.start_position_x, p.start_position_y, p.start_pitch_x, p.start_pitch_y,
        p.start_pitch_rate_x, p.start_pitch_rate_y,
        start_ns + round(p.hold_time * 1e9), p.fall_angle, p.backlash / 2.0,
        p.battery_model == DRAINING, p.idle_current, p.battery_voltage,
        capacity_slope(p.battery_capacity), p.battery_resistance, p.on_wall_hit == STOP_AT_HIT,
        half_cells(p.body_depth), half_cells(p.body_width),
        p.actuator_delay, p.actuator_delay_jitter, has_late_duties,
        link_of(p).battery_age_ns, noise_key(p.seed),
    )  # fmt: skip
