"""A foreign node that sends nonsense, as a separate process; needs rclpy.

``python -m campaign.sender TOPIC CONTENT PERIOD …`` sends until it is killed.
"""

from __future__ import annotations

import math
import random
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import rclpy
from rclpy.serialization import serialize_message

from ballbot_ros.nodes.endpoints import reliable_qos
from ballbot_ros.nodes.middleware import prepare_middleware
from ballbot_ros.recording.messages.topics import message_class
from campaign.strangers import LOOP_TOPICS, OPEN_TOPICS, STRANGER, Content

LARGE = 8_000
"""Length of each sequence and text of a long message."""

ENCODING = b'\x00\x01\x00\x00'
"""The first bytes of a message: little-endian CDR."""


def main(words: Sequence[str]) -> None:
    """Send the messages in the arguments: a topic, a content and a period [s] for each."""
    prepare_middleware()
    rclpy.init()
    node = rclpy.create_node(STRANGER)
    for name, content, period_s in zip(*[iter(words)] * 3, strict=True):
        topic = next(topic for topic in (*OPEN_TOPICS, *LOOP_TOPICS) if topic.name == name)
        kind = topic.message_class
        qos = reliable_qos(1, latched=topic.latched_depth > 0)
        publisher = node.create_publisher(kind, topic.name, qos)
        data = MAKERS[Content(content)](kind)
        node.create_timer(float(period_s), partial(publisher.publish, data))
    rclpy.spin(node)


def filled(kind: Any, number: float, length: int) -> Any:
    """Return a message whose floats are all `number`, with sequences of this length."""
    message = kind()
    for name, type_name in kind.get_fields_and_field_types().items():
        setattr(message, name, _value(getattr(message, name), type_name, number, length))
    return message


def _value(default: Any, type_name: str, number: float, length: int) -> Any:
    if type_name.startswith('sequence<'):
        item = type_name.removeprefix('sequence<').partition(',')[0].rstrip('>')
        return [_item(item, number, length)] * length
    if type_name.endswith(']'):
        return [_item(type_name.partition('[')[0], number, length)] * len(default)
    if '/' in type_name:
        return filled(type(default), number, length)
    return _item(type_name, number, length)


def _item(type_name: str, number: float, length: int) -> Any:
    if '/' in type_name:
        package, name = type_name.split('/')
        # Nested sequences stay short.
        return filled(message_class(f'{package}/msg/{name}'), number, 1)
    if type_name in ('double', 'float'):
        return number
    if type_name == 'string':
        return '\N{ROBOT FACE}' * length
    if type_name == 'boolean':
        return True
    if type_name == 'octet':
        return b'\x7f'
    return 127  # fits in every integer type


def _whole(kind: Any, number: float, length: int) -> bytes:
    return bytes(serialize_message(filled(kind, number, length)))


def _half(kind: Any) -> bytes:
    whole = _whole(kind, 1.0, 3)
    return whole[: len(whole) // 2]


def _noise(kind: Any) -> bytes:
    # As long as an empty message: for a type without sequences the middleware accepts no more.
    length = len(serialize_message(kind())) - len(ENCODING)
    return ENCODING + random.Random(kind.__name__).randbytes(length)


MAKERS: dict[Content, Callable[[Any], bytes]] = {
    Content.NOTHING: lambda kind: bytes(serialize_message(kind())),
    Content.NAN: lambda kind: _whole(kind, math.nan, 3),
    Content.INFINITY: lambda kind: _whole(kind, math.inf, 3),
    Content.AT_LENGTH: lambda kind: _whole(kind, math.nan, LARGE),
    Content.HALF: _half,
    Content.NOISE: _noise,
}
"""Functions that create the bytes to send from a message class; they are serialised once, so that
the stranger is faster than its readers."""


if __name__ == '__main__':
    main(sys.argv[1:])
