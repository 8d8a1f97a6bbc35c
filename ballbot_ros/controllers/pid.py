"""A cascade of two PID controllers: the ball's position demands a pitch, the pitch a voltage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ballbot_ros.controllers.controller import MAX_DUTY, duty_of_voltage
from ballbot_ros.controllers.driving import (
    NO_MOTION,
    NO_REFERENCE,
    DrivingConstants,
    DrivingController,
    Motion,
    PlaneInputs,
    Reference,
    driving_constants,
    driving_law,
    low_pass_share,
    next_reference,
)
from ballbot_ros.parameters import ControllerParameters, quantity
from ballbot_ros.parameters.parameter import live
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.plant.model import PhysicalParameters


def gain(default: float, unit: str, description: str) -> float:
    """Declare a gain, which can be changed during a run."""
    return live(default, unit, (0.0, 1e6), description)


@dataclass(frozen=True)
class PIDParameters:
    """Gains of both controllers, and time constants of the estimates."""

    reference_time: float = quantity(
        0.3, 's', (0.0, 60.0), 'time constant of each of two low passes of the speed'
    )
    pitch_p: float = gain(1.6, 'V/deg', 'voltage for a pitch error')
    pitch_d: float = gain(0.2, 'V·s/deg', 'voltage for a pitch rate')
    position_p: float = gain(0.012, '1', 'pitch for an error of the ball angle')
    position_i: float = gain(0.004, '1/s', 'pitch for its integral')
    position_d: float = gain(0.01, 's', 'pitch for an error of the ball rate')
    back_emf: float = gain(0.0111, 'V·s/deg', 'voltage that keeps the ball rolling, per ball rate')
    rate_time: float = quantity(
        0.02, 's', (0.0, 10.0), 'time constant of the low pass of the ball rate'
    )
    drift_time: float = quantity(
        6.0, 's', (0.1, 1e6), 'time constant at which the gyro offset is corrected'
    )


class Constants(NamedTuple):
    """The constants of the law: its parameters, and what follows from them."""

    driving: DrivingConstants
    reference_share: float
    pitch_p: float
    pitch_d: float
    position_p: float
    position_i: float
    position_d: float
    back_emf: float
    rate_share: float
    drift_time: float
    wheel_per_ball: float


class Plane(NamedTuple):
    """The state of a plane.

    Attributes
    ----------
    offset_error : float
        Error of the gyro's offset [deg/s].
    rate : float
        The previous reading of the gyro [deg/s].
    integral : float
        Of the error of the ball angle [deg s].
    """

    motion: Motion
    reference: Reference
    offset_error: float
    rate: float
    integral: float


def balance(p: Constants, plane: Plane, inputs: PlaneInputs) -> tuple[Plane, int]:
    """Return the next state of a plane, and its duty [%]."""
    reference = next_reference(p.reference_share, plane.reference, inputs.speed)
    offset_error, theta, psi, theta_dot, psi_dot = estimated(p, plane, inputs)
    error = reference.theta - theta
    pitch = (
        p.position_p * error
        + p.position_i * plane.integral
        + p.position_d * (reference.theta_dot - theta_dot)
    )
    voltage = p.pitch_p * (psi - pitch) + p.pitch_d * psi_dot + p.back_emf * theta_dot
    duty = duty_of_voltage(voltage, inputs.battery_mv)
    integral = plane.integral
    if abs(duty) < MAX_DUTY:  # else the integral would wind up
        integral += TICK_S * error
    motion = Motion(theta, psi, theta_dot, psi_dot, reference.theta, reference.theta_dot)
    return Plane(motion, reference, offset_error, inputs.rate, integral), duty


def estimated(
    p: Constants, plane: Plane, inputs: PlaneInputs
) -> tuple[float, float, float, float, float]:
    """Return the error of the gyro's offset, and theta, psi and their rates."""
    before = plane.motion
    # A robot that does not fall has a mean pitch of 0: what remains is the gyro's drift.
    offset_error = plane.offset_error + TICK_S / (p.drift_time * p.drift_time) * before.psi
    # The mean of two readings: the motors answer within a tick, so that a strong reaction to
    # single readings would make them shiver from tick to tick.
    psi_dot = (inputs.rate + plane.rate) / 2.0 - offset_error
    psi = before.psi + TICK_S * (psi_dot - 2.0 / p.drift_time * before.psi)
    theta = p.wheel_per_ball * inputs.revolution + psi
    change = (theta - before.theta) / TICK_S - before.theta_dot
    return offset_error, theta, psi, before.theta_dot + p.rate_share * change, psi_dot


class PID(DrivingController[PIDParameters]):
    """Two PID controllers in a cascade, for each plane.

    The outer one leans the body against an error of the ball's angle (P), its integral (I) and its
    rate (D). The inner one drives the ball under the body: P on the pitch error, D on its rate.
    """

    law = driving_law(balance)
    at_rest = Plane(NO_MOTION, NO_REFERENCE, 0.0, 0.0, 0.0)

    @classmethod
    def constants(
        cls, p: PIDParameters, model: PhysicalParameters, settings: ControllerParameters
    ) -> Constants:
        """Return the constants of the law."""
        return Constants(
            driving_constants(settings), low_pass_share(p.reference_time), p.pitch_p, p.pitch_d,
            p.position_p, p.position_i, p.position_d, p.back_emf, low_pass_share(p.rate_time),
            p.drift_time, 1.0 / model.ratio,
        )  # fmt: skip
