"""A linear quadratic Gaussian controller: Kalman filter and LQR, designed for ticks of 4 ms."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ballbot_ros.controllers.controller import MAX_DUTY, duty_of_voltage, max_voltage
from ballbot_ros.controllers.driving import (
    NO_MOTION,
    NO_REFERENCE,
    STANDING_BY,
    DrivingConstants,
    DrivingController,
    Motion,
    PlaneInputs,
    Reference,
    State,
    driving_constants,
    driving_law,
    low_pass_share,
    next_reference,
)
from ballbot_ros.errors import ControllerError
from ballbot_ros.parameters import ControllerParameters, TakesEffect, designed, quantity
from ballbot_ros.parameters.timing import TICK_MS, TICK_S
from ballbot_ros.robot.plant.integration import zero_order_hold
from ballbot_ros.robot.plant.model import Matrix, PhysicalParameters, state_space

DEGREE = math.pi / 180.0
ANY, POSITIVE = (-1e9, 1e9), (1e-6, 1e6)
STATES = 5
"""Of the filter: theta, psi, theta_dot, psi_dot, and the error of the gyro offset."""

PlaneError = tuple[float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class LQGParameters:
    """What the design starts from, and its results.

    The LQR weighs each deviation relative to its scale: deviations cost the same if they are the
    same multiple of their scales. The filter weighs errors by their standard deviations.
    """

    reference_time: float = quantity(
        0.3, 's', (0.0, 60.0), 'time constant of each of two low passes of the speed'
    )
    theta_scale: float = quantity(15.0, 'deg', POSITIVE, 'LQR: scale of θ')
    psi_scale: float = quantity(1.0, 'deg', POSITIVE, 'LQR: scale of ψ')
    theta_dot_scale: float = quantity(50.0, 'deg/s', POSITIVE, 'LQR: scale of θ˙')
    psi_dot_scale: float = quantity(200.0, 'deg/s', POSITIVE, 'LQR: scale of ψ˙')
    integral_scale: float = quantity(150.0, 'deg·s', POSITIVE, 'LQR: scale of ∫θ')
    voltage_scale: float = quantity(1.0, 'V', POSITIVE, 'LQR: scale of the voltage')
    voltage_error: float = quantity(
        0.1, 'V', POSITIVE, 'filter: error of the motor voltage in a tick'
    )
    torque_error: float = quantity(
        0.03, 'N·m', POSITIVE, 'filter: unknown torque on the body in a tick'
    )
    drift_rate: float = quantity(
        0.01, 'deg/s/√s', POSITIVE, 'filter: random walk of the gyro offset'
    )
    gyro_error: float = quantity(0.7, 'deg/s', POSITIVE, 'filter: error of a gyro reading')
    encoder_error: float = quantity(0.25, 'deg', POSITIVE, 'filter: error of an encoder reading')
    dead_zone: float = quantity(1.0, '%', (0.0, 50.0), 'filter: duty that friction takes')
    actuator_delay: float = quantity(
        0.0, 'ms', (0.0, 100.0), 'dead time of the motors to design for'
    )
    transition: tuple[float, ...] = designed(
        '1, s, 1/s', ANY, 'A of the filter, 5 × 5, row by row: θ, ψ, θ˙, ψ˙, gyro drift'
    )
    input_effect: tuple[float, ...] = designed(
        'deg/V, deg/s/V', ANY, 'B of the filter, 5 × n, row by row: of the newest n voltages'
    )
    lead: tuple[float, ...] = designed(
        '1, s, deg/V, deg/s/V',
        ANY,
        'state when the next duty takes effect, 4 × (4 + n - 1), row by row: from the state at the '
        'tick and the voltages on their way',
    )
    filter_gain: tuple[float, ...] = designed(
        's, 1, 1/s', ANY, 'Kalman gain, 5 × 2, row by row: of the gyro and of the encoder'
    )
    feedback: tuple[float, ...] = designed(
        'V/deg, V·s/deg, V/(deg·s)',
        ANY,
        'LQR gain of θ, ψ, θ˙, ψ˙, ∫θ',
        takes_effect=TakesEffect.IMMEDIATELY,
    )
    feedforward: tuple[float, ...] = designed(
        's, V·s/deg, s², V·s²/deg',
        ANY,
        'ψ and voltage per rate of the reference, then both per its acceleration',
        takes_effect=TakesEffect.IMMEDIATELY,
    )


def discrete_model(model: PhysicalParameters, dt: float = TICK_S) -> tuple[Matrix, Matrix]:
    """Return A (4, 4) and B (4, 2) for `dt` seconds in degrees: of voltage and torque on psi."""
    a, b = state_space(model)
    return zero_order_hold(a, b[:, [0, 2]] / DEGREE, dt)


def with_integral(model: PhysicalParameters) -> tuple[Matrix, Matrix]:
    """Return A (5, 5) and B (5, 1) of a tick: theta, psi, their rates, the integral of theta."""
    transition, effect = discrete_model(model)
    a = np.eye(5)
    a[:4, :4] = transition
    a[4, 0] = TICK_S
    return a, np.vstack([effect[:, :1], [[0.0]]])


def weights(p: LQGParameters) -> tuple[Matrix, Matrix]:
    """Return the weights of the state (5, 5) and of the voltage (1, 1)."""
    scales = [p.theta_scale, p.psi_scale, p.theta_dot_scale, p.psi_dot_scale, p.integral_scale]
    return np.diag(np.array(scales) ** -2.0), np.array([[p.voltage_scale**-2.0]])


def regulator(p: LQGParameters, model: PhysicalParameters) -> tuple[Matrix, Matrix]:
    """Return gain (1, 5) and cost (5, 5) of the LQR for the states of :func:`with_integral`."""
    import control  # only a design needs it, and it takes long to import

    gain, cost, _ = control.dlqr(*with_integral(model), *weights(p))
    return np.asarray(gain, float), np.asarray(cost, float)


def late_voltages(model: PhysicalParameters, delay_ms: float) -> tuple[Matrix, Matrix]:
    """Return what voltages do that take effect late.

    Returns
    -------
    lead : ndarray, shape (4, 4 + n - 1)
        The state after the dead time, from the state now and the n - 1 voltages on their way, the
        newest first.
    effects : ndarray, shape (5, n)
        The effect in a tick, on the filter's states, of its own voltage and of those before it, the
        newest first.
    """
    whole, part = divmod(delay_ms, TICK_MS)
    on_their_way = math.ceil(delay_ms / TICK_MS)
    lead = np.eye(4, 4 + on_their_way)
    for voltage in range(on_their_way, 0, -1):
        # The oldest one acts for the rest of its time, the others for a whole tick each.
        acts_ms = part or TICK_MS if voltage == on_their_way else TICK_MS
        transition, effect = discrete_model(model, acts_ms * 1e-3)
        lead = transition @ lead
        lead[:, 3 + voltage] += effect[:, 0]
    effects = np.zeros((STATES, 1 + on_their_way))
    # Within each tick a voltage follows the one before it.
    for voltage, acts_ms in ((int(whole) + 1, part), (int(whole), TICK_MS - part)):
        if acts_ms:
            transition, effect = discrete_model(model, acts_ms * 1e-3)
            effects[:4] = transition @ effects[:4]
            effects[:4, voltage] += effect[:, 0]
    return lead, effects


def kalman_filter(p: LQGParameters, model: PhysicalParameters) -> tuple[Matrix, Matrix]:
    """Return A (5, 5) and the gain (5, 2) of the stationary Kalman filter.

    The gyro reads psi_dot plus the drift, the encoder Rs/Rw (theta - psi). The gain is the one that
    corrects a prediction by the readings of the same tick.
    """
    import control

    transition, effect = discrete_model(model)
    a = np.eye(STATES)
    a[:4, :4] = transition
    g = np.zeros((STATES, 3))
    g[:4, :2] = effect
    g[4, 2] = 1.0
    errors = np.diag([p.voltage_error, p.torque_error, p.drift_rate * TICK_S**0.5]) ** 2
    disturbance = g @ errors @ g.T
    disturbance = (disturbance + disturbance.T) / 2.0  # dlqe refuses what rounding has left
    c = measurement(model.ratio)
    noise = np.diag([p.gyro_error, p.encoder_error]) ** 2
    _, covariance, _ = control.dlqe(a, np.eye(STATES), c, disturbance, noise)
    gain = covariance @ c.T @ np.linalg.inv(c @ covariance @ c.T + noise)
    return a, np.asarray(gain, float)


def measurement(ratio: float) -> Matrix:
    """Return C (2, 5): what gyro and encoder read of the filter's state."""
    return np.array([[0.0, 0.0, 0.0, 1.0, 1.0], [ratio, -ratio, 0.0, 0.0, 0.0]])


