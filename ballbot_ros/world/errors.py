"""The error of this package."""

from ballbot_ros.errors import BallbotError


class WorldError(BallbotError):
    """A map can't be read or written, or the start pose is not possible on it."""
