"""A learned policy as a controller: cross_entropy.py learns its weights.

ballbot run stationary --controller learned_policy.py:LearnedPolicy --params policy.yaml
"""

from dataclasses import dataclass
from typing import NamedTuple

from ballbot_ros.controllers import TICK_S, ControllerParameters, PhysicalParameters, quantity
from ballbot_ros.controllers.policy import Observation, PolicyController

WEIGHT = (-10.0, 10.0)


@dataclass(frozen=True)
class Weights:
    """Share of full duty for each feature of a plane."""

    pitch: float = quantity(0.0, '1/deg', WEIGHT, 'weight of the body pitch')
    pitch_rate: float = quantity(0.0, '1/(10 deg/s)', WEIGHT, 'weight of its rate')
    angle: float = quantity(0.0, '1/(90 deg)', WEIGHT, 'weight of the ball angle')
    angle_rate: float = quantity(0.0, '1/(90 deg/s)', WEIGHT, 'weight of its rate')
    integral: float = quantity(0.0, '1/(90 deg·s)', WEIGHT, 'weight of its integral')


class Constants(NamedTuple):
    """The weights, and how far a motor turns per angle of the ball."""

    pitch: float
    pitch_rate: float
    angle: float
    angle_rate: float
    integral: float
    wheel_per_ball: float


class Plane(NamedTuple):
    """The estimates of a plane's features; `rate` is the previous one of the gyro."""

    rate: float = 0.0
    offset: float = 0.0
    pitch: float = 0.0
    angle: float = 0.0
    angle_rate: float = 0.0
    integral: float = 0.0


class Planes(NamedTuple):
    """The state of the policy."""

    x: Plane
    y: Plane


def policy(
    p: Constants, planes: Planes, observation: Observation
) -> tuple[Planes, tuple[float, float]]:
    """Return the next state and the action; both planes have the same weights."""
    rate_x, rate_y, encoder_x, encoder_y, _ = observation
    x, action_x = balance(p, planes.x, rate_x, encoder_x)
    y, action_y = balance(p, planes.y, rate_y, encoder_y)
    return Planes(x, y), (action_x, action_y)


def balance(p: Constants, plane: Plane, rate: float, encoder: float) -> tuple[Plane, float]:
    """Return the share of full duty for a gyro rate [deg/s] and a motor angle [deg]."""
    # A robot that does not fall has a mean pitch of 0: what remains is drift of the gyro.
    offset = plane.offset + TICK_S / 36.0 * plane.pitch
    pitch_rate = (rate + plane.rate) / 2.0 - offset
    pitch = plane.pitch + TICK_S * (pitch_rate - plane.pitch / 3.0)
    angle = p.wheel_per_ball * encoder + pitch
    change = (angle - plane.angle) / TICK_S - plane.angle_rate
    angle_rate = plane.angle_rate + 0.2 * change
    integral = plane.integral + TICK_S * angle
    action = (
        p.pitch * pitch
        + p.pitch_rate * pitch_rate / 10.0
        + p.angle * angle / 90.0
        + p.angle_rate * angle_rate / 90.0
        + p.integral * integral / 90.0
    )
    return Plane(rate, offset, pitch, angle, angle_rate, integral), action


class LearnedPolicy(PolicyController[Weights]):
    """A linear policy on estimated features."""

    policy = policy

    @classmethod
    def constants(
        cls, weights: Weights, model: PhysicalParameters, _: ControllerParameters
    ) -> Constants:
        """Return the weights and the ratio of the model."""
        return Constants(
            weights.pitch, weights.pitch_rate, weights.angle, weights.angle_rate, weights.integral,
            1.0 / model.ratio,
        )  # fmt: skip

    @classmethod
    def initial_state(cls, constants: Constants) -> Planes:
        """Return the estimates at rest."""
        return Planes(Plane(), Plane())
