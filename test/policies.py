"""Policies that balance, for environments and as controllers."""

import sys
from pathlib import Path

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
    """Acts every 20 ms; it stands for some seconds."""

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


class DrivingPolicy(PolicyController):
    """Leans towards the commanded rates, as long as nothing is near."""

    drives = True

    def make_policy(self):
        pitch = [0.0, 0.0]

        def act(observation):
            *_, distance, command_x, command_y = observation
            action = []
            for axis, command in enumerate((command_x, command_y)):
                rate = observation[axis]
                pitch[axis] += 0.004 * rate
                lean = command / 400.0 if distance > 50.0 else 0.0
                action.append(0.2 * (pitch[axis] - lean) + 0.02 * rate)
            return action

        return act
