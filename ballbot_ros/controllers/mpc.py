"""A model predictive controller: the LQG's law within limits of voltage and pitch, by OSQP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ballbot_ros.controllers.controller import Duty, Readings, max_voltage
from ballbot_ros.controllers.driving import PlaneInputs, driving_law
from ballbot_ros.controllers.lqg import (
    LQG,
    STATES,
    Constants,
    LQGParameters,
    Plane,
    TrackingTask,
    next_plane,
    regulated,
    tracking_task,
)
from ballbot_ros.errors import ControllerError
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.parameter import live
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.plant.model import Matrix

HORIZON = 40
"""Ticks ahead that the limits count: 0.16 s."""

SLACK_WEIGHT = 1e4
"""Cost of leaning 1° beyond the limit: that of adding 100 V for a tick. It is not infinite, since a
robot that is pushed must be allowed to lean."""

SETTINGS = {
    'rho': 1.0, 'adaptive_rho': False, 'eps_abs': 1e-4, 'eps_rel': 1e-4, 'max_iter': 500,
    'polishing': False, 'verbose': False,
}  # fmt: skip
"""Nothing depends on time: the same inputs give the same duty on the same machine."""


@dataclass(frozen=True)
class MPCParameters(LQGParameters):
    """The parameters of the LQG, and the limit of the pitch."""

    pitch_limit: float = live(
        3.0, 'deg', (0.1, 45.0), 'pitch beyond which the body leans only if it must'
    )


class Predictions(NamedTuple):
    """What the LQR will do within the horizon.

    Attributes
    ----------
    voltage, pitch : ndarray, shape (HORIZON, 5)
        Voltages and pitches at the coming ticks for the present deviation from the reference.
    voltage_response, pitch_response : ndarray, shape (HORIZON, HORIZON)
        The changes of these by a voltage that is added at each of the ticks.
    """

    voltage: Matrix
    pitch: Matrix
    voltage_response: Matrix
    pitch_response: Matrix

    @classmethod
    def of(cls, p: LQGParameters) -> Predictions:
        """Return the predictions for the model and the gain of the LQG."""
        a, b = np.eye(STATES), np.zeros((STATES, 1))
        a[:-1, :-1] = np.reshape(p.transition, a.shape)[:-1, :-1]
        a[-1] = [TICK_S, 0.0, 0.0, 0.0, 1.0]  # the integral of theta, instead of the drift
        # From when it takes effect, a voltage acts for a whole tick: the sum of its effects.
        b[:-1, 0] = np.reshape(p.input_effect, (STATES, -1)).sum(axis=1)[:-1]
        gain = np.array([p.feedback])
        powers = [np.eye(STATES)]
        for _ in range(HORIZON):
            powers.append((a - b @ gain) @ powers[-1])
        voltage = np.vstack([-gain @ power for power in powers[:-1]])
        pitch = np.vstack([power[1] for power in powers[1:]])
        return cls(
            voltage,
            pitch,
            _responses(np.append(1.0, (voltage @ b)[:-1])),
            _responses(np.append(b[1], (pitch @ b)[:-1])),
        )


class LimitedRegulator:
    """The LQG's regulator of a plane, with additions to the voltage that keep to the limits."""

    def __init__(self, parameters: MPCParameters) -> None:
        self._p = parameters
        self._prepare()

    def retune(self, parameters: MPCParameters) -> None:
        """Use other gains and another limit."""
        gains_change = parameters.feedback != self._p.feedback
        self._p = parameters
        if gains_change:
            self._prepare()

    def _prepare(self) -> None:
        """Set up the quadratic program for the gains."""
        self._predictions = predictions = Predictions.of(self._p)
        # The unknowns are the additions, and the pitch beyond the limit.
        one, none = np.ones((HORIZON, 1)), np.zeros((HORIZON, 1))
        constraints = np.block(
            [
                [predictions.voltage_response, none],
                [predictions.pitch_response, -one],
                [predictions.pitch_response, one],
            ]
        )
        try:
            import osqp
        except ImportError as error:
            raise ControllerError(
                f'osqp not found ({error}): install it with `pip install "ballbot_ros[mpc]"`'
            ) from None
        self._solver = osqp.OSQP()
        self._solver.setup(
            sparse.diags([1.0] * HORIZON + [SLACK_WEIGHT], format='csc'),
            np.zeros(HORIZON + 1),
            sparse.csc_matrix(constraints),
            np.full(len(constraints), -np.inf),
            np.full(len(constraints), np.inf),
            **SETTINGS,
        )

    def voltage(self, task: TrackingTask, limits: tuple[float, float]) -> float:
        """Return the voltage of the LQR with the first addition [V].

        The limits are the lowest and the highest voltage that the motor can give besides that for
        the reference [V].
        """
        low, high = limits
        voltage = regulated(self._p.feedback, task.error)
        voltages = self._predictions.voltage @ task.error
        pitches = self._predictions.pitch @ task.error + task.psi_ref
        fits = low <= voltages.min() and voltages.max() <= high
        limit = self._p.pitch_limit
        if (fits and np.abs(pitches).max() <= limit) or low >= high:
            return voltage  # nothing to add, or no voltage at all
        free = np.full(HORIZON, np.inf)
        self._solver.update(
            l=np.concatenate([low - voltages, -free, -limit - pitches]),
            u=np.concatenate([high - voltages, limit - pitches, free]),
        )
        return voltage + float(self._solver.solve(raise_error=False).x[0])


def _responses(response: Matrix) -> Matrix:
    """Return the lower triangular matrix whose columns are a response, later by a tick each."""
    matrix = np.zeros((HORIZON, HORIZON))
    for tick in range(HORIZON):
        matrix[tick:, tick] = response[: HORIZON - tick]
    return matrix


class MPC(LQG):
    """At each tick, the cheapest voltages of the next 40 ticks that keep to the limits.

    The voltages are those of the LQR and additions to them. In the LQR's cost, up to infinity, the
    additions cost the sum of their squares. So without a limit in sight they are 0, and the
    controller is the LQG. Otherwise a quadratic program finds them, and the first one is applied.
    """

    portable = False
    parameters_class = MPCParameters
    parameters: MPCParameters

    def start(self) -> None:
        """Start both planes at rest."""
        super().start()
        self._regulators = LimitedRegulator(self.parameters), LimitedRegulator(self.parameters)
        self._law = driving_law(self._balance)

    def retune(self, parameters: LQGParameters, settings: ControllerParameters) -> None:
        """Use other gains, limits and thresholds."""
        super().retune(parameters, settings)
        for each in self._regulators:
            each.retune(self.parameters)

    def tick(self, readings: Readings) -> Duty:
        """Return the duty for the readings of a tick."""
        before = self.state
        self.state, duty = self._law(self.in_force, before, readings)
        self.report(before, readings)
        return duty

    def _balance(self, p: Constants, plane: Plane, inputs: PlaneInputs) -> tuple[Plane, int]:
        task = tracking_task(p, plane, inputs)
        full = max_voltage(inputs.battery_mv)
        limits = -full - task.voltage, full - task.voltage
        voltage = task.voltage + self._regulators[inputs.axis].voltage(task, limits)
        return next_plane(p, plane, task, voltage, inputs.battery_mv)
