"""Tests a node against the contract of its role.

The examination plays the plant and all other nodes: it calls the roll, sends the messages of one
tick after the other, and judges the answers.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from enum import Enum

from ballbot_ros.conformance.bench import Bench, Offer
from ballbot_ros.conformance.contract import CONTRACTS
from ballbot_ros.conformance.nominal_run import TickMessages, nominal_run
from ballbot_ros.messages.conversions import encode_header
from ballbot_ros.messages.participation import RunStatus, decode_announcement, encode_run_status
from ballbot_ros.messages.raw import same_content, stamp_of
from ballbot_ros.messages.topics import (
    GYRO_IMU,
    PARTICIPANTS,
    ROLL_CALL,
    RUN,
    RUN_STATUS,
    TOPICS,
    periodic_topics,
)
from ballbot_ros.parameters import CONTROLLER, NODES, RECORDER, ROLES
from ballbot_ros.simulation.lockstep import Run
from ballbot_ros.simulation.participants import Announcement
from ballbot_ros.timing import FIRST_TICK_NS, RESEND_S, SECOND_NS, SLOW_PERIOD_NS, next_start_ns

START_S = 30.0
"""Time limit for a node to start and join a run, as for a run's participants."""

ANSWER_S = 5.0
"""Time limit for an answer: longer than the plant's, since the machine may be busy."""

QUIET_S = 0.5
"""Time for which an input is withheld; the node must not answer without it."""

SILENCE_S = 2.5
"""Silence of the plant, in which the node must not send anything: longer than the plant's own
limit, since a pause may last as long as it likes."""

FEW, SERIES, LONG = 6, 75, 400
"""Numbers of ticks: up to the second sample of a slow device; 0.3 s; and 1.6 s, in which a
controller calibrates and begins to balance."""


class Verdict(Enum):
    """The verdict on one requirement."""

    MET = 'met'
    FAILED = 'failed'
    NOT_TESTED = 'not tested'


@dataclass(frozen=True)
class Row:
    """A requirement, the verdict, and the reason unless it is met."""

    name: str
    requirement: str
    verdict: Verdict
    reason: str = ''


class _BreachError(Exception):
    """The node has broken its contract."""


@dataclass(frozen=True)
class _Requirement:
    name: str
    text: str
    check: Callable[[Examination], None]
    roles: Collection[str] = ROLES
    restarts: bool = False


