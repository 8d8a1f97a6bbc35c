"""The error of this package."""

from ballbot_ros.errors import BallbotError


class TeleopError(BallbotError):
    """An input that cannot be opened or understood, or a data log that cannot be written."""
