"""The test of a node against its contract: nodes in memory that are right, or wrong in one way."""

from collections import Counter
from dataclasses import dataclass, field
from itertools import count

import pytest

from ballbot_ros.errors import BallbotError
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import Announcement, Objection, Participant
from ballbot_ros.nodes.conformance import contract
from ballbot_ros.nodes.conformance.contract import CONTRACTS, START_S, Offer, nominal_run
from ballbot_ros.nodes.conformance.examination import (
    DISCOVERY_S,
    FEW,
    REQUIREMENTS,
    SERIES,
    SILENCE_S,
    RequirementVerdict,
    examine,
)
from ballbot_ros.parameters import CONTROLLER, DRIVERS, GAMEPAD, GYRO, RECORDER, ROLES, SONAR
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_NS
from ballbot_ros.recording.messages.conversions import encode_duty, encode_header, encode_sticks
from ballbot_ros.recording.messages.devices import encode_encoders, encode_gyro, encode_sonar
from ballbot_ros.recording.messages.raw import decoder, stamp_of
from ballbot_ros.recording.messages.run_reports import encode_announcement
from ballbot_ros.recording.messages.topics import (
    CLOCK,
    GYRO_IMU,
    JOINT_STATES,
    MOTOR_DUTY,
    PARTICIPANTS,
    PLANT_ODOM,
    PLANT_STEPS,
    ROLL_CALL,
    SONAR_RANGE,
    TOPICS,
)

decode_header = decoder(ROLL_CALL.type_name)
ANSWERS = {
    GYRO: lambda ns, tick: encode_gyro(ns, (600 + tick, 600)),
    'encoder_driver': lambda ns, tick: encode_encoders(ns, (tick, 0)),
    SONAR: lambda ns, tick: encode_sonar(ns, tick % 255),
    GAMEPAD: lambda ns, tick: encode_sticks(ns, (tick % 100, 0), 'mine'),
    CONTROLLER: lambda ns, tick: encode_duty(ns, (tick % 7, -tick % 5)),
    RECORDER: lambda ns, tick: encode_header(ns),
}
UNREADABLE = {
    GYRO: lambda ns: encode_gyro(ns, (600, 600))[:20],
    'encoder_driver': lambda ns: encode_encoders(ns, (0, 0))[:20],
    SONAR: lambda ns: encode_sonar(ns, 256),
    GAMEPAD: lambda ns: encode_sticks(ns, (0, 0), 'mine')[:20],
    CONTROLLER: lambda ns: encode_duty(ns, (101, 0)),
}


