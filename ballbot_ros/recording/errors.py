"""The error of this package."""

from ballbot_ros.errors import BallbotError


class RecordingError(BallbotError):
    """A recording that cannot be created, written or read; the text begins with its path."""
