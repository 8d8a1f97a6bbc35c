"""Records every topic of the graph, and acknowledges complete ticks to the plant."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from ballbot_ros.errors import RecordingError
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import Objection
from ballbot_ros.lockstep.recording_order import Arrival, ArrivalOrder, Stream
from ballbot_ros.lockstep.run_recording import RunRecording
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.endpoints import (
    Inbox,
    drain,
    hidden_node,
    intra_process,
    raw_subscription,
    reliable_qos,
)
from ballbot_ros.nodes.participation import Participation, full_name
from ballbot_ros.parameters import PLANT, PlantParameters, RecorderParameters
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages import topics
from ballbot_ros.recording.messages.conversions import encode_header, is_stop
from ballbot_ros.recording.messages.raw import decoder, has_stamp, same_content, stamp_of
from ballbot_ros.recording.messages.run_reports import decode_run_status
from ballbot_ros.recording.messages.topics import Topic, find_message_class
from ballbot_ros.recording.rosbag2 import RELIABLE_LATCHED, QosProfile
from ballbot_ros.recording.writer import RUN_PARTICIPANTS, RecordingWriter
from ballbot_ros.viewer.derived_messages import DerivedChannels, DerivedMessages


class RecordedChannel:
    """A topic being recorded.

    Attributes
    ----------
    topic_names : list of str
        The topics that are read: the topic itself and its history, if it has one.
    is_stamped : bool
        Whether its stamps count. Those of a topic open to any tool may be of other clocks.
    is_source : bool
        Whether messages are derived from it.
    recorded : object
        The topic in the file; None before its first message.
    """

    def __init__(
        self, topic: Topic, subscription: Subscription | Inbox, history: Subscription | None
    ) -> None:
        self.topic = topic
        self._subscription, self._history = subscription, history
        self._reads_history = False
        self.topic_names = [each.topic_name for each in (subscription, history) if each]
        self.recorded: Any = None
        self.is_source = topic in DerivedMessages.INPUTS
        self.is_stamped = topic.publisher is not None and has_stamp(topic.type_name)
        self.stream = Stream(
            subscription.topic_name,
            period_ns=topic.period_ns,
            is_clock=topic is topics.CLOCK,
            is_live=topic.publisher in (PLANT, None),
            is_shared=topic.publisher is None,
            is_same=same_content(topic.type_name) if topic.period_ns else None,
        )

    def begin(self) -> None:
        """Begin a run: the topic may have another publisher, without a history."""
        self._reads_history = False

    def take(self) -> Iterator[Arrival[Item]]:
        """Read all waiting messages, from the topic's history if it has one.

        The history is discovered before the topic itself, so no message arrives before its history
        is known. A history found once is read even after its publisher has left, since messages may
        still be waiting.
        """
        come = list(drain(self._subscription))
        if self._history:
            self._reads_history = self._reads_history or self._history.get_publisher_count() > 0
            if self._reads_history:
                come.clear()
            come += drain(self._history)
        for data, info in come:
            item = (self, data, info['publication_sequence_number'])
            yield info['received_timestamp'], item


Item = tuple[RecordedChannel, bytes, int]
"""The channel of a message, the message, and its sequence number."""


class RecordedChannels:
    """The channels of a recorder, by the names of their topics."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._inbox = hidden_node('inbox', node)
        self._channels: dict[str, RecordedChannel] = {}
        self._sighted: set[str] = set()
        # The session only concerns its page.
        ignored = (*topics.UNRECORDED, topics.SESSION)
        self._ignored = {node.resolve_topic_name(topic.name) for topic in ignored}
        for topic in topics.TOPICS:
            if topic in topics.UNRECORDED:
                continue
            # Earlier messages come from the topic's history, if it has one. Subscribe to the topic
            # itself, too: publishers of other packages need not have a history.
            latched = topic.latched_depth > 0 and not topic.has_history
            self._subscribe(topic, reliable_qos(topics.HISTORY, latched=latched))

    def _subscribe(self, topic: Topic, qos: QoSProfile) -> None:
        if within := intra_process(topic):
            inbox = within.inbox(self._node.resolve_topic_name(topic.name))
            self._channels[inbox.topic_name] = RecordedChannel(topic, inbox, None)
            self._ignored.add(self._node.resolve_topic_name(topic.history.name))
            return
        subscription = raw_subscription(self._inbox, topic, qos)
        history = None
        if topic.has_history:
            qos = reliable_qos(topics.HISTORY, latched=True)
            history = raw_subscription(self._inbox, topic.history, qos)
            self._ignored.add(history.topic_name)
        self._channels[subscription.topic_name] = RecordedChannel(topic, subscription, history)

    def __iter__(self) -> Iterator[RecordedChannel]:
        return iter(self._channels.values())

    def __getitem__(self, name: str) -> RecordedChannel:
        return self._channels[name]

    def take(self) -> dict[str, Iterator[Arrival[Item]]]:
        """Return the iterators that read the waiting messages of each topic."""
        return {name: channel.take() for name, channel in self._channels.items()}

    def is_published(self, name: str) -> bool:
        """Return whether a topic has a publisher, and its type is installed."""
        return name not in self._ignored and self._node.count_publishers(name) > 0

    def offered_qos(self, name: str) -> list[QosProfile]:
        """Return the QoS of a topic's publishers."""
        offers = self._node.get_publishers_info_by_topic(name)
        return [QosProfile.from_rclpy(each.qos_profile) for each in offers] or [RELIABLE_LATCHED]

    def discover(self) -> None:
        """Subscribe to the topics of the graph that are not recorded yet."""
        for name, _ in self._node.get_topic_names_and_types():
            if name in self._channels or name in self._ignored:
                continue
            offers = self._node.get_publishers_info_by_topic(name)
            # Discovery may find a publisher before its node: check once more.
            if name not in self._sighted and not all(map(full_name, offers)):
                self._sighted.add(name)
                continue
            if not offers:
                continue
            topic = Topic(name, offers[0].topic_type, None)
            if find_message_class(topic.type_name) is None:
                self._ignored.add(name)
                self._node.get_logger().warning(
                    f'{name}: type {topic.type_name} not found: not recorded'
                )
                continue
            qos = QoSProfile(
                depth=topics.HISTORY,
                # The weakest QoS on offer, which matches all publishers.
                reliability=max(offer.qos_profile.reliability for offer in offers),
                durability=max(offer.qos_profile.durability for offer in offers),
            )
            try:
                self._subscribe(topic, qos)
            except RuntimeError:
                # It succeeds at a later look if the other node adapts, as that of ``cmd_vel`` does.
                self._node.get_logger().warning(
                    f'{name}: not recorded yet: another node of this process reads it with a type '
                    f'other than {topic.type_name}',
                    once=True,
                )

    def close(self) -> None:
        """Remove the subscriptions."""
        self._inbox.destroy_node()


