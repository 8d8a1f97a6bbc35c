"""What the nodes report of a run: announcements, status, summary, changed parameters.

Announcements of participants and the plant's status are ``diagnostic_msgs/DiagnosticStatus``, whose
keys and values any tool can show.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ballbot_ros.lockstep.participants import Announcement, Membership, Objection, Participant
from ballbot_ros.lockstep.run_actions import Outcome, PublishStatus, RunSummary
from ballbot_ros.lockstep.run_recording import RunStatus
from ballbot_ros.parameters import CONTROLLER, PLANT, Value
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.conversions import fill_time
from ballbot_ros.recording.messages.raw import decoder
from ballbot_ros.recording.messages.topics import DIAGNOSTICS, PARAMETER_EVENTS, PARTICIPANTS
from ballbot_ros.recording.rosbag2 import OUTCOME_KEYS
from ballbot_ros.recording.schemas import (
    DiagnosticStatus,
    ParameterEvent,
    ParameterMessage,
    encoder,
    new_message,
)

OK, ERROR = 0, 2

T = TypeVar('T')

_PARAMETER = 'parameter '
_AWAITS = 'awaits'


def encode_announcement(announcement: Announcement) -> bytes:
    """Return an announcement as a serialised message of ``participants``."""
    participant, objection = announcement.participant, announcement.objection
    values = {
        'role': participant.role,
        'process': participant.process,
        'instance': participant.instance,
        'run': announcement.run,
        'implementation': participant.implementation,
        'parameters sha256': participant.parameters_sha256,
        'guid prefix': participant.guid_prefix,
        'topics': ' '.join(participant.topics),
        'answered [ns]': announcement.answered_ns,
    }
    if announcement.awaits:
        values[_AWAITS] = json.dumps(dict(announcement.awaits))
    values |= {
        f'{_PARAMETER}{name}': json.dumps(value) for name, value in participant.parameters.items()
    }
    if objection:
        values |= {'objection topic': objection.topic, 'objection stamp [ns]': objection.stamp_ns}
    return _encoded(
        ERROR if objection else OK,
        participant.node,
        objection.text if objection else f'takes part as {participant.role}',
        participant.host,
        values,
    )


def decode_announcement(data: bytes) -> Announcement:
    """Decode a message of ``participants``.

    It raises ValueError if a key is missing, a number is malformed, or a parameter is not JSON.
    """
    message = decoder(PARTICIPANTS.type_name)(data)
    values = _Values(message)
    parameters = {
        key.removeprefix(_PARAMETER): values.read(key, _from_json)
        for key in values
        if key.startswith(_PARAMETER)
    }
    participant = Participant(
        role=values['role'],
        node=message.name,
        host=message.hardware_id,
        process=values.read('process', int),
        instance=values['instance'],
        implementation=values['implementation'],
        parameters_sha256=values['parameters sha256'],
        guid_prefix=values.get('guid prefix', ''),
        topics=tuple(values['topics'].split()),
        parameters=parameters,
    )
    objection = None
    if message.level != OK:
        topic = values['objection topic']
        objection = Objection(message.message, topic, values.read('objection stamp [ns]', int))
    answered_ns = values.read('answered [ns]', int)
    awaits = values.read(_AWAITS, _stamps) if _AWAITS in values else {}
    return Announcement(participant, values['run'], answered_ns, objection, awaits)


def encode_run_status(status: RunStatus) -> bytes:
    """Return the status of a run as a serialised message of ``plant/run_status``."""
    values = {
        'run': status.run,
        'lockstep': str(status.is_lockstep).lower(),
        'periodic topics': ' '.join(status.periodic_topics),
        **{f'participant {role}': text for role, text in status.participants.items()},
        **status.result,
    }
    outcome = status.result.get('outcome', 'running')
    level = ERROR if outcome == Outcome.FAILED else OK
    return _encoded(level, status.run, outcome, '', values)


def decode_run_status(data: bytes) -> RunStatus:
    """Decode a message of ``plant/run_status``; ValueError if a key is missing."""
    values = _Values(decoder(PARTICIPANTS.type_name)(data))
    prefix = 'participant '
    return RunStatus(
        values['run'],
        values['lockstep'] == 'true',
        tuple(values['periodic topics'].split()),
        {key.removeprefix(prefix): values[key] for key in values if key.startswith(prefix)},
        {key: values[key] for key in OUTCOME_KEYS} if 'outcome' in values else {},
    )


def membership_json(member: Membership, start_ns: int) -> dict[str, object]:
    """Return a participant of a run that began at `start_ns` [ns], for the result's JSON."""
    participant = member.participant
    namespace, _, _ = participant.node.rpartition('/')
    return {
        'role': participant.role,
        'node': participant.node,
        'namespace': namespace or '/',
        'host': participant.host,
        'process': participant.process,
        'implementation': participant.implementation,
        'parameters_sha256': participant.parameters_sha256,
        'since_s': max(0, member.since_ns - start_ns) / SECOND_NS,
        'successor': member.is_successor,
    }


