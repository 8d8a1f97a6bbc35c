"""A learned policy as a controller: cross_entropy.py learns its weights.

ballbot run stationary --controller learned_policy.py:LearnedPolicy --params policy.yaml
"""

from dataclasses import dataclass

from ballbot_ros.controllers import TICK_S, quantity
from ballbot_ros.controllers.policy import Observation, Policy, PolicyController

WEIGHT = (-10.0, 10.0)


@dataclass(frozen=True)
class Weights:
    """Share of full duty for each feature of a plane."""

    pitch: float = quantity(0.0, '1/deg', WEIGHT, 'weight of the body pitch')
    pitch_rate: float = quantity(0.0, '1/(10 deg/s)', WEIGHT, 'weight of its rate')
    angle: float = quantity(0.0, '1/(90 deg)', WEIGHT, 'weight of the ball angle')
    angle_rate: float = quantity(0.0, '1/(90 deg/s)', WEIGHT, 'weight of its rate')
    integral: float = quantity(0.0, '1/(90 deg·s)', WEIGHT, 'weight of its integral')


class LearnedPolicy(PolicyController[Weights]):
    """A linear policy on estimated features; both planes have the same weights."""

    def make_policy(self) -> Policy:
        """Return the policy, with its estimates at rest."""
        weights = self.parameters
        planes = Plane(weights, self.model.ratio), Plane(weights, self.model.ratio)

        def act(observation: Observation) -> tuple[float, float]:
            rate_x, rate_y, encoder_x, encoder_y, _ = observation
            return planes[0].action(rate_x, encoder_x), planes[1].action(rate_y, encoder_y)

        return act


class Plane:
    """The policy of one plane, with the estimates of its features."""

    def __init__(self, weights: Weights, ratio: float) -> None:
        self.weights, self.wheel_per_ball = weights, 1.0 / ratio
        self.last_rate = self.offset = self.pitch = 0.0
        self.angle = self.angle_rate = self.integral = 0.0

    def action(self, rate: float, encoder: float) -> float:
        """Return the share of full duty for a gyro rate [deg/s] and a motor angle [deg]."""
        # A robot that does not fall has a mean pitch of 0: what remains is drift of the gyro.
        self.offset += TICK_S / 36.0 * self.pitch
        pitch_rate = (rate + self.last_rate) / 2.0 - self.offset
        self.last_rate = rate
        self.pitch += TICK_S * (pitch_rate - self.pitch / 3.0)
        angle = self.wheel_per_ball * encoder + self.pitch
        self.angle_rate += 0.2 * ((angle - self.angle) / TICK_S - self.angle_rate)
        self.angle = angle
        self.integral += TICK_S * angle
        weights = self.weights
        return (
            weights.pitch * self.pitch
            + weights.pitch_rate * pitch_rate / 10.0
            + weights.angle * angle / 90.0
            + weights.angle_rate * self.angle_rate / 90.0
            + weights.integral * self.integral / 90.0
        )
