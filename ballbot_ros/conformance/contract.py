"""What each role owes the plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ballbot_ros.messages.conversions import decode_duty
from ballbot_ros.messages.inputs import INPUT_READERS
from ballbot_ros.messages.raw import stamp_of
from ballbot_ros.messages.topics import (
    MOTOR_DUTY,
    PARTICIPANTS,
    RECORDER_ACK,
    TOPICS,
    Topic,
    periodic_topics,
)
from ballbot_ros.parameters import CONTROLLER, DRIVER_PERIODS_NS, RECORDER, ROLES
from ballbot_ros.timing import TICK_NS


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

    @property
    def required(self) -> tuple[Topic, ...]:
        """The topics that it must publish."""
        return (PARTICIPANTS, self.answer)


def _read_duty(data: bytes) -> tuple[int, int]:
    duty = decode_duty(data)
    if duty is None:
        raise ValueError('the duties are not whole numbers within -100 … 100 %')
    return duty


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
