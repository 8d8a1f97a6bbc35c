"""Publishers and readers of topics: over the middleware, or within one process."""

from __future__ import annotations

import time
from collections import defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from ballbot_ros.recording.messages.topics import HISTORY, RECORDER_ACK, UNRECORDED, Topic

TURN_S = 5e-3
"""Time after which the executor gets its turn, even if there are messages [s]."""

Receive = Callable[[bytes], None]

_current: list[IntraProcess] = []


class Inbox:
    """The messages of a topic that its owner reads from time to time."""

    def __init__(self, topic_name: str) -> None:
        self.topic_name = topic_name
        self._messages: deque[tuple[bytes, Mapping[str, int]]] = deque()

    def put(self, data: bytes, sequence: int) -> None:
        """Append a message of a publisher with its sequence number."""
        metadata = {'received_timestamp': time.time_ns(), 'publication_sequence_number': sequence}
        self._messages.append((data, metadata))

    def take(self) -> Iterator[tuple[bytes, Mapping[str, int]]]:
        """Remove the messages, oldest first, each with the metadata of the middleware."""
        while self._messages:
            yield self._messages.popleft()


class IntraProcess:
    """The topics of the loop that nodes of this process, which have these `roles`, publish.

    Within this context, their messages reach the nodes of this process as bytes and in the order in
    which they were published, like with the intra-process communication of rclcpp. The middleware
    gets them only if somebody has subscribed there, which can't be a node of this process. All
    other topics, such as events, take the usual way. `turns` counts the turns of the executor, in
    which the middleware may have found new subscribers.
    """

    def __init__(self, roles: Collection[str]) -> None:
        self._roles = frozenset(roles)
        self.turns = 0
        self._callbacks: dict[str, list[Receive]] = defaultdict(list)
        self._inboxes: dict[str, list[Inbox]] = defaultdict(list)
        self._waiting: deque[tuple[Receive, bytes]] = deque()

    def __enter__(self) -> IntraProcess:
        _current.append(self)
        return self

    def __exit__(self, *error: object) -> None:
        _current.remove(self)

    def passes(self, topic: Topic) -> bool:
        """Return whether it passes the messages of a topic."""
        is_of_the_loop = topic.period_ns > 0 or topic in (*UNRECORDED, RECORDER_ACK)
        return is_of_the_loop and topic.publisher in self._roles

    def subscribe(self, name: str, receive: Receive) -> None:
        """Call `receive` with the messages of the topic of that resolved name."""
        self._callbacks[name].append(receive)

    def inbox(self, name: str) -> Inbox:
        """Return a new inbox of the topic of that resolved name."""
        inbox = Inbox(name)
        self._inboxes[name].append(inbox)
        return inbox

    def publish(self, name: str, data: bytes, sequence: int) -> None:
        """Publish a message; its sequence number is that of its publisher."""
        for inbox in self._inboxes[name]:
            inbox.put(data, sequence)
        self._waiting.extend((receive, data) for receive in self._callbacks[name])

    def deliver(self) -> bool:
        """Deliver messages, for a while; return whether there are more."""
        self.turns += 1
        ends_s = time.monotonic() + TURN_S
        while self._waiting:
            receive, data = self._waiting.popleft()
            receive(data)
            if time.monotonic() > ends_s:
                break
        return bool(self._waiting)


def intra_process(topic: Topic) -> IntraProcess | None:
    """Return what passes the messages of a topic within this process; None if nothing does."""
    return _current[-1] if _current and _current[-1].passes(topic) else None


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
    """The publishers of a topic: of its history, if it has one, and of the topic itself."""

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
        self.publishers: list[Publisher] = []
        if topic.has_history:
            qos = reliable_qos(HISTORY, latched=True)
            self.publishers.append(self._node.create_publisher(kind, topic.history.name, qos))
        # With a deep history for existing readers.
        qos = reliable_qos(topic.latched_depth or HISTORY, latched=topic.latched_depth > 0)
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


def hidden_node(name: str, owner: Node) -> Node:
    """Create a node for subscriptions that its owner drains; no executor spins it.

    Its name begins with an underscore, which hides it, and contains the name of its owner, in whose
    namespace it is.
    """
    return Node(
        f'_{owner.get_name()}_{name}',
        context=owner.context,
        namespace=owner.get_namespace(),
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
