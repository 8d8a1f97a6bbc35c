"""What each role owes the plant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.parameters import (
    CONTROLLER,
    DRIVER_PERIODS_NS,
    MAX_DELAY_MS,
    PLANT,
    RECORDER,
    ROLES,
    ParameterSet,
)
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.messages.conversions import decode_duty
from ballbot_ros.recording.messages.devices import INPUT_READERS
from ballbot_ros.recording.messages.raw import stamp_of
from ballbot_ros.recording.messages.run_messages import RunMessages, Send
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    MOTOR_DUTY,
    RECORDER_ACK,
    RUN,
    TOPICS,
    Topic,
    periodic_topics,
)


@dataclass(frozen=True)
class Contract:
    """What the node of a role publishes.

    Attributes
    ----------
    answer : Topic
        The topic on which it answers the plant.
    period_ns : int
        The plant waits for an answer at the multiples of this period [ns].
    read : callable
        Reads an answer as its readers in the graph do. Raises ValueError if they can't use it.
    """

    role: str
    answer: Topic
    period_ns: int
    read: Callable[[bytes], object]

    @property
    def topics(self) -> tuple[Topic, ...]:
        """All topics that only this role publishes; all but `answer` may be left out."""
        return tuple(topic for topic in TOPICS if topic.publisher == self.role)

    @property
    def acknowledges(self) -> bool:
        """Whether an answer acknowledges a tick, and may be repeated, instead of being a sample."""
        return self.answer is RECORDER_ACK

    @property
    def repetitions(self) -> int:
        """The number of answers when asked again: a controller may answer each repeated input."""
        return len(INPUT_READERS) if self.role == CONTROLLER else 1


def _read_duty(data: bytes) -> tuple[int, int]:
    duty = decode_duty(data)
    if duty is None:
        raise ValueError('the duties are not whole numbers within -100 … 100 %')
    return duty.x, duty.y


def _contract(role: str) -> Contract:
    period_ns = DRIVER_PERIODS_NS.get(role, TICK_NS)
    if role == RECORDER:
        return Contract(role, RECORDER_ACK, period_ns, stamp_of)
    if role == CONTROLLER:
        return Contract(role, MOTOR_DUTY, period_ns, _read_duty)
    (sample,) = periodic_topics(role)
    return Contract(role, sample, period_ns, INPUT_READERS[sample])


CONTRACTS = {role: _contract(role) for role in ROLES}
"""The contract of each role."""


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


START_PITCH = 0.07
"""Pitch at the start [rad], so that a controller has something to do."""

Message = tuple[Topic, bytes]


class TickMessages(NamedTuple):
    """All messages of a tick but those of the node under test, in causal order.

    `battery` is the newest message about the battery, which the plant repeats when it asks again.
    """

    stamp_ns: int
    messages: tuple[Message, ...]
    battery: Message

    def repeated(self) -> tuple[Message, ...]:
        """Return the messages with which the plant asks again."""
        others = [each for each in self.messages if each[0] is not BATTERY_STATE]
        clock, *rest = others
        return (clock, self.battery, *rest)


def nominal_run(role: str, start_ns: int) -> Iterator[TickMessages]:
    """Yield the ticks of a run that begins at `start_ns` [ns], in which the robot balances.

    The messages of the `role` under test are left out. The others do not depend on its answers.
    """
    parameters = ParameterSet()
    parameters.set(PLANT, 'start_pitch_x', START_PITCH)
    loop = ClosedLoop(parameters, start_ns=start_ns)
    # The node may be a driver with any dead time, of whole physics steps of 1 ms.
    loop.plant.keep_steps(2 * MAX_DELAY_MS)
    sent: list[Message] = []

    def make(topic: Topic) -> Send:
        def send(stamp_ns: int, data: bytes) -> None:
            if topic.publisher != role and topic is not RUN:
                sent.append((topic, data))

        return send

    messages = RunMessages(make, parameters)
    messages.begin(start_ns, loop.world, loop.pushes)
    battery: Message = (BATTERY_STATE, b'')
    while True:
        tick = loop.tick()
        messages.tick(tick, loop.program)
        messages.plant.send_unrecorded(tick.truth)
        battery = next((each for each in sent if each[0] is BATTERY_STATE), battery)
        yield TickMessages(tick.truth.stamp_ns, tuple(sent), battery)
        sent.clear()
