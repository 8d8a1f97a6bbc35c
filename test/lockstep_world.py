"""A graph without ROS around the master of a run: nodes that answer, hang, die and return.

Messages are in flight until they are delivered, so that a test can reorder, repeat or lose them.
Time passes only if a test lets it pass.
"""

import dataclasses
import operator
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from ballbot_ros.engine.plant import Plant
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.lockstep import run_actions as do
from ballbot_ros.lockstep.liveness import Observation, ThreadTime
from ballbot_ros.lockstep.lockstep_master import LockstepMaster
from ballbot_ros.lockstep.participants import Announcement, Objection, Participant, Publisher
from ballbot_ros.lockstep.run_actions import RunSetup
from ballbot_ros.parameters import (
    ALL_NODES,
    CONTROLLER,
    DRIVER_PERIODS_NS,
    DRIVERS,
    PLANT,
    RECORDER,
    PlantParameters,
)
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.messages.topics import RUN_TOPICS
from ballbot_ros.robot.brick.brick import MotorDuty
from ballbot_ros.robot.world.world import World

TOPICS = dataclasses.replace(RUN_TOPICS, is_same_duty=operator.eq)
ROLES = (*DRIVERS, CONTROLLER)
WATCH_S = 0.1
FREE_PERIODS_S = {'on_time': WATCH_S, 'on_tick': TICK_NS / 1e9}
LATENCY_S = 2e-4
"""Time from the arrival of one message to the next."""

WAITING = {1: ThreadTime(cpu_s=1.0, queued_s=0.0, is_runnable=False)}


def duty_of(stamp_ns):
    """Return the duty of this world's controller at a tick."""
    tick = stamp_ns // TICK_NS
    return tick % 7 - 3, tick % 5 - 2


def is_due(role, stamp_ns):
    """Return whether a driver has a sample at a stamp."""
    return stamp_ns % DRIVER_PERIODS_NS[role] == 0


def data_of(stamp_ns, duty):
    return f'{stamp_ns} {duty}'.encode()


@dataclass
class FakeNode:
    """A participant other than the plant.

    Attributes
    ----------
    participant : Participant
    samples : set of int
        Stamps that it has answered [ns].
    is_alive, is_hung : bool
    late_ns : int
        How much too old the stamps of its samples are [ns].
    is_mute : bool
        Whether it sends no samples, but answers roll calls.
    awaits, expects : dict
        What it says that it awaits before it answers a tick, and afterwards.
    """

    participant: Participant
    samples: set[int] = field(default_factory=set)
    is_alive: bool = True
    is_hung: bool = False
    late_ns: int = 0
    run: str = ''
    objection: Objection | None = None
    is_mute: bool = False
    awaits: dict[str, int | None] = field(default_factory=dict)
    expects: dict[str, int | None] = field(default_factory=dict)

    @property
    def role(self):
        return self.participant.role

    @property
    def answers(self):
        return self.is_alive and not self.is_hung

    def announcement(self):
        answered_ns = max(self.samples, default=0)
        awaits = self.awaits or self.expects
        return Announcement(self.participant, self.run, answered_ns, self.objection, awaits)


def make_participant(role, generation=0, **changes):
    """Return a participant; each generation is another process."""
    return Participant(
        role=role,
        node=f'/{role}',
        host='here',
        process=100 * generation + ALL_NODES.index(role) + 1,
        instance=f'{role} {generation}',
        implementation='ours',
        parameters_sha256='00',
        guid_prefix=f'{role} {generation}|'.encode().hex(),
        topics=tuple(name for name, roles in TOPICS.owners.items() if roles == (role,)),
        **changes,
    )


