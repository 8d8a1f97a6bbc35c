"""Where messages go: to a publisher of the graph, or into the recording of a run without one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from ballbot_ros.messages.topics import Topic
from ballbot_ros.recording.encoding import encoder, new_message


class Output(Protocol):
    """A topic's one message, which is filled and sent again and again."""

    message: Any

    def send(self, stamp_ns: int) -> None:
        """Send the message as it is now; `stamp_ns` is the sim time [ns] that it belongs to."""
        ...


MakeOutput = Callable[[Topic], Output]

Sink = Callable[[Topic, int, bytes], None]
"""Takes a message: its topic, its stamp [ns], and itself as CDR."""


class EncodedOutput:
    """An output without a graph, which encodes the message.

    Parameters
    ----------
    topic : Topic
    sink : callable
        What takes the encoded messages.
    """

    def __init__(self, topic: Topic, sink: Sink) -> None:
        self.message: Any = new_message(topic.type_name)
        self._encode = encoder(topic.type_name)
        self._topic = topic
        self._sink = sink

    def send(self, stamp_ns: int) -> None:
        """Encode the message and hand it on."""
        self._sink(self._topic, stamp_ns, self._encode(self.message))
