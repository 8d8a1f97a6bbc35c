"""The runs of a recording, and the robot's topics in it, in any namespace.

Time never goes back within a recording: the recorder begins another file when another plant begins
a run. So a stamp says which run a message belongs to.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.errors import RecordingError
from ballbot_ros.lockstep.participants import MAP_HASH, Participant
from ballbot_ros.parameters import (
    CONTROLLER,
    NODES,
    PATHS,
    PLANT,
    ROLES,
    SIMULATED,
    ParameterError,
    ParameterSet,
)
from ballbot_ros.recording.batch import Batch, RawMessage, Rows
from ballbot_ros.recording.messages.conversions import are_stops, time_ns
from ballbot_ros.recording.messages.run_reports import decode_announcement, decode_run_status
from ballbot_ros.recording.messages.topics import (
    BLUETOOTH_TX,
    HISTORY,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    RUN_STATUS,
    TOPICS,
    UNRECORDED,
    Topic,
)
from ballbot_ros.recording.reader import AttachedFile, RecordingReader
from ballbot_ros.recording.rosbag2 import MAPS
from ballbot_ros.recording.schemas import typestore
from ballbot_ros.robot.brick.faults import performed_faults
from ballbot_ros.robot.world.floor_map import is_file_name

IDENTIFYING_TOPICS = (
    MOTOR_DUTY,
    *(
        topic
        for topic in TOPICS
        if topic.name.startswith(('plant/', 'controller/')) and topic not in UNRECORDED
    ),
)
"""Topics that identify the robot's namespace, since no other robot has them."""


@dataclass(frozen=True)
class RobotTopics:
    """The robot's topics in a recording, by full name; its namespace is such as ``/robot``, or ''.

    `wrong_types` are the recorded types of topics that should have another type.
    """

    namespace: str
    by_name: Mapping[str, Topic]
    wrong_types: Mapping[str, str]

    @property
    def is_real(self) -> bool:
        """Whether it was a real robot: its data log is there, and no true motion."""
        found = {*self.by_name.values()}
        return BLUETOOTH_TX in found and not found & {PLANT_IMU, PLANT_ODOM, PLANT_JOINT_STATES}

    def mismatch(self, name: str) -> str:
        """Return a text about the wrong type of a topic."""
        return f'{name} is {self.wrong_types[name]}, not {self.by_name[name].type_name}'


def robot_topics(reader: RecordingReader) -> RobotTopics:
    """Find the robot's topics in a recording, in any namespace.

    Raises
    ------
    RecordingError
        If the recording has the topics of no ballbot, or of several.
    """
    # Search for duties first: topics named plant/… may come from other programs.
    namespace = robot_namespace(reader, [MOTOR_DUTY])
    if namespace is None:
        namespace = robot_namespace(reader, IDENTIFYING_TOPICS)
    if namespace is None:
        damage = f'{reader.damage}, and the rest is ' if reader.damage else ''
        raise RecordingError(
            f'{reader.path}: {damage}not a recording of a ballbot: it has none of the topics '
            f'{", ".join(mark.resolved() for mark in IDENTIFYING_TOPICS)}'
        )
    ours = {topic.resolved(namespace): topic for topic in TOPICS}
    types = {name: each.type_name for name, each in reader.topics().items() if name in ours}
    unreadable = reader.unreadable()
    for name in types:
        if name in unreadable or reader.typestore(name) is not typestore():
            types[name] += ' in another definition or encoding'
    return RobotTopics(
        namespace,
        {name: ours[name] for name in types},
        {name: found for name, found in types.items() if found != ours[name].type_name},
    )


def is_real_robot(reader: RecordingReader) -> bool:
    """Return whether a recording of any program is one of a real robot."""
    with suppress(RecordingError):  # of several robots
        if robot_namespace(reader, [BLUETOOTH_TX]) is not None:
            return robot_topics(reader).is_real
    return False


def robot_namespace(reader: RecordingReader, marks: Iterable[Topic]) -> str | None:
    """Return the namespace of the topics `marks` in a recording; None if it has none of them.

    The namespace is such as ``/robot``, or '' for none.

    Raises
    ------
    RecordingError
        If several namespaces have such topics.
    """
    endings = [f'/{mark.name}' for mark in marks]
    spaces = {
        name.removesuffix(ending)
        for name in reader.topics()
        for ending in endings
        if name.endswith(ending)
    }
    if len(spaces) > 1:
        names = ', '.join(sorted(space or '/' for space in spaces))
        raise RecordingError(
            f'{reader.path}: recording of several robots, in the namespaces {names}; '
            'only one is supported'
        )
    return next(iter(spaces), None)