class Examination:
    """The test of one node."""

    def __init__(self, role: str, bench: Bench, token: str) -> None:
        self._contract, self._bench, self._token = CONTRACTS[role], bench, token
        self._is_same = same_content(self._contract.answer.type_name)
        self._plants = 1
        self._run = Run('', FIRST_TICK_NS)
        self._number = self._calls = self._newest_ns = 0
        self._asked: dict[int, int] = {}
        self._ticks: Iterator[TickMessages] = iter(())
        self._first_announcement = self._first_answer = 0
        self._is_starting, self._has_waited = True, False
        self._unread = ''

    def rows(self) -> Iterator[Row]:
        """Check one requirement after the other."""
        for each in REQUIREMENTS:
            if self._contract.role not in each.roles:
                continue
            yield Row(each.name, each.text, *self._verdict(each))

    def _verdict(self, requirement: _Requirement) -> tuple[Verdict, str]:
        if requirement.restarts and not self._bench.can_start:
            return Verdict.NOT_TESTED, 'give the COMMAND that starts the node'
        if self._has_waited and not self._bench.received(PARTICIPANTS):
            return Verdict.NOT_TESTED, 'the node has never joined a run'
        try:
            requirement.check(self)
        except _BreachError as breach:
            is_gone = self._bench.can_start and self._bench.end
            return Verdict.FAILED, f'{breach}; {self._bench.end}' if is_gone else str(breach)
        return Verdict.MET, ''

    # Requirements

    def check_late_start(self) -> None:
        """Check that a roll call made before the node started reaches it."""
        self._bench.kill()
        self._announce_run()
        self._start()
        self._await_member()
        self._drive(1)

    def check_announcement(self) -> None:
        """Check that the announcement is complete, and true."""
        self._join()
        self._drive(FEW)
        participant = self._announcement().participant
        contract = self._contract
        if not participant.node.startswith('/'):
            raise _BreachError(f'its name is {participant.node!r}, not fully qualified as in /name')
        for name, value in (
            ('hardware_id', participant.host),
            ('instance', participant.instance),
            ('implementation', participant.implementation),
            ('parameters sha256', participant.parameters_sha256),
        ):
            if not value:
                raise _BreachError(f'{name!r} is empty')
        required = {contract.answer.name} if contract.answer.period_ns else set()
        allowed = {topic.name for topic in periodic_topics(contract.role)}
        if missing := required - set(participant.topics):
            raise _BreachError(f"'topics' lacks {', '.join(sorted(missing))}")
        if foreign := set(participant.topics) - allowed:
            raise _BreachError(f"'topics' has {', '.join(sorted(foreign))}, which is not its own")
        for topic in periodic_topics(contract.role):
            if topic.name in participant.topics and not self._bench.received(topic):
                raise _BreachError(f"'topics' has {topic.name}, but nothing was published there")

    def check_publishers(self) -> None:
        """Check types and quality of service against the table of topics."""
        self._join()
        self._drive(1)
        for topic in (*self._contract.required, *self._contract.topics):
            offers = self._bench.offers(topic)
            if not offers and topic in self._contract.required:
                raise _BreachError(f'nothing publishes on {topic.name!r}')
            due = Offer(topic.type_name, is_reliable=True, is_latched=topic.latched_depth > 0)
            for offer in offers:
                if offer != due:
                    raise _BreachError(f'{topic.name!r} is {offer}, not {due}')

    def check_every_stamp(self) -> None:
        """Check that each due stamp has one answer, and no other has one."""
        self._join()
        self._drive(SERIES)

    def check_values(self) -> None:
        """Check that the readers of the answers can use them."""
        self._join()
        self._drive(SERIES)
        for data in self._answers():
            self._read(data)

    def check_repetition(self) -> None:
        """Check that it repeats its newest answer, and a driver also older ones."""
        self._join()
        first = self._next()
        self._ask(first, is_first=True)
        self._drive(FEW - 1)
        if self._contract.acknowledges:
            self._check_repeated_acknowledgement()
            return
        newest = self._tick
        for tick in (newest,) if self._contract.role == CONTROLLER else (newest, first):
            before = self._answers_to(tick.stamp_ns)
            for count in range(2):
                self._send_again(tick)
                if not self._wait_for_answers(tick.stamp_ns, len(before) + count + 1):
                    raise _BreachError(f'asked again at {_s(tick.stamp_ns)}, it does not answer')
            for data in self._answers_to(tick.stamp_ns):
                if not self._is_same(before[0], data):
                    raise _BreachError(
                        f'asked again at {_s(tick.stamp_ns)}, it gives another answer'
                    )
        self._settle()

    def _check_repeated_acknowledgement(self) -> None:
        before = len(self._answers())
        self._call_roll()
        if not self._bench.wait(lambda: len(self._answers()) > before, ANSWER_S):
            raise _BreachError('a roll call does not make it repeat its acknowledgement')

    def check_inputs(self) -> None:
        """Check that it waits for an input that comes late."""
        self._join()
        self._drive(FEW)
        tick = self._next()
        self._asked[tick.stamp_ns] = 1
        withheld = [each for each in tick.messages if each[0] is GYRO_IMU]
        for topic, data in tick.messages:
            if topic is not GYRO_IMU:
                self._bench.publish(topic, data)
        if self._bench.wait(lambda: self._is_answered(tick.stamp_ns), QUIET_S):
            raise _BreachError(f'it answers {_s(tick.stamp_ns)} before {GYRO_IMU.name!r} has come')
        for topic, data in withheld:
            self._bench.publish(topic, data)
        if not self._wait_for_answers(tick.stamp_ns):
            raise _BreachError(f'{self._silence(tick.stamp_ns)} after a late {GYRO_IMU.name!r}')
        self._drive(FEW)

    def check_roll_call(self) -> None:
        """Check that it answers a roll call in mid-run with the newest stamp."""
        self._join()
        self._drive(FEW)
        self._settle()
        answered_ns = self._announcement().answered_ns
        due_ns = self._newest_due_ns()
        if answered_ns != due_ns:
            raise _BreachError(f"'answered [ns]' is {answered_ns}, not {due_ns}")

    def check_silence(self) -> None:
        """Check that it sends nothing unasked, and goes on after a silence."""
        self._join()
        self._drive(FEW)
        self._settle()
        before = len(self._answers())
        self._bench.wait(lambda: False, SILENCE_S)
        sent = self._answers()[before:]
        if sent and not self._contract.acknowledges:
            raise _BreachError(f'it sends {_s(stamp_of(sent[0]))} unasked')
        self._drive(FEW)

    def check_reset(self) -> None:
        """Check that it joins the next run, and that a controller computes the same again."""
        ticks = LONG if self._contract.role == CONTROLLER else SERIES
        self._join()
        self._drive(ticks)
        start_ns, before = self._run.start_ns, self._answers()
        self._join()
        self._drive(ticks)
        if self._contract.role != CONTROLLER:
            return
        read = self._read
        for one, other in zip(before, self._answers(), strict=True):
            if read(one) != read(other):
                at_s = (stamp_of(one) - start_ns) / SECOND_NS
                raise _BreachError(
                    f'after a reset, its duties {at_s:.3f} s after the start are {read(other)}, '
                    f'not {read(one)} as before'
                )

    def check_earlier_run(self) -> None:
        """Check that it does not answer messages of an earlier run."""
        self._join()
        self._drive(FEW)
        old = self._tick
        self._join()
        self._send_again(old, counts=False)
        self._drive(FEW)

    def check_next_plant(self) -> None:
        """Check that it serves another plant, whose time begins again."""
        self._join()
        self._drive(FEW)
        self._plants += 1
        self._number, self._newest_ns = 0, 0
        self._join()
        self._drive(FEW)

    def check_restart(self) -> None:
        """Check that it takes part after a restart in mid-run; a controller may object."""
        self._join()
        self._drive(FEW)
        before = self._announcement().participant.instance
        self._bench.kill()
        self._first_announcement = len(self._bench.received(PARTICIPANTS))
        self._start()
        self._await_member()
        if self._announcement().participant.instance == before:
            raise _BreachError(f'the restarted node has the same instance, {before!r}')
        while True:
            tick = self._next()
            self._send(tick)
            # Wait for a tick at which every role answers.
            if tick.stamp_ns % SLOW_PERIOD_NS == 0:
                break

        def is_back() -> bool:
            return self._is_answered(tick.stamp_ns) or bool(self._objection())

        if not self._repeat(lambda: self._send_again(tick), is_back):
            raise _BreachError(f'{self._silence(tick.stamp_ns)} after a restart')

    # Runs

    def _join(self) -> None:
        """Announce another run, and wait until the node has joined it."""
        self._announce_run()
        if self._bench.can_start and self._bench.end:
            self._start()
        self._await_member()

    def _start(self) -> None:
        self._is_starting = True
        self._bench.start()

    def _announce_run(self) -> None:
        self._number += 1
        start_ns = next_start_ns(self._newest_ns) if self._newest_ns else FIRST_TICK_NS
        self._run = Run(f'{self._number} {self._token}{self._plants}', start_ns)
        self._ticks = nominal_run(self._contract.role, start_ns)
        self._asked = {}
        self._first_announcement = len(self._bench.received(PARTICIPANTS))
        self._first_answer = len(self._bench.received(self._contract.answer))
        self._bench.publish(RUN, encode_header(start_ns, self._run.name))
        self._call_roll()
        topics = tuple(topic.name for topic in TOPICS if topic.period_ns)
        members = dict.fromkeys(NODES, '')
        status = encode_run_status(RunStatus(self._run.name, True, topics, members))
        self._bench.publish(RUN_STATUS, status)

    def _call_roll(self) -> None:
        self._bench.publish(ROLL_CALL, encode_header(self._run.start_ns, self._run.name))

    def _await_member(self) -> None:
        limit_s = START_S if self._is_starting else ANSWER_S
        self._is_starting, self._has_waited = False, True
        self._bench.wait(lambda: bool(self._announcements() or self._unread), limit_s)
        if not self._announcements():
            raise _BreachError(self._unread or 'it does not join the run')

    def _announcements(self) -> list[Announcement]:
        """Return its announcements for this run; note one that can't be used."""
        found = []
        self._unread = ''
        for data in self._bench.received(PARTICIPANTS)[self._first_announcement :]:
            try:
                announcement = decode_announcement(data)
            except ValueError as error:
                self._unread = f'its announcement cannot be read: {error}'
                continue
            if announcement.run != self._run.name:
                continue  # of an earlier run, and late
            if announcement.participant.role == self._contract.role:
                found.append(announcement)
            else:
                self._unread = f'it announces the role {announcement.participant.role!r}'
        if len({each.participant.instance for each in found}) > 1:
            names = ' and '.join(dict.fromkeys(str(each.participant) for each in found))
            raise _BreachError(f'two nodes take the role, or one changes its instance: {names}')
        return found

    def _announcement(self) -> Announcement:
        return self._announcements()[-1]

    def _objection(self) -> str:
        objection = self._announcement().objection
        return objection.text if objection else ''

    def _settle(self) -> None:
        """Wait for the answer to a roll call: by then, answers sent before have arrived."""
        before = len(self._announcements())
        self._call_roll()
        if not self._bench.wait(lambda: len(self._announcements()) > before, ANSWER_S):
            raise _BreachError('it does not answer a roll call in mid-run')

    # Ticks

    def _next(self) -> TickMessages:
        self._tick = next(self._ticks)
        self._newest_ns = self._tick.stamp_ns
        return self._tick

    def _drive(self, ticks: int) -> None:
        """Send some ticks, each after the answer to the one before; judge the answers."""
        for _ in range(ticks):
            self._ask(self._next(), is_first=not self._asked)
        self._settle()
        self._judge()

    def _ask(self, tick: TickMessages, *, is_first: bool) -> None:
        """Send a tick, and wait for the answer; only the first one may need to be sent again."""
        self._send(tick)
        if tick.stamp_ns % self._contract.period_ns:
            return
        if is_first and self._repeat(
            lambda: self._send_again(tick), lambda: self._is_answered(tick.stamp_ns)
        ):
            return
        if not self._wait_for_answers(tick.stamp_ns):
            raise _BreachError(self._silence(tick.stamp_ns))

    def _send(self, tick: TickMessages) -> None:
        self._asked[tick.stamp_ns] = 1
        for topic, data in tick.messages:
            self._bench.publish(topic, data)

    def _send_again(self, tick: TickMessages, *, counts: bool = True) -> None:
        if counts:
            self._asked[tick.stamp_ns] += 1
        for topic, data in tick.repeated():
            self._bench.publish(topic, data)

    def _repeat(self, send_again: Callable[[], None], is_done: Callable[[], bool]) -> bool:
        """Send again until it is done: the node may not have discovered all publishers yet."""
        for _ in range(round(ANSWER_S / RESEND_S)):
            if self._bench.wait(is_done, RESEND_S):
                return True
            send_again()
        return self._bench.wait(is_done, RESEND_S)

    # Answers

    def _answers(self) -> list[bytes]:
        """Return its answers in this run."""
        return list(self._bench.received(self._contract.answer)[self._first_answer :])

    def _read(self, data: bytes) -> object:
        try:
            return self._contract.read(data)
        except (ValueError, IndexError, OverflowError) as error:
            raise _BreachError(f'at {_s(stamp_of(data))}: {error}') from None

    def _answers_to(self, stamp_ns: int) -> list[bytes]:
        return [data for data in self._answers() if stamp_of(data) == stamp_ns]

    def _is_answered(self, stamp_ns: int) -> bool:
        return bool(self._answers_to(stamp_ns))

    def _wait_for_answers(self, stamp_ns: int, count: int = 1) -> bool:
        return self._bench.wait(lambda: len(self._answers_to(stamp_ns)) >= count, ANSWER_S)

    def _silence(self, stamp_ns: int) -> str:
        """Return the text for a tick without an answer."""
        text = f'no answer to {_s(stamp_ns)}'
        if objection := self._objection():
            return f'{text}: it objects that {objection}'
        others = [stamp_of(data) for data in self._answers()]
        return f'{text}; its newest one is stamped {_s(others[-1])}' if others else text

    def _newest_due_ns(self) -> int:
        return self._newest_ns - self._newest_ns % self._contract.period_ns

    def _judge(self) -> None:
        """Check the stamps of all answers in this run."""
        stamps = [stamp_of(data) for data in self._answers()]
        if self._contract.acknowledges:
            # An acknowledgement from before the run does not count; the plant ignores it.
            if ahead := [each for each in stamps if each > self._newest_ns]:
                raise _BreachError(f'it acknowledges {_s(ahead[0])}, ahead of the run')
            return
        for stamp_ns in stamps:
            if stamp_ns not in self._asked or stamp_ns % self._contract.period_ns:
                raise _BreachError(f'it answers {_s(stamp_ns)}, which nobody asked for')
            times, asked = stamps.count(stamp_ns), self._asked[stamp_ns]
            if times > asked:
                raise _BreachError(f'it answers {_s(stamp_ns)} {times} times, asked {asked} times')


