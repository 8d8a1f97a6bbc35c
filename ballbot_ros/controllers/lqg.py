"""A linear quadratic Gaussian controller: Kalman filter and LQR, designed for ticks of 4 ms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbot_ros.controllers.controller import MAX_DUTY, Readings
from ballbot_ros.controllers.driving import (
    DrivingController,
    PlaneController,
    PlaneInputs,
    SpeedReference,
)
from ballbot_ros.controllers.interface import Estimates
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
        0.3, 's', (0.0, 60.0), 'time constant of each of two low passes of the speed', 'project'
    )
    theta_scale: float = quantity(15.0, 'deg', POSITIVE, 'LQR: scale of θ', 'project')
    psi_scale: float = quantity(1.0, 'deg', POSITIVE, 'LQR: scale of ψ', 'project')
    theta_dot_scale: float = quantity(50.0, 'deg/s', POSITIVE, 'LQR: scale of θ˙', 'project')
    psi_dot_scale: float = quantity(200.0, 'deg/s', POSITIVE, 'LQR: scale of ψ˙', 'project')
    integral_scale: float = quantity(150.0, 'deg·s', POSITIVE, 'LQR: scale of ∫θ', 'project')
    voltage_scale: float = quantity(1.0, 'V', POSITIVE, 'LQR: scale of the voltage', 'project')
    voltage_error: float = quantity(
        0.1, 'V', POSITIVE, 'filter: error of the motor voltage in a tick', 'project'
    )
    torque_error: float = quantity(
        0.03, 'N·m', POSITIVE, 'filter: unknown torque on the body in a tick', 'project'
    )
    drift_rate: float = quantity(
        0.01, 'deg/s/√s', POSITIVE, 'filter: random walk of the gyro offset', 'project'
    )
    gyro_error: float = quantity(
        0.7, 'deg/s', POSITIVE, 'filter: error of a gyro reading', 'project'
    )
    encoder_error: float = quantity(
        0.25, 'deg', POSITIVE, 'filter: error of an encoder reading', 'project'
    )
    dead_zone: float = quantity(
        1.0, '%', (0.0, 50.0), 'filter: duty that friction takes', 'project'
    )
    actuator_delay: float = quantity(
        0.0, 'ms', (0.0, 100.0), 'dead time of the motors to design for', 'project'
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


class LQG(DrivingController[LQGParameters]):
    """A Kalman filter that knows the gyro's drift, and an LQR with the integral of theta.

    The filter corrects its prediction by the readings of a tick, the LQR answers, and the filter
    predicts the next tick with the voltage that the whole duty gives. Without a dead time, the duty
    acts at once and until the next tick. With one, the LQR answers the state that the voltages on
    their way will have led to when the duty takes effect: from there on, the loop is as without.
    """

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

    def make_plane(self) -> PlaneController:
        """Return the controller of a plane, at rest."""
        return Plane(self.parameters, self.model)


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


class Plane:
    """Filter and regulator of a plane, in plain floats: the same on every machine."""

    def __init__(self, parameters: LQGParameters, model: PhysicalParameters) -> None:
        p = self._p = parameters
        on_their_way = math.ceil(p.actuator_delay / TICK_MS)
        for name, count in (
            ('input_effect', STATES * (1 + on_their_way)),
            ('lead', 4 * (4 + on_their_way)),
        ):
            if len(getattr(p, name)) != count:
                raise ControllerError(
                    f'user.{name} needs {count} numbers for an actuator_delay of '
                    f'{p.actuator_delay:g} ms, not {len(getattr(p, name))}: omit it'
                )
        self._ratio = model.ratio
        self._transition = _rows(p.transition, STATES)
        self._effects = _rows(p.input_effect, 1 + on_their_way)
        self._lead = _rows(p.lead, 4 + on_their_way)
        self._dead_time = p.actuator_delay * 1e-3
        self._on_their_way = (0.0,) * on_their_way
        self._gain = _rows(p.filter_gain, 2)
        self._reference = SpeedReference(p.reference_time)
        self._predicted = (0.0,) * STATES
        self._integral = 0.0
        self.estimates = Estimates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def duty(self, readings: Readings, inputs: PlaneInputs) -> int:
        """Return the duty [%]."""
        reference, now = self._reference, self.estimates
        reference.update(inputs.speed)
        now.theta_ref, now.theta_ref_dot = reference.theta, reference.theta_dot
        state = self._corrected(inputs.rate, inputs.revolution)
        now.theta, now.psi, now.theta_dot, now.psi_dot, _ = state
        acting = _products(self._lead, (*state[:-1], *self._on_their_way))
        duty = readings.duty(self._voltage(acting, readings.max_voltage))
        if abs(duty) < MAX_DUTY:  # else the integral would wind up
            self._integral += TICK_S * (now.theta - now.theta_ref)
        self._predict(state, self._effective(duty) * readings.max_voltage / MAX_DUTY)
        return duty

    def retune(self, parameters: LQGParameters, _: ControllerParameters) -> None:
        """Use other gains."""
        self._p = parameters

    def _corrected(self, rate: float, revolution: int) -> Sequence[float]:
        """Return the state, corrected by the readings."""
        theta, psi, _, psi_dot, drift = self._predicted
        gyro = rate - (psi_dot + drift)
        encoder = revolution - self._ratio * (theta - psi)
        return [
            predicted + (of_gyro * gyro + of_encoder * encoder)
            for predicted, (of_gyro, of_encoder) in zip(self._predicted, self._gain, strict=True)
        ]

    def _voltage(self, acting: Sequence[float], max_voltage: float) -> float:
        """Return the voltage of feedforward and feedback.

        Parameters
        ----------
        acting : sequence of float
            theta, psi and their rates when the voltage takes effect.
        max_voltage : float
            The largest one [V].
        """
        now, acceleration = self.estimates, self._reference.theta_ddot
        theta, psi, theta_dot, psi_dot = acting
        psi_rate, voltage_rate, psi_acceleration, voltage_acceleration = self._p.feedforward
        psi_ref = psi_rate * now.theta_ref_dot + psi_acceleration * acceleration
        voltage = voltage_rate * now.theta_ref_dot + voltage_acceleration * acceleration
        error = (
            theta - (now.theta_ref + self._dead_time * now.theta_ref_dot),
            psi - psi_ref,
            theta_dot - now.theta_ref_dot,
            psi_dot,
            self._integral,
        )
        low, high = -max_voltage - voltage, max_voltage - voltage
        return voltage + self.feedback(error, (low, high), psi_ref)

    def feedback(self, error: PlaneError, limits: tuple[float, float], psi_ref: float) -> float:
        """Return the voltage [V] that takes a deviation back to the reference.

        Parameters
        ----------
        error : tuple of float
            Deviations of theta, psi and their rates, and the integral of that of theta.
        limits : tuple of float
            Lowest and highest voltage that the motor can give here [V].
        psi_ref : float
            Reference of the pitch [deg].
        """
        voltage = 0.0
        for gain, deviation in zip(self._p.feedback, error, strict=True):
            voltage -= gain * deviation
        return voltage

    def _effective(self, duty: int) -> float:
        """Return what friction leaves of a duty [%]."""
        rest = max(0.0, abs(duty) - self._p.dead_zone)
        return rest if duty > 0 else -rest

    def _predict(self, state: Sequence[float], voltage: float) -> None:
        voltages = (voltage, *self._on_their_way)
        self._on_their_way = voltages[:-1]
        self._predicted = tuple(
            moved + effect
            for moved, effect in zip(
                _products(self._transition, state), _products(self._effects, voltages), strict=True
            )
        )


def _products(rows: Sequence[Sequence[float]], values: Sequence[float]) -> list[float]:
    """Return the product of a matrix and a vector."""
    products = []
    for row in rows:
        # No sum(): since Python 3.12 it compensates the rounding.
        total = row[0] * values[0]
        for factor, value in zip(row[1:], values[1:], strict=True):
            total += factor * value
        products.append(total)
    return products


def _flat(matrix: Matrix) -> tuple[float, ...]:
    return tuple(matrix.ravel().tolist())


def _rows(values: Sequence[float], width: int) -> list[tuple[float, ...]]:
    return [tuple(values[start : start + width]) for start in range(0, len(values), width)]
