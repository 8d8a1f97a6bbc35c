"""Gains of the document's program for the loop as it runs: linear quadratic, or by its poles.

The program stays as it is: five signals, which it computes at each tick from filtered and delayed
samples, times ``k_f`` and ``k_i``. So this is output feedback, and the filters are given.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from ballbot_ros.controllers.design.linear_model import (
    STATES,
    DesignError,
    design_servo,
    require_weights,
)
from ballbot_ros.controllers.design.loop_analysis import (
    ROUNDING,
    STEADY,
    sorted_poles,
    steady_covariance,
)
from ballbot_ros.controllers.design.redesign import SIGNALS
from ballbot_ros.controllers.design.sampled_loop import (
    DUTY,
    ENCODER_ERROR,
    FORCE,
    GYRO_ERROR,
    INPUTS,
    LoopDelays,
    SampledLoop,
)
from ballbot_ros.parameters import CONTROLLER, ParameterSet, PlantParameters
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.plant.laws import max_voltage
from ballbot_ros.robot.plant.model import Matrix, PhysicalParameters

DISTURBANCE_N = 0.2
"""Random force on the body, new in each tick, that the linear quadratic design expects [N RMS]."""

_LARGEST_CHANGE = math.log(1e3)
"""The search keeps the signs of the gains of section 4.2, and their sizes within this factor."""

_DISCOUNT = 1e-4
"""How far below 1 a discount takes the largest pole of a loop that is not stable yet."""

_MAX_DISCOUNTS = 60
_LARGEST_STABLE = math.exp(-STEADY * TICK_S)
_TOLERANCE = 1e-13
_SLOWEST = -1e-3
"""Largest real part of a pole that can be asked for [1/s]: it decays in a quarter of an hour."""

_REPEATED = 1e-6
_DEGREES = 180.0 / math.pi

Gains = tuple[float, float, float, float, float]
"""``k_f`` of theta, psi and their rates, then ``k_i``, in the units of the parameters."""


def set_gains(parameters: ParameterSet, gains: Sequence[float]) -> None:
    """Set ``k_f`` and ``k_i`` to five gains, of as many digits as the brick's numbers have."""
    *k_f, k_i = (float(f'{gain:.8g}') for gain in gains)
    parameters.set(CONTROLLER, 'k_f', k_f)
    parameters.set(CONTROLLER, 'k_i', k_i)


