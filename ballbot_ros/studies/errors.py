"""The error of this package."""

from ballbot_ros.errors import BallbotError


class StudyError(BallbotError):
    """A study can't be read, run or kept."""
