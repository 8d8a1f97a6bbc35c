"""Extraction of the data for a report from a recording, into columns.

The stamped topics are read chunk by chunk without creating message objects: an hour of ticks has
some million messages.
"""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain
from sys import intern
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.recorded_runs import (
    AnnouncedParameters,
    RecordedRun,
    RobotTopics,
    RunFinder,
    robot_topics,
    samples_in,
)
from ballbot_ros.analysis.recorded_scenario import PushPairs
from ballbot_ros.errors import RecordingError
from ballbot_ros.parameters import Value
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.batch import Batch, BatchLayout, RawMessage, Rows
from ballbot_ros.recording.messages.conversions import (
    body_rates,
    is_stop,
    odometry_position,
    pitches,
    sound_tone,
)
from ballbot_ros.recording.messages.jobs import Jobs, jobs_in
from ballbot_ros.recording.messages.raw import Messages, Stamps, decoder
from ballbot_ros.recording.messages.run_reports import decode_parameter_event
from ballbot_ros.recording.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    BRICK_TASKS,
    CONTROLLER_STATE,
    DIAGNOSTICS,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    LCD,
    MAP,
    MOTOR_DUTY,
    OPERATING_STATE,
    PARAMETER_EVENTS,
    PARTICIPANTS,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    RUN,
    RUN_STATUS,
    SONAR_RANGE,
    SOUND,
    WALL_HIT,
    Topic,
)
from ballbot_ros.recording.overview import TopicStatistics
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import DiagnosticStatus, OccupancyGridMessage, typestore
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.brick import Tone

_EVENTS = (
    OPERATING_STATE, RUN_STATUS, PARTICIPANTS, DIAGNOSTICS, LCD, SOUND, MAP, PARAMETER_EVENTS,
    ACCEPTED_PUSH, WALL_HIT, BRICK_TASKS,
)  # fmt: skip
_MISSING = 'Topic {} not found; figures, metrics and columns that need it are missing.'


def _pitch(messages: Any) -> NDArray[np.float64]:
    """Return the pitch angles of many orientations, each computed by :func:`pitch_angles`."""
    q = messages.orientation
    return pitches(q.w, q.x, q.y, q.z)


def _references(values: Any) -> Sequence[object]:
    """Return the references in positions or velocities of ``controller/state``, shape (n, k).

    They are NaN if it has only estimates.
    """
    return values.T[4:6] if values.shape[1] >= 6 else (np.nan, np.nan)


STAMPED_TOPICS: Mapping[Topic, tuple[str, int, Callable[[Any], Sequence[Any]]]] = {
    PLANT_IMU: ('d', 4, lambda m: (*_pitch(m), *body_rates(m))),
    PLANT_ODOM: ('d', 2, odometry_position),
    PLANT_JOINT_STATES: ('f', 4, lambda m: (*m.velocity.T[:2], *m.effort.T[:2])),
    MOTOR_DUTY: ('f', 3, lambda m: (m.vector.x, m.vector.y, m.vector.z)),
    CONTROLLER_STATE: (
        'f',
        10,
        lambda m: (
            *m.position.T[:4],
            *m.velocity.T[[1, 3]],
            *_references(m.position),
            *_references(m.velocity),
        ),
    ),
    GYRO_IMU: ('f', 2, lambda m: (m.angular_velocity.y, m.angular_velocity.x)),
    JOINT_STATES: ('f', 2, lambda m: m.position.T[:2]),
    SONAR_RANGE: ('f', 2, lambda m: (m.range, m.field_of_view)),
    BATTERY_STATE: ('f', 1, lambda m: (m.voltage,)),
    GAMEPAD_JOY: ('f', 2, lambda m: (-m.axes.T[0], m.axes.T[1])),
}
"""The stamped topics, with the type code and number of their columns, and the function that reads
them from a record array of messages.

Pitch and pitch rate of planes x, y [rad, rad/s]; position x, y [m]; motor rate x, y [rad/s] and
torque x, y [N·m]; duty x, y [%] and the time until it acts [s]; the estimates of
``controller/state`` [rad], its pitch rates x, y [rad/s], its references of the ball angle x, y
[rad] and their rates [rad/s]; gyro x, y with offset [rad/s]; encoder x, y [rad]; distance [m];
voltage [V]; sticks forward, rightward, each -1 ... 1.
"""


