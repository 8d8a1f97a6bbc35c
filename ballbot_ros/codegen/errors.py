"""What can go wrong in this package."""

from ballbot_ros.errors import BallbotError


class CodegenError(BallbotError):
    """A folder that can't be written or read, a missing tool, or C that does not build or run."""
