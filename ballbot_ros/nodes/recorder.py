"""Records every topic of the graph, and tells the plant how far it has got."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from datetime import datetime
from operator import itemgetter
from pathlib import Path
from typing import Any

from rclpy.qos import QoSProfile

from ballbot_ros.messages.conversions import fill_time
from ballbot_ros.messages.raw import decoder, has_stamp, stamp_of
from ballbot_ros.messages.topics import (
    DIAGNOSTICS,
    HISTORY,
    RECORDER_ACK,
    TOPICS,
    Topic,
    message_class,
)
from ballbot_ros.nodes.base import BallbotNode, requested_qos, run_node
from ballbot_ros.nodes.inbox import hidden_node, raw_subscription, taken
from ballbot_ros.parameters import PLANT, RECORDER, VISUALIZER
from ballbot_ros.recording.attachments import media_type
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.qos import RELIABLE_LATCHED, QosProfile
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.simulation.timing import TICK_NS

POLL_S = 5e-3
FLUSH_S = 0.5
DISCOVERY_S = 1.0

_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
"""What the middleware calls a publisher's node of which it has not heard yet."""


class Recorder(BallbotNode):
    """Writes what it receives as it came, and acknowledges the ticks that are complete.

    It takes the messages in batches, past the executor: that costs a fifth of a callback each,
    and tells the publisher's sequence number, by which a lost message is noticed. The histories
    of the publishers and the plant's bounded lead keep everything until it is taken.
    """

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        super().__init__(RECORDER, values)
        path = Path(self.values['output'] or _new_path())
        attachments = _read_folder(self.values['attachments'])
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(f'{path}: {error.strerror}') from None
        self._writer = RecordingWriter(path)
        for name, data in attachments.items():
            self._writer.add_attachment(name, media_type(name), data)
        self._inbox = hidden_node(f'{RECORDER}_inbox', self.get_namespace())
        self._channels: dict[str, _Channel] = {}
        for topic in TOPICS:
            self._subscribe(topic, requested_qos(topic, HISTORY))
        self._periodic = [c for c in self._channels.values() if c.topic.period_ns]
        self._late: list[_Item] = []
        self._refused: set[str] = set()
        self._sighted: set[str] = set()
        self._acked_ns = 0
        self._lost = 0
        self._early: list[tuple[int, tuple[_Channel, bytes, int]]] = []
        self._decode_diagnostics = decoder(DIAGNOSTICS.type_name)
        self._outcome: dict[str, str] = {}
        self._ack = self.output(RECORDER_ACK)
        self.every(POLL_S, self._poll)
        self.every(FLUSH_S, self._flush)
        self.every(DISCOVERY_S, self._discover)

    def _subscribe(self, topic: Topic, qos: QoSProfile) -> None:
        subscription = raw_subscription(self._inbox, topic, qos)
        self._channels[subscription.topic_name] = _Channel(topic, subscription)

    def _poll(self) -> None:
        """Write what has come until now, in the order in which it came, and acknowledge it.

        What comes while the topics are looked at one by one waits for the next time: of an
        earlier topic there may be something older.
        """
        self._write_until(time.time_ns())

    def _write_until(self, received_ns: float) -> None:
        if self.exit_status:
            return
        come: list[_Item] = []
        for channel in self._channels.values():
            channel.take_into(come)
        batch = self._late + [item for item in come if item[0] <= received_ns]
        batch.sort(key=itemgetter(0))
        self._late = [item for item in come if item[0] > received_ns]
        try:
            for _, channel, data, sequence in batch:
                self._write(channel, data, sequence)
        except RecordingError as error:
            self._fail(error)
            return
        complete = min(channel.complete_ns() for channel in self._periodic)
        if complete > self._acked_ns:
            self._acked_ns = complete
            fill_time(self._ack.message.stamp, complete)
            self._ack.send(complete)

    def _write(self, channel: _Channel, data: bytes, sequence: int) -> None:
        if channel.lost_before(sequence):
            self._lost += 1
            self.warn(f'{channel.topic.name}: messages before number {sequence} were lost')
        stamp = stamp_of(data) if channel.is_stamped else 0
        if channel.topic.period_ns:
            if stamp <= channel.newest_ns:
                return
            channel.newest_ns = stamp
            if stamp > self.now_ns:
                self.sampled(stamp)
        if self.now_ns == 0:
            # There is no time yet to log it with.
            self._early.append((stamp, (channel, data, sequence)))
            return
        for early_stamp, early in self._early:
            self._keep(early_stamp or self.now_ns, *early)
        self._early.clear()
        self._keep(stamp or self.now_ns, channel, data, sequence)

    def _keep(self, stamp: int, channel: _Channel, data: bytes, sequence: int) -> None:
        if channel.recorded is None:
            channel.recorded = self._announce(channel)
        self._writer.write(channel.recorded, stamp, data, sequence)
        if channel.topic is DIAGNOSTICS:
            self._note_outcome(data)

    def _note_outcome(self, data: bytes) -> None:
        for status in self._decode_diagnostics(data).status:
            if status.name == f'{PLANT}: loop':
                account = {item.key: item.value for item in status.values}
                self._outcome = account if 'outcome' in account else {}

    def _announce(self, channel: _Channel) -> Any:
        """Add a topic to the file, with what its publishers offer."""
        name = channel.subscription.topic_name
        offers = self.get_publishers_info_by_topic(name)
        qos = [QosProfile.from_rclpy(offer.qos_profile) for offer in offers]
        return self._writer.add_topic(name, channel.topic.type_name, qos=qos or [RELIABLE_LATCHED])

    def _flush(self) -> None:
        if self.finished:
            return
        try:
            self._writer.flush()
        except RecordingError as error:
            self._fail(error)

    def _fail(self, error: RecordingError) -> None:
        self.finish()
        self.fail(str(error))

    def _discover(self) -> None:
        """Subscribe to topics that the graph has beside its own."""
        for name, _ in self.get_topic_names_and_types():
            if name in self._channels or name in self._refused:
                continue
            offers = self.get_publishers_info_by_topic(name)
            # Discovery may tell of a publisher before it tells of its node: look once more.
            if name not in self._sighted and any(o.node_name == _UNKNOWN_NODE for o in offers):
                self._sighted.add(name)
                continue
            # What is drawn for other tools follows from what is recorded.
            offers = [offer for offer in offers if offer.node_name != VISUALIZER]
            if not offers:
                continue
            # Not the graph's types, which are also those that somebody would like to read.
            topic = Topic(name, offers[0].topic_type, None)
            try:
                message_class(topic.type_name)
            except (ImportError, AttributeError):
                self._refused.add(name)
                self.get_logger().warning(f'{name}: no type {topic.type_name} here: not recorded')
                continue
            self._subscribe(
                topic,
                QoSProfile(
                    depth=HISTORY,
                    # The weakest that any publisher offers, so that all of them match.
                    reliability=max(offer.qos_profile.reliability for offer in offers),
                    durability=max(offer.qos_profile.durability for offer in offers),
                ),
            )

    def diagnose(self) -> Mapping[str, Any]:
        """Return what was recorded."""
        return {
            'file': self._writer.path,
            'acknowledged [s]': f'{self._acked_ns * 1e-9:.3f}',
            'lost messages': self._lost,
        }

    def close(self) -> None:
        """Take what has still come, and finish the file."""
        self._write_until(math.inf)
        if self._outcome and self.exit_status == 0:
            self._writer.add_outcome(self._outcome)
        if self._lost and self.exit_status == 0:
            self._writer.mark_incomplete(f'{self._lost} gaps in the sequence of messages')
        self._writer.close()
        # Last: the middleware may be held up by a node that hangs, and the file is not to be.
        self._inbox.destroy_node()


