"""The package's error."""

from ballbot_ros.errors import BallbotError


class WorldError(BallbotError):
    """A map that can't be read or written, or a start pose that it does not allow."""
