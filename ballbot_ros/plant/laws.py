"""The laws of a step that are no equations of motion: falls, pushes, gear play, release."""

from __future__ import annotations

from ballbot_ros.numerics.elementary import sine_cosine
from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.plant.integration import PlaneState
from ballbot_ros.timing import STEP_NS


def has_fallen(psi_x: float, psi_y: float, fall_angle: float) -> bool:
    """Return whether a pitch [rad] is not within the fall angle [rad]; NaN is not."""
    return not (-fall_angle < psi_x < fall_angle and -fall_angle < psi_y < fall_angle)


def state_after_fall(state: PlaneState, fall_angle: float) -> PlaneState:
    """Return the state of a fallen plane at rest, at a pitch of at most `fall_angle` [rad]."""
    return state[0], max(-fall_angle, min(fall_angle, state[1])), 0.0, 0.0


def wheel_angle(ratio: float, theta: float, psi: float, start_psi: float) -> float:
    """Return the angle [rad] of a wheel since the start, from ball angle and pitch [rad]."""
    return ratio * (theta - (psi - start_psi))


def shaft_angle(shaft: float, wheel: float, half_play: float) -> float:
    """Return the angle of the motor shaft, which the wheel drags along within the gear play.

    The previous angle of the shaft, the wheel's angle and half of the play are in rad.
    """
    return min(wheel + half_play, max(wheel - half_play, shaft))


def add_push_forces(
    force_theta: float,
    force_psi: float,
    force: float,
    torque: float,
    psi: float,
    ball_radius: float,
    body_height: float,
) -> Pair:
    """Return the generalised forces [N·m] on theta and psi, with those of a push added.

    Parameters
    ----------
    force_theta, force_psi : float
        The other forces [N·m].
    force, torque : float
        Horizontal force at the body's centre [N] and torque [N·m] of the push.
    psi : float
        Pitch [rad].
    ball_radius, body_height : float
        Rs and L [m].
    """
    _, cosine = sine_cosine(psi)
    force_theta += force * ball_radius
    force_psi += force * body_height * cosine
    force_psi += torque
    return force_theta, force_psi


def is_release(time_ns: int, hold_until: int) -> bool:
    """Return whether the step that begins at a time [ns] is the first after the hold [ns]."""
    return time_ns - STEP_NS < hold_until <= time_ns


def released(state: PlaneState, pitch_rate: float) -> PlaneState:
    """Return the state of a plane that is released with a rate of its pitch [rad/s]."""
    return state[0], state[1], state[2], state[3] + pitch_rate