class _Channel:
    """A topic being recorded."""

    def __init__(self, topic: Topic, subscription: Any) -> None:
        self.topic = topic
        self.subscription = subscription
        self.recorded: Any = None
        # Other publishers stamp with clocks of their own.
        self.is_stamped = topic.publisher is not None and has_stamp(topic.type_name)
        self.newest_ns = 0
        self._sequence = 0

    def take_into(self, batch: list[_Item]) -> None:
        """Take all messages that wait."""
        for data, info in taken(self.subscription):
            batch.append(
                (info['received_timestamp'], self, data, info['publication_sequence_number'])
            )

    def lost_before(self, sequence: int) -> bool:
        """Note a publisher's sequence number; tell whether some before it are missing."""
        last, self._sequence = self._sequence, sequence
        return self.topic.publisher is not None and 0 < last < sequence - 1

    def complete_ns(self) -> int:
        """Return the newest tick at which nothing of this topic is still to come."""
        if self.newest_ns == 0:
            return 0
        return self.newest_ns + self.topic.period_ns - TICK_NS


_Item = tuple[int, _Channel, bytes, int]
"""When a message came, on which channel, the message, and its publisher's number."""


def _new_path() -> Path:
    return Path('runs') / f'{datetime.now():%Y-%m-%d_%H-%M-%S}' / 'ballbot.mcap'


def _read_folder(folder: str) -> dict[str, bytes]:
    if not folder:
        return {}
    try:
        return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
    except OSError as error:
        raise RecordingError(f'{folder}: {error.strerror}') from None


def main() -> None:
    """Run the node."""
    sys.exit(run_node(Recorder))


if __name__ == '__main__':
    main()