def membership_text(member: Membership, start_ns: int) -> str:
    """Return a participant of a run that began at `start_ns` [ns], as one line of text."""
    row = membership_json(member, start_ns)
    since = f', since {row["since_s"]:.3f} s' if member.is_successor else ''
    sha256 = member.participant.parameters_sha256
    parameters = f', parameters {sha256[:12]}' if sha256 else ''
    return f'{member.participant}{since}, {member.participant.implementation}{parameters}'


def _stamps(text: str) -> dict[str, int | None]:
    stamps = _from_json(text)
    if not isinstance(stamps, dict) or not all(
        each is None or type(each) is int for each in stamps.values()
    ):
        raise ValueError('not stamps by topic')
    return stamps


def _from_json(text: str) -> object:
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError('nested too deeply') from None


def _encoded(level: int, name: str, text: str, host: str, values: Mapping[str, object]) -> bytes:
    message = new_message(PARTICIPANTS.type_name)
    message.level, message.name, message.message, message.hardware_id = level, name, text, host
    for key, value in values.items():
        pair = new_message('diagnostic_msgs/msg/KeyValue')
        pair.key, pair.value = key, str(value)
        message.values.append(pair)
    return encoder(PARTICIPANTS.type_name)(message)


class _Values(dict[str, str]):
    """The values of a message; an error names the message and the key."""

    def __init__(self, message: DiagnosticStatus) -> None:
        super().__init__((pair.key, pair.value) for pair in message.values)
        self._name = message.name

    def __missing__(self, key: str) -> str:
        raise ValueError(f'{self._name}: has no {key!r}')

    def read(self, key: str, decode: Callable[[str], T]) -> T:
        text = self[key]
        try:
            return decode(text)
        except ValueError as error:
            raise ValueError(f'{self._name}: {key!r} is {text[:40]!r}: {error}') from None


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
        'external_pushes': [  # with times from the start of the run, in plane signs
            {
                'start_s': (each.start_ns - summary.start_ns) / SECOND_NS,
                'end_s': (each.end_ns - summary.start_ns) / SECOND_NS,
                'force_n': list(each.force),
                'torque_n_m': list(each.torque),
            }
            for each in summary.external_pushes
        ],
        'parameter_changes': [each.as_json() for each in summary.parameter_changes],
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
        message = decoder(DIAGNOSTICS.type_name)(data)
    except ValueError:
        return None
    for status in message.status:
        values = {pair.key: pair.value for pair in status.values}
        if values.get('role') == PLANT:
            return PlantReport(
                run=values.get('run name', ''),
                is_paused=values.get('paused') == str(True),
                awaits_start=values.get('awaits start') == str(True),
                pace=_number(values.get('pace', '')),
                missing=tuple(values.get('missing', '').split()),
                outcome=values.get('outcome', ''),
                problem='' if status.level == OK else status.message,
            )
    return None


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
    return encoder(PARAMETER_EVENTS.type_name)(message)


def decode_parameter_event(data: bytes) -> dict[str, Value]:
    """Return the new values of ``controller/parameter_events``, by name.

    It raises ValueError for a malformed message, or a type that no parameter here has.
    """
    message: ParameterEvent = decoder(PARAMETER_EVENTS.type_name)(data)
    return {each.name: _value(each) for each in message.changed_parameters}


def _value(message: ParameterMessage) -> Value:
    if message.value.type not in _KINDS:
        raise ValueError(f'{message.name}: type {message.value.type} of its value')
    kind, field = _KINDS[message.value.type]
    value: Value = kind(getattr(message.value, field))
    return tuple(map(float, value)) if isinstance(value, tuple) else value
