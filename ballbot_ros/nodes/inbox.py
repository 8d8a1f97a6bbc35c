"""Taking messages past the executor: whoever looks now and then pays no callback for each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from ballbot_ros.messages.topics import Topic


def hidden_node(name: str, owner: Node | None = None) -> Node:
    """Return a node that no executor is to spin: its subscriptions are its owner's to empty.

    It is in the namespace of the node that owns it, if one does, and has its name before its own.
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
    """Subscribe a hidden node to a topic; the messages are read as they come off the wire."""
    return node.create_subscription(
        topic.message_class, topic.name, lambda data: None, qos, raw=True
    )


def drain(subscription: Subscription) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """Take the messages that wait, oldest first, each with what the middleware says of it."""
    handle, kind, raw = subscription.handle, subscription.msg_type, subscription.raw
    with handle:
        while (message := handle.take_message(kind, raw)) is not None:
            yield message
