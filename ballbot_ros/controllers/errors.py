"""Errors of controllers."""

from __future__ import annotations

from ballbot_ros.errors import BallbotError


class ControllerError(BallbotError):
    """A controller that can't be loaded, fails, or answers with something that is no duty."""


class TickTimeoutError(BaseException):
    """A tick that does not return; no Exception, so that few controllers catch it."""
