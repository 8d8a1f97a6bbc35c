"""Errors of controllers."""

from __future__ import annotations

from ballbot_ros.errors import BallbotError


class ControllerError(BallbotError):
    """A controller that can't be loaded, fails, or answers with something that is no duty."""
