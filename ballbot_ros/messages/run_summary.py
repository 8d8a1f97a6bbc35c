"""The summary of a run as JSON, in diagnostics, and in the status that the plant publishes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbot_ros.messages.participation import membership_json, membership_text
from ballbot_ros.plant.ground_truth import Push
from ballbot_ros.recording.attachments import OUTCOME_KEYS
from ballbot_ros.simulation.run_actions import PublishStatus, RunSummary
from ballbot_ros.simulation.run_recording import RunStatus
from ballbot_ros.timing import SECOND_NS


def summary_json(summary: RunSummary) -> dict[str, object]:
    """Return a summary with the keys of the command's JSON."""
    return {
        'outcome': summary.outcome.value,
        'reason': summary.reason,
        'ticks': summary.ticks,
        'duty_sha256': summary.duty_sha256,
        'real_time_factor': summary.real_time_factor,
        'late_ticks': summary.late_ticks,
        'resends': summary.resends,
        'round_trip_ms': _in_milliseconds(summary.round_trips_s),
        'participants': [membership_json(each, summary.start_ns) for each in summary.members],
        'external_pushes': [_push_json(each, summary.start_ns) for each in summary.external_pushes],
        'parameter_changes': [each.as_json() for each in summary.parameter_changes],
    }


def _push_json(push: Push, start_ns: int) -> dict[str, object]:
    """Return a push with times from the start of the run, in plane signs."""
    return {
        'start_s': (push.start_ns - start_ns) / SECOND_NS,
        'end_s': (push.end_ns - start_ns) / SECOND_NS,
        'force_n': list(push.force),
        'torque_n_m': list(push.torque),
    }


def summary_words(summary: RunSummary) -> dict[str, object]:
    """Return the entries that the summary adds to the plant's diagnostics."""
    words: dict[str, object] = {
        'outcome': summary.outcome.value,
        'reason': summary.reason,
        'duty_sha256': summary.duty_sha256,
        'real_time_factor': summary.real_time_factor,
    }
    if trips_ms := _in_milliseconds(summary.round_trips_s):
        label = f'round trip {" / ".join(trips_ms)} [ms]'
        words[label] = ' / '.join(f'{trip_ms:.2f}' for trip_ms in trips_ms.values())
    return words


def run_status(action: PublishStatus) -> RunStatus:
    """Return the status of a run, ready to publish."""
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


def _in_milliseconds(round_trips_s: Sequence[float]) -> dict[str, float] | None:
    if not round_trips_s:
        return None
    trips_ms = np.array(round_trips_s) * 1e3
    return {
        'p50': float(np.percentile(trips_ms, 50)),
        'p99': float(np.percentile(trips_ms, 99)),
        'max': float(trips_ms.max()),
    }
