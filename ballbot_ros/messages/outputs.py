"""Destinations of messages: publishers of the graph, or a recording without a graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from ballbot_ros.messages.topics import Topic
from ballbot_ros.recording.encoding import encoder, new_message


class Output(Protocol):
    """The message of a topic, which is filled and sent repeatedly."""

    message: Any

    def send(self, stamp_ns: int) -> None:
        """Send the message with its current content; `stamp_ns` is its sim time [ns]."""
        ...


MakeOutput = Callable[[Topic], Output]

Sink = Callable[[Topic, int, bytes], None]
"""Receives a message: its topic, its stamp [ns], and the message as CDR."""


class EncodedOutput:
    """An output that encodes the message, without a graph.

    Parameters
    ----------
    topic : Topic
    sink : callable
        Receives the encoded messages.
    """

    def __init__(self, topic: Topic, sink: Sink) -> None:
        self.message: Any = new_message(topic.type_name)
        self._encode = encoder(topic.type_name)
        self._topic = topic
        self._sink = sink

    def send(self, stamp_ns: int) -> None:
        """Encode the message and pass it to the sink."""
        self._sink(self._topic, stamp_ns, self._encode(self.message))
