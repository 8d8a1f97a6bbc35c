"""What each role owes the plant, and a node under test as its plant sees it.

The test consists of runs, their ticks, and the answers to them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from itertools import dropwhile
from typing import TYPE_CHECKING, NamedTuple

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import Announcement
from ballbot_ros.lockstep.run_recording import RunStatus
from ballbot_ros.parameters import (
    CONTROLLER,
    DRIVER_PERIODS_NS,
    MAX_DELAY_MS,
    NODES,
    PLANT,
    RECORDER,
    ROLES,
    ParameterSet,
)
from ballbot_ros.parameters.timing import FIRST_TICK_NS, RESEND_S, SECOND_NS, TICK_NS, next_start_ns
from ballbot_ros.recording.messages.conversions import decode_duty, encode_header
from ballbot_ros.recording.messages.devices import INPUT_READERS
from ballbot_ros.recording.messages.raw import stamp_of
from ballbot_ros.recording.messages.run_messages import RunMessages, Send
from ballbot_ros.recording.messages.run_reports import decode_announcement, encode_run_status
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    MOTOR_DUTY,
    PARTICIPANTS,
    RECORDER_ACK,
    ROLL_CALL,
    RUN,
    RUN_STATUS,
    TOPICS,
    Topic,
    periodic_topics,
)

if TYPE_CHECKING:  # it needs rclpy
    from ballbot_ros.nodes.conformance.bench import Bench


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


START_S = 30.0
"""Time limit for a node to start and join a run, as for a run's participants."""

ANSWER_S = 5.0
"""Time limit for an answer: longer than the plant's, since the machine may be busy."""


class BreachError(Exception):
    """The node has broken its contract."""


