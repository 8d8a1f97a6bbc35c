"""What a test needs of the graph around a node under test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from ballbot_ros.messages.topics import Topic


@dataclass(frozen=True)
class Offer:
    """A publisher of the node under test."""

    type_name: str
    is_reliable: bool
    is_latched: bool

    def __str__(self) -> str:
        reliability = 'reliable' if self.is_reliable else 'best effort'
        durability = 'transient local' if self.is_latched else 'volatile'
        return f'{self.type_name}, {reliability}, {durability}'


class Bench(Protocol):
    """The graph around the node under test, of which it is the only node that answers."""

    @property
    def can_start(self) -> bool:
        """Whether the bench starts and kills the node; if not, the user has started it."""

    @property
    def end(self) -> str:
        """Why a node that the bench starts is not running; '' while it runs."""

    def start(self) -> None:
        """Start the node."""

    def kill(self) -> None:
        """Kill the node, if it runs."""

    def publish(self, topic: Topic, data: bytes) -> None:
        """Publish a message of the rest of the graph."""

    def received(self, topic: Topic) -> Sequence[bytes]:
        """Return all messages of the node on a topic so far, oldest first."""

    def offers(self, topic: Topic) -> Sequence[Offer]:
        """Return the node's publishers on a topic."""

    def wait(self, is_done: Callable[[], bool], limit_s: float) -> bool:
        """Receive messages until `is_done`, but at most for a time [s]; return whether it is.

        It returns early if the node has ended.
        """