@dataclass
class Node:
    """A node of a role that meets its contract, except for a fault."""

    role: str
    fault: str
    generation: int
    send: object
    run: RunIdentity | None = None
    newest_ns: int = 0
    answered_ns: int = 0
    ticks: int = 0
    calls: int = 0
    given: dict = field(default_factory=dict)
    inputs: set = field(default_factory=set)
    objection: Objection | None = None

    @property
    def contract(self):
        return CONTRACTS[self.role]

    def take(self, topic, data):
        if topic is ROLL_CALL:
            header = decode_header(data)
            self._answer_call(RunIdentity(header.frame_id, stamp_of(data)))
            return
        if topic is CLOCK:
            self.newest_ns = stamp_of(data)
            self.inputs.clear()
        self.inputs.add(topic)
        if self.run and self._is_complete_by(topic):
            self._answer(self.newest_ns)

    def _is_complete_by(self, topic):
        if self.role in DRIVERS or self.fault == 'answers before its inputs':
            return topic is PLANT_ODOM
        needed = {JOINT_STATES} if self.fault == 'uses no gyro' else {GYRO_IMU, JOINT_STATES}
        if self.role == RECORDER:
            needed = {
                each
                for each in TOPICS
                if each.period_ns
                and self.newest_ns % each.period_ns == 0
                and each is not self.unneeded
            }
        return topic in needed and needed <= self.inputs

    @property
    def unneeded(self):
        """The topic that a careless recorder forgets."""
        return {'forgets the duties': MOTOR_DUTY, 'forgets the sonar': SONAR_RANGE}.get(self.fault)

    def _answer_call(self, run):
        if self.fault == 'ignores every roll call':
            return
        if self.fault == 'ignores the next plant' and self.run and run.plant != self.run.plant:
            return
        if self.fault == 'joins only one run' and self.run:
            run = self.run
        if run != self.run:
            if self.fault == 'acknowledges again late' and self.answered_ns:
                self.send(self.contract.answer, encode_header(self.answered_ns))
            self.run, self.answered_ns, self.calls = run, 0, 0
            if self.fault != 'keeps its state':
                self.ticks = 0
            if self.fault != 'answers an earlier run':
                self.given.clear()
        self.calls += 1
        if self.fault == 'answers one roll call a run' and self.calls > 1:
            return
        self._announce()
        if self.role == RECORDER and self.answered_ns and self.fault != 'does not repeat':
            self.send(self.contract.answer, encode_header(self.answered_ns))

    def _announce(self):
        fault = self.fault
        topics = (self.contract.answer.name,) if self.contract.answer.period_ns else ()
        if fault == 'announces no topics':
            topics = ()
        if fault in ('announces foreign topics', 'announces no topics') and not topics:
            topics = ('plant/odom',)
        participant = Participant(
            role='gyro' if fault == 'announces another role' else self.role,
            node='mine' if fault == 'has a relative name' else '/mine',
            host='' if fault == 'does not name its host' else 'here',
            process=1,
            instance='same' if fault == 'keeps its instance' else f'{self.generation}',
            implementation='mine 1.0',
            parameters_sha256='00',
            topics=topics,
            parameters={'delay': -1} if fault == 'announces an impossible delay' else {},
        )
        answered_ns = 0 if fault == 'does not say what it has answered' else self.answered_ns
        data = encode_announcement(
            Announcement(participant, self.run.name, answered_ns, self.objection)
        )
        if fault == 'sends an announcement without a role':
            data = data.replace(b'role\0', b'rolf\0')
        self.send(PARTICIPANTS, data)

    def _answer(self, stamp_ns):
        run, fault = self.run, self.fault
        if stamp_ns < run.start_ns and fault != 'answers an earlier run':
            return
        if fault == 'knows no earlier time' and stamp_ns < max(self.given, default=0):
            return
        if fault == 'is silent after a restart' and self.generation > 1:
            return
        if self.role == CONTROLLER and not self.given and stamp_ns > run.start_ns:
            self.objection = Objection('it started in mid-run')
            self._announce()
            return
        is_due = stamp_ns % self.contract.period_ns == 0
        if fault == 'answers undue stamps':
            is_due = True
        if not is_due:
            return
        tick = (stamp_ns - run.start_ns) // TICK_NS
        if fault == 'skips a tick' and tick == 40:
            return
        if stamp_ns in self.given:
            if fault != 'does not repeat':
                again = self._sample(stamp_ns, 99) if fault == 'repeats another answer' else None
                for _ in range(3 if fault == 'answers again three times' else 1):
                    self.send(self.contract.answer, again or self.given[stamp_ns])
            return
        self.ticks += 1
        self.answered_ns = stamp_ns
        number = self.ticks if self.role == CONTROLLER else tick
        if fault == 'answers at random':
            number += 50 * self.generation
        self.given[stamp_ns] = self._sample(stamp_ns, number)
        for _ in range(2 if fault == 'answers twice' else 1):
            self.send(self.contract.answer, self.given[stamp_ns])

    def _sample(self, stamp_ns, number):
        if self.fault == 'sends unreadable values':
            return UNREADABLE[self.role](stamp_ns)
        if self.fault == 'answers with an older stamp':
            stamp_ns -= 5 * TICK_NS
        if self.fault == 'is ahead of the run':
            stamp_ns += 5 * TICK_NS
        return ANSWERS[self.role](stamp_ns, number)

    def pass_time(self, seconds):
        """Let time pass in which nothing arrives."""
        if self.fault == 'sends unasked' and self.given and seconds == SILENCE_S:
            self.send(self.contract.answer, self._sample(self.answered_ns, 1))


class MemoryBench:
    """A bench whose node is an object: a message has its effect before `publish` returns."""

    def __init__(self, role, fault='', *, can_start=True):
        self.role, self.fault, self.can_start = role, fault, can_start
        self.messages = {topic: [] for topic in (PARTICIPANTS, *CONTRACTS[role].topics)}
        self.node, self.generation, self.latched = None, 0, b''
        self.limits = Counter()
        if not can_start:
            self.start()

    @property
    def end(self):
        return '' if self.node else 'it has ended'

    def start(self):
        self.generation += 1
        self.node = Node(self.role, self.fault, self.generation, self.send)
        if self.latched and self.fault != 'misses earlier roll calls':
            self.node.take(ROLL_CALL, self.latched)

    def kill(self):
        self.node = None

    def send(self, topic, data):
        self.messages[topic].append(data)

    def publish(self, topic, data):
        if topic is ROLL_CALL:
            self.latched = data
        if self.node:
            self.node.take(topic, data)
            if self.fault == 'dies' and len(self.received(CONTRACTS[self.role].answer)) > 600:
                self.kill()

    def received(self, topic):
        return self.messages[topic]

    def offers(self, topic):
        if topic not in (PARTICIPANTS, CONTRACTS[self.role].answer) or not self.node:
            return []
        if topic is PARTICIPANTS:
            return [Offer(topic.type_name, True, self.fault != 'is volatile')]
        kind = 'std_msgs/msg/String' if self.fault == 'has another type' else topic.type_name
        found = [Offer(kind, self.fault != 'is best effort', self.fault == 'is latched')]
        return [] if self.fault == 'publishes nothing' else found

    def wait(self, is_done, limit_s):
        if is_done():
            return True
        self.limits[limit_s] += 1
        if self.node:
            self.node.pass_time(limit_s)
        return is_done()