def feedforward(model: PhysicalParameters) -> Matrix:
    """Return what a steadily rolling or accelerating ball takes, with psi constant.

    They are psi and voltage per deg/s of its rate, then psi and voltage per deg/s² of its
    acceleration: the solution of the last two rows of (3.24).
    """
    a, b = state_space(model)
    unknown = np.column_stack([a[2:, 1], b[2:, 0] / DEGREE])
    known = np.column_stack([-a[2:, 2], [1.0, 0.0]])
    return np.asarray(np.linalg.solve(unknown, known).T, float)


class Constants(NamedTuple):
    """The constants of the law: its parameters, and what follows from them."""

    driving: DrivingConstants
    reference_share: float
    ratio: float
    dead_zone: float
    dead_time: float
    transition: tuple[float, ...]
    input_effect: tuple[float, ...]
    lead: tuple[float, ...]
    filter_gain: tuple[float, ...]
    feedback: tuple[float, ...]
    feedforward: tuple[float, ...]


class Plane(NamedTuple):
    """The state of a plane.

    Attributes
    ----------
    predicted : tuple of float
        The filter's states at the next tick.
    on_their_way : tuple of float
        The voltages that do not act yet, the newest first [V].
    integral : float
        Of the error of the ball angle [deg s].
    """

    motion: Motion
    reference: Reference
    predicted: tuple[float, ...]
    on_their_way: tuple[float, ...]
    integral: float


