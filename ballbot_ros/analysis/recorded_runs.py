"""The runs of a recording, and the robot's topics in it, in any namespace.

Time may go back within a file: the runs of each plant begin at 1 s, and a recorder may outlive one
plant and record the runs of the next into the same file. A part of the file in which time does not
go back is an *epoch*; a stamp identifies a tick only within its epoch.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.errors import RecordingError
from ballbot_ros.lockstep.participants import MAP_HASH, Participant
from ballbot_ros.lockstep.recording_order import MAX_AHEAD_NS
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
    RUN,
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
    def well_typed(self) -> dict[str, Topic]:
        """The topics with the correct type, by name."""
        return {n: topic for n, topic in self.by_name.items() if n not in self.wrong_types}

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

    It raises RecordingError if the recording has the topics of no ballbot, or of several.
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

    The namespace is such as ``/robot``, or '' for none. It raises RecordingError if several
    namespaces have such topics.
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
    epoch : int
        Its epoch in the file, from 0.
    name : str
        Its name in ``plant/run``; '' if unknown.
    start_ns : int
        Sim time of its first tick [ns].
    end_ns : int
        Sim time at which the next run of the epoch begins [ns], or :data:`END_OF_TIME_NS`.
    is_announced : bool
        Whether ``plant/run`` announces it. If not, it begins with the first sample of its epoch.
    """

    epoch: int
    name: str
    start_ns: int
    end_ns: int = END_OF_TIME_NS
    is_announced: bool = True

    def has(self, epoch: int, stamp_ns: int) -> bool:
        """Return whether a stamp of an epoch [ns] belongs to this run."""
        return epoch == self.epoch and self.start_ns <= stamp_ns < self.end_ns


def samples_in(batch: Batch, rows: Mapping[Topic, Rows]) -> dict[Topic, Rows]:
    """Return the rows of each topic that are samples: periodic messages, without motor stops."""
    samples = {}
    for topic, topic_rows in rows.items():
        if topic is MOTOR_DUTY:
            topic_rows = topic_rows[~are_stops(batch, topic_rows)]
        if topic.period_ns and len(topic_rows):
            samples[topic] = topic_rows
    return samples


Epochs = tuple[NDArray[np.intp], NDArray[np.bool_]]
"""The epoch of each message in a batch, and which are new samples: newer than all earlier ones of
their topic and epoch."""


class EpochMessage(NamedTuple):
    """A recorded message with its topic and epoch."""

    epoch: int
    topic: Topic
    raw: RawMessage


@dataclass
class _Epoch:
    """Start [ns] and name of the runs announced in an epoch, and the span of its samples [ns]."""

    names: dict[int, str] = field(default_factory=dict)
    oldest_ns: int = END_OF_TIME_NS
    newest_ns: int = -1

    def note(self, oldest_ns: int, newest_ns: int) -> None:
        self.oldest_ns = min(self.oldest_ns, oldest_ns)
        self.newest_ns = max(self.newest_ns, newest_ns)


def _by_row(rows: Mapping[Topic, Rows]) -> dict[int, Topic]:
    return {row: topic for topic, topic_rows in rows.items() for row in topic_rows.tolist()}