def _s(stamp_ns: int) -> str:
    return f'{stamp_ns / SECOND_NS:.3f} s'


REQUIREMENTS = (
    _Requirement(
        'late start',
        'joins a run whose roll call was made before it started',
        Examination.check_late_start,
        restarts=True,
    ),
    _Requirement(
        'announcement',
        'says on participants who it is and what it publishes',
        Examination.check_announcement,
    ),
    _Requirement(
        'publishers',
        'publishes with the types and the quality of service of its topics',
        Examination.check_publishers,
    ),
    _Requirement(
        'every stamp', 'answers each due stamp once, and no other', Examination.check_every_stamp
    ),
    _Requirement('values', 'sends values that its readers can use', Examination.check_values),
    _Requirement(
        'asked again', 'repeats its answer when asked again', Examination.check_repetition
    ),
    _Requirement(
        'inputs',
        'does not answer a tick before its inputs are there',
        Examination.check_inputs,
        roles=(CONTROLLER, RECORDER),
    ),
    _Requirement(
        'roll call',
        'answers a roll call in mid-run, with the stamp of its newest answer',
        Examination.check_roll_call,
    ),
    _Requirement(
        'silence', 'sends nothing unasked, and goes on after a silence', Examination.check_silence
    ),
    _Requirement(
        'reset', 'joins the next run, and starts from its initial state', Examination.check_reset
    ),
    _Requirement(
        'earlier run', 'ignores messages of an earlier run', Examination.check_earlier_run
    ),
    _Requirement(
        'next plant',
        'serves the next plant, whose time begins again',
        Examination.check_next_plant,
    ),
    _Requirement(
        'restart',
        'takes part again after it was killed in mid-run; a controller may object',
        Examination.check_restart,
        restarts=True,
    ),
)
"""What is tested, in this order."""
