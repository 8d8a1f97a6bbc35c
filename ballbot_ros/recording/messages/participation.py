"""Announcements of participants and the plant's status of a run, as serialised messages.

Both are ``diagnostic_msgs/DiagnosticStatus``, whose keys and values any tool can show.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import TypeVar

from ballbot_ros.lockstep.participants import Announcement, Membership, Objection, Participant
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.lockstep.run_recording import RunStatus
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.message_types import DiagnosticStatus
from ballbot_ros.recording.messages.raw import decoder
from ballbot_ros.recording.messages.topics import PARTICIPANTS
from ballbot_ros.recording.rosbag2 import OUTCOME_KEYS
from ballbot_ros.recording.schemas import encoder, new_message

OK, ERROR = 0, 2

T = TypeVar('T')

_PARAMETER = 'parameter '
_AWAITS = 'awaits'
_KEY_VALUE = 'diagnostic_msgs/msg/KeyValue'
_encode = encoder(PARTICIPANTS.type_name)
_decode = decoder(PARTICIPANTS.type_name)


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
    message = _decode(data)
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
    values = _Values(_decode(data))
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
        pair = new_message(_KEY_VALUE)
        pair.key, pair.value = key, str(value)
        message.values.append(pair)
    return _encode(message)


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