class FakeGraph:
    """The graph of a world's nodes, as the master sees it."""

    def __init__(self, world):
        self._world = world
        self.clocks = 1
        self.complete = True
        self.present = {}
        self.strangers = {}
        self.heard_messages = []
        self.is_listening = False

    def is_complete(self):
        return self.complete

    def present_nodes(self):
        return self.present

    def publishers(self):
        found = {topic: list(self.strangers.get(topic, ())) for topic in TOPICS.owners}
        for node in (self._world.plant_node, *self._world.in_graph):
            for topic, roles in TOPICS.owners.items():
                if node.role in roles and (node.role != PLANT or topic != TOPICS.duty):
                    gid = f'{node.participant.instance}|{topic}'.encode()
                    found[topic].append(Publisher(gid, node.participant.node))
        return found

    def count_publishers(self, topic):
        if topic == TOPICS.clock:
            return self.clocks
        return sum(topic == TOPICS.ack and node.role == RECORDER for node in self._world.in_graph)

    def received(self, topics):
        self.is_listening = self.is_listening or bool(topics)
        heard = [(topic, stamp_ns) for topic, stamp_ns in self.heard_messages if topic in topics]
        self.heard_messages = [each for each in self.heard_messages if each not in heard]
        return heard

    def stop_listening(self):
        self.is_listening = False


class FakeProcessObserver:
    """Processes that always get all the processor time that they need.

    Attributes
    ----------
    started : list of LocalNode
        The nodes that were started together with the plant.
    """

    def __init__(self, world):
        self._world = world
        self.started = []

    def observe(self, processes):
        nodes = [self._world.plant_node, *self._world.nodes.values()]
        living = {node.participant.process for node in nodes if node.is_alive}
        return Observation(self._world.now_s, dict.fromkeys(living & set(processes), WAITING))

    def started_nodes(self):
        return self.started