class SampleBuffer:
    """The samples of a stamped topic, by epoch of the file.

    A sample has `width` numbers, of a type code of the module `array`.
    """

    def __init__(self, type_code: str, width: int) -> None:
        self._type_code, self._width = type_code, width
        self._epochs: dict[int, tuple[array[int], array[float]]] = {}

    def __bool__(self) -> bool:
        """Return whether there are samples."""
        return bool(self._epochs)

    def extend(self, stamps: NDArray[np.int64], values: Floats, epochs: NDArray[np.intp]) -> None:
        """Add samples: stamps (n,), values (n, width) and epochs (n,)."""
        for epoch in np.unique(epochs).tolist():
            column, numbers = self._epochs.setdefault(epoch, (array('q'), array(self._type_code)))
            selected = epochs == epoch
            column.frombytes(stamps[selected].tobytes())
            numbers.frombytes(values[selected].astype(self._type_code, copy=False).tobytes())

    def epoch(self, number: int) -> tuple[NDArray[np.int64], Floats]:
        """Return stamps, shape (n,), and values, shape (n, width), without copying them."""
        if number not in self._epochs:
            return np.zeros(0, np.int64), np.zeros((0, self._width), self._type_code)
        stamps, numbers = self._epochs[number]
        return (
            np.frombuffer(stamps, np.int64),
            np.frombuffer(numbers, self._type_code).reshape(-1, self._width),
        )


class Status(NamedTuple):
    """A node's report in ``/diagnostics``.

    Equal texts share one object: in an hour, nodes repeat the same text thousands of times.
    """

    name: str
    message: str
    level: int
    keys: tuple[str, ...]
    texts: tuple[str, ...]

    @property
    def node(self) -> str:
        """Name of the node."""
        return self.name.partition(':')[0]

    @property
    def values(self) -> Iterator[tuple[str, str]]:
        """Pairs of key and value."""
        return zip(self.keys, self.texts, strict=True)


@dataclass
class Extraction:
    """The content of a recording; each event is a tuple of epoch, log time [ns] and content.

    The pushes are by epoch. `is_real` says whether it was a real robot.
    """

    runs: tuple[RecordedRun, ...] = ()
    is_real: bool = False
    buffers: dict[Topic, SampleBuffer] = field(
        default_factory=lambda: {
            topic: SampleBuffer(code, width) for topic, (code, width, _) in STAMPED_TOPICS.items()
        }
    )
    announced: AnnouncedParameters = field(default_factory=AnnouncedParameters)
    states: list[tuple[int, int, str]] = field(default_factory=list)
    statuses: list[tuple[int, int, Status]] = field(default_factory=list)
    pages: list[tuple[int, int, str]] = field(default_factory=list)
    tones: list[tuple[int, int, Tone]] = field(default_factory=list)
    jobs: list[tuple[int, int, Jobs]] = field(default_factory=list)
    retunings: list[tuple[int, int, Mapping[str, Value]]] = field(default_factory=list)
    maps: list[tuple[int, int, OccupancyGridMessage]] = field(default_factory=list)
    wall_hits: list[tuple[int, int, bool]] = field(default_factory=list)
    pushes: defaultdict[int, PushPairs] = field(default_factory=lambda: defaultdict(PushPairs))
    topic_statistics: dict[str, TopicStatistics] = field(default_factory=dict)
    notices: list[str] = field(default_factory=list)

    def take(self, topic: Topic, epoch: int, log_ns: int, message: Any) -> None:
        """Take an event; raise ValueError or OverflowError if it is malformed."""
        if topic is OPERATING_STATE:
            self.states.append((epoch, log_ns, message.data))
        elif topic is DIAGNOSTICS:
            self.statuses += [(epoch, log_ns, _status(each)) for each in message.status]
        elif topic is LCD:
            self.pages.append((epoch, log_ns, message.data))
        elif topic is ACCEPTED_PUSH:
            self.pushes[epoch].add(message)
        elif topic is WALL_HIT:
            self.wall_hits.append((epoch, log_ns, message.data))
        elif topic is SOUND:
            self.tones.append((epoch, log_ns, sound_tone(message)))
        elif topic is BRICK_TASKS:
            self.jobs.append((epoch, log_ns, jobs_in(message)))
        elif topic is MAP:
            self.maps.append((epoch, log_ns, message))