class RunFinder:
    """Finds the runs of a recording from its messages in file order.

    The topics of a file are in no fixed order relative to each other, so each is tracked
    separately. The first topic whose time goes back begins the next epoch, and the others follow.
    A message without a stamp belongs to the epoch around it. If it is from the plant and follows
    the announcement of the next epoch's first run, it belongs to the next epoch.
    """

    def __init__(self, reader: RecordingReader) -> None:
        self._reader = reader
        self._epochs = [_Epoch()]
        self._next: dict[int, str] = {}  # announced runs of the next epoch
        self._newest: dict[Topic, tuple[int, int]] = {}  # sample: its epoch and stamp

    @property
    def epochs(self) -> int:
        """Number of epochs so far, at least 1."""
        return len(self._epochs)

    def runs(self) -> tuple[RecordedRun, ...]:
        """Return the runs found so far, in file order."""
        runs = []
        for number, epoch in enumerate(self._epochs):
            starts = sorted(epoch.names)
            runs += [
                RecordedRun(number, epoch.names[start], start, end)
                for start, end in zip(starts, [*starts[1:], END_OF_TIME_NS], strict=False)
            ]
            if not starts and epoch.newest_ns >= 0:
                runs.append(RecordedRun(number, '', epoch.oldest_ns, is_announced=False))
        return tuple(runs)

    def process(
        self,
        batch: Batch,
        rows: Mapping[Topic, Rows],
        samples: Mapping[Topic, Rows],
        stamps: NDArray[np.int64],
    ) -> Epochs:
        """Process the next messages of the file.

        It raises RecordingError if a message of ``plant/run`` cannot be decoded.

        Parameters
        ----------
        rows : mapping of Topic to ndarray
            The rows of the batch by topic.
        samples : mapping of Topic to ndarray
            The rows that are samples, from :func:`samples_in`.
        stamps : ndarray, shape (n,)
            The stamps of the samples [ns], and the log times of all other messages.
        """
        if RUN not in rows and not self._next:
            are_new = self._process_together(samples, stamps)
            if are_new is not None:
                return np.full(len(batch), self.epochs - 1), are_new
        topics, sample_topics = _by_row(rows), _by_row(samples)
        epochs, are_new = np.empty(len(batch), np.intp), np.zeros(len(batch), np.bool_)
        for row, stamp_ns in enumerate(stamps.tolist()):
            if row in sample_topics:
                epochs[row], are_new[row] = self._process_sample(sample_topics[row], stamp_ns)
                continue
            topic = topics.get(row)
            if topic is RUN:
                message = self._reader.decode(batch.message(row))
                self._announce(time_ns(message.stamp), message.frame_id)
            epochs[row] = self.epochs - 1
            if self._next and topic and topic.publisher == PLANT:
                epochs[row] += 1  # it is from the next plant, which has announced its run
        return epochs, are_new

    def _process_together(
        self, samples: Mapping[Topic, Rows], stamps: NDArray[np.int64]
    ) -> NDArray[np.bool_] | None:
        """Process messages of the current epoch, and return which are new.

        None, and nothing is processed, if a sample is older than an earlier one.
        """
        are_new = np.zeros(len(stamps), np.bool_)
        for topic, rows in samples.items():
            epoch, newest_ns = self._newest.get(topic, (self.epochs - 1, -1))
            steps = np.diff(stamps[rows], prepend=newest_ns)
            if epoch != self.epochs - 1 or (steps < 0).any():
                return None
            are_new[rows] = steps > 0
        for topic, rows in samples.items():
            first, last = stamps[rows[[0, -1]]].tolist()
            self._newest[topic] = self.epochs - 1, last
            self._epochs[-1].note(first, last)
        return are_new

    def _announce(self, start_ns: int, name: str) -> None:
        epoch = self._epochs[-1]
        rises = start_ns > max(epoch.names, default=-1)
        if rises and (not self._next or start_ns > epoch.newest_ns):
            epoch.names[start_ns] = name
        else:
            self._next[start_ns] = name

    def _process_sample(self, topic: Topic, stamp_ns: int) -> tuple[int, bool]:
        """Return the epoch of a sample, and whether it is newer than earlier ones."""
        epoch, newest_ns = self._newest.get(topic, (self.epochs - 1, -1))
        if epoch == self.epochs - 1:
            is_far_back = stamp_ns < newest_ns - HISTORY * topic.period_ns
            is_earliest = self._epochs[-1].oldest_ns >= stamp_ns < newest_ns
            if stamp_ns in self._next or is_far_back or is_earliest:
                # It begins another epoch, rather than being late or a resend.
                self._epochs.append(_Epoch(self._next))
                self._next = {}
        elif stamp_ns > max(newest_ns, self._epochs[-1].newest_ns + MAX_AHEAD_NS):
            # It is late, and belongs to the previous epoch.
            self._newest[topic] = epoch, stamp_ns
            return epoch, True
        if epoch != self.epochs - 1:
            epoch, newest_ns = self.epochs - 1, -1
        if stamp_ns <= newest_ns:
            return epoch, False
        if topic.publisher == PLANT and self._next.items() <= self._epochs[-1].names.items():
            self._next = {}  # the same run was announced again
        self._newest[topic] = epoch, stamp_ns
        self._epochs[-1].note(stamp_ns, stamp_ns)
        return epoch, True