class LockstepWorld:
    """The master, its nodes, and the messages in flight between them.

    Attributes
    ----------
    done : list of Action
        All actions of the master so far.
    in_flight : deque of callable
        Messages to the master that are still to be delivered.
    """

    kind: Callable = LockstepMaster
    periods_s: Mapping = MappingProxyType({'on_time': WATCH_S})

    @property
    def wake_s(self):
        return self.calls_s.get('on_wake')

    def __init__(self, scenario=None, /, **values):
        self.now_s = 1000.0
        given = {'duration': 0.2, 'real_time_factor': 0.0, **values}
        self.parameters = PlantParameters(**given)
        self.scenario = scenario or Scenario()
        self.plant_node = FakeNode(make_participant(PLANT))
        self.nodes = {}
        self.in_graph = []
        self.graph = FakeGraph(self)
        self.in_flight = deque()
        self.done = []
        self.calls_s = {event: self.now_s + period for event, period in self.periods_s.items()}
        self.process_observer = FakeProcessObserver(self)
        self.master = self.kind(
            self.graph, self.process_observer, TOPICS, self._set_up, 'token', self.now_s
        )

    def _set_up(self, start_ns):
        world = World.of(self.parameters)
        return RunSetup(
            parameters=self.parameters,
            plant=Plant(self.parameters, start_ns, world),
            world=world,
            scenario=self.scenario,
            participant=self.plant_node.participant,
        )

    # The nodes

    def start(self, *roles, generation=0, **changes):
        """Start nodes, which join at the next roll call."""
        for role in roles or ROLES:
            node = FakeNode(make_participant(role, generation, **changes))
            self.nodes[role] = node
            self.in_graph.append(node)
        return self

    def kill(self, role):
        """Kill a node; its publishers stay in the graph."""
        self.nodes[role].is_alive = False

    def leave(self, role):
        """End a node in an orderly way: its publishers leave the graph."""
        self.nodes[role].is_alive = False
        self.in_graph.remove(self.nodes[role])

    # The master

    def dispatch(self, event, *what, **details):
        """Pass an event to the master; return the resulting actions."""
        actions = event(self.now_s, *what, **details)
        for action in actions:
            self._carry_out(action)
        self.done += actions
        return actions

    def _carry_out(self, action):
        match action:
            case do.CallRoll(run):
                for node in self.nodes.values():
                    if node.answers:
                        if node.run != run.name:
                            self._join(node, run)
                        self._announce(node)
            case do.PublishTruth(truth) | do.ResendToDrivers(truth):
                self._answer(truth)
            case do.WakeIn(delay_s):
                self.calls_s['on_wake'] = self.now_s + delay_s
            case do.CancelWake():
                self.calls_s.pop('on_wake', None)

    def _join(self, node, run):
        node.run, node.objection = run.name, None
        node.samples.clear()

    def _announce(self, node):
        announcement = node.announcement()
        self.send(self.master.on_announcement, announcement)

    def _answer(self, truth):
        """Let the nodes answer a tick, as far as they can."""
        stamp_ns = truth.stamp_ns
        for role in DRIVERS:
            node = self.nodes.get(role)
            if node and node.answers and node.run and is_due(role, stamp_ns) and not node.is_mute:
                node.samples.add(stamp_ns)
        senders = [
            self.nodes[role] for role in DRIVERS if role in self.nodes and is_due(role, stamp_ns)
        ]
        controller = self.nodes.get(CONTROLLER)
        if controller and controller.answers and controller.run:
            controller.awaits = {
                topic: stamp_ns - node.late_ns if node.late_ns and node.answers else None
                for node in senders
                if node.late_ns or stamp_ns not in node.samples
                for topic in node.participant.topics
            }
            if not controller.awaits:
                controller.samples.add(stamp_ns)
                self.send_duty(stamp_ns - controller.late_ns)

    def send_duty(self, stamp_ns, duty=None):
        duty = MotorDuty(*(duty or duty_of(stamp_ns)))
        self.send(self.master.on_duty, stamp_ns, duty, data_of(stamp_ns, duty))
        recorder = self.nodes.get(RECORDER)
        if recorder and recorder.answers and recorder.run:
            recorder.samples.add(stamp_ns)
            self.send(self.master.on_ack, max(recorder.samples) - recorder.late_ns)

    def send(self, event, *what):
        self.in_flight.append((event, what))

    # Time

    def arriving(self):
        """Return the index of the next message to arrive, None if there is none."""
        return 0 if self.in_flight else None

    def deliver(self):
        """Deliver one message, which takes time; return whether there was one."""
        index = self.arriving()
        if index is None:
            return False
        self.now_s += LATENCY_S
        event, what = self.in_flight[index]
        del self.in_flight[index]
        self.receive(event, *what)
        return True

    def receive(self, event, *what):
        """Pass a message to its receiver."""
        self.dispatch(event, *what)

    def wait(self, seconds=WATCH_S):
        """Let time pass: messages arrive, and the master is called when due."""
        end_s = self.now_s + seconds
        while True:
            event = min(self.calls_s, key=self.calls_s.__getitem__)
            due_s = self.calls_s[event]
            if self.now_s + LATENCY_S < min(due_s, end_s) and self.deliver():
                continue
            if due_s <= end_s + 1e-9:
                self._call(event)
            else:
                self.now_s = end_s
                return self

    def _call(self, event):
        """Call the master at its due time, and schedule the next call."""
        self.now_s = max(self.now_s, self.calls_s.pop(event))
        if event in self.periods_s:
            self.calls_s[event] = self.now_s + self.periods_s[event]
        self.dispatch(getattr(self.master, event))

    def advance(self, ticks):
        """Deliver messages until the run has done this many ticks."""
        while self.ticks < ticks:
            if not self.deliver():
                self.wait()
        return self

    def settle(self):
        """Deliver messages until there are no more."""
        while self.deliver():
            pass
        return self

    # History

    def actions(self, kind):
        return [action for action in self.done if isinstance(action, kind)]

    @property
    def truths(self):
        """Stamps of the truths published for the first time [ns]."""
        return [each.truth.stamp_ns for each in self.actions(do.PublishTruth) if not each.is_resend]

    @property
    def ticks(self):
        return self.master.log.ticks

    @property
    def summary(self):
        return self.master.summary

    @property
    def warnings(self):
        return [action.text for action in self.actions(do.Warn)]

    @property
    def logged(self):
        return [action.text for action in self.actions(do.Log)]
