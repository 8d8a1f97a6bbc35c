"""What describes a recording: quality of service, attachments, metadata of rosbag2."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from pathlib import PurePath
from typing import Any, NamedTuple

from ballbot_ros.parameters.yaml_document import parse_data, yaml_text

INFINITE = 2**63 - 1
"""An infinite duration [ns]."""


@dataclass(frozen=True)
class QosProfile:
    """The QoS offered by a publisher, with the names and the order of rosbag2.

    Attributes
    ----------
    history : str
        ``keep_last``, ``keep_all``, ``system_default``, or ``unknown`` if discovery does not report
        it.
    depth : int
        Number of messages kept; 0 if unknown.
    reliability : str
        ``reliable``, ``best_effort``, ...
    durability : str
        ``transient_local``, ``volatile``, ...
    deadline, lifespan, liveliness_lease_duration : int
        Durations [ns]; 0 if left to the middleware, or `INFINITE`.
    liveliness : str
        ``automatic``, ``manual_by_topic``, ...
    avoid_ros_namespace_conventions : bool
        Whether the topic's name is passed to the middleware unchanged.
    """

    history: str
    depth: int
    reliability: str
    durability: str
    deadline: int = INFINITE
    lifespan: int = INFINITE
    liveliness: str = 'automatic'
    liveliness_lease_duration: int = INFINITE
    avoid_ros_namespace_conventions: bool = False

    @classmethod
    def from_rclpy(cls, profile: Any) -> QosProfile:
        """Convert an ``rclpy.qos.QoSProfile``, such as ``TopicEndpointInfo.qos_profile``."""
        values = {each.name: getattr(profile, each.name) for each in fields(cls)}
        values |= {name: values[name].name.lower() for name in _WORDS}
        values |= {name: values[name].nanoseconds for name in _DURATIONS}
        return cls(**values)


RELIABLE_LATCHED = QosProfile('keep_last', 128, 'reliable', 'transient_local')
"""The QoS offered by every publisher of the graph."""


SCENARIO, PARAMETERS, VERSIONS = 'scenario.yaml', 'parameters.yaml', 'versions.yaml'

OUTCOME_KEYS = ('outcome', 'reason', 'ticks', 'duty_sha256')
"""Keys of the outcome of a run."""

MAPS = ('map.png', 'map.bmp')
"""Possible names of the attached map image, one per format; without a map there is none."""

CONTROLLER_INFO = 'controller.yaml'
"""Name of the file that identifies a controller other than the document's."""

PARENT = 'parent.yaml'
"""Name of the file that identifies the run that a recording has branched off."""

_MEDIA_TYPES = {
    '.yaml': 'application/yaml', '.png': 'image/png', '.bmp': 'image/bmp',
    '.py': 'text/x-python', '.zip': 'application/zip',
}  # fmt: skip


def media_type(name: str) -> str:
    """Return the media type of a file from the ending of its name."""
    return _MEDIA_TYPES.get(PurePath(name).suffix.lower(), 'application/octet-stream')


METADATA_NAME = 'rosbag2'
"""Name of the MCAP metadata record."""

DERIVED = 'ballbot_ros/derived'
"""Key in the metadata of channels whose messages no node has published: they were computed from
the others when the file was written."""

_VERSION = 9
_NO_TIME = 2**63 - 1

_WORDS = {
    'history': {0: 'system_default', 1: 'keep_last', 2: 'keep_all', 3: 'unknown'},
    'reliability': {0: 'system_default', 1: 'reliable', 2: 'best_effort', 3: 'unknown'},
    'durability': {0: 'system_default', 1: 'transient_local', 2: 'volatile', 3: 'unknown'},
    'liveliness': {0: 'system_default', 1: 'automatic', 3: 'manual_by_topic', 4: 'unknown'},
}
"""The names that Jazzy writes, by the numbers of rmw that earlier releases write."""

_DURATIONS = ('deadline', 'lifespan', 'liveliness_lease_duration')


