"""What plant and controller report of a run: its state, its summary, changed parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballbot_ros.lockstep.run_actions import PublishStatus, RunSummary
from ballbot_ros.lockstep.run_recording import RunStatus
from ballbot_ros.parameters import CONTROLLER, PLANT, Value
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.conversions import fill_time
from ballbot_ros.recording.messages.message_types import ParameterEvent, ParameterMessage
from ballbot_ros.recording.messages.participation import OK, membership_json, membership_text
from ballbot_ros.recording.messages.raw import decoder
from ballbot_ros.recording.messages.topics import DIAGNOSTICS, PARAMETER_EVENTS
from ballbot_ros.recording.rosbag2 import OUTCOME_KEYS
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.robot.plant.ground_truth import Push


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


_decode_diagnostics = decoder(DIAGNOSTICS.type_name)


@dataclass(frozen=True)
class PlantReport:
    """State of the plant and of its run.

    Attributes
    ----------
    run : str
        Name of the run in ``plant/run``; '' before the first.
    awaits_start : bool
        Whether the run is paused because it starts paused.
    pace : float
        Required sim time per wall time; 0: as fast as possible.
    missing : tuple of str
        The roles that the run waits for before its first tick.
    outcome : str
        How the run has ended; '' while it lasts.
    problem : str
        The current warning or error, or ''.
    """

    run: str = ''
    is_paused: bool = False
    awaits_start: bool = False
    pace: float = 1.0
    missing: tuple[str, ...] = ()
    outcome: str = ''
    problem: str = ''


def decode_plant_report(data: bytes) -> PlantReport | None:
    """Decode a message of ``/diagnostics``; None if it is not the plant's.

    Only a message that can be the plant's is decoded: all nodes publish on this topic.
    """
    if PLANT.encode() not in data:
        return None
    try:
        message = _decode_diagnostics(data)
    except ValueError:
        return None
    for status in message.status:
        values = {pair.key: pair.value for pair in status.values}
        if values.get('role') == PLANT:
            return _report(values, '' if status.level == OK else status.message)
    return None


def _report(values: dict[str, str], problem: str) -> PlantReport:
    return PlantReport(
        run=values.get('run name', ''),
        is_paused=values.get('paused') == str(True),
        awaits_start=values.get('awaits start') == str(True),
        pace=_number(values.get('pace', '')),
        missing=tuple(values.get('missing', '').split()),
        outcome=values.get('outcome', ''),
        problem=problem,
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return PlantReport.pace


_FIELDS = {
    bool: (1, 'bool_value'),
    int: (2, 'integer_value'),
    float: (3, 'double_value'),
    str: (4, 'string_value'),
    tuple: (8, 'double_array_value'),
}
"""Number of each type of ``rcl_interfaces/ParameterType``, and the field of its values."""

_KINDS = {number: (kind, name) for kind, (number, name) in _FIELDS.items()}
_encode_event, _decode_event = (
    encoder(PARAMETER_EVENTS.type_name),
    decoder(PARAMETER_EVENTS.type_name),
)


def encode_parameter_event(stamp_ns: int, values: Mapping[str, Value]) -> bytes:
    """Return ``controller/parameter_events``: new values by name, from the tick `stamp_ns` on."""
    message = new_message(PARAMETER_EVENTS.type_name)
    fill_time(message.stamp, stamp_ns)
    message.node = CONTROLLER
    for name, value in values.items():
        each = new_message('rcl_interfaces/msg/Parameter')
        each.name = name
        number, field = _FIELDS[type(value)]
        each.value.type = number
        setattr(each.value, field, np.array(value) if isinstance(value, tuple) else value)
        message.changed_parameters.append(each)
    return _encode_event(message)


def decode_parameter_event(data: bytes) -> dict[str, Value]:
    """Return the new values of ``controller/parameter_events``, by name.

    It raises ValueError for a malformed message, or a type that no parameter here has.
    """
    message: ParameterEvent = _decode_event(data)
    return {each.name: _value(each) for each in message.changed_parameters}


def _value(message: ParameterMessage) -> Value:
    if message.value.type not in _KINDS:
        raise ValueError(f'{message.name}: type {message.value.type} of its value')
    kind, field = _KINDS[message.value.type]
    value: Value = kind(getattr(message.value, field))
    return tuple(map(float, value)) if isinstance(value, tuple) else value
