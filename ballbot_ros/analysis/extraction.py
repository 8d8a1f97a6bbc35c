"""What a report needs of a recording, gathered into columns.

The stamped topics are read a chunk of the file at once, and no message of them is ever made an
object: an hour of ticks is some million messages.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain
from sys import intern
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.namespace import robot_namespace
from ballbot_ros.analysis.told_parameters import ToldParameters
from ballbot_ros.brick.brick import Tone
from ballbot_ros.messages.conversions import (
    ball_position,
    body_rates,
    pitch_angles,
    stamp_ns,
    tone_of,
)
from ballbot_ros.messages.motor_stop import are_stops
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
from ballbot_ros.recording.batch import Batch, RawMessage, Rows
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.simulation.timing import SECOND_NS

_EVENTS = (OPERATING_STATE, RUN, RUN_STATUS, PARTICIPANTS, DIAGNOSTICS, LCD, SOUND, MAP)
_FOREVER_NS = 2**63 - 1
_OTHER_CLOCK_MS = 3.6e6


def _pitch(messages: Any) -> NDArray[np.float64]:
    """Return the pitch angles of many orientations as :func:`pitch_angles` reckons each."""
    q = messages.orientation
    wxyz = (part.tolist() for part in (q.w, q.x, q.y, q.z))
    return np.array(list(map(pitch_angles, *wxyz))).T


TICKED: Mapping[Topic, tuple[str, int, Callable[[Any], Sequence[Any]]]] = {
    PLANT_IMU: ('d', 4, lambda m: (*_pitch(m), *body_rates(m))),
    PLANT_ODOM: ('d', 2, ball_position),
    PLANT_JOINT_STATES: ('f', 4, lambda m: (*m.velocity.T[:2], *m.effort.T[:2])),
    MOTOR_DUTY: ('f', 2, lambda m: (m.vector.x, m.vector.y)),
    CONTROLLER_STATE: ('f', 6, lambda m: (*m.position.T[:4], *m.velocity.T[[1, 3]])),
    GYRO_IMU: ('f', 2, lambda m: (m.angular_velocity.y, m.angular_velocity.x)),
    SONAR_RANGE: ('f', 1, lambda m: (m.range,)),
    BATTERY_STATE: ('f', 1, lambda m: (m.voltage,)),
}
"""The stamped topics, with number type and count of their columns, and how these are read from a
record array of messages.

Pitch and pitch rate of planes x, y [rad, rad/s]; position x, y [m]; motor rate x, y [rad/s] and
torque x, y [N·m]; duty x, y [%]; the estimates of ``controller/state`` [rad] and its pitch rates
x, y [rad/s]; gyro x, y with offset [rad/s]; distance [m]; voltage [V].
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
        self._newest = 0

    def __len__(self) -> int:
        """Return the number of epochs."""
        return len(self._epochs)

    def extend(self, stamps: NDArray[np.int64], values: NDArray[Any]) -> NDArray[np.intp]:
        """Add samples, and return the epoch of each; one that comes twice is dropped.

        Parameters
        ----------
        stamps : ndarray, shape (n,)
        values : ndarray, shape (n, width)
        """
        before = np.append(self._newest, stamps[:-1])
        begins = stamps < before
        is_new = stamps != before
        if not self._epochs:
            begins[0] = is_new[0] = True
        epochs = len(self) - 1 + np.cumsum(begins)
        for epoch in range(int(epochs[0]), int(epochs[-1]) + 1):
            if epoch == len(self):
                self._epochs.append((array('q'), array(self._kind)))
            taken = is_new & (epochs == epoch)
            column, numbers = self._epochs[epoch]
            column.frombytes(stamps[taken].tobytes())
            numbers.frombytes(values[taken].astype(self._kind, copy=False).tobytes())
        self._newest = int(stamps[-1])
        return epochs

    def epoch(self, index: int) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """Return stamps, shape (n,), and values, shape (n, width), without copying them."""
        if index >= len(self._epochs):
            return np.zeros(0, np.int64), np.zeros((0, self._width), self._kind)
        stamps, numbers = self._epochs[index]
        return (
            np.frombuffer(stamps, np.int64),
            np.frombuffer(numbers, self._kind).reshape(-1, self._width),
        )


