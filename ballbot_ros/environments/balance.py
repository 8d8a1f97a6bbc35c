"""Balancing on the spot."""

from __future__ import annotations

import math
from typing import ClassVar

from ballbot_ros.controllers.controller import Duty
from ballbot_ros.environments import rewards
from ballbot_ros.environments.environment import BallbotEnv
from ballbot_ros.environments.episode import Episode


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
