"""Environments for reinforcement learning, with the interface of Gymnasium. No ROS.

The import registers ``ballbot_ros/Balance-v0`` and ``ballbot_ros/Drive-v0``.
"""

from ballbot_ros.lab.environments import (
    BalanceEnv,
    BalanceVectorEnv,
    BallbotEnv,
    BallbotVectorEnv,
    DriveEnv,
    DriveVectorEnv,
    EnvironmentConfigurationError,
    EnvironmentState,
)

__all__ = [
    'BalanceEnv',
    'BalanceVectorEnv',
    'BallbotEnv',
    'BallbotVectorEnv',
    'DriveEnv',
    'DriveVectorEnv',
    'EnvironmentConfigurationError',
    'EnvironmentState',
]
