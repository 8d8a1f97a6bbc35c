"""What rosbag2 of ROS 2 Jazzy keeps in an MCAP file beside the messages, as YAML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol

from ballbot_ros.recording.qos import QosProfile

METADATA_NAME = 'rosbag2'
"""Name of the MCAP metadata record."""

_VERSION = 9
_NO_TIME = 2**63 - 1
_PLAIN = re.compile(r'[A-Za-z/][\w/.-]*', re.ASCII)

_Yaml = dict[str, '_Yaml'] | list['_Yaml'] | str | int | bool | None


class RecordedTopic(Protocol):
    """What the metadata says of a topic."""

    name: str
    type_name: str
    type_hash: str
    qos: Sequence[QosProfile]
    count: int


class TimeRange(NamedTuple):
    """The stamps of the oldest and the newest message [ns]."""

    start: int
    end: int


def offered_qos_profiles(profiles: Iterable[QosProfile]) -> str:
    """Write `profiles`, one for each publisher, as the channel metadata of that name."""
    return '\n'.join(_lines(_qos(profiles)))


def serialized_metadata(
    file_name: str, topics: Iterable[RecordedTopic], times: TimeRange | None
) -> str:
    """Write the bag's description as the metadata record's value of that name.

    Parameters
    ----------
    file_name : str
        The recording's name without its directory.
    topics : iterable of RecordedTopic
        Everything recorded, with the number of messages.
    times : TimeRange or None
        None if there are no messages.
    """
    topics = list(topics)
    start: _Yaml = {'nanoseconds_since_epoch': times.start if times else _NO_TIME}
    duration: _Yaml = {'nanoseconds': times.end - times.start if times else 0}
    count = sum(topic.count for topic in topics)
    return '\n'.join(
        _lines(
            {
                'version': _VERSION,
                'storage_identifier': 'mcap',
                'duration': duration,
                'starting_time': start,
                'message_count': count,
                'topics_with_message_count': [_topic(topic) for topic in topics],
                'compression_format': '',
                'compression_mode': '',
                'relative_file_paths': [file_name],
                'files': [
                    {
                        'path': file_name,
                        'starting_time': start,
                        'duration': duration,
                        'message_count': count,
                    }
                ],
                'custom_data': None,
                'ros_distro': 'jazzy',
            }
        )
    )


def _topic(topic: RecordedTopic) -> _Yaml:
    return {
        'topic_metadata': {
            'name': topic.name,
            'type': topic.type_name,
            'serialization_format': 'cdr',
            'offered_qos_profiles': _qos(topic.qos),
            'type_description_hash': topic.type_hash,
        },
        'message_count': topic.count,
    }


def _qos(profiles: Iterable[QosProfile]) -> list[_Yaml]:
    return [
        {
            'history': profile.history,
            'depth': profile.depth,
            'reliability': profile.reliability,
            'durability': profile.durability,
            'deadline': _duration(profile.deadline),
            'lifespan': _duration(profile.lifespan),
            'liveliness': profile.liveliness,
            'liveliness_lease_duration': _duration(profile.liveliness_lease_duration),
            'avoid_ros_namespace_conventions': profile.avoid_ros_namespace_conventions,
        }
        for profile in profiles
    ]


def _duration(nanoseconds: int) -> _Yaml:
    sec, nsec = divmod(nanoseconds, 10**9)
    return {'sec': sec, 'nsec': nsec}


def _lines(value: _Yaml) -> list[str]:
    """Lay `value` out in blocks, as yaml-cpp does."""
    if isinstance(value, dict):
        lines = []
        for key, item in value.items():
            nested = _lines(item)
            if isinstance(item, dict | list):
                lines += [f'{key}:', *(f'  {line}' for line in nested)]
            else:
                lines.append(f'{key}: {nested[0]}')
        return lines
    if isinstance(value, list):
        items = [_lines(item) for item in value]
        return [
            f'{"  " if number else "- "}{line}'
            for item in items
            for number, line in enumerate(item)
        ] or ['[]']
    if value is None:
        return ['~']
    if isinstance(value, str) and _PLAIN.fullmatch(value):
        return [value]
    return [json.dumps(value, ensure_ascii=False)]
