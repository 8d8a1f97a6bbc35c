"""The environments of :mod:`ballbot_ros.environments`.

The import registers ``ballbot_ros/Balance-v0`` and ``ballbot_ros/Drive-v0``.
"""

try:
    import gymnasium
except ImportError as error:
    raise ImportError(
        f'gymnasium not found ({error}): install it with `pip install "ballbot_ros[gym]"`'
    ) from None

from ballbot_ros.errors import EnvironmentConfigurationError
from ballbot_ros.lab.environments.environment import BallbotEnv
from ballbot_ros.lab.environments.episode import EnvironmentState
from ballbot_ros.lab.environments.tasks import BalanceEnv, DriveEnv

__all__ = [
    'BalanceEnv',
    'BallbotEnv',
    'DriveEnv',
    'EnvironmentConfigurationError',
    'EnvironmentState',
]

for _cls in (BalanceEnv, DriveEnv):
    gymnasium.register(
        id=f'ballbot_ros/{_cls.task}-v0', entry_point=f'{_cls.__module__}:{_cls.__name__}'
    )
