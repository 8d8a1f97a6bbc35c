"""The document's control law with a filter that removes the drift of the gyro (section 10)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from ballbot_ros.controllers.controller import Readings
from ballbot_ros.controllers.document.axis import (
    AT_REST,
    THOUSAND,
    TS1_PERIOD,
    Constants,
    PlaneValues,
    ProgramConstants,
    Single,
    constants_of,
    control,
)
from ballbot_ros.controllers.driving import DrivingController, PlaneController, PlaneInputs
from ballbot_ros.controllers.interface import Estimates
from ballbot_ros.parameters import ControllerParameters, quantity
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.plant.model import PhysicalParameters, mass_matrix


@dataclass(frozen=True)
class DriftFilterParameters:
    """The time constant of the filter."""

    drift_time: float = quantity(
        8.0, 's', (0.1, 1e6), 'time constant of the correction of pitch and gyro offset', '10'
    )


class DriftFilter(DrivingController[DriftFilterParameters]):
    """The document's law on a pitch that does not drift.

    The document's program takes the low-passed gyro reading for its offset. Its pitch is therefore
    too small when the body leans for long, and wrong while the offset changes. Here the ball tells
    what the body really did, see :class:`LeanObserver`.
    """

    tunable_settings: ClassVar[tuple[str, ...]] = (
        *DrivingController.tunable_settings,
        'k_f',
        'k_i',
        'pwm_gain',
        'pwm_offset',
    )

    def make_plane(self) -> PlaneController:
        """Return the controller of a plane, at rest."""
        return DriftFreeAxis(self.settings, self.parameters.drift_time, self.model)


class DriftFreeAxis:
    """The document's controller of a plane, whose gyro offset is known."""

    def __init__(
        self, settings: ControllerParameters, drift_time: float, model: PhysicalParameters
    ) -> None:
        self._constants, self._state = _constants(settings), AT_REST
        self._observer = LeanObserver(drift_time, model)
        self.estimates = Estimates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def retune(self, _: DriftFilterParameters, settings: ControllerParameters) -> None:
        """Use other gains of the document."""
        self._constants = _constants(settings)

    def duty(self, readings: Readings, inputs: PlaneInputs) -> int:
        """Return the duty [%]."""
        observer = self._observer
        offset = Single(inputs.gyro - inputs.rate + observer.offset_error)
        state, estimates, duty = control(
            self._constants, (offset, *self._state[1:]), Single(inputs.gyro),
            Single(inputs.revolution), Single(inputs.stick), Single(readings.max_voltage),
        )  # fmt: skip
        axis = PlaneValues(*state, *estimates)
        pitch_error = observer.update(float(axis.psi), float(axis.theta_dot), float(axis.psi_dot))
        sum_psi_dot = axis.sum_psi_dot - Single(pitch_error) * THOUSAND / TS1_PERIOD
        self._state = (*state[:3], sum_psi_dot, *state[4:])
        for name in vars(self.estimates):
            setattr(self.estimates, name, float(getattr(axis, name)))
        return int(duty)


def _constants(settings: ControllerParameters) -> Constants:
    """Return constants with which the law keeps the gyro offset that it is given."""
    return constants_of(ProgramConstants.of(replace(settings, a_gd=1.0)))


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
        self.offset_error += error / (self._time * self._time)
        return 2.0 / self._time * error
