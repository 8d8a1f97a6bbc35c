"""A neural network as a controller: ppo_stable_baselines3.py learns its weights.

ballbot run stationary --controller network_policy.py:NetworkPolicy --params network.yaml
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ballbot_ros.controllers import designed
from ballbot_ros.controllers.policy import Observation, Policy, PolicyController

STEP_S = 0.02
SIZES = (8, 32, 32, 2)
"""Features, two hidden layers with tanh, actions."""


@dataclass(frozen=True)
class Network:
    """The weights and biases of each layer, one after the other."""

    weights: tuple[float, ...] = designed('1', None, 'weights and biases of all layers')


class NetworkPolicy(PolicyController[Network]):
    """A network on estimated features."""

    portable = False
    step_ms = 20

    def make_policy(self) -> Policy:
        """Return the policy, with its estimates at rest."""
        layers = layers_of(self.parameters.weights)
        features = Features(self.model.ratio)

        def act(observation: Observation) -> list[float]:
            values = features.update(observation)
            for matrix, bias in layers[:-1]:
                values = np.tanh(matrix @ values + bias)
            matrix, bias = layers[-1]
            return (matrix @ values + bias).tolist()

        return act


def layers_of(weights):
    """Return the matrix and the bias of each layer."""
    flat, layers = np.array(weights), []
    for inputs, outputs in pairwise(SIZES):
        matrix, flat = np.split(flat, [inputs * outputs])
        bias, flat = np.split(flat, [outputs])
        layers.append((matrix.reshape(outputs, inputs), bias))
    return layers


class Features:
    """Estimates pitch and ball angle from gyro and encoder, every 20 ms."""

    def __init__(self, ratio: float) -> None:
        self.wheel_per_ball = 1.0 / ratio
        self.offset, self.pitch, self.angle = np.zeros((3, 2))

    def update(self, observation: Observation) -> np.ndarray:
        """Return pitch, its rate, ball angle and its rate of both planes."""
        rate, encoder = np.array(observation[0:2]), np.array(observation[2:4])
        # A robot that does not fall has a mean pitch of 0: what remains is drift of the gyro.
        self.offset += STEP_S / 36.0 * self.pitch
        rate = rate - self.offset
        self.pitch = self.pitch + STEP_S * (rate - self.pitch / 3.0)
        angle = self.wheel_per_ball * encoder + self.pitch
        angle_rate = (angle - self.angle) / STEP_S
        self.angle = angle
        features = self.pitch / 2.0, rate / 20.0, angle / 90.0, angle_rate / 180.0
        return np.clip(np.concatenate(features), -5.0, 5.0)
