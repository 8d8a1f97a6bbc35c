"""The error of this package."""

from ballbot_ros.errors import BallbotError


class CodegenError(BallbotError):
    """A folder can't be written or read, a tool is missing, or the C does not build or run."""
