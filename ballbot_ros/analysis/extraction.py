"""What a report needs of a recording, gathered message by message into columns.

A message object lives only until its numbers are taken: an hour of ticks is then some hundred
megabytes less than as messages.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.namespace import robot_namespace
from ballbot_ros.analysis.told_parameters import ToldParameters
from ballbot_ros.brick.brick import Tone
from ballbot_ros.messages.conversions import (
    ball_position,
    body_pitch,
    body_rates,
    stamp_ns,
    tone_of,
)
from ballbot_ros.messages.motor_stop import is_stop
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    CONTROLLER_STATE,
    DIAGNOSTICS,
    GYRO_IMU,
    LCD,
    MAP,
    MOTOR_DUTY,
    OPERATING_STATE,
    PARTICIPANTS,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    RUN,
    RUN_STATUS,
    SONAR_RANGE,
    SOUND,
    TOPICS,
    Topic,
)
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RawMessage, RecordingReader

_EVENTS = (OPERATING_STATE, RUN, RUN_STATUS, PARTICIPANTS, DIAGNOSTICS, LCD, SOUND, MAP)
_FOREVER_NS = 2**63 - 1
_OTHER_CLOCK_MS = 3.6e6
_PROGRESS_STRIDE = 4096

_Fields = Callable[[Any], tuple[float, ...]]

TICKED: Mapping[Topic, tuple[str, int, _Fields]] = {
    PLANT_IMU: ('d', 4, lambda m: (*body_pitch(m), *body_rates(m))),
    PLANT_ODOM: ('d', 2, ball_position),
    PLANT_JOINT_STATES: (
        'f', 4, lambda m: (m.velocity[0], m.velocity[1], m.effort[0], m.effort[1])
    ),
    MOTOR_DUTY: ('f', 2, lambda m: (m.vector.x, m.vector.y)),
    CONTROLLER_STATE: ('f', 8, lambda m: (*m.position, m.velocity[1], m.velocity[3])),
    GYRO_IMU: ('f', 2, lambda m: (m.angular_velocity.y, m.angular_velocity.x)),
    SONAR_RANGE: ('f', 1, lambda m: (m.range,)),
    BATTERY_STATE: ('f', 1, lambda m: (m.voltage,)),
}  # fmt: skip
"""The stamped topics, with number type and count of their columns, and how these are read.

