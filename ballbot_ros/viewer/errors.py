"""The package's error."""

from ballbot_ros.errors import BallbotError


class ViewerError(BallbotError):
    """A page that can't be served, or a picture that can't be made."""