def balance(p: Constants, plane: Plane, inputs: PlaneInputs) -> tuple[Plane, int]:
    """Return the next state of a plane, and its duty [%]."""
    task = tracking_task(p, plane, inputs)
    voltage = task.voltage + regulated(p.feedback, task.error)
    return next_plane(p, plane, task, voltage, inputs.battery_mv)


class TrackingTask(NamedTuple):
    """What the regulator of a plane has to do at a tick.

    Attributes
    ----------
    state : tuple of float
        The filter's states, corrected by the readings.
    error : tuple of float
        Deviations of theta, psi and their rates when the voltage takes effect, and the integral of
        that of theta.
    voltage : float
        What the reference takes [V].
    psi_ref : float
        Reference of the pitch [deg].
    """

    reference: Reference
    state: tuple[float, float, float, float, float]
    error: PlaneError
    voltage: float
    psi_ref: float


def tracking_task(p: Constants, plane: Plane, inputs: PlaneInputs) -> TrackingTask:
    """Return what the regulator has to do, by the filter and the reference."""
    reference = next_reference(p.reference_share, plane.reference, inputs.speed)
    theta, psi, theta_dot, psi_dot, drift = plane.predicted
    gyro = inputs.rate - (psi_dot + drift)
    encoder = inputs.revolution - p.ratio * (theta - psi)
    gain = p.filter_gain
    theta = theta + (gain[0] * gyro + gain[1] * encoder)
    psi = psi + (gain[2] * gyro + gain[3] * encoder)
    theta_dot = theta_dot + (gain[4] * gyro + gain[5] * encoder)
    psi_dot = psi_dot + (gain[6] * gyro + gain[7] * encoder)
    drift = drift + (gain[8] * gyro + gain[9] * encoder)

    now = (theta, psi, theta_dot, psi_dot) + plane.on_their_way  # noqa: RUF005
    psi_rate, voltage_rate, psi_acceleration, voltage_acceleration = p.feedforward
    rate, acceleration = reference.theta_dot, reference.theta_ddot
    psi_ref = psi_rate * rate + psi_acceleration * acceleration
    error = (
        product(p.lead, 0, now) - (reference.theta + p.dead_time * rate),
        product(p.lead, 1, now) - psi_ref,
        product(p.lead, 2, now) - rate,
        product(p.lead, 3, now),
        plane.integral,
    )
    voltage = voltage_rate * rate + voltage_acceleration * acceleration
    return TrackingTask(reference, (theta, psi, theta_dot, psi_dot, drift), error, voltage, psi_ref)


def product(matrix: tuple[float, ...], row: int, values: tuple[float, ...]) -> float:
    """Return the product of a row of a matrix, which is stored row by row, and a vector."""
    first = row * len(values)
    # No sum(): since Python 3.12 it compensates the rounding.
    total = matrix[first] * values[0]
    for each in range(1, len(values)):
        total += matrix[first + each] * values[each]
    return total


