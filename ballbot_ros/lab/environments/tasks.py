"""The tasks: balancing on the spot, and driving at a commanded speed."""

from __future__ import annotations

import math
from functools import cached_property
from typing import ClassVar

from ballbot_ros.controllers.controller import Duty
from ballbot_ros.lab.environments import rewards
from ballbot_ros.lab.environments.configuration import Commands, random_commands
from ballbot_ros.lab.environments.environment import BallbotEnv
from ballbot_ros.lab.environments.episode import Component, Episode, pair
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.robot.plant.ground_truth import Pair


class BalanceEnv(BallbotEnv):
    """``ballbot_ros/Balance-v0``: balance on the spot, with little duty."""

    task: ClassVar[str] = 'Balance'
    default_duration: ClassVar[float] = 10.0
    largest_pitch: ClassVar[float] = math.radians(4.0)

    def _reward(self, episode: Episode, duty: Duty) -> tuple[float, dict[str, float]]:
        state = self._state(episode)
        upright = rewards.upright(episode.truth.psi)
        near = rewards.near((state[0], state[1]))
        calm = rewards.calm(duty)
        return 0.4 * upright + 0.4 * near + 0.2 * calm, {
            'reward_upright': upright,
            'reward_near': near,
            'reward_calm': calm,
        }


class DriveEnv(BallbotEnv):
    """``ballbot_ros/Drive-v0``: follow a commanded speed that changes every 3 s."""

    task: ClassVar[str] = 'Drive'
    default_duration: ClassVar[float] = 20.0
    largest_pitch: ClassVar[float] = math.radians(1.0)
    drives: ClassVar[bool] = True

    @cached_property
    def _metres_per_degree(self) -> float:
        return math.radians(self._parameters.of(PlantParameters).ball_radius)

    def _quantities(self, state: tuple[Component, ...]) -> tuple[Component, ...]:
        quantities = super()._quantities(state)
        if not self._observes_state:
            return quantities
        full_speed = self._settings.k_thetadot * self._metres_per_degree
        return (*quantities, *pair('commanded_velocity_{}_m_per_s', full_speed))

    def _observe(self, episode: Episode) -> tuple[float, ...]:
        observation = super()._observe(episode)
        if not self._observes_state:
            return observation
        return (*observation, *self._commanded_velocity(episode))

    def _commanded_velocity(self, episode: Episode) -> Pair:
        x, y = episode.observer.commanded_rates
        return x * self._metres_per_degree, y * self._metres_per_degree

    def _commands(self) -> Commands:
        return random_commands(self.np_random, self.duration)

    def _reward(self, episode: Episode, duty: Duty) -> tuple[float, dict[str, float]]:
        commanded, velocity = self._commanded_velocity(episode), episode.truth.velocity
        upright = rewards.upright(episode.truth.psi)
        follow = rewards.follow((velocity[0] - commanded[0], velocity[1] - commanded[1]))
        calm = rewards.calm(duty)
        return 0.3 * upright + 0.5 * follow + 0.2 * calm, {
            'reward_upright': upright,
            'reward_follow': follow,
            'reward_calm': calm,
        }
