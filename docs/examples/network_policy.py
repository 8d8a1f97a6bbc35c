"""A neural network as a controller: ppo_stable_baselines3.py learns its weights.

ballbot run stationary --controller network_policy.py:NetworkPolicy --params network.yaml
"""

from dataclasses import dataclass
from typing import NamedTuple

from ballbot_ros.controllers import ControllerParameters, PhysicalParameters, designed
from ballbot_ros.controllers.policy import Observation, PolicyController

STEP_S = 0.02
FEATURES = 5


@dataclass(frozen=True)
class Network:
    """A hidden layer, and an output: for each plane the share of full duty."""

    weights: tuple[float, ...] = designed('1', None, 'weights and biases, layer by layer')


class Constants(NamedTuple):
    """The weights, and how far a motor turns per angle of the ball."""

    weights: tuple[float, ...]
    wheel_per_ball: float


class Plane(NamedTuple):
    """The estimates of a plane."""

    offset: float = 0.0
    pitch: float = 0.0
    pitch_rate: float = 0.0
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
    """Return the next state and the action; both planes have the same network."""
    rate_x, rate_y, encoder_x, encoder_y, _ = observation
    x = estimated(planes.x, p.wheel_per_ball, rate_x, encoder_x)
    y = estimated(planes.y, p.wheel_per_ball, rate_y, encoder_y)
    return Planes(x, y), (output(p.weights, features(x)), output(p.weights, features(y)))


def estimated(plane: Plane, wheel_per_ball: float, rate: float, encoder: float) -> Plane:
    """Return the estimates after 20 ms for a gyro rate [deg/s] and a motor angle [deg]."""
    # A robot that does not fall has a mean pitch of 0: what remains is drift of the gyro.
    offset = plane.offset + STEP_S / 36.0 * plane.pitch
    pitch_rate = rate - offset
    pitch = plane.pitch + STEP_S * (pitch_rate - plane.pitch / 3.0)
    angle = wheel_per_ball * encoder + pitch
    angle_rate = (angle - plane.angle) / STEP_S
    return Plane(offset, pitch, pitch_rate, angle, angle_rate, plane.integral + STEP_S * angle)


def features(plane: Plane) -> tuple[float, float, float, float, float]:
    """Return the inputs of the network, of which most are within ±1."""
    return (
        plane.pitch / 2.0, plane.pitch_rate / 20.0,
        plane.angle / 90.0, plane.angle_rate / 180.0, plane.integral / 180.0,
    )  # fmt: skip


def output(weights: tuple[float, ...], inputs: tuple[float, float, float, float, float]) -> float:
    """Return the output of the network.

    The units of the hidden layer are softsigns, x / (1 + |x|), which are the same on every machine.
    """
    units = len(weights) // (FEATURES + 2)
    biases, outputs = units * FEATURES, units * (FEATURES + 1)
    total = weights[len(weights) - 1]
    for unit in range(units):
        x = weights[biases + unit]
        for number in range(FEATURES):
            x += weights[unit * FEATURES + number] * inputs[number]
        total += weights[outputs + unit] * x / (1.0 + abs(x))
    return total


class NetworkPolicy(PolicyController[Network]):
    """A network on estimated features."""

    policy = policy
    step_ms = 20

    @classmethod
    def constants(
        cls, network: Network, model: PhysicalParameters, _: ControllerParameters
    ) -> Constants:
        """Return the weights and the ratio of the model."""
        return Constants(network.weights, 1.0 / model.ratio)

    @classmethod
    def initial_state(cls, constants: Constants) -> Planes:
        """Return the estimates at rest."""
        return Planes(Plane(), Plane())