@dataclass(slots=True, eq=False)
class RecordedTopic:
    """A topic of a recording: its MCAP channel, full name and number of messages so far.

    Its type is such as ``sensor_msgs/msg/Imu``; the REP 2011 hash of that may be empty. `qos` is
    what each of its publishers offers.
    """

    channel: int
    name: str
    type_name: str
    type_hash: str
    qos: Sequence[QosProfile]
    count: int = 0


class TimeRange(NamedTuple):
    """The stamps of the oldest and the newest message [ns]."""

    start: int
    end: int


@lru_cache(64)
def offered_qos_profiles(profiles: tuple[QosProfile, ...]) -> str:
    """Return `profiles`, one per publisher, as the channel metadata ``offered_qos_profiles``."""
    return yaml_text(_qos(profiles))


def parse_offered_qos(text: str) -> list[QosProfile]:
    """Read the channel metadata ``offered_qos_profiles`` of any ROS 2 release; [] if malformed."""
    try:
        profiles = parse_data(text)
        return [_parse_profile(each) for each in profiles] if isinstance(profiles, list) else []
    except (TypeError, LookupError, ValueError, OverflowError):
        return []


def _parse_profile(profile: dict[str, Any]) -> QosProfile:
    values: dict[str, Any] = {
        'depth': int(profile['depth']),
        'avoid_ros_namespace_conventions': bool(profile['avoid_ros_namespace_conventions']),
    }
    for key, words in _WORDS.items():
        # Releases before Jazzy write the numbers of the middleware.
        word = profile[key]
        values[key] = words[word] if isinstance(word, int) else str(word)
    for key in _DURATIONS:
        values[key] = int(profile[key]['sec']) * 10**9 + int(profile[key]['nsec'])
    return QosProfile(**values)


def serialized_metadata(
    file_name: str, topics: Iterable[RecordedTopic], times: TimeRange | None
) -> str:
    """Return the bag's description as text for the key of that name in the metadata record.

    The name of the file is without its folder; `times` is None if there are no messages.
    """
    topics = list(topics)
    start, end = times or (_NO_TIME, _NO_TIME)
    extent = {
        'starting_time': {'nanoseconds_since_epoch': start},
        'duration': {'nanoseconds': end - start},
        'message_count': sum(topic.count for topic in topics),
    }
    head = {'version': _VERSION, 'storage_identifier': 'mcap', **extent}
    tail = {
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file_name],
        'files': [{'path': file_name, **extent}],
        'custom_data': None,
        'ros_distro': 'jazzy',
    }
    by_name: dict[str, list[RecordedTopic]] = {}  # a topic of several channels counts once
    for topic in topics:
        by_name.setdefault(topic.name, []).append(topic)
    listed = '' if topics else ' []'
    for name, channels in by_name.items():
        first, qos = channels[0], tuple(profile for each in channels for profile in each.qos)
        metadata = _topic_metadata(name, first.type_name, first.type_hash, qos)
        listed += f'\n{metadata}  message_count: {sum(each.count for each in channels)}'
    return f'{yaml_text(head)}topics_with_message_count:{listed}\n{yaml_text(tail)}'


@lru_cache(64)
def _topic_metadata(name: str, type_name: str, type_hash: str, qos: tuple[QosProfile, ...]) -> str:
    """Return the begin of a topic's entry, which takes most of the time of a description."""
    metadata = {
        'name': name,
        'type': type_name,
        'serialization_format': 'cdr',
        'offered_qos_profiles': _qos(qos),
        'type_description_hash': type_hash,
    }
    return yaml_text([{'topic_metadata': metadata}])


def _qos(profiles: Iterable[QosProfile]) -> list[dict[str, object]]:
    return [
        {
            name: dict(zip(('sec', 'nsec'), divmod(value, 10**9), strict=True))
            if name in _DURATIONS
            else value
            for name, value in asdict(profile).items()
        }
        for profile in profiles
    ]
