"""Errors of the identification."""

from __future__ import annotations

from ballbot_ros.errors import BallbotError


class IdentificationError(BallbotError):
    """A recording that cannot be used, or a parameter that cannot be identified."""
