"""The document's control law with a filter that removes the drift of the gyro (section 10)."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.controllers.controller import Controller, Duty, Readings
from ballbot_ros.controllers.document.axis import THOUSAND, TS1_PERIOD, Axis
from ballbot_ros.controllers.document.constants import ProgramConstants, Single
from ballbot_ros.controllers.driving import MOTORS_OFF, TICK_S, Driving, DrivingParameters
from ballbot_ros.controllers.interface import Estimates
from ballbot_ros.parameters import ControllerParameters, quantity
from ballbot_ros.plant.model import PhysicalParameters, mass_matrix

COEFFICIENT = (0.0, 1.0)
LAW = ControllerParameters()
"""The document's values."""


@dataclass(frozen=True, kw_only=True)
class DriftFilterParameters(DrivingParameters):
    """The parameters of the document's law, and the time constant of the filter."""

    k_f: tuple[float, float, float, float] = quantity(
        LAW.k_f, 'V/deg, V·s/deg', (-1e9, 1e9), 'servo control feedback gain of θ, ψ, θ˙, ψ˙', '4.2'
    )
    k_i: float = quantity(LAW.k_i, 'V/(deg·s)', (-1e9, 1e9), 'servo control integral gain', '4.2')
    a_d: float = quantity(LAW.a_d, '1', COEFFICIENT, 'low pass: velocity', '7.7')
    a_r: float = quantity(LAW.a_r, '1', COEFFICIENT, 'low pass: speed reference', '7.7')
    drift_time: float = quantity(
        8.0, 's', (0.1, 1e6), 'time constant of the correction of pitch and gyro offset', '10'
    )


class DriftFilter(Controller[DriftFilterParameters]):
    """The document's law on a pitch that does not drift.

    The document's program takes the low-passed gyro reading for its offset. Its pitch is therefore
    too small when the body leans for long, and wrong while the offset changes. Here the ball tells
    what the body really did, see :class:`LeanObserver`.
    """

    def start(self) -> None:
        """Start both planes at rest."""
        p = self.parameters
        constants = ProgramConstants.of(
            ControllerParameters(
                k_f=p.k_f, k_i=p.k_i, a_d=p.a_d, a_r=p.a_r,
                a_gd=1.0,  # Axis keeps the offset that it is given
                k_thetadot=p.k_thetadot,
                wheel_radius=self.model.wheel_radius, ball_radius=self.model.ball_radius,
            )
        )  # fmt: skip
        self._driving = Driving(p, self.sound)
        self._axes = Axis(constants), Axis(constants)
        self._observers = tuple(LeanObserver(p.drift_time, self.model) for _ in self._axes)

    def tick(self, readings: Readings) -> Duty:
        """Return the duties for the readings."""
        driving = self._driving
        self.operating_state = driving.update(readings)
        if not driving.balances:
            return MOTORS_OFF
        duty = self._duty(0, readings), self._duty(1, readings)
        self.x, self.y = (_estimates(axis) for axis in self._axes)
        driving.watch(readings, self.x, self.y)
        return duty

    def _duty(self, plane: int, readings: Readings) -> int:
        axis, observer = self._axes[plane], self._observers[plane]
        axis.gyro_offset = Single(self._driving.gyro_offsets[plane] + observer.offset_error)
        duty = axis.control(
            readings.gyro[plane],
            readings.revolutions[plane],
            self._driving.sticks[plane],
            Single(readings.max_voltage),
        )
        pitch_error = observer.update(float(axis.psi), float(axis.theta_dot), float(axis.psi_dot))
        axis.sum_psi_dot -= Single(pitch_error) * THOUSAND / TS1_PERIOD
        return duty


class LeanObserver:
    """Finds the errors of pitch and gyro offset from the motion of the ball.

    A body that leans makes the ball accelerate. The sum of both equations of motion (3.22) says so
    without the motor, whose torque acts on ball and body alike, and without its dead zone:
    ``lean · psi = rolling · theta_ddot + tilting · psi_ddot``. Integrated over a time, a lean of
    the estimate that the rates of ball and body do not show is an error. It is also right in
    accelerated motion, when the mean pitch is not 0.

    Parameters
    ----------
    time_constant : float
        Of the correction [s]; both poles of the error are at its inverse.

    Attributes
    ----------
    offset_error : float
        Correction of the gyro's offset [deg/s].
    """

    def __init__(self, time_constant: float, model: PhysicalParameters) -> None:
        m = mass_matrix(model)
        lean = model.body_mass * model.body_height * model.gravity
        self._rolling = (m.m11 + m.coupling - m.drive) / lean
        self._tilting = (m.m22 + m.coupling - m.drive) / lean
        self._time = time_constant
        self._momentum = 0.0
        self.offset_error = 0.0

    def update(self, psi: float, theta_dot: float, psi_dot: float) -> float:
        """Return the error of the pitch [deg] to correct, from the estimates of a tick."""
        momentum = self._rolling * theta_dot + self._tilting * psi_dot
        error = TICK_S * psi - (momentum - self._momentum)
        self._momentum = momentum
        self.offset_error += error / self._time**2
        return 2.0 / self._time * error


def _estimates(axis: Axis) -> Estimates:
    return Estimates(
        *map(
            float,
            (
                axis.theta, axis.psi, axis.theta_dot, axis.psi_dot,
                axis.theta_ref, axis.theta_ref_dot,
            ),
        )
    )  # fmt: skip
