"""The document's control law with a filter that removes the drift of the gyro (section 10)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

from ballbot_ros.controllers.controller import max_voltage
from ballbot_ros.controllers.document import axis
from ballbot_ros.controllers.document.axis import (
    THOUSAND,
    TS1_PERIOD,
    ProgramConstants,
    Single,
    constants_of,
    control,
)
from ballbot_ros.controllers.driving import (
    NO_MOTION,
    DrivingConstants,
    DrivingController,
    Motion,
    PlaneInputs,
    driving_constants,
    driving_law,
)
from ballbot_ros.parameters import ControllerParameters, quantity
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.plant.model import PhysicalParameters, mass_matrix


@dataclass(frozen=True)
class DriftFilterParameters:
    """The time constant of the filter."""

    drift_time: float = quantity(
        8.0, 's', (0.1, 1e6), 'time constant of the correction of pitch and gyro offset', '10'
    )


class LeanConstants(NamedTuple):
    """Constants of :func:`observed_lean`: times [s] by which the rates of ball and body count."""

    time: float
    rolling: float
    tilting: float


def lean_constants(time_constant: float, model: PhysicalParameters) -> LeanConstants:
    """Return the constants for a time constant of the correction [s].

    Both poles of the error are at its inverse.
    """
    m = mass_matrix(model)
    lean = model.body_mass * model.body_height * model.gravity
    return LeanConstants(
        time_constant, (m.m11 + m.coupling - m.drive) / lean, (m.m22 + m.coupling - m.drive) / lean
    )


class Lean(NamedTuple):
    """The state of :func:`observed_lean`.

    Attributes
    ----------
    momentum : float
        What the rates of ball and body amount to [deg s].
    offset_error : float
        Correction of the gyro's offset [deg/s].
    """

    momentum: float
    offset_error: float


def observed_lean(
    p: LeanConstants, lean: Lean, psi: float, theta_dot: float, psi_dot: float
) -> tuple[Lean, float]:
    """Return the next state, and the error of the pitch [deg], from the estimates of a tick.

    A body that leans makes the ball accelerate. The sum of both equations of motion (3.22) says so
    without the motor, whose torque acts on ball and body alike, and without its dead zone:
    ``lean · psi = rolling · theta_ddot + tilting · psi_ddot``. Integrated over a time, a lean of
    the estimate that the rates of ball and body do not show is an error. It is also right in
    accelerated motion, when the mean pitch is not 0.
    """
    momentum = p.rolling * theta_dot + p.tilting * psi_dot
    error = TICK_S * psi - (momentum - lean.momentum)
    offset_error = lean.offset_error + error / (p.time * p.time)
    return Lean(momentum, offset_error), 2.0 / p.time * error


class Constants(NamedTuple):
    """The constants of the law; `axis` are those of the document's law."""

    driving: DrivingConstants
    axis: axis.Constants
    lean: LeanConstants


class Plane(NamedTuple):
    """The state of a plane; `axis` is that of the document's law."""

    motion: Motion
    axis: axis.AxisState
    lean: Lean


def balance(p: Constants, plane: Plane, inputs: PlaneInputs) -> tuple[Plane, int]:
    """Return the next state of a plane, and its duty [%]."""
    _, theta_ref_dot, sum_theta_ref_dot, sum_psi_dot, sum_theta_diff, smooth = plane.axis
    offset = Single(inputs.gyro - inputs.rate + plane.lean.offset_error)
    after, estimates, duty = control(
        p.axis, (offset, theta_ref_dot, sum_theta_ref_dot, sum_psi_dot, sum_theta_diff, smooth),
        Single(inputs.gyro), Single(inputs.revolution), Single(inputs.stick),
        Single(max_voltage(inputs.battery_mv)),
    )  # fmt: skip
    gyro_offset, theta_ref_dot, sum_theta_ref_dot, sum_psi_dot, sum_theta_diff, smooth = after
    theta, psi, theta_dot, psi_dot, theta_ref, _, _ = estimates
    motion = Motion(
        double(theta), double(psi), double(theta_dot), double(psi_dot), double(theta_ref),
        double(theta_ref_dot),
    )  # fmt: skip
    lean, pitch_error = observed_lean(
        p.lean, plane.lean, motion.psi, motion.theta_dot, motion.psi_dot
    )
    sum_psi_dot = sum_psi_dot - Single(pitch_error) * THOUSAND / TS1_PERIOD
    corrected = gyro_offset, theta_ref_dot, sum_theta_ref_dot, sum_psi_dot, sum_theta_diff, smooth
    return Plane(motion, corrected, lean), int(duty)


def double(value: Single) -> float:
    """Return a number in double precision; for the compiler, `float` alone does not change it."""
    return float(value) * 1.0


class DriftFilter(DrivingController[DriftFilterParameters]):
    """The document's law on a pitch that does not drift.

    The document's program takes the low-passed gyro reading for its offset. Its pitch is therefore
    too small when the body leans for long, and wrong while the offset changes. Here the ball tells
    what the body really did, see :func:`observed_lean`.
    """

    law = driving_law(balance)
    at_rest = Plane(NO_MOTION, axis.AT_REST, Lean(0.0, 0.0))
    tunable_settings: ClassVar[tuple[str, ...]] = (
        *DrivingController.tunable_settings,
        'k_f',
        'k_i',
        'pwm_gain',
        'pwm_offset',
    )

    @classmethod
    def constants(
        cls,
        parameters: DriftFilterParameters,
        model: PhysicalParameters,
        settings: ControllerParameters,
    ) -> Constants:
        """Return constants with which the document's law keeps the gyro offset that it is given."""
        return Constants(
            driving_constants(settings),
            constants_of(replace(ProgramConstants.of(settings), a_gd=Single(1.0))),
            lean_constants(parameters.drift_time, model),
        )
