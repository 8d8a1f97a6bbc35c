"""The summary of a run as JSON, in diagnostics, and in the account that the plant publishes."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ballbot_ros.messages.participation import RunStatus, membership_json, membership_text
from ballbot_ros.recording.attachments import OUTCOME_KEYS
from ballbot_ros.simulation.run_actions import PublishStatus, RunSummary


def summary_json(summary: RunSummary) -> dict[str, Any]:
    """Return a summary under the keys that the command's JSON has."""
    return {
        'outcome': summary.outcome,
        'reason': summary.reason,
        'ticks': summary.ticks,
        'duty_sha256': summary.duty_sha256,
        'real_time_factor': summary.real_time_factor,
        'missed_ticks': summary.late_ticks,
        'asked_again': summary.resends,
        'round_trip_ms': asdict(summary.round_trips) if summary.round_trips else None,
        'participants': [membership_json(each, summary.start_ns) for each in summary.members],
    }


def summary_words(summary: RunSummary) -> dict[str, Any]:
    """Return what the plant's diagnostics have of a summary."""
    words = {
        key: value
        for key, value in summary_json(summary).items()
        if key not in ('ticks', 'participants', 'round_trip_ms')
    }
    if trips := summary.round_trips:
        words['round trip p50 / p99 / max [ms]'] = (
            f'{trips.p50:.2f} / {trips.p99:.2f} / {trips.max:.2f}'
        )
    return words


def run_status(action: PublishStatus) -> RunStatus:
    """Return the account of a run that is to be published."""
    summary = action.summary
    return RunStatus(
        run=action.run.name,
        is_lockstep=action.is_lockstep,
        periodic_topics=action.topics,
        participants={
            member.participant.role: membership_text(member, action.run.start_ns)
            for member in action.members
        },
        result={key: str(getattr(summary, key)) for key in OUTCOME_KEYS} if summary else {},
    )
