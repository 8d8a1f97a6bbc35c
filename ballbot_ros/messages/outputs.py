"""Destinations of messages: publishers of the graph, or a recording without a graph."""

from __future__ import annotations

from collections.abc import Callable

from ballbot_ros.messages.topics import Topic

Send = Callable[[int, bytes], None]
"""Sends a message of a topic: its stamp [ns], and the message as CDR."""

MakeSend = Callable[[Topic], Send]
"""Returns the function that sends the messages of a topic."""
