"""Errors of the environments."""

from ballbot_ros.errors import BallbotError


class EnvironmentConfigurationError(BallbotError, ValueError):
    """An argument, a reset option or a saved state that an environment can't use."""
