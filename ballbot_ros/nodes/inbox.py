"""Reading messages without the executor: a poll costs less than a callback for each message."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from ballbot_ros.messages.topics import Topic
from ballbot_ros.nodes.intra_process import Inbox


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
