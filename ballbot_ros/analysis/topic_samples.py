"""The numbers of any recorded topic in a run, as columns that change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.extraction import STAMPED_TOPICS
from ballbot_ros.analysis.recorded_runs import RobotTopics, RunFinder, robot_topics, samples_in
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.errors import RecordingError
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.batch import Batch, Rows
from ballbot_ros.recording.columns import OWN_STAMP, Column, ColumnHints, TopicColumns, has_signals
from ballbot_ros.recording.messages.column_hints import column_hints
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.recording.messages.topics import RUN
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.arithmetic import Floats


@dataclass(frozen=True)
class TopicSamples:
    """The numbers in the messages of a topic in a run.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time since the start of the run [s], not decreasing: by the stamps of the headers, or else
        the log times.
    columns : mapping of str to ndarray
        The columns of `ballbot export` that have numbers, each of shape (n,).
    """

    time: Floats
    columns: Mapping[str, Floats]

    @property
    def changing(self) -> tuple[str, ...]:
        """The names of the columns with at least two different values."""
        return tuple(
            name
            for name, values in self.columns.items()
            if not np.array_equal(values[1:], values[:-1], equal_nan=True)
        )

    def newest(self, name: str, time: Floats) -> Floats:
        """Return the newest value of a column at each `time` [s]; NaN outside the samples."""
        if np.array_equal(time, self.time):
            return self.columns[name]
        rows = np.searchsorted(self.time, time, 'right') - 1
        is_inside = (rows >= 0) & (time <= self.time[-1])
        return np.where(is_inside, self.columns[name][rows], np.nan)


def topics_with_signals(path: Path) -> list[str]:
    """Return the readable topics of a recording whose messages can have numbers, by name.

    It raises RecordingError if the file can't be read.
    """
    with open_recording(path) as reader:
        unreadable = reader.unreadable()
        return sorted(
            name
            for name, topic in reader.topics().items()
            if topic.message_count
            and name not in unreadable
            and has_signals(topic.type_name, reader.typestore(name))
        )


def read_topic(
    run: RunData, topic: str, progress: ProgressCallback = lambda done, total: None
) -> TopicSamples:
    """Read the messages of a topic in a run from its recording.

    A stamp before the first tick or after the last comes from another clock; the log time takes its
    place. It raises RecordingError if the file can't be read, a message does not match its type, or
    the elements of its lists change during the run.
    """
    with open_recording(run.path) as reader:
        robot = robot_topics(reader)
        samples = _RunSamples(reader, topic, robot.namespace, run)
        finder = RunFinder(reader)
        topics = reader.topics()
        with_epochs = {*STAMPED_TOPICS, RUN}
        names = {topic, *(name for name, each in robot.well_typed.items() if each in with_epochs)}
        done, total = 0, sum(topics[name].message_count for name in names)
        for batch in reader.batches(names):
            progress(done, total)
            done += len(batch)
            epochs = _epochs(finder, robot, batch)
            if topic in (rows := batch.rows()):
                samples.add(batch, rows[topic], epochs)
    return samples.joined()


def _epochs(finder: RunFinder, robot: RobotTopics, batch: Batch) -> NDArray[np.intp]:
    """Return the epoch of each message, found as for the run itself."""
    known = robot.well_typed
    ours = {known[name]: rows for name, rows in batch.rows().items() if name in known}
    samples = samples_in(batch, {topic: ours[topic] for topic in STAMPED_TOPICS if topic in ours})
    stamps = batch.log_ns.copy()
    for rows in samples.values():
        stamps[rows] = batch.stamps_ns(rows)
    epochs, _ = finder.process(batch, ours, samples, stamps)
    return epochs


class _RunSamples:
    """The messages of a topic in a run, read batch by batch."""

    def __init__(self, reader: RecordingReader, topic: str, namespace: str, run: RunData) -> None:
        self._reader, self._topic, self._run = reader, topic, run
        type_name = reader.topics()[topic].type_name
        self._hints = column_hints(namespace).get((topic, type_name), ColumnHints())
        self._forms: list[TopicColumns] = []
        # Messages with the same columns: these, their times [ns] and their values.
        self._parts: list[tuple[TopicColumns, NDArray[np.int64], Floats]] = []

    def add(self, batch: Batch, rows: Rows, epochs: NDArray[np.intp]) -> None:
        """Read the messages of a batch that are in the run."""
        recorded = self._run.recorded
        last_ns = recorded.start_ns + round(self._run.end * SECOND_NS)
        for some, messages in self._reader.records(self._topic, batch, rows):
            columns = self._columns(self._reader.decode(batch.message(some[0])))
            signals = _signals(columns)
            values = np.empty((len(some), len(signals)))
            for number, column in enumerate(signals):
                values[:, number] = column.read(messages)
            times = batch.log_ns[some]
            if columns.has_header:
                stamps = batch.stamps_ns(some)
                is_in_time = (stamps >= recorded.start_ns) & (stamps <= last_ns)
                times = np.where(is_in_time, stamps, times)
            kept = (times >= recorded.start_ns) & (times < recorded.end_ns)
            kept &= epochs[some] == recorded.epoch
            if kept.any():
                self._parts.append((columns, times[kept], values[kept]))

    def _columns(self, message: object) -> TopicColumns:
        """Return the columns that fit a message."""
        for columns in reversed(self._forms):
            if columns.fits(message):
                return columns
        self._forms.append(TopicColumns(message, self._hints))
        return self._forms[-1]

    def joined(self) -> TopicSamples:
        """Return all samples."""
        if not self._parts:
            return TopicSamples(np.zeros(0), {})
        forms, times, values = zip(*self._parts, strict=True)
        if any(other is not forms[0] for other in forms):
            raise RecordingError(
                f'{self._reader.path}: {self._topic}: the names or the number of its elements '
                'change during the run'
            )
        stamps = np.concatenate(times)
        order = np.argsort(stamps, kind='stable')
        table = np.concatenate(values)[order]
        return TopicSamples(
            (stamps[order] - self._run.recorded.start_ns) / SECOND_NS,
            {column.name: table[:, number] for number, column in enumerate(_signals(forms[0]))},
        )


def _signals(columns: TopicColumns) -> list[Column]:
    """Return the columns with numbers other than the messages' own stamps."""
    return [each for each in columns.columns if each.kind is not str and each.name != OWN_STAMP]
