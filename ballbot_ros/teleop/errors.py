"""The error of this package."""

from ballbot_ros.errors import BallbotError


class TeleopError(BallbotError):
    """An input can't be opened or understood, or a data log can't be written."""