class Status(NamedTuple):
    """What a node reported in ``/diagnostics``.

    Equal texts are one object: in an hour, some nodes that report each second say thousands of
    times the same.

    Attributes
    ----------
    name, message : str
    level : int
    keys, texts : tuple of str
    """

    name: str
    message: str
    level: int
    keys: tuple[str, ...]
    texts: tuple[str, ...]

    @property
    def values(self) -> Iterator[tuple[str, str]]:
        """The keys, each with its value."""
        return zip(self.keys, self.texts, strict=True)


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

    def extend(self, log_ns: NDArray[np.int64], age_ms: NDArray[np.floating[Any]]) -> None:
        """Count messages."""
        if self.count == 0:
            self.first_ns = self.last_ns = int(log_ns[0])
        newest = np.maximum.accumulate(np.append(self.last_ns, log_ns))
        self.gap_ns = max(self.gap_ns, int(np.diff(newest).max()))
        self.last_ns = int(newest[-1])
        self.count += len(log_ns)
        # One after the other: the sum of an array would be rounded in the order of its pieces.
        self.age_sum_ms = float(np.cumsum(np.append(self.age_sum_ms, age_ms))[-1])
        self.age_max_ms = max(self.age_max_ms, float(age_ms.max()))

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
    statuses: list[tuple[int, int, Status]] = field(default_factory=list)
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
    newest_ns = epoch = done = 0
    for batch in recording.batches():
        progress(done, recording.count)
        done += len(batch)
        rows = batch.rows()
        log_ns = batch.log_ns
        stamps, epochs = log_ns.copy(), np.full(len(batch), -1)
        for name, places in rows.items():
            topic = wanted.get(name)
            if topic is MOTOR_DUTY:
                places = places[~are_stops(batch, places)]
            if topic is not None and topic in TICKED and len(places):
                stamps[places], values = _samples(recording, topic, name, batch, places)
                epochs[places] = extraction.columns[topic].extend(stamps[places], values)
        epochs = _last_known(epochs, epoch)
        epoch = int(epochs[-1])
        events = (rows[name].tolist() for name in rows if wanted.get(name) in _EVENTS)
        for row in sorted(chain.from_iterable(events)):
            raw = batch.message(row)
            _take_event(extraction, recording, wanted[raw.topic], raw, int(epochs[row]))
        newest = np.maximum.accumulate(log_ns).clip(min=newest_ns)
        newest_ns = int(newest[-1])
        ages_ms = (newest - stamps) * 1e-6
        for name, places in rows.items():
            traffic[name].extend(log_ns[places], ages_ms[places])
    if not any(map(len, extraction.columns.values())):
        raise RecordingError(f'{recording.path}: no messages of a ballbot: nothing to report')
    extraction.traffic = {name: each for name, each in traffic.items() if each.count}
    return extraction


def _samples(
    recording: RecordingReader, topic: Topic, name: str, batch: Batch, rows: Rows
) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Return the stamps [ns] of messages of a stamped topic, shape (n,), and what is read of them.

    The latter has the shape (n, width).
    """
    kind, width, read = TICKED[topic]
    stamps, values = np.empty(len(rows), np.int64), np.empty((len(rows), width), kind)
    for some, messages in recording.records(name, batch, rows):
        places = np.searchsorted(rows, some)
        try:
            stamp = messages.header.stamp
            stamps[places] = stamp.sec.astype(np.int64) * SECOND_NS + stamp.nanosec
            columns = read(messages)
            if len(columns) != width:
                raise IndexError(f'{len(columns)} numbers instead of {width}')
        except (AttributeError, IndexError) as error:
            raise _unlike(recording, batch.message(some[0]), error) from None
        with np.errstate(over='ignore'):
            for number, column in enumerate(columns):
                values[places, number] = column
    return stamps, values


def _last_known(epochs: NDArray[np.intp], before: int) -> NDArray[np.intp]:
    """Return the epochs of all messages: that of the sample before where there is none, −1."""
    places = np.maximum.accumulate(np.where(epochs < 0, -1, np.arange(len(epochs))))
    return np.where(places < 0, before, epochs[places])


def _take_event(
    extraction: Extraction, recording: RecordingReader, topic: Topic, raw: RawMessage, epoch: int
) -> None:
    if topic in (PARTICIPANTS, RUN_STATUS):
        extraction.told.add(topic, raw.data)
        return
    message, log_ns = recording.decode(raw), raw.stamp_ns
    if topic is RUN:
        extraction.announce(stamp_ns(_Headed(message)), message.frame_id)
    elif topic is OPERATING_STATE:
        extraction.states.append((epoch, log_ns, message.data))
    elif topic is DIAGNOSTICS:
        extraction.statuses += [(epoch, log_ns, _status(each)) for each in message.status]
    elif topic is LCD:
        extraction.pages.append((epoch, log_ns, message.data))
    elif topic is SOUND:
        try:
            extraction.tones.append((epoch, log_ns, tone_of(message)))
        except (ValueError, OverflowError) as error:
            raise _unlike(recording, raw, error) from None
    else:
        extraction.maps.append((epoch, log_ns, message))


@dataclass(frozen=True)
class _Headed:
    """A message that is a header, as one that has it."""

    header: Any


def _status(message: Any) -> Status:
    return Status(
        intern(message.name),
        intern(message.message),
        int(message.level),
        _same_keys(tuple(intern(each.key) for each in message.values)),
        tuple(intern(each.value) for each in message.values),
    )


@lru_cache(128)
def _same_keys(keys: tuple[str, ...]) -> tuple[str, ...]:
    """Return the first tuple of these keys that there was."""
    return keys


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
            if topic is not None and topic in TICKED:
                notices.append(f'There is no topic {name}; what needs it is left out.')
        elif topics[name].type_name != topic.type_name:
            notices.append(
                f'{name} is {topics[name].type_name}, not {topic.type_name}; it is left out.'
            )
        else:
            wanted[name] = topic
    return wanted
