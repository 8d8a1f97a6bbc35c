"""The package's error."""

from ballbot_ros.errors import BallbotError


class ViewerError(BallbotError):
    """A page can't be served, or a picture can't be rendered."""