def extract(recording: RecordingReader, progress: ProgressCallback) -> Extraction:
    """Read a recording once.

    It raises RecordingError if the recording has no topics of a ballbot, topics of several
    ballbots, or a malformed message.
    """
    topics = robot_topics(recording)
    extraction = Extraction(is_real=topics.is_real)
    wanted = _wanted(topics, extraction)
    finder = RunFinder(recording)
    statistics = {
        name: TopicStatistics(name, summary.type_name)
        for name, summary in recording.topics().items()
    }
    newest_ns = done = 0
    for batch in recording.batches():
        progress(done, recording.count)
        done += len(batch)
        rows = batch.rows()
        ours = {wanted[name]: topic_rows for name, topic_rows in rows.items() if name in wanted}
        log_ns = batch.log_ns
        stamps, values = log_ns.copy(), {}
        samples = samples_in(
            batch, {topic: ours[topic] for topic in STAMPED_TOPICS if topic in ours}
        )
        for topic, topic_rows in samples.items():
            stamps[topic_rows], values[topic] = _samples(recording, topic, batch, topic_rows)
        epochs, are_new = finder.process(batch, ours, samples, stamps)
        for topic, topic_rows in samples.items():
            new = are_new[topic_rows]
            kept = topic_rows[new]
            extraction.buffers[topic].extend(stamps[kept], values[topic][new], epochs[kept])
        for row in sorted(chain.from_iterable(ours[t].tolist() for t in _EVENTS if t in ours)):
            raw = batch.message(row)
            _take_event(extraction, recording, wanted[raw.topic], raw, int(epochs[row]))
        newest = _newest_log_ns(log_ns, newest_ns, ours.get(ACCEPTED_PUSH))
        newest_ns = int(newest[-1])
        ages_ms = (np.maximum(newest, log_ns) - stamps) * 1e-6
        for name, topic_rows in rows.items():
            statistics[name].extend(log_ns[topic_rows], ages_ms[topic_rows])
    if not any(extraction.buffers.values()):
        raise RecordingError(f'{recording.path}: no messages of a ballbot: nothing to report')
    extraction.runs = finder.runs()
    extraction.topic_statistics = {name: each for name, each in statistics.items() if each.count}
    return extraction


class MessageCollector:
    """Collects from the messages of a simulated run what :func:`extract` reads in its recording.

    `name` is that of the run in ``plant/run``, `start_ns` the stamp of its first tick [ns].
    """

    def __init__(self, name: str, start_ns: int) -> None:
        self._extraction = Extraction(runs=(RecordedRun(0, name, start_ns),))
        self._statistics: dict[str, TopicStatistics] = {}

    def add(self, topic: Topic, stamps_ns: Stamps, messages: Messages) -> None:
        """Collect messages of a topic; those of a stamped topic differ only in their numbers."""
        name, count = topic.resolved(), len(stamps_ns)
        statistics = self._statistics.setdefault(name, TopicStatistics(name, topic.type_name))
        statistics.extend(stamps_ns)
        first = messages[0].tobytes()
        if topic in _EVENTS:
            decode = decoder(topic.type_name)
            for stamp_ns, message in zip(stamps_ns.tolist(), messages, strict=True):
                self._extraction.take(topic, 0, stamp_ns, decode(message.tobytes()))
        elif topic in STAMPED_TOPICS and not (topic is MOTOR_DUTY and is_stop(first)):
            records: Any = messages.view(_record_type(topic, first)).view(np.recarray)
            values = _values(topic, records)
            self._extraction.buffers[topic].extend(stamps_ns, values, np.zeros(count, np.intp))

    def extraction(self, names: Iterable[str]) -> Extraction:
        """Return what was collected; `names` are those of the topics in the order of the file."""
        wanted = (topic.resolved() for topic in STAMPED_TOPICS)
        missing = [name for name in wanted if name not in self._statistics]
        self._extraction.notices += map(_MISSING.format, missing)
        self._extraction.topic_statistics = {name: self._statistics[name] for name in names}
        return self._extraction