_RUNS = {}


@pytest.fixture(autouse=True)
def remember_runs(monkeypatch):
    """Compute each nominal run once: it depends on role and start only."""

    def remembered(role, start_ns):
        known, ticks = _RUNS.setdefault((role, start_ns), ([], nominal_run(role, start_ns)))
        for number in count():
            if number == len(known):
                known.append(next(ticks))
            yield known[number]

    monkeypatch.setattr(contract, 'nominal_run', remembered)


def rows_of(role, fault='', **options):
    return list(examine(role, MemoryBench(role, fault, **options), 'token'))


def failed(rows):
    return {row.name: row.reason for row in rows if row.verdict is RequirementVerdict.FAILED}


def names(role):
    return [each.name for each in REQUIREMENTS if role in each.roles]


SAMPLING = (*DRIVERS, CONTROLLER)
ALONE = {
    'announces foreign topics': ('announcement', (RECORDER,)),
    'announces no topics': ('announcement', ROLES),
    'announces an impossible delay': ('announcement', (GYRO, 'encoder_driver', SONAR)),
    'does not name its host': ('announcement', ROLES),
    'has a relative name': ('announcement', ROLES),
    'is volatile': ('publishers', ROLES),
    'is latched': ('publishers', ROLES),
    'has another type': ('publishers', ROLES),
    'is best effort': ('publishers', ROLES),
    'publishes nothing': ('publishers', ROLES),
    'sends unreadable values': ('values', DRIVERS),
    'does not repeat': ('asked again', DRIVERS),
    'answers before its inputs': ('inputs', (CONTROLLER, RECORDER)),
    'forgets the duties': ('inputs', (RECORDER,)),
    'forgets the sonar': ('inputs', (RECORDER,)),
    'answers at random': ('restart', DRIVERS),
    'answers again three times': ('asked again', DRIVERS),
    'does not say what it has answered': ('roll call', ROLES),
    'sends unasked': ('silence', SAMPLING),
    'keeps its state': ('reset', (CONTROLLER,)),
    'answers an earlier run': ('earlier run', SAMPLING),
    'keeps its instance': ('restart', ROLES),
    'is silent after a restart': ('restart', ROLES),
}
"""Faults that fail the one requirement that they are about, and the roles that can have them."""

WITH_OTHERS = {
    'knows no earlier time': ('asked again', (GYRO,)),
    'misses earlier roll calls': ('late start', ROLES),
    'sends unreadable values': ('values', (CONTROLLER,)),
    'announces another role': ('announcement', ROLES),
    'sends an announcement without a role': ('announcement', ROLES),
    'skips a tick': ('every stamp', ROLES),
    'answers twice': ('every stamp', SAMPLING),
    'answers undue stamps': ('every stamp', (SONAR, GAMEPAD)),
    'answers with an older stamp': ('every stamp', ROLES),
    'is ahead of the run': ('every stamp', ROLES),
    'repeats another answer': ('asked again', (GYRO, CONTROLLER)),
    'answers one roll call a run': ('roll call', ROLES),
    'joins only one run': ('reset', ROLES),
    'ignores the next plant': ('next plant', ROLES),
    'dies': ('reset', (CONTROLLER,)),
}
"""Faults that also fail requirements that build on the one that they are about."""


@pytest.mark.parametrize('role', ROLES)
def test_a_right_node_meets_every_requirement(role):
    rows = rows_of(role)
    assert [row.name for row in rows] == names(role)
    assert failed(rows) == {}
    assert {row.verdict for row in rows} == {RequirementVerdict.MET}


@pytest.mark.parametrize('role', ROLES)
def test_without_a_command_nothing_is_restarted(role):
    bench = MemoryBench(role, can_start=False)
    rows = list(examine(role, bench, 'token'))
    untested = [row.name for row in rows if row.verdict is RequirementVerdict.NOT_TESTED]
    assert untested == ['late start', 'restart']
    assert failed(rows) == {}
    assert bench.generation == 1