def regulated(feedback: tuple[float, ...], error: PlaneError) -> float:
    """Return the voltage [V] that takes a deviation back to the reference."""
    voltage = 0.0
    for each in range(len(error)):
        voltage -= feedback[each] * error[each]
    return voltage


def next_plane(
    p: Constants, plane: Plane, task: TrackingTask, voltage: float, battery_mv: int
) -> tuple[Plane, int]:
    """Return the next state of a plane, and the duty [%] for a voltage [V]."""
    reference, state = task.reference, task.state
    theta, psi, theta_dot, psi_dot, _ = state
    duty = duty_of_voltage(voltage, battery_mv)
    integral = plane.integral
    if abs(duty) < MAX_DUTY:  # else the integral would wind up
        integral += TICK_S * (theta - reference.theta)
    # What friction leaves of the duty.
    rest = max(0.0, abs(duty) - p.dead_zone)
    acting = (rest if duty > 0 else -rest) * max_voltage(battery_mv) / MAX_DUTY
    voltages = (acting,) + plane.on_their_way  # noqa: RUF005
    predicted = (
        product(p.transition, 0, state) + product(p.input_effect, 0, voltages),
        product(p.transition, 1, state) + product(p.input_effect, 1, voltages),
        product(p.transition, 2, state) + product(p.input_effect, 2, voltages),
        product(p.transition, 3, state) + product(p.input_effect, 3, voltages),
        product(p.transition, 4, state) + product(p.input_effect, 4, voltages),
    )
    motion = Motion(theta, psi, theta_dot, psi_dot, reference.theta, reference.theta_dot)
    return Plane(motion, reference, predicted, voltages[:-1], integral), duty


class LQG(DrivingController[LQGParameters]):
    """A Kalman filter that knows the gyro's drift, and an LQR with the integral of theta.

    The filter corrects its prediction by the readings of a tick, the LQR answers, and the filter
    predicts the next tick with the voltage that the whole duty gives. Without a dead time, the duty
    acts at once and until the next tick. With one, the LQR answers the state that the voltages on
    their way will have led to when the duty takes effect: from there on, the loop is as without.
    """

    law = driving_law(balance)

    @classmethod
    def design(cls, parameters: LQGParameters, model: PhysicalParameters) -> LQGParameters:
        """Return the parameters with the filter and the gains for a model."""
        filter_a, filter_gain = kalman_filter(parameters, model)
        gain, _ = regulator(parameters, model)
        lead, effects = late_voltages(model, parameters.actuator_delay)
        return replace(
            parameters,
            transition=_flat(filter_a),
            input_effect=_flat(effects),
            lead=_flat(lead),
            filter_gain=_flat(filter_gain),
            feedback=_flat(gain),
            feedforward=_flat(feedforward(model)),
        )

    @classmethod
    def constants(
        cls, parameters: LQGParameters, model: PhysicalParameters, settings: ControllerParameters
    ) -> Constants:
        """Return the constants of the law; ControllerError if a design is for another dead time."""
        on_their_way = math.ceil(parameters.actuator_delay / TICK_MS)
        for name, count in (
            ('input_effect', STATES * (1 + on_their_way)),
            ('lead', 4 * (4 + on_their_way)),
        ):
            if len(getattr(parameters, name)) != count:
                raise ControllerError(
                    f'user.{name} needs {count} numbers for an actuator_delay of '
                    f'{parameters.actuator_delay:g} ms, not {len(getattr(parameters, name))}: '
                    'omit it'
                )
        return Constants(
            driving_constants(settings), low_pass_share(parameters.reference_time), model.ratio,
            parameters.dead_zone, parameters.actuator_delay * 1e-3, parameters.transition,
            parameters.input_effect, parameters.lead, parameters.filter_gain, parameters.feedback,
            parameters.feedforward,
        )  # fmt: skip

    @classmethod
    def initial_state(cls, constants: Constants) -> State:
        """Return the state before the first tick."""
        on_their_way = (0.0,) * (len(constants.lead) // 4 - 4)
        at_rest = Plane(NO_MOTION, NO_REFERENCE, (0.0,) * STATES, on_their_way, 0.0)
        return State(STANDING_BY, at_rest, at_rest)


def _flat(matrix: Matrix) -> tuple[float, ...]:
    return tuple(matrix.ravel().tolist())
