"""Environments for reinforcement learning, with the interface of Gymnasium. No ROS.

The import registers ``ballbot_ros/Balance-v0`` and ``ballbot_ros/Drive-v0``.
"""

try:
    import gymnasium
except ImportError as error:
    raise ImportError(
        f'gymnasium not found ({error}): install it with `pip install "ballbot_ros[gym]"`'
    ) from None

from ballbot_ros.errors import EnvironmentConfigurationError
from ballbot_ros.lab.environments.environment import BalanceEnv, BallbotEnv, DriveEnv
from ballbot_ros.lab.environments.episode import EnvironmentState
from ballbot_ros.lab.environments.vector_environment import (
    BalanceVectorEnv,
    BallbotVectorEnv,
    DriveVectorEnv,
)

__all__ = [
    'BalanceEnv', 'BalanceVectorEnv', 'BallbotEnv', 'BallbotVectorEnv', 'DriveEnv',
    'DriveVectorEnv', 'EnvironmentConfigurationError', 'EnvironmentState',
]  # fmt: skip

for _one, _many in ((BalanceEnv, BalanceVectorEnv), (DriveEnv, DriveVectorEnv)):
    gymnasium.register(
        id=f'ballbot_ros/{_one.task.name}-v0',
        entry_point=f'{_one.__module__}:{_one.__name__}',
        vector_entry_point=f'{_many.__module__}:{_many.__name__}',
    )
