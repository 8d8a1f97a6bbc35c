"""Publishers of topics, their quality of service, and reading without the executor."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from ballbot_ros.nodes.intra_process import Inbox, intra_process
from ballbot_ros.recording.messages.topics import HISTORY, Topic

FLUSH_S = 1.0
"""Time limit for the last messages to reach their readers."""


def reliable_qos(depth: int, *, latched: bool) -> QoSProfile:
    """Return reliable QoS; if `latched`, late subscribers receive earlier messages, too."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def offered_qos(topic: Topic) -> QoSProfile:
    """Return the QoS that publishers offer, with a deep history for their existing readers."""
    return reliable_qos(topic.latched_depth or HISTORY, latched=topic.latched_depth > 0)


def requested_qos(topic: Topic, depth: int) -> QoSProfile:
    """Return the QoS that subscriptions request; topics open to any tool are never latched."""
    return reliable_qos(depth, latched=topic.latched_depth > 0 and topic.publisher is not None)


def flush(publishers: Iterable[Publisher]) -> bool:
    """Wait until the last messages have reached their readers; return whether they have.

    All together have :data:`FLUSH_S`, since the reader may have been killed.
    """
    deadline_s = time.monotonic() + FLUSH_S
    return all(
        publisher.wait_for_all_acked(Duration(seconds=max(deadline_s - time.monotonic(), 0.0)))
        for publisher in publishers
    )


class TopicPublisher:
    """The publishers of a topic.

    Attributes
    ----------
    publishers : list of Publisher
    """

    publishers: list[Publisher]

    def __init__(self, node: Node, topic: Topic) -> None:
        self._node, self._topic = node, topic
        self._within = intra_process(topic)
        self._name = node.resolve_topic_name(topic.name)
        self._make()

    def _make(self) -> None:
        kind, topic = self._topic.message_class, self._topic
        self._sequence = 0
        self._turn, self._is_read_outside = -1, True
        # Create the history first, so that a subscriber discovers it before the topic itself.
        self.publishers = []
        if topic.has_history:
            qos = reliable_qos(HISTORY, latched=True)
            self.publishers.append(self._node.create_publisher(kind, topic.history.name, qos))
        qos = offered_qos(topic)
        self.publishers.append(self._node.create_publisher(kind, topic.name, qos))

    def recreate_publishers(self) -> None:
        """Publish from new publishers, which keep no earlier messages."""
        for publisher in self.publishers:
            self._node.destroy_publisher(publisher)
        self._make()

    def send(self, stamp_ns: int, data: bytes) -> None:
        """Publish a serialised message: a `Send` of :mod:`~ballbot_ros.recording.messages`."""
        self.publish(data)

    def publish(self, message: object) -> None:
        """Publish a message, serialised or not."""
        within = self._within
        if within and isinstance(message, bytes):
            self._sequence += 1
            within.publish(self._name, message, self._sequence)
            if self._turn != within.turns:
                self._turn = within.turns
                self._is_read_outside = self._topic.latched_depth > 0 or self.has_subscribers
            if not self._is_read_outside:
                return
        for publisher in self.publishers:
            publisher.publish(message)

    @property
    def has_subscribers(self) -> bool:
        """Whether the topic has a subscriber in the middleware."""
        return bool(self.publishers[-1].get_subscription_count())


def hidden_node(name: str, owner: Node | None = None) -> Node:
    """Create a node for subscriptions that its owner drains; no executor spins it.

    Its name begins with an underscore, which hides it. If it has an owner, it is in the owner's
    namespace, and its name contains the owner's name.
    """
    if owner is not None:
        name = f'{owner.get_name()}_{name}'
    return Node(
        f'_{name}',
        context=owner.context if owner else None,
        namespace=owner.get_namespace() if owner else '',
        use_global_arguments=False,
        start_parameter_services=False,
        enable_rosout=False,
    )


def raw_subscription(node: Node, topic: Topic, qos: QoSProfile) -> Subscription:
    """Subscribe a hidden node to the serialised messages of a topic."""
    return node.create_subscription(
        topic.message_class, topic.name, lambda data: None, qos, raw=True
    )


def drain(subscription: Subscription | Inbox) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """Read the waiting messages, oldest first, each with its metadata from the middleware."""
    if isinstance(subscription, Inbox):
        yield from subscription.take()
        return
    handle, kind, raw = subscription.handle, subscription.msg_type, subscription.raw
    with handle:
        while (message := handle.take_message(kind, raw)) is not None:
            yield message