@lru_cache(32)
def _record_type(topic: Topic, message: bytes) -> np.dtype[Any]:
    return BatchLayout.of(message, typestore(), topic.type_name).dtype


def _newest_log_ns(
    log_ns: NDArray[np.int64], before_ns: int, ahead: Rows | None
) -> NDArray[np.int64]:
    """Return the newest log time [ns] so far at each message, not counting the rows `ahead`.

    A push is announced with the time of its start, which may be later than all messages around it.
    """
    counted = log_ns.copy()
    if ahead is not None:
        counted[ahead] = before_ns
    return np.maximum.accumulate(counted).clip(min=before_ns)


def _samples(
    recording: RecordingReader, topic: Topic, batch: Batch, rows: Rows
) -> tuple[NDArray[np.int64], Floats]:
    """Return the stamps [ns] and the columns of messages of a stamped topic.

    Their shapes are (n,) and (n, width).
    """
    type_code, width, _ = STAMPED_TOPICS[topic]
    stamps, values = np.empty(len(rows), np.int64), np.empty((len(rows), width), type_code)
    name = batch.message(rows[0]).topic
    for some, messages in recording.records(name, batch, rows):
        indices = np.searchsorted(rows, some)
        try:
            stamp = messages.header.stamp
            stamps[indices] = stamp.sec.astype(np.int64) * SECOND_NS + stamp.nanosec
            values[indices] = _values(topic, messages)
        except (AttributeError, IndexError) as error:
            raise _unlike(recording, batch.message(some[0]), error) from None
    return stamps, values


def _values(topic: Topic, messages: Any) -> Floats:
    """Return the columns of a stamped topic in a record array of messages, shape (n, width).

    It raises AttributeError or IndexError if the messages lack a number.
    """
    type_code, width, read = STAMPED_TOPICS[topic]
    columns = read(messages)
    if len(columns) != width:
        raise IndexError(f'{len(columns)} numbers instead of {width}')
    values = np.empty((len(messages), width), type_code)
    with np.errstate(over='ignore'):
        for number, column in enumerate(columns):
            values[:, number] = column
    return values


def _take_event(
    extraction: Extraction, recording: RecordingReader, topic: Topic, raw: RawMessage, epoch: int
) -> None:
    if topic in (PARTICIPANTS, RUN_STATUS):
        extraction.announced.add(topic, raw.data)
        return
    try:
        if topic is PARAMETER_EVENTS:
            values = decode_parameter_event(raw.data)
            extraction.retunings.append((epoch, raw.stamp_ns, values))
        else:
            extraction.take(topic, epoch, raw.stamp_ns, recording.decode(raw))
    except (ValueError, OverflowError) as error:
        raise _unlike(recording, raw, error) from None


def _status(message: DiagnosticStatus) -> Status:
    return Status(
        intern(message.name),
        intern(message.message),
        int(message.level),
        _same_keys(tuple(intern(each.key) for each in message.values)),
        tuple(intern(each.value) for each in message.values),
    )


@lru_cache(128)
def _same_keys(keys: tuple[str, ...]) -> tuple[str, ...]:
    """Return the first tuple with these keys, so that equal tuples share one object."""
    return keys


def _unlike(recording: RecordingReader, raw: RawMessage, error: Exception) -> RecordingError:
    return RecordingError(
        f'{recording.path}: {raw.topic} at {raw.stamp_ns} ns is malformed: {error}'
    )


def _wanted(topics: RobotTopics, extraction: Extraction) -> dict[str, Topic]:
    """Return the topics to read, by name in the file; note missing and mistyped ones."""
    wanted = {}
    for topic in (*STAMPED_TOPICS, *_EVENTS, RUN):
        name = topic.resolved(topics.namespace)
        if name in topics.wrong_types:
            extraction.notices.append(f'{topics.mismatch(name)}; ignored.')
        elif name in topics.by_name:
            wanted[name] = topic
        elif topic in STAMPED_TOPICS and not extraction.is_real:
            extraction.notices.append(_MISSING.format(name))
    return wanted
