"""Policies that balance, for environments and as controllers."""

import sys
from pathlib import Path
from typing import NamedTuple

import yaml

from ballbot_ros.controllers.policy import PolicyController

EXAMPLES = Path(__file__).parents[1] / 'docs' / 'examples'
sys.path.insert(0, str(EXAMPLES))

from learned_policy import LearnedPolicy, Weights  # noqa: E402

sys.path.remove(str(EXAMPLES))

LEARNED = EXAMPLES / 'policy.yaml'
"""What cross_entropy.py writes."""


def learned_policy():
    """Return the controller with the learned weights."""
    text = yaml.safe_load(LEARNED.read_text(encoding='utf-8'))
    values = text['/**/controller']['ros__parameters']
    weights = {name.removeprefix('user.'): value for name, value in values.items()}
    return LearnedPolicy(Weights(**weights))


class SlowPolicy(PolicyController):
    """Acts every 20 ms, by a function that keeps its state; it stands for some seconds."""

    step_ms = 20

    def make_policy(self):
        pitch = [0.0, 0.0]

        def act(observation):
            action = []
            for axis in (0, 1):
                rate = observation[axis]
                pitch[axis] += 0.02 * rate
                action.append(0.15 * pitch[axis] + 0.02 * rate + observation[2 + axis] / 900.0)
            return action

        return act


class Pitch(NamedTuple):
    x: float = 0.0
    y: float = 0.0


def drive(p, pitch, observation):
    rate_x, rate_y, _, _, _, distance, command_x, command_y = observation
    near = distance <= 50.0
    x, action_x = lean(pitch.x, rate_x, 0.0 if near else command_x)
    y, action_y = lean(pitch.y, rate_y, 0.0 if near else command_y)
    return Pitch(x, y), (action_x, action_y)


def lean(pitch, rate, command):
    pitch += 0.004 * rate
    return pitch, 0.2 * (pitch - command / 400.0) + 0.02 * rate


class DrivingPolicy(PolicyController):
    """Leans towards the commanded rates, as long as nothing is near."""

    policy = drive
    drives = True

    @classmethod
    def initial_state(cls, constants):
        return Pitch()