POLL_S = 10e-3
FLUSH_PERIOD_S = 0.5
DISCOVERY_S = 1.0
END_S = 1.0
"""How long to wait for the end of a run that is stopped together with the recorder."""


class Recorder(BallbotNode[RecorderParameters]):
    """Writes messages as they arrive, and acknowledges complete ticks.

    It reads the messages in batches without the executor. That takes a fifth of the time of
    callbacks, and gives access to the publishers' sequence numbers, which reveal lost messages. The
    publishers' histories and the plant's bounded lead keep everything until it is read.
    """

    def __init__(self, parameters: RecorderParameters | None = None) -> None:
        super().__init__(RecorderParameters, parameters)
        new = f'runs/{datetime.now():%Y-%m-%d_%H-%M-%S}/ballbot.mcap'
        path = Path(self.parameters.output or new)
        self._writer = RecordingWriter.with_attachments(path, self.parameters.attachments)
        self._channels = RecordedChannels(self)
        self._derived = DerivedChannels(
            self._writer,
            PlantParameters(),
            name_of=lambda topic: self.resolve_topic_name(topic.name),
            is_published=self._channels.is_published,
        )
        self._recording = RunRecording(
            self, lambda: ((each.topic.name, each.stream) for each in self._channels)
        )
        self._order: ArrivalOrder[Item] = ArrivalOrder()
        self._lost = 0
        self._decode_run = decoder(topics.RUN.type_name)
        self._ack = self.output(topics.RECORDER_ACK)
        self._participation = Participation(self, self._on_run, self._repeat_ack)
        self.get_logger().info(f'records to {path}')
        self.create_wall_timer(POLL_S, self._poll)
        self.create_wall_timer(FLUSH_PERIOD_S, self._flush)
        self.create_wall_timer(DISCOVERY_S, self._channels.discover)

    def _poll(self) -> None:
        """Write the messages that have arrived, in order of arrival, and acknowledge them."""
        self._write_until(time.time_ns())
        self._acknowledge()

    def _acknowledge(self) -> None:
        if not self.exit_status and self._recording.ticks.advance():
            self._send_ack()

    def _write_until(self, received_ns: float) -> None:
        if self.exit_status:
            return
        if self._recording.run is None:
            self._recording.gate.awaits_run = self.count_publishers(topics.RUN.name) > 0
        try:
            for channel, data, sequence in self._order.merge(self._channels.take(), received_ns):
                self._take(channel, data, sequence)
        except RecordingError as error:
            self._fail(error)

    def _take(self, channel: RecordedChannel, data: bytes, sequence: int) -> None:
        try:
            stamp_ns = stamp_of(data) if channel.is_stamped else 0
            if channel.topic is topics.RUN and not self._recording.announces(
                RunIdentity(self._decode_run(data).frame_id, stamp_ns)
            ):
                return
        except ValueError as error:
            self.warn_malformed(channel.topic, error)
            return
        if channel.topic is topics.RUN_STATUS:
            self._note_status(data)
        elif channel.topic is topics.MOTOR_DUTY and is_stop(data):
            self._recording.hold_stop(channel.stream, stamp_ns, data, sequence)
            return
        self._recording.gate.take(channel.stream, stamp_ns, data, sequence)

    def _repeat_ack(self) -> None:
        """Send the acknowledgement again: the plant may only now have discovered this node."""
        if self._recording.ticks.acked_ns:
            self._send_ack()

    def _send_ack(self) -> None:
        self._ack.publish(encode_header(self._recording.ticks.acked_ns))

    def _on_run(self, run: RunIdentity) -> None:
        # Without an acknowledgement, which the plant of this run would take for its own, and
        # without holding anything back: what has arrived was sent before this run.
        self._write_until(math.inf)
        for channel in self._channels:
            channel.begin()
        try:
            self._recording.join(run)
        except RecordingError as error:
            self._fail(error)

    def keep(self, stream: Stream, log_ns: int, data: bytes, sequence: int) -> None:
        """Write a message."""
        channel = self._channels[stream.name]
        if channel.recorded is None:
            # The file has the QoS of the publishers, too.
            channel.recorded = self._writer.add_topic(
                stream.name, channel.topic.type_name, qos=self._channels.offered_qos(stream.name)
            )
        self._writer.write(channel.recorded, log_ns, data, sequence)
        if channel.is_source:
            self._derived.add(channel.topic, log_ns, data)
        if stream.period_ns:
            self.count_sample(self._recording.gate.now_ns)

    def raise_objection(self, stream: Stream, stamp_ns: int) -> None:
        """Object to a sample that can't belong to the plant's run."""
        topic = self._channels[stream.name].topic
        self._participation.raise_objection(Objection.to_sample(topic.name, stamp_ns))

    def report_loss(self, stream: Stream, sequence: int) -> None:
        """Count and report lost messages."""
        self._lost += 1
        self.warn(f'{stream.name}: messages before sequence number {sequence} were lost')

    def has_several_publishers(self, stream: Stream) -> bool:
        """Return whether a topic, or its history, has more than one publisher."""
        names = self._channels[stream.name].topic_names
        return any(self.count_publishers(name) > 1 for name in names)

    def _note_status(self, data: bytes) -> None:
        """Note from the plant's status what the run requires, and how it ended."""
        try:
            self._recording.note_status(decode_run_status(data))
        except ValueError as error:
            self.warn_malformed(topics.RUN_STATUS, error)

    def _flush(self) -> None:
        if self.finished:
            return
        try:
            self._writer.flush()
        except RecordingError as error:
            self._fail(error)

    def _fail(self, error: RecordingError) -> None:
        """End, and report the reason to the plant, which may require a recorder."""
        self._participation.raise_objection(Objection(str(error)))
        self.finish()
        self.fail(str(error))

    def _await_end(self) -> None:
        """Keep recording until the run has ended: it may be stopped together with the recorder."""
        deadline = time.monotonic() + END_S
        self._write_until(math.inf)
        self._acknowledge()
        while self._recording.is_under_way and not self.exit_status and time.monotonic() < deadline:
            time.sleep(POLL_S)
            self._write_until(math.inf)
            self._acknowledge()

    def diagnose(self) -> Mapping[str, Any]:
        """Return the counts of the recording."""
        return {
            'file': self._writer.path,
            'acknowledged [s]': f'{self._recording.ticks.acked_ns * 1e-9:.3f}',
            'lost messages': self._lost,
        }

    def close(self) -> None:
        """Record the remaining messages, and finish the file."""
        self._await_end()
        try:
            if self.exit_status == 0:
                self._recording.write_stop()
                self._write_metadata()
            self._writer.close()
        except RecordingError as error:
            self._fail(error)
        if self.exit_status == 0:
            self.get_logger().info(f'finished {self._writer.path}')
        # Flush last: a hanging node can block the middleware, but must not keep the file open.
        self.flush(topics.PARTICIPANTS)
        self._channels.close()

    def _write_metadata(self) -> None:
        """Write the participants, the outcome, and whether messages are missing."""
        if self._recording.members:
            self._writer.add_metadata(RUN_PARTICIPANTS, self._recording.members)
        if self._recording.outcome:
            self._writer.add_outcome(self._recording.outcome)
        if begins_ns := self._recording.gate.complete_from_ns:
            begins = f'{begins_ns / SECOND_NS:.3f} s'
            self._writer.mark_incomplete(f'complete only from {begins} on: recorded from mid-run')
        if self._lost:
            gaps = '1 gap' if self._lost == 1 else f'{self._lost} gaps'
            self._writer.mark_incomplete(f'{gaps} in the sequence of messages')
