"""The topics that are recorded: subscriptions to the graph's own topics, and to all others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from ballbot_ros.messages.raw import has_stamp, same_content
from ballbot_ros.messages.topics import (
    CLOCK,
    HISTORY,
    SESSION,
    TOPICS,
    UNRECORDED,
    Topic,
    find_message_class,
)
from ballbot_ros.nodes.graph_observer import full_name
from ballbot_ros.nodes.inbox import drain, hidden_node, raw_subscription
from ballbot_ros.nodes.intra_process import Inbox, intra_process
from ballbot_ros.nodes.topic_publisher import reliable_qos
from ballbot_ros.parameters import PLANT
from ballbot_ros.recording.qos import RELIABLE_LATCHED, QosProfile
from ballbot_ros.simulation.arrival_order import Arrival
from ballbot_ros.simulation.recording_gate import Stream
from ballbot_ros.viewer.derived_messages import DerivedMessages


class Channel:
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
            is_clock=topic is CLOCK,
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


Item = tuple[Channel, bytes, int]
"""The channel of a message, the message, and its sequence number."""


class Channels:
    """The channels of a recorder, by the names of their topics."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._inbox = hidden_node('inbox', node)
        self._channels: dict[str, Channel] = {}
        self._sighted: set[str] = set()
        # The session only concerns its page.
        ignored = (*UNRECORDED, SESSION)
        self._ignored = {node.resolve_topic_name(topic.name) for topic in ignored}
        for topic in TOPICS:
            if topic in UNRECORDED:
                continue
            # Earlier messages come from the topic's history, if it has one. Subscribe to the topic
            # itself, too: publishers of other packages need not have a history.
            latched = topic.latched_depth > 0 and not topic.has_history
            self._subscribe(topic, reliable_qos(HISTORY, latched=latched))

    def _subscribe(self, topic: Topic, qos: QoSProfile) -> None:
        if within := intra_process(topic):
            inbox = within.inbox(self._node.resolve_topic_name(topic.name))
            self._channels[inbox.topic_name] = Channel(topic, inbox, None)
            self._ignored.add(self._node.resolve_topic_name(topic.history.name))
            return
        subscription = raw_subscription(self._inbox, topic, qos)
        history = None
        if topic.has_history:
            qos = reliable_qos(HISTORY, latched=True)
            history = raw_subscription(self._inbox, topic.history, qos)
            self._ignored.add(history.topic_name)
        self._channels[subscription.topic_name] = Channel(topic, subscription, history)

    def __iter__(self) -> Iterator[Channel]:
        return iter(self._channels.values())

    def __getitem__(self, name: str) -> Channel:
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
                depth=HISTORY,
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
