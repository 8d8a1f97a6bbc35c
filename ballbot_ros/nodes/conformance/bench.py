"""The graph around a node under test: one node in the place of all others."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.nodes.conformance.contract import CONTRACTS, Offer
from ballbot_ros.nodes.endpoints import (
    TopicPublisher,
    drain,
    hidden_node,
    raw_subscription,
    reliable_qos,
)
from ballbot_ros.nodes.processes import exit_description
from ballbot_ros.process import StopRequest
from ballbot_ros.recording.messages.topics import HISTORY, PARTICIPANTS, TOPICS, Topic

POLL_S = 2e-4
END_S = 5.0
"""Time that a node has to end when asked to [s]."""


class Bench:
    """The rest of the graph around the node of a role, which is the only node that answers it.

    Parameters
    ----------
    command : sequence of str
        The command that starts the node under test; empty if the user starts it.
    stop : StopRequest
        A requested stop interrupts a wait by KeyboardInterrupt.
    """

    def __init__(self, role: str, command: Sequence[str], stop: StopRequest) -> None:
        self._command, self._stop = command, stop
        self._node = Node('ballbot_conform')
        self._inbox = hidden_node('inbox', self._node)
        self._process: subprocess.Popen[bytes] | None = None
        contract = CONTRACTS[role]
        self._publishers = {
            topic: TopicPublisher(self._node, topic)
            for topic in TOPICS
            if topic.publisher not in (None, role)
        }
        topics = (PARTICIPANTS, *contract.topics)
        self._received: dict[Topic, list[bytes]] = {topic: [] for topic in topics}
        self._subscriptions = [
            (topic, raw_subscription(self._inbox, topic, reliable_qos(HISTORY, latched=is_latched)))
            for topic in topics
            # The node may answer a roll call before its publisher is discovered, so also get what
            # it keeps; but one that wrongly keeps nothing must be heard, too.
            for is_latched in ((True, False) if topic is PARTICIPANTS else (False,))
        ]
        self._announced: set[tuple[int, bytes]] = set()

    @property
    def can_start(self) -> bool:
        """Whether the bench starts and kills the node; if not, the user has started it."""
        return bool(self._command)

    @property
    def end(self) -> str:
        """Why the node is not running; '' while it runs."""
        if self._process is None:
            return 'it was not started'
        status = self._process.poll()
        return '' if status is None else f'it {exit_description(status)}'

    def start(self) -> None:
        """Start the node; BallbotError if there is no such program."""
        try:
            # Its output goes to the errors: the output is the table, or JSON.
            self._process = subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=2, start_new_session=True
            )
        except (OSError, ValueError) as error:  # ValueError: a null character
            reason = getattr(error, 'strerror', None) or one_line(error)
            raise BallbotError(f'{self._command[0]!r}: {reason}') from None

    def kill(self) -> None:
        """Kill the node, and the processes that it has started."""
        self._signal(signal.SIGKILL)
        if self._process:
            self._process.wait()

    def close(self) -> None:
        """Ask the node to end, kill it if it does not, and leave the graph."""
        self._signal(signal.SIGTERM)
        if self._process:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(END_S)
        self.kill()
        self._inbox.destroy_node()
        self._node.destroy_node()

    def _signal(self, number: signal.Signals) -> None:
        # The group may still have processes when its first one, such as `ros2 run`, has ended.
        if self._process:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)

    def publish(self, topic: Topic, data: bytes) -> None:
        """Publish a message of the rest of the graph."""
        self._publishers[topic].publish(data)

    def received(self, topic: Topic) -> Sequence[bytes]:
        """Return all messages of the node on a topic so far, oldest first."""
        return self._received[topic]

    def offers(self, topic: Topic) -> Sequence[Offer]:
        """Return the publishers on a topic, of which the bench has none."""
        return [
            Offer(
                found.topic_type,
                found.qos_profile.reliability is ReliabilityPolicy.RELIABLE,
                found.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL,
            )
            for found in self._node.get_publishers_info_by_topic(topic.name)
        ]

    def wait(self, is_done: Callable[[], bool], limit_s: float) -> bool:
        """Receive messages until `is_done`, the time [s] is over, or the node has ended.

        Return whether it is done.
        """
        deadline_s = time.monotonic() + limit_s
        while True:
            self._receive()
            if is_done():
                return True
            if time.monotonic() > deadline_s or (self._process and self.end):
                return False
            if self._stop.signal:
                raise KeyboardInterrupt
            time.sleep(POLL_S)

    def _receive(self) -> None:
        for topic, subscription in self._subscriptions:
            for data, info in drain(subscription):
                if topic is PARTICIPANTS:
                    key = (info['publication_sequence_number'], data)
                    if key in self._announced:
                        continue
                    self._announced.add(key)
                self._received[topic].append(data)