@pytest.mark.parametrize(('fault', 'about', 'roles'), [(f, *rest) for f, rest in ALONE.items()])
def test_a_fault_fails_the_requirement_that_it_is_about(fault, about, roles):
    for role in roles:
        assert failed(rows_of(role, fault)).keys() == {about}, role


@pytest.mark.parametrize(
    ('fault', 'about', 'roles'), [(f, *rest) for f, rest in WITH_OTHERS.items()]
)
def test_a_grave_fault_fails_others_too(fault, about, roles):
    for role in roles:
        assert about in failed(rows_of(role, fault)), role


@pytest.mark.parametrize('role', ROLES)
def test_every_requirement_can_fail(role):
    about = {name for name, roles in (*ALONE.values(), *WITH_OTHERS.values()) if role in roles}
    # The recorder's answers are stamps only, and it may repeat them.
    harmless = {RECORDER: {'values', 'asked again', 'silence', 'earlier run'}}
    assert about == set(names(role)) - harmless.get(role, set())


def test_after_a_node_that_never_joins_nothing_else_is_tested():
    for options in ({}, {'can_start': False}):
        bench = MemoryBench(GYRO, 'ignores every roll call', **options)
        first, *others = [row for row in examine(GYRO, bench, 'token') if row.reason[:4] != 'give']
        assert (first.verdict, first.reason) == (
            RequirementVerdict.FAILED,
            'it does not join the run',
        )
        assert {row.verdict for row in others} == {RequirementVerdict.NOT_TESTED}
        assert {row.reason for row in others} == {'the node has never joined a run'}
        assert bench.limits == {START_S: 1} | ({DISCOVERY_S: 1} if bench.can_start else {})


def test_a_controller_need_not_use_the_gyro():
    assert failed(rows_of(CONTROLLER, 'uses no gyro')) == {}


def test_a_controller_may_answer_each_repeated_input():
    assert failed(rows_of(CONTROLLER, 'answers again three times')) == {}


def test_an_acknowledgement_that_was_sent_before_the_run_may_be_late():
    assert failed(rows_of(RECORDER, 'acknowledges again late')) == {}


@pytest.mark.parametrize('role', ROLES)
def test_with_a_node_in_the_role_already_the_command_is_not_started(role):
    bench = MemoryBench(role)
    bench.start()
    with pytest.raises(BallbotError, match='is running already: end it, or omit COMMAND'):
        list(examine(role, bench, 'token'))
    assert bench.generation == 1


def test_a_recorder_that_does_not_repeat_itself_fails():
    assert 'asked again' in failed(rows_of(RECORDER, 'does not repeat'))


@pytest.mark.parametrize(
    ('role', 'fault', 'name', 'reason'),
    [
        (
            GYRO,
            'skips a tick',
            'every stamp',
            'no answer to 1.460 s; its newest one is stamped 1',
        ),
        (GYRO, 'answers twice', 'every stamp', 'it answers 1.300 s 2 times'),
        (CONTROLLER, 'sends unreadable values', 'values', 'the duties are not whole numbers'),
        (GYRO, 'announces no topics', 'announcement', "'topics' lacks gyro"),
        (GYRO, 'is best effort', 'publishers', "'gyro' is sensor_msgs/msg/Imu, best effort, vol"),
        (GYRO, 'is best effort', 'publishers', 'not sensor_msgs/msg/Imu, reliable, volatile'),
        (GYRO, 'announces another role', 'values', "it announces the role 'gyro'"),
        (
            CONTROLLER,
            'keeps its state',
            'reset',
            'after a reset, its duties 0.000 s after',
        ),
    ],
)
def test_the_reason_says_what_where_and_what_is_expected(role, fault, name, reason):
    assert reason in failed(rows_of(role, fault))[name]


def test_the_run_around_a_node_lacks_only_its_own_messages():
    for role in ROLES:
        ticks = nominal_run(role, FIRST_TICK_NS)
        first = next(ticks)
        sent = {topic for topic, _ in first.messages}
        assert {topic.publisher for topic in sent}.isdisjoint({role})
        assert sent | set(CONTRACTS[role].topics) >= {
            CLOCK, PLANT_ODOM, PLANT_STEPS, GYRO_IMU, MOTOR_DUTY,
        }  # fmt: skip
        assert first.repeated()[:2] == (first.messages[0], first.battery)
        second = next(ticks)
        assert second.battery == first.battery
        assert second.stamp_ns - first.stamp_ns == TICK_NS


def test_the_series_reach_a_second_sample_of_slow_devices():
    assert SERIES > FEW > 20_000_000 // TICK_NS