END_OF_TIME_NS = 2**63 - 1
"""The largest stamp."""


@dataclass(frozen=True)
class RecordedRun:
    """A run of a recording.

    Attributes
    ----------
    name : str
        Its name in ``plant/run``; '' if unknown.
    start_ns : int
        Sim time of its first tick [ns].
    end_ns : int
        Sim time at which the next run begins [ns], or :data:`END_OF_TIME_NS`.
    is_announced : bool
        Whether ``plant/run`` announces it. If not, it begins with the first sample.
    """

    name: str
    start_ns: int
    end_ns: int = END_OF_TIME_NS
    is_announced: bool = True

    def has(self, stamp_ns: int) -> bool:
        """Return whether a stamp [ns] belongs to this run."""
        return self.start_ns <= stamp_ns < self.end_ns


def samples_in(batch: Batch, rows: Mapping[Topic, Rows]) -> dict[Topic, Rows]:
    """Return the rows of each topic that are samples: periodic messages, without motor stops."""
    samples = {}
    for topic, topic_rows in rows.items():
        if topic is MOTOR_DUTY:
            topic_rows = topic_rows[~are_stops(batch, topic_rows)]
        if topic.period_ns and len(topic_rows):
            samples[topic] = topic_rows
    return samples


class RunFinder:
    """Finds the runs of a recording: those announced, or else one from the first sample on."""

    def __init__(self, reader: RecordingReader) -> None:
        self._reader = reader
        self._names: dict[int, str] = {}  # of announced runs, by their start
        self._first_ns: dict[Topic, int] = {}
        self._newest_ns: dict[Topic, int] = {}

    def announce(self, raw: RawMessage) -> None:
        """Take a message of ``plant/run``.

        Raises
        ------
        RecordingError
            If it cannot be decoded, or announces the run of another plant.
        """
        message = self._reader.decode(raw)
        start_ns = time_ns(message.stamp)
        if self._names.setdefault(start_ns, message.frame_id) != message.frame_id:
            raise self._goes_back(start_ns)

    def are_new(self, topic: Topic, stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Take samples of a topic in file order; return which are newer than all earlier ones.

        Raises
        ------
        RecordingError
            If time goes back further than for a sample that was late or sent again.
        """
        first_ns = self._first_ns.setdefault(topic, int(stamps[0]))
        newest = np.append(self._newest_ns.get(topic, -1), stamps)
        *_, self._newest_ns[topic] = newest = np.maximum.accumulate(newest)
        before = newest[:-1]
        far_back = stamps < np.maximum(before - HISTORY * topic.period_ns, first_ns + 1)
        if (goes_back := far_back & (stamps < before)).any():
            raise self._goes_back(int(stamps[goes_back][0]))
        return np.asarray(stamps > before)

    def runs(self) -> tuple[RecordedRun, ...]:
        """Return the runs in the order of their times."""
        starts = sorted(self._names)
        if not starts and self._first_ns:
            return (RecordedRun('', min(self._first_ns.values()), is_announced=False),)
        return tuple(
            RecordedRun(self._names[start], start, end)
            for start, end in zip(starts, [*starts[1:], END_OF_TIME_NS], strict=False)
        )

    def _goes_back(self, stamp_ns: int) -> RecordingError:
        return RecordingError(
            f'{self._reader.path}: time goes back to {stamp_ns * 1e-9:.3f} s: record the runs of '
            'each plant to a file of its own'
        )


class TopicBlock(NamedTuple):
    """Messages of a topic, in file order, and their log times [ns]."""

    topic: Topic
    stamps_ns: list[int]
    data: list[bytes]


class RobotRecording(NamedTuple):
    """A recording of the robot, with its topics."""

    reader: RecordingReader
    topics: RobotTopics

    def messages(
        self, wanted: Collection[Topic], start_ns: int = 0
    ) -> Iterator[tuple[Topic, RawMessage]]:
        """Iterate over the messages of some topics in file order, from a log time [ns] on."""
        names = {name: topic for name, topic in self.topics.by_name.items() if topic in wanted}
        for raw in self.reader.raw_messages(names, start_ns):
            yield names[raw.topic], raw

    def blocks(
        self, wanted: Collection[Topic], start_ns: int, last_ns: int
    ) -> Iterator[TopicBlock]:
        """Iterate over the messages with log times [ns] from `start_ns` to `last_ns`.

        Those of a part of the file come topic by topic, which takes less time.
        """
        names = {name: topic for name, topic in self.topics.by_name.items() if topic in wanted}
        for batch in self.reader.batches(names, start_ns):
            for name, rows in batch.rows().items():
                rows = rows[batch.log_ns[rows] <= last_ns]
                if len(rows):
                    log_ns = batch.log_ns[rows].tolist()
                    yield TopicBlock(names[name], log_ns, batch.contents(rows))


class AnnouncedParameters:
    """Collects the announcements of participants in a recording: `by_run`, by its name."""

    def __init__(self) -> None:
        self.by_run: dict[str, list[Participant]] = {}
        self._members: dict[str, Mapping[str, str]] = {}

    def add(self, topic: Topic, data: bytes) -> None:
        """Process a message of ``participants`` or ``plant/run_status``; ignore all others."""
        try:
            if topic is RUN_STATUS:
                status = decode_run_status(data)
                self._members[status.run] = status.participants
                return
            announcement = decode_announcement(data)
        except ValueError:
            return
        self.by_run.setdefault(announcement.run, []).append(announcement.participant)

    def _of_run(self, run: str) -> dict[str, Mapping[str, object]]:
        """Return the last parameters by role, only of participants that the run status lists."""
        found: dict[str, Participant] = {}
        for each in self.by_run.get(run, ()):
            is_known = each.role in NODES and each.parameters and self._took_part(each, run)
            if is_known and found.setdefault(each.role, each).instance == each.instance:
                found[each.role] = each
        return {role: each.parameters for role, each in found.items()}

    def _took_part(self, participant: Participant, run: str) -> bool:
        member = self._members.get(run, {}).get(participant.role, '')
        return participant.parameters_sha256[:12] in member

    def participant(self, run: str, role: str) -> Participant | None:
        """Return who took a role in the run with this name; None if nobody was announced."""
        announced = (each for each in self.by_run.get(run, ()) if each.role == role)
        return next((each for each in announced if self._took_part(each, run)), None)

    def foreign(self, run: str) -> dict[str, Participant]:
        """Return the participants that are nodes of other packages, by role."""
        found = ((role, self.participant(run, role)) for role in ROLES)
        return {role: each for role, each in found if each and each.is_foreign}

    def has_parameters(self, run: str) -> bool:
        """Return whether all parameters needed to replay the run with this name were announced."""
        return self._of_run(run).keys() >= SIMULATED

    def is_of_another_scenario(self, run: str) -> bool:
        """Return whether the scenario of a run differs from that of the first announced run."""
        runs = run, next(iter(self.by_run), run)
        one, other = (self._of_run(each).get(PLANT, {}).get('scenario') for each in runs)
        return bool(one != other)

    def of(
        self, run: str, attached: ParameterSet, files: Mapping[str, AttachedFile]
    ) -> ParameterSet:
        """Return the parameters of a run by its name in ``plant/run``.

        The attached parameters apply where no value was announced; the attached files include the
        map if it was a file.
        """
        parameters = ParameterSet(attached)
        told = self._of_run(run)
        for role, values in told.items():
            for name, value in values.items():
                if name in PATHS and name != 'map':
                    continue  # a path is useless on another machine
                if name == 'map' and isinstance(value, str) and is_file_name(value):
                    value = _attached_map(files, values.get(MAP_HASH)) or value
                try:
                    parameters.set(role, name, value)
                except ParameterError:
                    continue  # a foreign controller has its own parameters
        texts = {
            role: str(told[role].get('faults', '')) for role in (PLANT, CONTROLLER) if role in told
        }
        if len({*texts.values()}) == 2:
            with suppress(ParameterError):
                parameters.set(PLANT, 'faults', performed_faults(texts))
        return parameters


def _attached_map(files: Mapping[str, AttachedFile], sha256: object) -> str | None:
    for name in MAPS:
        if name in files and hashlib.sha256(files[name].data).hexdigest() == sha256:
            return name
    return None
