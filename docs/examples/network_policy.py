"""A neural network as a controller: ppo_stable_baselines3.py learns its weights.

ballbot run stationary --controller network_policy.py:NetworkPolicy --params network.yaml
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ballbot_ros.controllers import TICK_S, designed
from ballbot_ros.controllers.policy import Observation, Policy, PolicyController

SIZES = (5, 16, 16, 1)
"""Features of a plane, two hidden layers with tanh, the plane's action."""

ESTIMATES = 6
"""Numbers that :func:`estimate` keeps of a plane."""


@dataclass(frozen=True)
class Network:
    """The weights and biases of each layer, one after the other."""

    weights: tuple[float, ...] = designed('1', None, 'weights and biases of all layers')


class NetworkPolicy(PolicyController[Network]):
    """A network on estimated features, the same for both planes."""

    # Another numpy may sum in another order.
    portable = False

    def make_policy(self) -> Policy:
        """Return the policy, with its estimates at rest."""
        layers = layers_of(self.parameters.weights)
        wheel_per_ball = 1.0 / self.model.ratio
        estimates = np.zeros((ESTIMATES, 2))

        def act(observation: Observation) -> list[float]:
            nonlocal estimates
            estimates, values = estimate(estimates, np.array(observation), wheel_per_ball)
            for matrix, bias in layers[:-1]:
                values = np.tanh(values @ matrix.T + bias)
            matrix, bias = layers[-1]
            return (values @ matrix.T + bias)[:, 0].tolist()

        return act


def layers_of(weights):
    """Return the matrix and the bias of each layer."""
    flat, layers = np.array(weights), []
    for inputs, outputs in pairwise(SIZES):
        matrix, flat = np.split(flat, [inputs * outputs])
        bias, flat = np.split(flat, [outputs])
        layers.append((matrix.reshape(outputs, inputs), bias))
    return layers


def estimate(estimates, observation, wheel_per_ball):
    """Estimate pitch and ball angle of both planes from gyro and encoder, every 4 ms.

    Parameters
    ----------
    estimates : (6, ..., 2) array
        The previous estimates; the last axis has the planes, those before it may have robots.
    observation : (..., 5) array

    Returns
    -------
    (6, ..., 2) array
        The next estimates.
    (..., 2, 5) array
        Features: pitch, its rate, ball angle, its rate and its integral.
    """
    previous_rate, offset, pitch, previous_angle, angle_rate, integral = estimates
    rate, encoder = observation[..., 0:2], observation[..., 2:4]
    # A robot that does not fall has a mean pitch of 0: what remains is drift of the gyro.
    offset = offset + TICK_S / 36.0 * pitch
    pitch_rate = (rate + previous_rate) / 2.0 - offset
    pitch = pitch + TICK_S * (pitch_rate - pitch / 3.0)
    angle = wheel_per_ball * encoder + pitch
    angle_rate = angle_rate + 0.2 * ((angle - previous_angle) / TICK_S - angle_rate)
    integral = integral + TICK_S * angle
    features = pitch / 2.0, pitch_rate / 20.0, angle / 90.0, angle_rate / 90.0, integral / 90.0
    return (
        np.stack([rate, offset, pitch, angle, angle_rate, integral]),
        np.clip(np.stack(features, axis=-1), -5.0, 5.0),
    )