class GainDesign:
    """The loop of a plane as it runs, with its gains left open.

    The parameters are those of the plant, the drivers, and the program with its filters; `delays`
    are dead times to design for instead of theirs. It raises DesignError if the controller is
    another than the document's program.
    """

    def __init__(self, parameters: ParameterSet, delays: LoopDelays | None = None) -> None:
        loop = SampledLoop(_with_gains(parameters, (1.0,) * SIGNALS), delays)
        _, basis = loop.feedback_states()
        inverse = np.linalg.pinv(basis)
        self._a, self._b = inverse @ loop.a @ basis, inverse @ loop.b
        self._applied = self._b[:, INPUTS.index(DUTY)]
        units = [
            SampledLoop(_with_gains(parameters, unit), delays) for unit in np.eye(SIGNALS).tolist()
        ]
        # Duty per unit of each gain, from the states and from the inputs.
        self._signals = np.array([unit.c for unit in units]) @ basis
        self._direct = np.array([unit.d for unit in units])

        weighted = np.zeros((SIGNALS, len(loop.states)))
        for row, name in zip(weighted, STATES, strict=False):
            row[loop.states.index(name)] = _DEGREES
        weighted[-1, loop.states.index('sum_theta_diff')] = TICK_S
        self._weighted = weighted @ basis
        plant = parameters.of(PlantParameters)
        self._physical = PhysicalParameters.from_parameters(plant)
        full = max_voltage(plant.battery_voltage, plant.voltage_slope, plant.voltage_offset)
        self._volts = full / 100.0
        noise = {GYRO_ERROR: ROUNDING, ENCODER_ERROR: ROUNDING, FORCE: DISTURBANCE_N}
        self._noise = np.array([noise.get(name, 0.0) for name in INPUTS])

    def poles(self, gains: ArrayLike) -> NDArray[np.complex128]:
        """Return the poles of the closed loop with these gains, in the z plane."""
        feedback = np.outer(self._applied, np.asarray(gains) @ self._signals)
        return np.linalg.eigvals(self._a + feedback).astype(complex)

    def regulator(self, q: ArrayLike, r: float) -> Gains:
        """Return the gains that minimise the mean of x'Qx + r u² from tick to tick.

        The mean is that of a loop whose samples are rounded to counts, with the errors white, and
        whose body a random force of `DISTURBANCE_N` pushes. It raises DesignError if a weight is
        not allowed, or no gains are found with which the loop is stable.

        Parameters
        ----------
        q : array_like, shape (5,)
            Weights of theta and psi [1/deg²], their rates [s²/deg²], and the program's integral of
            theta [1/(deg² s²)].
        r : float
            Weight of the motor voltage [1/V²].
        """
        require_weights(np.diag(np.asarray(q, float)), [[r]])
        origin = design_servo(self._physical).gain  # the loop need not be stable with them
        exponents = np.zeros(SIGNALS)
        largest = math.inf
        # An unstable loop has no mean cost. One whose motions are discounted has: the gains that
        # are best for it need less of a discount.
        for _ in range(_MAX_DISCOUNTS):
            before, largest = largest, abs(self.poles(origin * np.exp(exponents))).max()
            is_stable = largest < _LARGEST_STABLE
            if before <= largest and not is_stable:
                break
            discount = 1.0 if is_stable else (1.0 - _DISCOUNT) / largest
            found = minimize(
                self._logarithmic_cost,
                exponents,
                (origin, np.asarray(q, float), r, discount),
                'L-BFGS-B',
                jac=True,
                bounds=[(-_LARGEST_CHANGE, _LARGEST_CHANGE)] * SIGNALS,
                options={'ftol': _TOLERANCE, 'gtol': 1e-7, 'maxiter': 1000},
            )
            exponents = found.x
            if not math.isfinite(found.fun):
                break
            if discount == 1.0:
                return self._stable(origin * np.exp(exponents))
        raise DesignError('no gains are found with which the loop is stable')

    def with_poles(self, poles: Sequence[complex]) -> Gains:
        """Return the gains with which the closed loop has five given poles; the others follow.

        The poles are in the s plane [1/s], complex ones in conjugate pairs. Those of the loop are
        exp(4 ms · pole). It raises DesignError if these poles are not possible, or the loop has
        another one that is not stable.
        """
        _require_poles(poles)
        # A pole z of the closed loop solves k G(z) = 1, which is linear in the gains k.
        rows, known = [], []
        for pole in poles:
            z = np.exp(complex(pole) * TICK_S)
            try:
                states = np.linalg.solve(z * np.eye(len(self._a)) - self._a, self._applied)
            except np.linalg.LinAlgError:
                raise DesignError(
                    f'the loop keeps its pole {_text(pole)}: no gain moves it'
                ) from None
            response = self._signals @ states
            if pole.imag >= 0.0:
                rows.append(response.real)
                known.append(1.0)
            if pole.imag > 0.0:
                rows.append(response.imag)
                known.append(0.0)
        scale = np.abs(rows).max(axis=1, keepdims=True)
        try:
            if not scale.all():
                raise np.linalg.LinAlgError
            gains = np.linalg.solve(rows / scale, known / scale[:, 0])
        except np.linalg.LinAlgError:
            raise DesignError('these poles cannot be placed: no gains give them') from None
        return self._stable(gains)

    def cost(self, gains: ArrayLike, q: ArrayLike, r: float, discount: float = 1.0) -> Cost:
        """Return the mean of x'Qx + r u² and its gradient, see :meth:`regulator`.

        The discount is a factor of all states from one tick to the next.
        """
        k, per_volt = np.asarray(gains, float), r * self._volts**2
        duty, direct = k @ self._signals, k @ self._direct * self._noise
        a = discount * (self._a + np.outer(self._applied, duty))
        if not np.isfinite(a).all() or abs(np.linalg.eigvals(a)).max() >= _LARGEST_STABLE:
            return Cost(math.inf, np.zeros(SIGNALS))
        b = self._b * self._noise + np.outer(self._applied, direct)
        weight = self._weighted.T @ (np.asarray(q, float)[:, None] * self._weighted)
        weight = weight + per_volt * np.outer(duty, duty)
        covariance = steady_covariance(a, b @ b.T)
        # The cost of a state's deviation in all ticks to come.
        future = steady_covariance(a.T, weight)
        value = np.sum(weight * covariance) + per_volt * direct @ direct
        signal_noise = self._direct * self._noise
        gradient = 2.0 * (
            per_volt * (self._signals @ covariance @ duty + signal_noise @ direct)
            + discount * self._signals @ covariance @ a.T @ future @ self._applied
            + signal_noise @ b.T @ future @ self._applied
        )
        return Cost(float(value), gradient)

    def _logarithmic_cost(
        self, exponents: Matrix, origin: Matrix, q: Matrix, r: float, discount: float
    ) -> tuple[float, Matrix]:
        gains = origin * np.exp(exponents)
        value, gradient = self.cost(gains, q, r, discount)
        if not math.isfinite(value):
            return 1e3, gradient
        return math.log(value), gradient * gains / value

    def _stable(self, gains: Matrix) -> Gains:
        """Return the gains; raise DesignError if the loop is not stable with them."""
        for pole in sorted_poles(self.poles(gains), TICK_S):
            if not pole.is_stable:
                s = np.log(pole.value) / TICK_S
                raise DesignError(f'no design: the motion of a pole at {_text(s)} does not decay')
        theta, psi, theta_dot, psi_dot, integral = gains.tolist()
        return theta, psi, theta_dot, psi_dot, integral


class Cost(NamedTuple):
    """A mean cost for each tick, and its derivatives by the gains, shape (5,)."""

    value: float
    gradient: Matrix


def _with_gains(parameters: ParameterSet, gains: Sequence[float]) -> ParameterSet:
    """Return a copy of parameters with other gains."""
    copy = ParameterSet(parameters)
    set_gains(copy, gains)
    return copy


def _require_poles(poles: Sequence[complex]) -> None:
    if len(poles) != SIGNALS:
        raise DesignError(f'{SIGNALS} poles are needed, one for each gain: got {len(poles)}')
    for index, pole in enumerate(poles):
        if not (math.isfinite(abs(pole)) and pole.real <= _SLOWEST):
            raise DesignError(f'the pole {_text(pole)} needs a real part below {_SLOWEST:g} 1/s')
        if abs(pole.imag) >= math.pi / TICK_S:
            raise DesignError(f'the pole {_text(pole)} oscillates faster than 125 Hz')
        if pole.imag and not any(_near(pole.conjugate(), other) for other in poles):
            raise DesignError(f'the pole {_text(pole)} needs its conjugate')
        if any(_near(pole, other) for other in poles[:index]):
            raise DesignError(f'the pole {_text(pole)} is given twice')


def _near(pole: complex, other: complex) -> bool:
    return abs(pole - other) <= _REPEATED * abs(pole)


def _text(pole: complex) -> str:
    value = complex(pole)
    return f'{value.real:.4g} 1/s' if not value.imag else f'{value:.4g} 1/s'
