"""The runs of a recording: when each began and ended, and what came from outside."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from ballbot_ros.analysis.namespace import robot_namespace
from ballbot_ros.analysis.told_parameters import ToldParameters
from ballbot_ros.errors import BallbotError
from ballbot_ros.messages.conversions import push_forces, stamp_ns, stick_values, time_ns
from ballbot_ros.messages.motor_stop import is_stop
from ballbot_ros.messages.topics import (
    ACCEPTED_PUSH,
    CLOCK,
    GAMEPAD_JOY,
    MOTOR_DUTY,
    PARTICIPANTS,
    RUN,
    RUN_STATUS,
    TOPICS,
    Topic,
)
from ballbot_ros.plant.truth import Push
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.simulation.timing import TICK_NS


@dataclass
class RecordedRun:
    """A run, and what it depends on beside its parameters.

    Attributes
    ----------
    name : str
        Its name, as ``plant/run`` has it.
    start_ns, last_ns : int
        Sim time [ns] of its first tick, and of its last one that has a duty.
    sticks : dict of int to tuple of int
        The gamepad's sticks by stamp [ns].
    sources : dict of int to str
        Who was in command, by stamp [ns].
    duties : dict of int to tuple of int
        The duties [%] by stamp [ns].
    pushes : list of Push
        The pushes that acted, from the scenario or from outside.
    """

    name: str
    start_ns: int
    last_ns: int
    sticks: dict[int, tuple[int, int]] = field(default_factory=dict)
    sources: dict[int, str] = field(default_factory=dict)
    duties: dict[int, tuple[int, int]] = field(default_factory=dict)
    pushes: list[Push] = field(default_factory=list)

    @property
    def ticks(self) -> int:
        """Number of ticks that have a duty."""
        return max(0, (self.last_ns - self.start_ns) // TICK_NS + 1)

    def sticks_at(self, time: float) -> tuple[int, int]:
        """Return the sticks at `time` [s] from the start of the run."""
        return self.sticks.get(self.start_ns + round(time * 1e9), (0, 0))

    def pushes_from(self, start_ns: int) -> list[Push]:
        """Return the pushes of the run."""
        return self.pushes


@contextmanager
def taken_from(reader: RecordingReader, what: str, stamp_ns: int) -> Iterator[None]:
    """Say where in a recording the values stand that cannot be used.

    Raises
    ------
    RecordingError
        If a value is not finite, beyond what a device gives, or missing.
    """
    try:
        yield
    except (BallbotError, IndexError, OverflowError, ValueError) as error:
        raise RecordingError(f'{reader.path}: {what} at {stamp_ns} ns: {error}') from None


def recorded_topics(reader: RecordingReader) -> dict[str, Topic]:
    """Return the graph's topics by the names that they have in a recording, namespace included.

    Raises
    ------
    RecordingError
        If it has no duties, and is no recording of this robot, or those of several robots.
    """
    namespace = robot_namespace(reader, [MOTOR_DUTY])
    if namespace is None:
        raise RecordingError(
            f'{reader.path}: no topic {MOTOR_DUTY.resolved()}: not a recording of this robot'
        )
    names = {topic.resolved(namespace): topic for topic in TOPICS}
    return {name: names[name] for name in reader.topics() if name in names}


def has_begun(reader: RecordingReader, run: RecordedRun) -> bool:
    """Tell whether the plant has published a tick of a run, if only one that nobody answered."""
    clock = [name for name, topic in recorded_topics(reader).items() if topic is CLOCK]
    first = next(reader.raw_messages(clock, run.start_ns), None) if clock else None
    return first is not None and first.stamp_ns == run.start_ns


def recorded_runs(reader: RecordingReader) -> tuple[list[RecordedRun], ToldParameters]:
    """Return the runs of a recording, in the order of time, and what was told of their parameters.

    Raises
    ------
    RecordingError
        If it has none, its beginning is missing, or a message cannot be used.
    """
    wanted = (RUN, RUN_STATUS, PARTICIPANTS, GAMEPAD_JOY, ACCEPTED_PUSH, MOTOR_DUTY)
    topics = {name: topic for name, topic in recorded_topics(reader).items() if topic in wanted}
    told = ToldParameters()
    names: dict[int, str] = {}
    sticks: dict[int, tuple[int, int]] = {}
    sources: dict[int, str] = {}
    duties: dict[int, tuple[int, int]] = {}
    begun: dict[str, Any] = {}
    pushes: list[Push] = []
    for raw in reader.raw_messages(topics):
        name, log_ns, topic = raw.topic, raw.stamp_ns, topics[raw.topic]
        if topic in (PARTICIPANTS, RUN_STATUS):
            told.add(topic, raw.data)
            continue
        if topic is MOTOR_DUTY and is_stop(raw.data):
            continue
        message = reader.decode(raw)
        if topic is RUN:
            names[time_ns(message.stamp)] = message.frame_id
        elif topic is GAMEPAD_JOY:
            with taken_from(reader, name, log_ns):
                sticks[stamp_ns(message)] = stick_values(message)
            sources[stamp_ns(message)] = message.header.frame_id
        elif topic is MOTOR_DUTY:
            with taken_from(reader, name, log_ns):
                duties[stamp_ns(message)] = int(message.vector.x), int(message.vector.y)
        elif start := begun.pop(message.header.frame_id, None):
            pushes.append(Push(stamp_ns(start), stamp_ns(message), *push_forces(start)))
        else:
            begun[message.header.frame_id] = message
    if not names or (duties and min(duties) < min(names)):
        raise RecordingError(f'{reader.path}: begins in mid-run')
    # Several topics come in no fixed order, so what belongs to which run follows from the stamps.
    order = sorted(names)
    runs = [
        RecordedRun(names[start], start, start - TICK_NS, sticks, sources, duties)
        for start in order
    ]
    for stamp in duties:
        run = runs[bisect_right(order, stamp) - 1]
        run.last_ns = max(run.last_ns, stamp)
    for push in pushes:
        runs[bisect_right(order, push.start_ns) - 1].pushes.append(push)
    return runs, told