class NodeUnderTest:
    """A node of a role, in runs that a bench plays.

    The methods that wait for the node raise BreachError if it does not do what it should. `run` is
    the current run, and `tick` its newest tick.
    """

    tick: TickMessages

    def __init__(self, role: str, bench: Bench, token: str) -> None:
        self.contract, self.bench, self._token = CONTRACTS[role], bench, token
        self.run = RunIdentity('', FIRST_TICK_NS)
        self._plant = 1
        self._number = self._newest_ns = self._earlier_ns = 0
        self._asked: dict[int, int] = {}
        self._ticks: Iterator[TickMessages] = iter(())
        self._first_announcement = self._first_answer = 0
        self._is_starting = True
        self._unusable = ''

    @property
    def has_been_deaf(self) -> bool:
        """Whether it has announced nothing in spite of a roll call."""
        return self._number > 0 and not self.bench.received(PARTICIPANTS)

    # Runs

    def join(self) -> None:
        """Announce another run, and wait until the node, started if necessary, has joined it."""
        self.announce_run()
        if self.bench.can_start and self.bench.end:
            self.start()
        self.await_member()

    def announce_run(self) -> None:
        """Announce another run, and call the roll."""
        self._number += 1
        start_ns = next_start_ns(self._newest_ns) if self._newest_ns else FIRST_TICK_NS
        self.run = RunIdentity(f'{self._number} {self._token}{self._plant}', start_ns)
        self._ticks = nominal_run(self.contract.role, start_ns)
        self._asked = {}
        self._earlier_ns = max(map(stamp_of, self.answers()), default=0)
        self._first_announcement = len(self.bench.received(PARTICIPANTS))
        self._first_answer = len(self.bench.received(self.contract.answer))
        self.bench.publish(RUN, encode_header(start_ns, self.run.name))
        self.call_roll()

    def replace_plant(self) -> None:
        """Let the next run be the first one of another plant, whose time begins again."""
        self._plant += 1
        self._number = self._newest_ns = 0

    def start(self) -> None:
        """Start the node."""
        self._is_starting = True
        self.bench.start()

    def restart(self) -> None:
        """Kill the node in mid-run, start it again, and wait until it has joined the run."""
        self.bench.kill()
        self._first_announcement = len(self.bench.received(PARTICIPANTS))
        self.start()
        self.await_member()

    def call_roll(self) -> None:
        """Ask the node to announce itself."""
        self.bench.publish(ROLL_CALL, encode_header(self.run.start_ns, self.run.name))

    def await_member(self) -> None:
        """Wait until the node has joined the run."""
        limit_s = START_S if self._is_starting else ANSWER_S
        self._is_starting = False
        self.bench.wait(lambda: bool(self._announcements() or self._unusable), limit_s)
        if not self._announcements():
            raise BreachError(self._unusable or 'it does not join the run')
        topics = tuple(topic.name for topic in TOPICS if topic.period_ns)
        status = RunStatus(self.run.name, True, topics, dict.fromkeys(NODES, ''))
        self.bench.publish(RUN_STATUS, encode_run_status(status))

    def settle(self) -> None:
        """Wait for the answer to a roll call: by then, answers sent before have arrived."""
        before = len(self._announcements())
        self.call_roll()
        if not self.bench.wait(lambda: len(self._announcements()) > before, ANSWER_S):
            raise BreachError('it does not answer a roll call in mid-run')

    def announcement(self) -> Announcement:
        """Return its newest announcement for this run."""
        return self._announcements()[-1]

    def objection(self) -> str:
        """Return the text of its objection; '' if there is none."""
        objection = self.announcement().objection
        return objection.text if objection else ''

    def _announcements(self) -> list[Announcement]:
        """Return its announcements for this run; note one that can't be used."""
        found = []
        self._unusable = ''
        for data in self.bench.received(PARTICIPANTS)[self._first_announcement :]:
            try:
                announcement = decode_announcement(data)
            except ValueError as error:
                self._unusable = f'its announcement cannot be read: {error}'
                continue
            if announcement.run != self.run.name:
                continue  # of an earlier run, and late
            if announcement.participant.role == self.contract.role:
                found.append(announcement)
            else:
                self._unusable = f'it announces the role {announcement.participant.role!r}'
        if len({each.participant.instance for each in found}) > 1:
            names = ' and '.join(dict.fromkeys(str(each.participant) for each in found))
            raise BreachError(f'two nodes take the role, or one changes its instance: {names}')
        return found

    # Ticks

    def begin_run(self, ticks: int) -> None:
        """Let the node join another run, and drive through its first ticks."""
        self.join()
        self.drive(ticks)

    def drive(self, ticks: int) -> None:
        """Send some ticks, each after the answer to the one before; judge the answers."""
        for _ in range(ticks):
            self.ask()
        self.settle()
        self.judge()

    def ask(self) -> None:
        """Send the next tick, and wait for its answer; only the first one may be sent again."""
        is_first = not self._asked
        self.send_next()
        stamp_ns = self.tick.stamp_ns
        if stamp_ns % self.contract.period_ns:
            return
        if is_first:
            self.repeat_until(lambda: self.is_answered(stamp_ns))
        if not self.await_answers(stamp_ns):
            raise BreachError(self.silence(stamp_ns))

    def send_next(self, without: Collection[Topic] = ()) -> None:
        """Send the next tick, without the messages on some topics."""
        self.tick = next(self._ticks)
        self._newest_ns = self.tick.stamp_ns
        self._asked[self.tick.stamp_ns] = 1
        for topic, data in self.tick.messages:
            if topic not in without:
                self.bench.publish(topic, data)

    def send_again(self, tick: TickMessages) -> None:
        """Ask again for a tick; one of an earlier run must not be answered."""
        if tick.stamp_ns in self._asked:
            self._asked[tick.stamp_ns] += 1
        for topic, data in tick.repeated():
            self.bench.publish(topic, data)

    def repeat_until(self, is_done: Callable[[], bool]) -> bool:
        """Ask again for the newest tick: the node may not have discovered all publishers yet."""
        for _ in range(round(ANSWER_S / RESEND_S)):
            if self.bench.wait(is_done, RESEND_S):
                return True
            self.send_again(self.tick)
        return self.bench.wait(is_done, RESEND_S)

    # Answers

    def answers(self) -> list[bytes]:
        """Return its answers in this run."""
        return list(self.bench.received(self.contract.answer)[self._first_answer :])

    def answers_to(self, stamp_ns: int) -> list[bytes]:
        """Return its answers with a stamp [ns]."""
        return [data for data in self.answers() if stamp_of(data) == stamp_ns]

    def is_answered(self, stamp_ns: int) -> bool:
        """Return whether it has answered a stamp [ns]."""
        return bool(self.answers_to(stamp_ns))

    def await_answers(self, stamp_ns: int, count: int = 1) -> bool:
        """Wait for a number of answers to a stamp [ns]; return whether they have come."""
        return self.bench.wait(lambda: len(self.answers_to(stamp_ns)) >= count, ANSWER_S)

    def read(self, data: bytes) -> object:
        """Return what the readers of an answer make of it."""
        try:
            return self.contract.read(data)
        except (ValueError, IndexError, OverflowError) as error:
            raise BreachError(f'at {seconds_text(stamp_of(data))}: {error}') from None

    def silence(self, stamp_ns: int) -> str:
        """Return the text for a stamp [ns] without an answer."""
        text = f'no answer to {seconds_text(stamp_ns)}'
        if objection := self.objection():
            return f'{text}: it objects that {objection}'
        others = [stamp_of(data) for data in self.answers()]
        return f'{text}; its newest one is stamped {seconds_text(others[-1])}' if others else text

    def judge(self) -> None:
        """Check the stamps of all answers in this run."""
        stamps = [stamp_of(data) for data in self.answers()]
        if self.contract.acknowledges:
            # An acknowledgement from before the run does not count: the plant ignores it. A late
            # one of the run before may even arrive after the next plant has begun.
            stamps = list(dropwhile(lambda each: each == self._earlier_ns, stamps))
            if ahead := [each for each in stamps if each > self._newest_ns]:
                raise BreachError(f'it acknowledges {seconds_text(ahead[0])}, ahead of the run')
            return
        # When asked again, a controller may answer each repeated input.
        repetitions = len(INPUT_READERS) if self.contract.role == CONTROLLER else 1
        for stamp_ns in stamps:
            if stamp_ns not in self._asked or stamp_ns % self.contract.period_ns:
                raise BreachError(f'it answers {seconds_text(stamp_ns)}, which nobody asked for')
            times, asked = stamps.count(stamp_ns), self._asked[stamp_ns]
            if times > 1 + (asked - 1) * repetitions:
                raise BreachError(f'it answers {seconds_text(stamp_ns)} {times} times')


def seconds_text(stamp_ns: int) -> str:
    """Return a stamp [ns] as text in seconds."""
    return f'{stamp_ns / SECOND_NS:.3f} s'
