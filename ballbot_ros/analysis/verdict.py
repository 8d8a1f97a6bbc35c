"""The verdicts on a run and on its expectations."""

from __future__ import annotations

from ballbot_ros.text_enum import TextEnum


class Verdict(TextEnum):
    """What came of a run, in the words of reports, tables and JSON."""

    PASSED = 'passed'
    NOT_MET = 'expectations not met'
    FAILED = 'failed'
    STOPPED = 'stopped'
    INCOMPLETE = 'incomplete'
    """Of a recording: it lacks a part of the run."""
    NOT_JUDGED = 'not judged'
    """Of a recording: it lacks what the expectations are about."""


class ExpectationVerdict(TextEnum):
    """What came of an expectation in a recorded run."""

    MET = 'met'
    NOT_MET = 'not met'
    NOT_JUDGED = 'not judged'
    """The recording lacks what it is about."""