def messages_by_epoch(
    reader: RecordingReader, topics: RobotTopics, finder: RunFinder, wanted: Collection[Topic]
) -> Iterator[EpochMessage]:
    """Iterate over the messages of some topics in file order, with the epochs that `finder` finds.

    For this it also receives all samples and announcements.
    """
    read = [n for n, topic in topics.by_name.items() if topic in (*wanted, RUN) or topic.period_ns]
    well_typed = topics.well_typed
    for batch in reader.batches(read):
        rows = batch.rows()
        ours = {
            well_typed[name]: topic_rows for name, topic_rows in rows.items() if name in well_typed
        }
        epochs, _ = finder.process(batch, ours, samples_in(batch, ours), batch.log_ns)
        is_wanted = np.zeros(len(batch), np.bool_)
        for name, topic_rows in rows.items():
            is_wanted[topic_rows] = topics.by_name[name] in wanted
        messages = batch.select(is_wanted).messages()
        for epoch, raw in zip(epochs[is_wanted].tolist(), messages, strict=True):
            yield EpochMessage(epoch, topics.by_name[raw.topic], raw)


class EpochBlock(NamedTuple):
    """Messages of a topic in an epoch of a recording, in file order, and their log times [ns]."""

    epoch: int
    topic: Topic
    stamps_ns: list[int]
    data: list[bytes]


@dataclass(frozen=True)
class RobotRecording:
    """A recording of the robot, with its topics and its number of epochs, at least 1."""

    reader: RecordingReader
    topics: RobotTopics
    epochs: int

    def messages(self, wanted: Collection[Topic], start_ns: int = 0) -> Iterator[EpochMessage]:
        """Iterate over the messages of some topics in file order, from a log time [ns] on."""
        if self.epochs == 1:
            names = {name: topic for name, topic in self.topics.by_name.items() if topic in wanted}
            for raw in self.reader.raw_messages(names, start_ns):
                yield EpochMessage(0, names[raw.topic], raw)
            return
        finder = RunFinder(self.reader)
        for each in messages_by_epoch(self.reader, self.topics, finder, wanted):
            if each.raw.stamp_ns >= start_ns:
                yield each

    def blocks(
        self, wanted: Collection[Topic], start_ns: int, last_ns: int
    ) -> Iterator[EpochBlock]:
        """Iterate over the messages with log times [ns] from `start_ns` to `last_ns`.

        Those of a part of the file come topic by topic, which takes less time.
        """
        if self.epochs > 1:
            for epoch, topic, raw in self.messages(wanted, start_ns):
                if raw.stamp_ns <= last_ns:
                    yield EpochBlock(epoch, topic, [raw.stamp_ns], [raw.data])
            return
        names = {name: topic for name, topic in self.topics.by_name.items() if topic in wanted}
        for batch in self.reader.batches(names, start_ns):
            for name, rows in batch.rows().items():
                rows = rows[batch.log_ns[rows] <= last_ns]
                if len(rows):
                    log_ns = batch.log_ns[rows].tolist()
                    yield EpochBlock(0, names[name], log_ns, batch.contents(rows))


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
