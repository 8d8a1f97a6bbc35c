"""The recording of a run without a graph: the messages that its nodes would have published."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, cast

import numpy as np

from ballbot_ros.analysis.collection import MessageCollector
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.controllers.interface import Program
from ballbot_ros.engine.closed_loop import Tick
from ballbot_ros.engine.compiled_loop import TickColumns
from ballbot_ros.lockstep.run_actions import RunSummary
from ballbot_ros.parameters import ParameterSet, PlantParameters
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.raw import Messages, Stamps
from ballbot_ros.recording.messages.run_columns import RunColumns, SendAll
from ballbot_ros.recording.messages.run_messages import RunMessages, Send
from ballbot_ros.recording.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    BLUETOOTH_TX,
    CLOCK,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    LCD,
    MAP,
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    RUN,
    SONAR_RANGE,
    SOUND,
    WALL_HIT,
    Topic,
)
from ballbot_ros.recording.rosbag2 import OUTCOME_KEYS, RecordedTopic, media_type
from ballbot_ros.recording.writer import RecordedMessages, RecordingWriter
from ballbot_ros.robot.plant.ground_truth import Push
from ballbot_ros.robot.world.world import World
from ballbot_ros.viewer.derived_messages import DerivedChannels, DerivedMessages, RobotTicks

_ORDER = (
    RUN, MAP, CLOCK, BATTERY_STATE, PLANT_IMU, PLANT_JOINT_STATES, PLANT_ODOM, WALL_HIT,
    ACCEPTED_PUSH, GYRO_IMU, JOINT_STATES, *DerivedMessages.OUTPUTS, SONAR_RANGE, GAMEPAD_JOY,
    OPERATING_STATE, BLUETOOTH_TX, SOUND, LCD, MOTOR_DUTY, CONTROLLER_STATE,
)  # fmt: skip
"""The order of the messages of a tick."""

_END_NS = 2**63 - 1

_Block = tuple[Stamps, Messages]
"""Stamps [ns] and messages of equal length, which follow each other in a topic."""


class _BufferedTopic:
    """A topic, which is added to the recording before its first message, and what is not written.

    Attributes
    ----------
    count : int
        Number of messages that were added one by one.
    """

    def __init__(self, topic: Topic) -> None:
        self.topic = topic
        self.settings: Mapping[str, Any] = {}
        self.recorded: RecordedTopic | None = None
        self.count = 0
        self._blocks: list[_Block] = []
        self._new_blocks: list[_Block] = []
        self._stamps: list[int] = []
        self._messages: list[bytes] = []

    def add(self, stamp_ns: int, message: bytes) -> None:
        """Add a message."""
        self.count += 1
        self._stamps.append(stamp_ns)
        self._messages.append(message)

    def add_all(self, stamps: Stamps, messages: Messages) -> None:
        """Add messages of equal length."""
        if len(stamps):
            self._new_blocks.append((stamps, messages))

    def gather(self) -> Sequence[_Block]:
        """Prepare messages for :meth:`take`; return the new ones."""
        stamps = iter(self._stamps)
        for length, group in groupby(self._messages, len):
            data = np.frombuffer(b''.join(group), f'V{length}')
            self._new_blocks.append((np.fromiter(stamps, np.int64, len(data)), data))
        blocks, self._new_blocks = self._new_blocks, []
        self._stamps, self._messages = [], []
        self._blocks += blocks
        return blocks

    @property
    def due_ns(self) -> int:
        """The stamp before which the recording must have the topic [ns]."""
        return _END_NS if self.recorded or not self._blocks else int(self._blocks[0][0][0])

    def add_to(self, writer: RecordingWriter) -> None:
        """Add the topic to a recording."""
        name, type_name = self.topic.resolved(), self.topic.type_name
        self.recorded = writer.add_topic(name, type_name, **self.settings)

    def take(self, until_ns: int, *, inclusive: bool) -> Iterator[RecordedMessages]:
        """Take the messages up to a stamp."""
        blocks, self._blocks = self._blocks, []
        for stamps, data in blocks:
            end = int(np.searchsorted(stamps, until_ns, 'right' if inclusive else 'left'))
            if end:
                yield cast(RecordedTopic, self.recorded), stamps[:end], data[:end]
            if end < len(stamps):
                self._blocks.append((stamps[end:], data[end:]))


class _MessageBuffer:
    """Messages that have not been written.

    For those who write, it is like a :class:`RecordingWriter`.
    """

    def __init__(self, writer: RecordingWriter, collector: MessageCollector | None) -> None:
        self._writer, self._collector = writer, collector
        self._topics = {topic.resolved(): _BufferedTopic(topic) for topic in _ORDER}

    def topic(self, topic: Topic) -> _BufferedTopic:
        """Return a topic of the recording."""
        return self._topics.setdefault(topic.resolved(), _BufferedTopic(topic))

    def add_topic(self, name: str, type_name: str, **settings: Any) -> _BufferedTopic:
        """As in :class:`RecordingWriter`."""
        topic = self._topics[name]
        topic.settings = settings
        return topic

    def write(self, topic: _BufferedTopic, stamp_ns: int, data: bytes, sequence: int) -> None:
        """As in :class:`RecordingWriter`."""
        topic.add(stamp_ns, data)

    @property
    def names(self) -> list[str]:
        """The names of the recorded topics, in the order of their channels."""
        recorded = (each.recorded for each in self._topics.values() if each.recorded)
        return [each.name for each in sorted(recorded, key=lambda each: each.channel)]

    def gather(self) -> None:
        """Prepare the messages for :meth:`write_out`."""
        for topic in self._topics.values():
            for block in topic.gather():
                if self._collector:
                    self._collector.add(topic.topic, *block)

    def write_out(self, until_ns: int = _END_NS) -> None:
        """Write the messages up to a stamp, of those that :meth:`gather` has prepared."""
        topics = list(self._topics.values())
        for due_ns, number in sorted((each.due_ns, i) for i, each in enumerate(topics)):
            if due_ns > until_ns or due_ns == _END_NS:
                break
            self._write(due_ns, number)
            topics[number].add_to(self._writer)
        self._write(until_ns, len(topics))

    def _write(self, until_ns: int, number: int) -> None:
        """Write the messages before those of a topic at a stamp."""
        self._writer.write_all(
            part
            for i, topic in enumerate(self._topics.values())
            for part in topic.take(until_ns, inclusive=i < number)
        )


class SimulatedRecording:
    """Writes the messages that the nodes would have published, and those derived from them.

    Parameters
    ----------
    path : Path
        The file to create.
    attachments : mapping of str to bytes
        By file name.
    collector : MessageCollector or None
        Gets all messages, too.
    """

    def __init__(
        self,
        path: Path,
        attachments: Mapping[str, bytes],
        parameters: ParameterSet,
        collector: MessageCollector | None = None,
    ) -> None:
        self._writer = RecordingWriter(path)
        for name, data in attachments.items():
            self._writer.add_attachment(name, media_type(name), data)
        self._buffer = _MessageBuffer(self._writer, collector)
        self._derived = DerivedChannels(self._buffer, parameters.of(PlantParameters))
        self._messages = RunMessages(self._make_send, parameters)
        self._columns = RunColumns(self._messages, cache(self._make_send_all), parameters)
        self._ticks: list[Tick] = []
        self.plant = self._messages.plant
        self._flushed_ns = 0

    def _make_send(self, topic: Topic) -> Send:
        add = self._buffer.topic(topic).add

        def send_source(stamp_ns: int, data: bytes) -> None:
            add(stamp_ns, data)
            self._derived.add(topic, stamp_ns, data)

        return send_source if topic in (RUN, MAP) else add

    def _make_send_all(self, topic: Topic) -> SendAll:
        buffered = self._buffer.topic(topic)

        def send_all(stamps: Stamps, messages: Messages | Sequence[bytes]) -> None:
            if isinstance(messages, np.ndarray):
                buffered.add_all(stamps, messages)
                return
            for stamp_ns, message in zip(stamps.tolist(), messages, strict=True):
                buffered.add(stamp_ns, message)

        return send_all

    def begin(self, start_ns: int, world: World | None, pushes: Iterable[Push]) -> None:
        """Write the messages at the start of a run."""
        self._messages.begin(start_ns, world, ())
        self._buffer.gather()
        self._buffer.write_out()
        for number, push in enumerate(pushes, 1):  # they are announced in advance, in their order
            self.plant.push(push, number)
            self._buffer.gather()
            self._buffer.write_out()
        self._flushed_ns = start_ns

    def add(self, tick: Tick, program: Program) -> None:
        """Write the messages of a tick."""
        self._messages.tick(tick, program)
        self._ticks.append(tick)
        if tick.truth.stamp_ns - self._flushed_ns >= SECOND_NS:
            self._gather()
            self._flush(tick.truth.stamp_ns)

    def add_all(self, ticks: TickColumns, program: ControlProgram) -> None:
        """Write the messages of many ticks."""
        self._columns.ticks(ticks, program)
        truth, inputs = ticks.truth, ticks.inputs
        stamps = np.asarray(truth.stamp_ns)
        self._derived.add_ticks(
            RobotTicks(
                stamps,
                np.array(truth.position),
                np.array(truth.psi),
                np.column_stack([inputs.gyro_x, inputs.gyro_y]),
                np.column_stack([inputs.revolution_x, inputs.revolution_y]),
            )
        )
        self._gather()
        self._flush(int(stamps[-1]))

    def _gather(self) -> None:
        """Derive messages from the ticks that came one by one, and prepare all for writing."""
        ticks, self._ticks = self._ticks, []
        if ticks:
            self._derived.add_ticks(
                RobotTicks(
                    np.array([each.truth.stamp_ns for each in ticks]),
                    np.array([each.truth.position for each in ticks]).T,
                    np.array([each.truth.psi for each in ticks]).T,
                    np.array([each.inputs.gyro for each in ticks]),
                    np.array([each.inputs.revolutions for each in ticks]),
                )
            )
        self._buffer.gather()

    def _flush(self, now_ns: int) -> None:
        while now_ns - self._flushed_ns >= SECOND_NS:
            self._flushed_ns += SECOND_NS
            self._buffer.write_out(self._flushed_ns)
            self._writer.flush()

    def close(self, summary: RunSummary) -> None:
        """Write how the run ended, and finish the file."""
        self._gather()
        self._buffer.write_out()
        self._writer.add_outcome(outcome_of(summary))
        self._writer.close()

    @property
    def topic_names(self) -> list[str]:
        """The names of the recorded topics, in the order of the file."""
        return self._buffer.names


def outcome_of(summary: RunSummary) -> dict[str, str]:
    """Return how a run ended, as it is recorded."""
    return {key: str(getattr(summary, key)) for key in OUTCOME_KEYS}
