"""The error of this package."""

from ballbot_ros.errors import BallbotError


class RecordingError(BallbotError):
    """A recording can't be created, written or read; the message begins with its path."""
