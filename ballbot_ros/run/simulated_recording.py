"""The recording of a run without a graph: the messages that its nodes would have published."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.controllers.interface import Program
from ballbot_ros.engine.closed_loop import Tick
from ballbot_ros.engine.compiled_loop import TickColumns
from ballbot_ros.lockstep.run_actions import RunSummary
from ballbot_ros.parameters import ParameterSet, PlantParameters
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.run_columns import RunColumns, SendAll
from ballbot_ros.recording.messages.run_messages import RunMessages, Send
from ballbot_ros.recording.messages.topics import (
    GYRO_IMU,
    JOINT_STATES,
    PLANT_IMU,
    PLANT_ODOM,
    Topic,
)
from ballbot_ros.recording.rosbag2 import OUTCOME_KEYS, RecordedTopic, media_type
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.plant.ground_truth import Push
from ballbot_ros.robot.world.world import World
from ballbot_ros.viewer.derived_messages import PERIOD_NS, DerivedChannels, DerivedMessages

_SOURCES = (PLANT_IMU, PLANT_ODOM, GYRO_IMU, JOINT_STATES)
"""From their messages at a tick others are derived, in the order in which they are sent."""


class _NewTopic:
    """A topic that is added to the recording before its first message."""

    def __init__(self, name: str, type_name: str, settings: Mapping[str, Any]) -> None:
        self.name, self.type_name, self.settings = name, type_name, settings
        self.count = 0
        self.recorded: RecordedTopic | None = None


class _MessageBuffer:
    """Messages that have not been written; in each tick, they are in the order of :meth:`add`.

    For those who write, it is like a :class:`RecordingWriter`.
    """

    def __init__(self, writer: RecordingWriter) -> None:
        self._writer = writer
        self._topics: list[_NewTopic] = []
        self._stamps: list[int] = []
        self._messages: list[bytes] = []

    def add_topic(self, name: str, type_name: str, **settings: Any) -> _NewTopic:
        """As in :class:`RecordingWriter`."""
        return _NewTopic(name, type_name, settings)

    def write(self, topic: _NewTopic, stamp_ns: int, data: bytes, sequence: int) -> None:
        """As in :class:`RecordingWriter`."""
        self.add(topic, (stamp_ns,), (data,))

    def add(self, topic: _NewTopic, stamps: Sequence[int], messages: Sequence[bytes]) -> None:
        """Add messages of a topic."""
        topic.count += len(stamps)
        self._topics += [topic] * len(stamps)
        self._stamps += stamps
        self._messages += messages

    @property
    def newest_ns(self) -> int:
        """The stamp of the last message."""
        return self._stamps[-1]

    def sort(self) -> None:
        """Put the messages into the order of their stamps."""
        order = np.argsort(self._stamps, kind='stable').tolist()
        self._topics = [self._topics[each] for each in order]
        self._stamps = [self._stamps[each] for each in order]
        self._messages = [self._messages[each] for each in order]

    def write_out(self, until_ns: float = math.inf) -> None:
        """Write the messages up to a stamp."""
        end = len(self._stamps)
        if until_ns < math.inf:
            end = int(np.searchsorted(self._stamps, until_ns, side='right'))
        topics, begin = self._topics[:end], 0
        for topic in dict.fromkeys(topics):
            if topic.recorded is None:
                at = topics.index(topic)
                self._write(begin, at)
                begin = at
                topic.recorded = self._writer.add_topic(
                    topic.name, topic.type_name, **topic.settings
                )
        self._write(begin, end)
        del self._topics[:end], self._stamps[:end], self._messages[:end]

    def _write(self, begin: int, end: int) -> None:
        topics = [cast(RecordedTopic, each.recorded) for each in self._topics[begin:end]]
        stamps = np.array(self._stamps[begin:end], np.int64)
        self._writer.write_all(topics, stamps, self._messages[begin:end])


class SimulatedRecording:
    """Writes the messages that the nodes would have published, and those derived from them."""

    def __init__(
        self, path: Path, attachments: Mapping[str, bytes], parameters: ParameterSet
    ) -> None:
        self._writer = RecordingWriter(path)
        for name, data in attachments.items():
            self._writer.add_attachment(name, media_type(name), data)
        self._buffer = _MessageBuffer(self._writer)
        self._derived = DerivedChannels(self._buffer, parameters.of(PlantParameters))
        # Cached, because plant and controller share the topic of the duties.
        self._topic = cache(lambda topic: self._buffer.add_topic(topic.resolved(), topic.type_name))
        self._messages = RunMessages(cache(self._make_send), parameters)
        self._columns = RunColumns(self._messages, cache(self._make_send_all), parameters)
        self._sources: dict[Topic, Sequence[bytes]] = {}
        self.plant = self._messages.plant
        self._flushed_ns = self._begun_ns = 0

    def _make_send(self, topic: Topic) -> Send:
        added, add = self._topic(topic), self._buffer.add

        def send(stamp_ns: int, data: bytes) -> None:
            add(added, (stamp_ns,), (data,))

        def send_source(stamp_ns: int, data: bytes) -> None:
            send(stamp_ns, data)
            self._derived.add(topic, stamp_ns, data)

        return send_source if topic in DerivedMessages.INPUTS else send

    def _make_send_all(self, topic: Topic) -> SendAll:
        added = self._topic(topic)

        def send_all(stamps: Sequence[int], messages: Sequence[bytes]) -> None:
            self._buffer.add(added, stamps, messages)
            self._sources[topic] = messages
            if topic == _SOURCES[-1]:
                self._derive(stamps)

        return send_all

    def _derive(self, stamps: Sequence[int]) -> None:
        """Derive messages, only where they are due: between, they need the gyro alone."""
        for number, stamp_ns in enumerate(stamps):
            is_due = stamp_ns % PERIOD_NS == 0 or stamp_ns == self._begun_ns
            for topic in _SOURCES if is_due else (GYRO_IMU,):
                self._derived.add(topic, stamp_ns, self._sources[topic][number])

    def begin(self, start_ns: int, world: World | None, pushes: Iterable[Push]) -> None:
        """Write the messages at the start of a run."""
        self._messages.begin(start_ns, world, pushes)
        self._buffer.write_out()  # the stamps of pushes are later than those of the first ticks
        self._flushed_ns = self._begun_ns = start_ns

    def add(self, tick: Tick, program: Program) -> None:
        """Write the messages of a tick."""
        self._messages.tick(tick, program)
        self._flush(tick.truth.stamp_ns)

    def add_all(self, ticks: TickColumns, program: ControlProgram) -> None:
        """Write the messages of many ticks."""
        self._columns.ticks(ticks, program)
        self._buffer.sort()
        self._flush(self._buffer.newest_ns)

    def _flush(self, now_ns: int) -> None:
        while now_ns - self._flushed_ns >= SECOND_NS:
            self._flushed_ns += SECOND_NS
            self._buffer.write_out(self._flushed_ns)
            self._writer.flush()

    def close(self, summary: RunSummary) -> None:
        """Write how the run ended, and finish the file."""
        self._buffer.write_out()
        self._writer.add_outcome({key: str(getattr(summary, key)) for key in OUTCOME_KEYS})
        self._writer.close()
