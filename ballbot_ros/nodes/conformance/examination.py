"""The requirements of a contract, and the test of each."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.conformance.contract import (
    ANSWER_S,
    BreachError,
    NodeUnderTest,
    Offer,
    TickMessages,
    seconds_text,
)
from ballbot_ros.parameters import (
    COMMON_PERIOD_NS,
    CONTROLLER,
    DRIVERS,
    RECORDER,
    ROLES,
    ParameterError,
)
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.messages.raw import same_content, stamp_of
from ballbot_ros.recording.messages.topics import (
    CLOCK,
    GYRO_IMU,
    JOINT_STATES,
    PARTICIPANTS,
    TOPICS,
    Topic,
    periodic_topics,
)

if TYPE_CHECKING:  # it needs rclpy
    from ballbot_ros.nodes.conformance.bench import Bench

DISCOVERY_S = 1.0
"""Time within which a node that is running already is discovered."""

QUIET_S = 0.3
"""Time for which an input is withheld; the node must not answer without it."""

SILENCE_S = 2.5
"""Silence of the plant, in which the node must not send anything: longer than the plant's own
limit, since a pause may last as long as it likes."""

FEW, SERIES, LONG = COMMON_PERIOD_NS // TICK_NS + 1, 75, 400
"""Numbers of ticks: up to the second sample of the slowest driver; 0.3 s; and 1.6 s, in which a
controller calibrates and begins to balance."""


Check = Callable[[NodeUnderTest], None]


class RequirementVerdict(Enum):
    """The verdict on one requirement."""

    MET = 'met'
    FAILED = 'failed'
    NOT_TESTED = 'not tested'


@dataclass(frozen=True)
class RequirementResult:
    """A requirement, the verdict, and the reason unless it is met."""

    name: str
    requirement: str
    verdict: RequirementVerdict
    reason: str = ''


@dataclass(frozen=True)
class Requirement:
    """Something that a contract requires.

    `check` tests it in runs of its own, and raises BreachError if the node does not meet it. If
    `restarts`, the test starts or kills the node.
    """

    name: str
    text: str
    check: Check
    roles: Collection[str]
    restarts: bool


def examine(role: str, bench: Bench, token: str) -> Iterator[RequirementResult]:
    """Test the node of a role; yield a row for each requirement.

    The unique text `token` identifies the played plant. It raises BallbotError if another node has
    the role already.
    """
    node = NodeUnderTest(role, bench, token)
    topic = node.contract.answer
    if bench.can_start and bench.wait(lambda: bool(bench.offers(topic)), DISCOVERY_S):
        # The other node would answer in the place of the one under test.
        raise BallbotError(
            f'a node that publishes on {topic.name!r} is running already: end it, or omit COMMAND '
            'to test it'
        )
    for each in REQUIREMENTS:
        if role in each.roles:
            yield RequirementResult(each.name, each.text, *_verdict(each, node))


def _verdict(requirement: Requirement, node: NodeUnderTest) -> tuple[RequirementVerdict, str]:
    if requirement.restarts and not node.bench.can_start:
        return RequirementVerdict.NOT_TESTED, 'give the COMMAND that starts the node'
    if node.has_been_deaf:
        return RequirementVerdict.NOT_TESTED, 'the node has never joined a run'
    try:
        requirement.check(node)
    except BreachError as breach:
        end = node.bench.end if node.bench.can_start else ''
        return RequirementVerdict.FAILED, '; '.join(filter(None, (str(breach), end)))
    return RequirementVerdict.MET, ''


REQUIREMENTS: list[Requirement] = []
"""What is tested, in this order; each test begins with a run of its own."""


def requirement(
    name: str, text: str, *, roles: Collection[str] = ROLES, restarts: bool = False
) -> Callable[[Check], Check]:
    """Add a requirement, which the decorated function tests; see :class:`Requirement`."""

    def add(check: Check) -> Check:
        REQUIREMENTS.append(Requirement(name, text, check, roles, restarts))
        return check

    return add


@requirement('late start', 'joins a run whose roll call was made before it started', restarts=True)
def _check_late_start(node: NodeUnderTest) -> None:
    node.bench.kill()
    node.announce_run()
    node.start()
    node.await_member()
    node.drive(1)


@requirement('announcement', 'says on participants who it is and what it publishes')
def _check_announcement(node: NodeUnderTest) -> None:
    node.begin_run(FEW)
    participant = node.announcement().participant
    if not participant.node.startswith('/'):
        raise BreachError(f'its name is {participant.node!r}, not fully qualified as in /name')
    for name, value in (
        ('hardware_id', participant.host),
        ('instance', participant.instance),
        ('implementation', participant.implementation),
    ):
        if not value:
            raise BreachError(f'{name!r} is empty')
    try:
        participant.longest_delay()
    except ParameterError as error:
        raise BreachError(str(error)) from None
    answer, own = node.contract.answer, periodic_topics(node.contract.role)
    if answer.period_ns and answer.name not in participant.topics:
        raise BreachError(f"'topics' lacks {answer.name}")
    if foreign := set(participant.topics) - {topic.name for topic in own}:
        raise BreachError(f"'topics' has {', '.join(sorted(foreign))}, which is not its own")
    for topic in own:
        if topic.name in participant.topics and not node.bench.received(topic):
            raise BreachError(f"'topics' has {topic.name}, but nothing was published there")


@requirement('publishers', 'publishes with the types and the quality of service of its topics')
def _check_publishers(node: NodeUnderTest) -> None:
    node.begin_run(1)
    required = (PARTICIPANTS, node.contract.answer)
    for topic in dict.fromkeys((*required, *node.contract.topics)):
        offers = node.bench.offers(topic)
        if topic in required and not offers:
            raise BreachError(f'nothing publishes on {topic.name!r}')
        due = Offer(topic.type_name, is_reliable=True, is_latched=topic.latched_depth > 0)
        for offer in offers:
            if offer != due:
                raise BreachError(f'{topic.name!r} is {offer}, not {due}')


@requirement('every stamp', 'answers each due stamp once, and no other')
def _check_every_stamp(node: NodeUnderTest) -> None:
    node.begin_run(SERIES)


@requirement('values', 'sends values that its readers can use')
def _check_values(node: NodeUnderTest) -> None:
    node.begin_run(SERIES)
    for data in node.answers():
        node.read(data)


@requirement('asked again', 'repeats its answer when asked again')
def _check_repetition(node: NodeUnderTest) -> None:
    node.join()
    node.ask()
    first = node.tick
    node.drive(FEW - 1)
    if node.contract.acknowledges:
        before = len(node.answers())
        node.call_roll()
        if not node.bench.wait(lambda: len(node.answers()) > before, ANSWER_S):
            raise BreachError('a roll call does not make it repeat its acknowledgement')
        return
    is_same = same_content(node.contract.answer.type_name)
    # The recorder may lack an earlier sample of a driver; a controller repeats only its newest.
    for tick in (node.tick,) if node.contract.role == CONTROLLER else (node.tick, first):
        answers, at = node.answers_to(tick.stamp_ns), seconds_text(tick.stamp_ns)
        for count in range(2):
            node.send_again(tick)
            if not node.await_answers(tick.stamp_ns, len(answers) + count + 1):
                raise BreachError(f'asked again at {at}, it does not answer')
        for data in node.answers_to(tick.stamp_ns):
            if not is_same(answers[0], data):
                raise BreachError(f'asked again at {at}, it gives another answer')
    node.settle()
    node.judge()


@requirement(
    'inputs', 'does not answer a tick before its inputs are there', roles=(CONTROLLER, RECORDER)
)
def _check_inputs(node: NodeUnderTest) -> None:
    node.begin_run(FEW)
    if node.contract.role == CONTROLLER:
        # It need not use both, but without either it has measured nothing.
        _check_late_inputs(node, [GYRO_IMU, JOINT_STATES])
    else:
        for topic in TOPICS:
            if topic.period_ns and topic is not CLOCK:
                _check_late_inputs(node, [topic])
    node.drive(FEW)


def _check_late_inputs(node: NodeUnderTest, topics: Sequence[Topic]) -> None:
    """Check that it does not answer a tick before the messages on some topics have come."""
    period_ns = max(topic.period_ns for topic in topics)
    while (node.tick.stamp_ns + TICK_NS) % period_ns:
        node.ask()
    node.send_next(without=topics)
    stamp_ns, names = node.tick.stamp_ns, ' and '.join(repr(topic.name) for topic in topics)
    if node.bench.wait(lambda: node.is_answered(stamp_ns), QUIET_S):
        raise BreachError(f'it answers {seconds_text(stamp_ns)} before {names}')
    for topic, data in node.tick.messages:
        if topic in topics:
            node.bench.publish(topic, data)
    if not node.await_answers(stamp_ns):
        raise BreachError(f'{node.silence(stamp_ns)} after {names} came late')


@requirement('roll call', 'answers a roll call in mid-run, with the stamp of its newest answer')
def _check_roll_call(node: NodeUnderTest) -> None:
    node.begin_run(FEW)
    newest_ns = node.tick.stamp_ns
    due_ns = newest_ns - newest_ns % node.contract.period_ns
    answered_ns = node.announcement().answered_ns
    if answered_ns != due_ns:
        raise BreachError(f"'answered [ns]' is {answered_ns}, not {due_ns}")


@requirement('silence', 'sends nothing unasked, and goes on after a silence')
def _check_silence(node: NodeUnderTest) -> None:
    node.begin_run(FEW)
    before = len(node.answers())
    node.bench.wait(lambda: False, SILENCE_S)
    sent = node.answers()[before:]
    if sent and not node.contract.acknowledges:
        raise BreachError(f'it sends {seconds_text(stamp_of(sent[0]))} unasked')
    node.drive(FEW)


@requirement('reset', 'joins the next run, and starts from its initial state')
def _check_reset(node: NodeUnderTest) -> None:
    if node.contract.role != CONTROLLER:
        for _ in range(2):
            node.begin_run(SERIES)
        return
    first, second = _duties(node), _duties(node)
    for elapsed_ns, duty in first.items():
        if second[elapsed_ns] != duty:
            raise BreachError(
                f'after a reset, its duties {seconds_text(elapsed_ns)} after the start are '
                f'{second[elapsed_ns]}, not {duty} as before'
            )


def _duties(node: NodeUnderTest) -> dict[int, object]:
    """Return the duties of a run by the time since its start [ns]."""
    node.begin_run(LONG)
    return {stamp_of(data) - node.run.start_ns: node.read(data) for data in node.answers()}


@requirement('earlier run', 'ignores messages of an earlier run')
def _check_earlier_run(node: NodeUnderTest) -> None:
    node.begin_run(FEW)
    old = node.tick
    node.join()
    node.send_again(old)
    node.drive(FEW)


@requirement('next plant', 'serves the next plant, whose time begins again')
def _check_next_plant(node: NodeUnderTest) -> None:
    node.begin_run(FEW)
    node.replace_plant()
    node.begin_run(FEW)


@requirement(
    'restart',
    'takes part again after it was killed in mid-run; a controller may object',
    restarts=True,
)
def _check_restart(node: NodeUnderTest) -> None:
    node.begin_run(FEW)
    old, instance = node.tick, node.announcement().participant.instance
    node.restart()
    if node.announcement().participant.instance == instance:
        raise BreachError(f'the restarted node has the same instance, {instance!r}')
    node.send_next()
    while node.tick.stamp_ns % COMMON_PERIOD_NS:  # up to a tick that every role answers
        node.send_next()
    stamp_ns = node.tick.stamp_ns
    may_object = node.contract.role == CONTROLLER

    def is_back() -> bool:
        return node.is_answered(stamp_ns) or (may_object and bool(node.objection()))

    if not node.repeat_until(is_back):
        raise BreachError(f'{node.silence(stamp_ns)} after a restart')
    if node.contract.role in DRIVERS:
        _check_same_answer(node, old)


def _check_same_answer(node: NodeUnderTest, tick: TickMessages) -> None:
    """Check that a restarted driver answers as the one before."""
    before = node.answers_to(tick.stamp_ns)
    node.send_again(tick)
    if not node.await_answers(tick.stamp_ns, len(before) + 1):
        raise BreachError(
            f'after a restart, it does not answer {seconds_text(tick.stamp_ns)} again'
        )
    is_same = same_content(node.contract.answer.type_name)
    if not is_same(before[0], node.answers_to(tick.stamp_ns)[-1]):
        raise BreachError(
            f'after a restart, it changes its answer to {seconds_text(tick.stamp_ns)}'
        )
