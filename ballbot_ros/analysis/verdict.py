"""The verdicts on a run and on its expectations."""

from __future__ import annotations

from ballbot_ros.text_enum import TextEnum


class Verdict(TextEnum):
    """Verdict on a run, as shown in reports, tables and JSON."""

    PASSED = 'passed'
    NOT_MET = 'expectations not met'
    FAILED = 'failed'
    STOPPED = 'stopped'
    CHANGED = 'changed'
    """All expectations are met, but somebody set parameters during the run."""
    INCOMPLETE = 'incomplete'
    """The recording lacks a part of the run."""
    NOT_JUDGED = 'not judged'
    """The recording lacks the data that the expectations need."""


class ExpectationVerdict(TextEnum):
    """Verdict on an expectation in a recorded run."""

    MET = 'met'
    NOT_MET = 'not met'
    NOT_JUDGED = 'not judged'
    """The recording lacks the data that the expectation needs."""