Pitch and pitch rate of planes x, y [rad, rad/s]; position x, y [m]; motor rate x, y [rad/s] and
torque x, y [N·m]; duty x, y [%]; the estimates and references of ``controller/state`` [rad] and its
pitch rates x, y [rad/s]; gyro x, y with offset [rad/s]; distance [m]; voltage [V].
"""


class Columns:
    """The samples of a stamped topic; an epoch is a stretch of the file in which stamps rise.

    Parameters
    ----------
    kind : str
        Number type, as of the module array.
    width : int
        Numbers of a sample.
    """

    def __init__(self, kind: str, width: int) -> None:
        self._kind, self._width = kind, width
        self._epochs: list[tuple[array[int], array[float]]] = []
        self.newest = -1

    def __len__(self) -> int:
        """Return the number of epochs."""
        return len(self._epochs)

    def add(self, stamp: int, values: tuple[float, ...]) -> None:
        """Add a sample; one that comes twice is dropped."""
        if stamp == self.newest:
            return
        if stamp < self.newest or not self._epochs:
            self._epochs.append((array('q'), array(self._kind)))
        self.newest = stamp
        stamps, numbers = self._epochs[-1]
        if len(values) != self._width:
            raise IndexError(f'{len(values)} numbers instead of {self._width}')
        stamps.append(stamp)
        numbers.extend(values)

    def epoch(self, index: int) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """Return stamps, shape (n,), and values, shape (n, width), without copying them."""
        if index >= len(self._epochs):
            return np.zeros(0, np.int64), np.zeros((0, self._width), self._kind)
        stamps, numbers = self._epochs[index]
        return (
            np.frombuffer(stamps, np.int64),
            np.frombuffer(numbers, self._kind).reshape(-1, self._width),
        )


@dataclass
class Traffic:
    """How the messages of a topic came.

    Attributes
    ----------
    topic, type_name : str
    count : int
    first_ns, last_ns, gap_ns : int
        Oldest and newest log time, and the longest time between two messages.
    age_sum_ms, age_max_ms : float
        Ages: how far a message's stamp lies behind the newest log time before it in the file.
    """

    topic: str
    type_name: str
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    gap_ns: int = 0
    age_sum_ms: float = 0.0
    age_max_ms: float = 0.0

    def add(self, log_ns: int, age_ms: float) -> None:
        """Count a message."""
        if self.count == 0:
            self.first_ns = self.last_ns = log_ns
        elif log_ns > self.last_ns:
            self.gap_ns = max(self.gap_ns, log_ns - self.last_ns)
            self.last_ns = log_ns
        self.count += 1
        self.age_sum_ms += age_ms
        self.age_max_ms = max(self.age_max_ms, age_ms)

    @property
    def rate(self) -> float:
        """Messages a second [Hz]; NaN of fewer than two."""
        span = self.last_ns - self.first_ns
        return (self.count - 1) * 1e9 / span if span else float('nan')

    @property
    def age_ms(self) -> tuple[float, float]:
        """Mean and largest age [ms]; NaN where stamps and log times are of different clocks."""
        if self.age_max_ms > _OTHER_CLOCK_MS:
            return float('nan'), float('nan')
        return self.age_sum_ms / self.count, self.age_max_ms


@dataclass
class Extraction:
    """All runs of a recording; of events the epoch, the stamp [ns] and the content."""

    columns: dict[Topic, Columns] = field(
        default_factory=lambda: {topic: Columns(*TICKED[topic][:2]) for topic in TICKED}
    )
    announced: list[tuple[int, int]] = field(default_factory=list)
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    told: ToldParameters = field(default_factory=ToldParameters)
    states: list[tuple[int, int, str]] = field(default_factory=list)
    statuses: list[tuple[int, int, Any]] = field(default_factory=list)
    pages: list[tuple[int, int, str]] = field(default_factory=list)
    tones: list[tuple[int, int, Tone]] = field(default_factory=list)
    maps: list[tuple[int, int, Any]] = field(default_factory=list)
    traffic: dict[str, Traffic] = field(default_factory=dict)
    notices: list[str] = field(default_factory=list)

    def runs(self) -> list[tuple[int, int, int]]:
        """Return epoch, first tick and end [ns] of each run, in the order of the file.

        A run begins where ``plant/run`` says so, and where time goes back in the file.
        """
        runs = []
        for epoch in range(max(map(len, self.columns.values()))):
            starts = [start for each, start in self.announced if each == epoch]
            if not starts:
                pieces = (columns.epoch(epoch)[0] for columns in self.columns.values())
                starts = [min(int(stamps[0]) for stamps in pieces if len(stamps))]
            runs += list(
                zip([epoch] * len(starts), starts, [*starts[1:], _FOREVER_NS], strict=True)
            )
        return runs

    def announce(self, start: int, name: str) -> None:
        """Note what ``plant/run`` says."""
        epoch, newest = self.announced[-1] if self.announced else (0, -1)
        self.announced.append((epoch + (start <= newest), start))
        self.names[self.announced[-1]] = name


def extract(recording: RecordingReader, progress: Callable[[int, int], None]) -> Extraction:
    """Go through a recording once.

    Raises
    ------
    RecordingError
        If it has no topic of a ballbot, those of several, or a message that is not as it should be.
    """
    extraction = Extraction()
    wanted = _wanted(recording, extraction.notices)
    traffic = extraction.traffic = {
        name: Traffic(name, summary.type_name) for name, summary in recording.topics().items()
    }
    newest_log = epoch = 0
    for count, raw in enumerate(recording.raw_messages()):
        if count % _PROGRESS_STRIDE == 0:
            progress(count, recording.count)
        stamp = log_ns = raw.stamp_ns
        newest_log = max(newest_log, log_ns)
        topic = wanted.get(raw.topic)
        if topic is MOTOR_DUTY and is_stop(raw.data):
            topic = None  # it answers no tick
        if topic in (PARTICIPANTS, RUN_STATUS):
            extraction.told.add(topic, raw.data)
        elif topic is not None:
            message = recording.decode(raw)
            try:
                if topic in TICKED:
                    stamp = stamp_ns(message)
                    columns = extraction.columns[topic]
                    columns.add(stamp, TICKED[topic][2](message))
                    epoch = len(columns) - 1
                else:
                    _take_event(extraction, topic, message, epoch, log_ns)
            except (IndexError, ValueError, OverflowError) as error:
                raise _unlike(recording, raw, error) from None
        if raw.topic in traffic:
            traffic[raw.topic].add(log_ns, (newest_log - stamp) * 1e-6)
    if not any(map(len, extraction.columns.values())):
        raise RecordingError(f'{recording.path}: no messages of a ballbot: nothing to report')
    extraction.traffic = {name: each for name, each in traffic.items() if each.count}
    return extraction


def _take_event(
    extraction: Extraction, topic: Topic, message: Any, epoch: int, log_ns: int
) -> None:
    if topic is RUN:
        extraction.announce(stamp_ns(_Headed(message)), message.frame_id)
    elif topic is OPERATING_STATE:
        extraction.states.append((epoch, log_ns, message.data))
    elif topic is DIAGNOSTICS:
        extraction.statuses += [(epoch, log_ns, status) for status in message.status]
    elif topic is LCD:
        extraction.pages.append((epoch, log_ns, message.data))
    elif topic is SOUND:
        extraction.tones.append((epoch, log_ns, tone_of(message)))
    else:
        extraction.maps.append((epoch, log_ns, message))


@dataclass(frozen=True)
class _Headed:
    """A message that is a header, as one that has it."""

    header: Any


def _unlike(recording: RecordingReader, raw: RawMessage, error: Exception) -> RecordingError:
    return RecordingError(
        f'{recording.path}: {raw.topic} at {raw.stamp_ns} ns is not as a ballbot sends it: {error}'
    )


def _wanted(recording: RecordingReader, notices: list[str]) -> dict[str, Topic]:
    """Return our topics by the names they have in the file, below whatever namespace."""
    topics = recording.topics()
    ours = (*TICKED, *_EVENTS)
    # These names are nobody else's, and none ends like another one.
    marks = [topic for topic in TOPICS if topic.name.startswith(('plant/', 'controller/'))]
    marks.append(MOTOR_DUTY)
    namespace = robot_namespace(recording, marks)
    if namespace is None:
        raise RecordingError(
            f'{recording.path}: no recording of a ballbot: it has none of '
            f'{", ".join(mark.resolved() for mark in marks)}'
        )
    wanted = {}
    for topic in ours:
        name = topic.resolved(namespace)
        if name not in topics:
            if topic in TICKED:
                notices.append(f'There is no topic {name}; what needs it is left out.')
        elif topics[name].type_name != topic.type_name:
            notices.append(
                f'{name} is {topics[name].type_name}, not {topic.type_name}; it is left out.'
            )
        else:
            wanted[name] = topic
    return wanted
