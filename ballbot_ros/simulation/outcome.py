"""How a run has ended."""

from __future__ import annotations

from ballbot_ros.text_enum import TextEnum


class Outcome(TextEnum):
    """How a run has ended, in the word that its status, recording and JSON have."""

    COMPLETED = 'completed'
    FAILED = 'failed'
    STOPPED = 'stopped'
