"""Who publishes on the topics of the lockstep, and whether strangers there are heard."""

from __future__ import annotations

import time
from collections.abc import Collection

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import Header

from ballbot_ros.messages.raw import stamp_of
from ballbot_ros.messages.topics import Topic
from ballbot_ros.nodes.inbox import drain, hidden_node, raw_subscription
from ballbot_ros.simulation.participants import Publisher

_PREFIX = 24
"""Hexadecimal digits that the identifiers of one DDS participant have in common."""

_LOOK_S = 1.0

UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
"""What the middleware calls a publisher's node of which it has not heard yet."""


class GraphObserver:
    """The publishers of some topics, and whether a message comes on them.

    Parameters
    ----------
    node : rclpy.node.Node
        In whose namespace the topics are.
    topics : collection of Topic
    """

    def __init__(self, node: Node, topics: Collection[Topic]) -> None:
        self._node = node
        self._topics = {topic.name: topic for topic in topics}
        self._inbox: Node | None = None
        self._subscriptions: dict[str, Subscription] = {}
        self._counts: list[int] = []
        self._found: dict[str, list[Publisher]] = {}
        self._looked_at = 0.0

    def publishers(self) -> dict[str, list[Publisher]]:
        """Return the publishers of each topic by its name.

        To count them costs a fifth. Where their numbers stay the same, they are looked at once a
        second.
        """
        now = time.monotonic()
        counts = [self._node.count_publishers(name) for name in self._topics]
        is_known = all(publisher.node for found in self._found.values() for publisher in found)
        if counts == self._counts and is_known and now - self._looked_at < _LOOK_S:
            return self._found
        self._counts, self._looked_at = counts, now
        self._found = {
            name: [
                Publisher(bytes(offer.endpoint_gid), _full_name(offer))
                for offer in self._node.get_publishers_info_by_topic(name)
            ]
            for name in self._topics
        }
        return self._found

    def count_publishers(self, topic: str) -> int:
        """Return the number of publishers on a topic."""
        return int(self._node.count_publishers(topic))

    def heard(self, names: Collection[str]) -> list[tuple[str, int]]:
        """Return what has come on these topics since the last look: topic and stamp [ns].

        The first look at a topic begins to listen.
        """
        found = []
        for name in names:
            if name not in self._subscriptions:
                self._subscriptions[name] = self._listen(name)
            found += [(name, stamp_of(data)) for data, _ in drain(self._subscriptions[name])]
        return found

    def _listen(self, name: str) -> Subscription:
        if self._inbox is None:
            self._inbox = hidden_node('look', self._node)
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        return raw_subscription(self._inbox, self._topics[name], qos)

    def stop_listening(self) -> None:
        """Listen no longer."""
        if self._inbox is not None:
            self._inbox.destroy_node()
            self._inbox = None
            self._subscriptions.clear()


def guid_prefix(node: Node, word: str) -> str:
    """Return what the identifiers of a node's publishers begin with, as hexadecimal text.

    Nodes of one process have it in common. For want of another way it is that of two publishers
    on a topic of their own, which has the unique `word` as its name; '' if they
    have none in common.
    """
    topic = f'_{word}'
    publishers = [node.create_publisher(Header, topic, 1) for _ in range(2)]
    gids = [bytes(offer.endpoint_gid).hex() for offer in node.get_publishers_info_by_topic(topic)]
    for publisher in publishers:
        node.destroy_publisher(publisher)
    prefixes = {gid[:_PREFIX] for gid in gids}
    return prefixes.pop() if len(prefixes) == 1 else ''


def _full_name(offer: TopicEndpointInfo) -> str:
    """Return the fully qualified name of a publisher's node, '' while it is not known."""
    if offer.node_name == UNKNOWN_NODE:
        return ''
    return f'{offer.node_namespace.rstrip("/")}/{offer.node_name}'
