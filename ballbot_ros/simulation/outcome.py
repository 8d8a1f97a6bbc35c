"""The outcome of a run."""

from __future__ import annotations

from ballbot_ros.text_enum import TextEnum


class Outcome(TextEnum):
    """Outcome of a run; the values appear in its status, recording and JSON."""

    COMPLETED = 'completed'
    FAILED = 'failed'
    STOPPED = 'stopped'
