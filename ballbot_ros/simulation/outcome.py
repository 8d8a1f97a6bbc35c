"""How a run ended."""

from __future__ import annotations

from ballbot_ros.text_enum import TextEnum


class Outcome(TextEnum):
    """How a run ended; the values appear in its status, recording and JSON."""

    COMPLETED = 'completed'
    FAILED = 'failed'
    STOPPED = 'stopped'
