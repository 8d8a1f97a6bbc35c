"""Errors in studies."""

from ballbot_ros.errors import BallbotError


class StudyError(BallbotError):
    """An unknown study, or a file that does not describe one."""
