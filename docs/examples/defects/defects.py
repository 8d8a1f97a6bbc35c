"""Controllers with planted defects: each is the included `pid` but for one mistake.

A study next to this file varies the runs of each. Few of them show the mistake; with `pid` itself,
all properties hold.
"""

from typing import NamedTuple

from ballbot_ros.controllers import Duty, Readings
from ballbot_ros.controllers.driving import (
    STANDING_BY,
    DrivingState,
    PlaneInputs,
    State,
    driving_law,
)
from ballbot_ros.controllers.pid import PID, Constants, Plane, balance
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.brick.sensors import NO_ECHO_CM

FAST_DEG_PER_S = 300.0
HOLD_MS = 1000
INT16_VALUES = 1 << 16

drive = PID.law


def balance_with_sign_error(p: Constants, plane: Plane, inputs: PlaneInputs) -> tuple[Plane, int]:
    """Balance a plane, but beyond ±300 deg/s with the derivative term of the wrong sign."""
    sign = -1.0 if abs(inputs.rate) > FAST_DEG_PER_S else 1.0
    wrong = Constants(
        p.driving, p.reference_share, p.pitch_p, sign * p.pitch_d, p.position_p, p.position_i,
        p.position_d, p.back_emf, p.rate_share, p.drift_time, p.wheel_per_ball,
    )  # fmt: skip
    return balance(wrong, plane, inputs)


class SignError(PID):
    """Drives the wrong way while the body tips faster than 300 deg/s."""

    law = driving_law(balance_with_sign_error)


def balance_winding_up(p: Constants, plane: Plane, inputs: PlaneInputs) -> tuple[Plane, int]:
    """Balance a plane, but integrate the error of the ball angle at full duty, too."""
    after, duty = balance(p, plane, inputs)
    integral = plane.integral + TICK_S * (after.motion.theta_ref - after.motion.theta)
    return Plane(after.motion, after.reference, after.offset_error, after.rate, integral), duty


class UnlimitedIntegrator(PID):
    """Lets the integral wind up while the motors can't follow."""

    law = driving_law(balance_winding_up)


class SonarState(NamedTuple):
    """The state of a controller that drives, with what it knows of the sonar.

    Attributes
    ----------
    distance_cm : int
        The distance in force.
    missed_ms : int
        When the newest echo was missed.
    """

    driving: DrivingState
    x: Plane
    y: Plane
    distance_cm: int
    missed_ms: int


def drive_by_stale_sonar(
    p: Constants, state: SonarState, readings: Readings
) -> tuple[SonarState, Duty]:
    """Drive, but after a missed echo with the distance before it, even if echoes return again."""
    distance_cm, missed_ms = readings.distance_cm, state.missed_ms
    if distance_cm == NO_ECHO_CM:
        missed_ms = readings.elapsed_ms
    if readings.elapsed_ms - missed_ms < HOLD_MS:
        distance_cm = state.distance_cm
    seen = Readings(
        readings.elapsed_ms, readings.gyro, readings.revolutions, readings.battery_mv, distance_cm,
        readings.sticks,
    )  # fmt: skip
    after, duty = drive(p, State(state.driving, state.x, state.y), seen)
    return SonarState(after.driving, after.x, after.y, distance_cm, missed_ms), duty


class StaleSonar(PID):
    """Keeps a distance for a second after a missed echo."""

    law = drive_by_stale_sonar

    @classmethod
    def initial_state(cls, constants: Constants) -> SonarState:  # type: ignore[override]
        """Return the state before the first tick."""
        return SonarState(STANDING_BY, cls.at_rest, cls.at_rest, NO_ECHO_CM, -HOLD_MS)


def balance_with_overflow(p: Constants, plane: Plane, inputs: PlaneInputs) -> tuple[Plane, int]:
    """Balance a plane, but multiply stick and largest speed as C may: in 16 bits."""
    product = inputs.stick * int(p.driving.k_thetadot)
    wrapped = (product + INT16_VALUES // 2) % INT16_VALUES - INT16_VALUES // 2
    speed = wrapped / p.driving.gp_max
    return balance(
        p, plane,
        PlaneInputs(
            inputs.axis, inputs.gyro, inputs.rate, inputs.revolution, inputs.stick, speed,
            inputs.battery_mv,
        ),
    )  # fmt: skip


class FullStick(PID):
    """Drives backwards if the product of stick and largest speed exceeds 32767."""

    law = driving_law(balance_with_overflow)
