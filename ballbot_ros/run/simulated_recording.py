"""The recording of a run without a graph: the messages that its nodes would have published."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any, cast

import numpy as np

from ballbot_ros.controllers.interface import Program
from ballbot_ros.engine.closed_loop import Tick
from ballbot_ros.engine.compiled_loop import TickColumns
from ballbot_ros.lockstep.run_actions import RunSummary
from ballbot_ros.parameters import ParameterSet, PlantParameters
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.raw import Messages, Stamps
from ballbot_ros.recording.messages.run_messages import RunColumns, RunMessages, Send
from ballbot_ros.recording.messages.topics import JOINT_STATES, MAP, RUN, TOPICS, Topic
from ballbot_ros.recording.rosbag2 import OUTCOME_KEYS, RecordedTopic, media_type
from ballbot_ros.recording.writer import RecordedMessages, RecordingWriter
from ballbot_ros.robot.plant.ground_truth import Push
from ballbot_ros.robot.world.world import World
from ballbot_ros.viewer.derived_messages import DerivedMessages, offered_qos

_DERIVED_AT = TOPICS.index(JOINT_STATES) + 1
"""The messages derived at a tick follow those of the sensors."""

_END_NS = 2**63 - 1

Collect = Callable[[Topic, Stamps, Messages], None]
"""Takes messages of a topic that have the same length, and their stamps [ns]."""


class _BufferedTopic:
    """A topic, which is added to the recording before its first message, and what is not written.

    `stamps` and `messages` are those that came one by one since the last :meth:`gather`.
    """

    def __init__(self, topic: Topic, collect: Collect | None) -> None:
        self._topic, self._collect = topic, collect
        self._recorded: RecordedTopic | None = None
        self._blocks: list[tuple[Stamps, Messages]] = []
        self.stamps: list[int] = []
        self.messages: list[bytes] = []

    def add(self, stamp_ns: int, message: bytes) -> None:
        """Add a message."""
        self.stamps.append(stamp_ns)
        self.messages.append(message)

    def add_all(self, stamps: Stamps, messages: Messages) -> None:
        """Add messages of the same length."""
        if len(stamps):
            self._blocks.append((stamps, messages))
            if self._collect:
                self._collect(self._topic, stamps, messages)

    def gather(self) -> None:
        """Prepare the messages that came one by one for :meth:`take`."""
        stamps = iter(self.stamps)
        for length, group in groupby(self.messages, len):
            data = np.frombuffer(b''.join(group), f'V{length}')
            self.add_all(np.fromiter(stamps, np.int64, len(data)), data)
        self.stamps, self.messages = [], []

    @property
    def due_ns(self) -> int:
        """The stamp before which the topic must be added to the recording [ns]."""
        return _END_NS if self._recorded or not self._blocks else int(self._blocks[0][0][0])

    def add_to(self, writer: RecordingWriter) -> str:
        """Add the topic to a recording; return its name."""
        name, settings = self._topic.resolved(), dict[str, Any]()
        if self._topic in DerivedMessages.OUTPUTS:
            settings = {'qos': (offered_qos(self._topic),), 'derived': True}
        self._recorded = writer.add_topic(name, self._topic.type_name, **settings)
        return name

    def take(self, until_ns: int, *, inclusive: bool) -> Iterator[RecordedMessages]:
        """Take the messages up to a stamp."""
        blocks, self._blocks = self._blocks, []
        for stamps, data in blocks:
            end = int(np.searchsorted(stamps, until_ns, 'right' if inclusive else 'left'))
            if end:
                yield cast(RecordedTopic, self._recorded), stamps[:end], data[:end]
            if end < len(stamps):
                self._blocks.append((stamps[end:], data[end:]))


class SimulatedRecording:
    """Writes the messages that the nodes would have published, and those derived from them.

    `collect` takes all messages, too. `names` are the topics in the order of the file.
    """

    def __init__(
        self,
        path: Path,
        attachments: Mapping[str, bytes],
        parameters: ParameterSet,
        collect: Collect | None = None,
    ) -> None:
        self.names: list[str] = []
        self._writer = RecordingWriter(path)
        for name, data in attachments.items():
            self._writer.add_attachment(name, media_type(name), data)
        order = (*TOPICS[:_DERIVED_AT], *DerivedMessages.OUTPUTS, *TOPICS[_DERIVED_AT:])
        topics = self._topics = {topic: _BufferedTopic(topic, collect) for topic in order}

        def make(topic: Topic) -> Send:
            return topics[topic].add

        self._derived = DerivedMessages(make, parameters.of(PlantParameters))
        self._messages = RunMessages(make, parameters)
        self._columns = RunColumns(
            self._messages, make, lambda topic: topics[topic].add_all, parameters
        )
        self._ticks: list[tuple[Any, ...]] = []  # from which messages will be derived
        self.plant, self.controller = self._messages.plant, self._messages.controller
        self._flushed_ns = 0

    def begin(self, start_ns: int, world: World | None, pushes: Iterable[Push]) -> None:
        """Write the messages at the start of a run."""
        self._messages.begin(start_ns, world, ())
        for topic in (RUN, MAP):
            buffered = self._topics[topic]
            for stamp_ns, message in zip(buffered.stamps, buffered.messages, strict=True):
                self._derived.add(topic, stamp_ns, message)
        self._write_out()
        for number, push in enumerate(pushes, 1):
            self.plant.push(push, number)
            self._write_out()  # in advance, whatever their stamps
        self._flushed_ns = start_ns

    def add(self, tick: Tick, program: Program) -> None:
        """Write the messages of a tick."""
        truth, inputs = tick.truth, tick.inputs
        self._messages.tick(tick, program)
        self._ticks.append(
            (truth.stamp_ns, truth.position, truth.psi, inputs.gyro, inputs.revolutions)
        )
        self._flush(truth.stamp_ns)

    def add_all(self, ticks: TickColumns, program: Program) -> None:
        """Write the messages of many ticks."""
        truth, inputs, stamps = ticks.truth, ticks.inputs, np.asarray(ticks.truth.stamp_ns)
        self._columns.ticks(ticks, program)
        gyro = inputs.gyro_x, inputs.gyro_y
        encoders = inputs.revolution_x, inputs.revolution_y
        pairs: Any = truth.position, truth.psi, gyro, encoders
        self._derived.send_ticks(stamps, *map(np.column_stack, pairs))
        self._flush(int(stamps[-1]))

    def _flush(self, now_ns: int) -> None:
        while now_ns - self._flushed_ns >= SECOND_NS:
            self._flushed_ns += SECOND_NS
            self._write_out(self._flushed_ns)
            self._writer.flush()

    def _write_out(self, until_ns: int = _END_NS) -> None:
        """Write the messages up to a stamp."""
        if self._ticks:
            self._derived.send_ticks(*map(np.array, zip(*self._ticks, strict=True)))
            self._ticks = []
        topics = list(self._topics.values())
        for topic in topics:
            topic.gather()
        for due_ns, number in sorted((each.due_ns, i) for i, each in enumerate(topics)):
            if due_ns > until_ns or due_ns == _END_NS:
                break
            self._write(due_ns, number)
            self.names.append(topics[number].add_to(self._writer))
        self._write(until_ns, len(topics))

    def _write(self, until_ns: int, number: int) -> None:
        """Write the messages before those of a topic at a stamp."""
        self._writer.write_all(
            part
            for i, topic in enumerate(self._topics.values())
            for part in topic.take(until_ns, inclusive=i < number)
        )

    def close(self, summary: RunSummary) -> None:
        """Write how the run ended, and finish the file."""
        self._write_out()
        self._writer.add_outcome({key: str(getattr(summary, key)) for key in OUTCOME_KEYS})
        self._writer.close()
