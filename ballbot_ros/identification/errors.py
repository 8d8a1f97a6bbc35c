"""Errors of the identification."""

from __future__ import annotations

from ballbot_ros.errors import BallbotError


class IdentificationError(BallbotError):
    """A recording or log from which nothing can be identified, or an unknown parameter."""
