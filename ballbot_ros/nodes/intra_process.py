"""Messages between the nodes of one process, without the middleware."""

from __future__ import annotations

import time
from collections import defaultdict, deque
from collections.abc import Callable, Collection, Iterator, Mapping

from ballbot_ros.recording.messages.topics import RECORDER_ACK, UNRECORDED, Topic

TURN_S = 5e-3
"""Time after which the executor gets its turn, even if there are messages [s]."""

Receive = Callable[[bytes], None]

_current: list[IntraProcess] = []


class Inbox:
    """The messages of a topic that its owner reads from time to time.

    Attributes
    ----------
    topic_name : str
    """

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
    """The topics of the loop that nodes of this process publish.

    Within this context, their messages reach the nodes of this process as bytes and in the order in
    which they were published, like with the intra-process communication of rclcpp. The middleware
    gets them only if somebody has subscribed there, which can't be a node of this process. All
    other topics, such as events, take the usual way.

    Parameters
    ----------
    roles : collection of str
        The roles of the nodes in this process.

    Attributes
    ----------
    turns : int
        Counts the turns of the executor, in which the middleware may have found new subscribers.
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
