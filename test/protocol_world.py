"""The whole protocol of a run in one process, with its own clock and a network that loses.

Each node here carries out the decisions of the same objects as the node of the graph: the master
of the run with its roster, the controller's ticks and timers, the drivers' devices, the gamepad's
arbiter, and the recorder's gate. The messages have the bytes of the graph.

What the network does to them is what Fast DDS does: messages of one publisher on one topic to one
reader keep their order; everything else has any order. A message is lost if its reader has not been
discovered yet, if its queue is full, or if its publisher or its reader dies before it is taken.
"""

import hashlib
import heapq
import math
import operator
import random
from collections import Counter
from functools import cache
from types import MappingProxyType

from robot_world import Brick

from ballbot_ros.engine.plant import Plant
from ballbot_ros.lockstep import run_actions as do
from ballbot_ros.lockstep.liveness import Observation, ThreadTime
from ballbot_ros.lockstep.lockstep import DEPTH, GivenAnswers, RunIdentity
from ballbot_ros.lockstep.lockstep_master import LockstepMaster
from ballbot_ros.lockstep.participants import (
    Announcement,
    LocalNode,
    Objection,
    Participant,
    Publisher,
    RunMember,
)
from ballbot_ros.lockstep.recording_order import ArrivalOrder, Stream
from ballbot_ros.lockstep.run_actions import RunSetup
from ballbot_ros.lockstep.run_recording import RunRecording
from ballbot_ros.nodes.teleop.sticks import Arbiter
from ballbot_ros.parameters import (
    CONTROLLER,
    GAMEPAD,
    PLANT,
    RECORDER,
    ROLES,
    ControllerParameters,
    PlantParameters,
)
from ballbot_ros.parameters.timing import RESEND_S, SLOW_PERIOD_NS
from ballbot_ros.recording.messages.conversions import decode_duty, encode_sticks, is_stop
from ballbot_ros.recording.messages.devices import DEVICE_MESSAGES, INPUT_READERS
from ballbot_ros.recording.messages.raw import same_content, stamp_of
from ballbot_ros.recording.messages.run_messages import ControllerMessages, PlantMessages
from ballbot_ros.recording.messages.run_reports import run_status
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CLOCK,
    GAMEPAD_JOY,
    HISTORY,
    LOCKSTEP_PUBLISHERS,
    MOTOR_DUTY,
    PARTICIPANTS,
    PLANT_SLOW_ODOM,
    RECORDER_ACK,
    ROLL_CALL,
    RUN,
    RUN_STATUS,
    RUN_TOPICS,
    periodic_topics,
)
from ballbot_ros.robot.world.world import World

DRIVER_NODES = {each.sample.publisher: each for each in DEVICE_MESSAGES}
PERIODIC = {topic.name: topic for role in (PLANT, *ROLES) for topic in periodic_topics(role)}
TOPICS_OF = {
    role: tuple(topic.name for topic, roles in LOCKSTEP_PUBLISHERS.items() if role in roles)
    for role in (PLANT, RECORDER, CONTROLLER, GAMEPAD, *DRIVER_NODES)
}
STREAM_TOPICS = (*PERIODIC.values(), RUN, RUN_STATUS)
NUMBER_OF = {topic.name: number for number, topic in enumerate(LOCKSTEP_PUBLISHERS)}
LATENCY_S = 2e-4
"""Mean time that a message takes."""

POLL_S = 5e-3
"""Period at which the recorder reads its messages."""

LEASE_S = 20.0
"""Longest time for which a killed process stays in the graph."""

DISCOVERY_S = (0.005, 0.05)
NAME_S = 3.0
"""Longest time after which a publisher's node has a name."""


@cache
def is_same(topic):
    """Return whether two messages of a topic have the same content."""
    return same_content(PERIODIC[topic].type_name)


class Process:
    """A process with a node, whose messages wait while it is suspended.

    Attributes
    ----------
    readers : dict of str to tuple
        For each topic that it reads: the callback, the depth, and whether it gets earlier messages.
    kept : dict of str to list
        Messages that it keeps for late readers, by topic.
    is_starved : bool
        Whether it is suspended because it gets no processor, not because it is stopped.
    """

    host = 'here'
    latched = MappingProxyType({PARTICIPANTS.name: HISTORY})

    def __init__(self, world, role, name=''):
        self.world, self.role, self.name = world, role, name or f'/{role}'
        world.processes += 1
        self.pid = 100 + world.processes
        self.instance = f'{self.pid:x}'
        self.prefix = f'{self.pid:024x}'
        self.is_alive, self.is_suspended, self.is_starved = True, False, False
        self._queued_s, self._starved_since_s = 0.0, 0.0
        self.died_s = self.gone_s = None
        self.named_s = world.now_s
        self.topics = TOPICS_OF.get(role, ())
        self.readers, self.kept, self.held = {}, {}, []
        self.numbers = Counter()

    def starve(self):
        """Get no processor from now on."""
        self.is_starved, self._starved_since_s = True, self.world.now_s

    def feed(self):
        """Get a processor again: only now the system counts the time without one."""
        self._queued_s += self.world.now_s - self._starved_since_s
        self.is_starved = False

    @property
    def threads(self):
        """The processor time of its thread."""
        return {1: ThreadTime(1.0, self._queued_s, is_runnable=self.is_starved)}

    @property
    def participant(self):
        """What its node announces of itself."""
        return Participant(
            role=self.role,
            node=self.name,
            host=self.host,
            process=self.pid,
            instance=self.instance,
            implementation='ballbot_ros 1 Node',
            parameters_sha256='00',
            guid_prefix=self.prefix,
            topics=tuple(topic.name for topic in periodic_topics(self.role)),
            parameters=self.world.announced(self.role),
        )

    def publisher(self, topic, name):
        """Return a publisher of this process as the graph shows it."""
        gid = bytes.fromhex(f'{self.prefix}{NUMBER_OF[topic]:08x}')
        return Publisher(gid, name)

    def publish(self, topic, *message):
        self.world.publish(self, topic, message)

    def close(self):
        """Do what the node does at an orderly end."""


class Node(Process):
    """A node that takes part in runs."""

    def __init__(self, world, role, name=''):
        super().__init__(world, role, name)
        self.answered_ns = 0
        self.member = RunMember(self.participant)
        self.readers[ROLL_CALL.name] = (self._on_roll_call, 1, True)

    def _on_roll_call(self, run):
        if run != self.member.run:
            if self.member.join(run):
                self.drop_kept()
            self.answered_ns = 0
            self.on_run(run)
        self.announce()
        self.on_call()

    def drop_kept(self):
        for topic in self.kept.keys() - {PARTICIPANTS.name}:
            del self.kept[topic]

    def announce(self):
        if announcement := self.member.announcement(self.answered_ns, self.awaited()):
            self.publish(PARTICIPANTS.name, announcement)

    def object(self, objection):
        if self.member.objects(objection):
            self.announce()

    def on_run(self, run):
        """Begin a run."""

    def on_call(self):
        """Do what follows a roll call."""

    def awaited(self):
        return {}


class DriverNode(Node):
    """Answers the truth of each sampling time."""

    def __init__(self, world, role, name=''):
        super().__init__(world, role, name)
        messages = DRIVER_NODES[role]
        parameters = world.parameters.of(messages.device.parameters)
        self._read, self._encode = messages.device.make(parameters), messages.encoder(parameters)
        self._source, self._topic = messages.source(parameters, 0), messages.sample
        self.is_mute = False
        self.readers[self._source.topic.name] = (self._on_truth, HISTORY, False)

    def _on_truth(self, data):
        now_ns = stamp_of(data)
        if now_ns % self._topic.period_ns or not self.member.includes(now_ns) or self.is_mute:
            return
        reading = self._read(self._source.measured(data, now_ns), now_ns)
        self.publish(self._topic.name, self._encode(now_ns, reading))
        self.answered_ns = max(now_ns, self.answered_ns)


class GamepadNode(Node):
    """Answers with the sticks of the input in command."""

    def __init__(self, world, role, name=''):
        super().__init__(world, role, name)
        self.sources, self._answers = Arbiter(), GivenAnswers()
        self.is_mute = False
        self.readers[PLANT_SLOW_ODOM.name] = (self._on_truth, HISTORY, False)

    def on_run(self, run):
        self._answers = GivenAnswers()

    def _on_truth(self, data):
        now_ns = stamp_of(data)
        if now_ns % SLOW_PERIOD_NS or not self.member.includes(now_ns) or self.is_mute:
            return
        elapsed_s = (now_ns - self.member.run.start_ns) * 1e-9
        scenario = self.world.scenario.sticks_at(elapsed_s)
        now_s = self.world.now_s
        answer = self._answers.at(now_ns, lambda: self.sources.select(now_s, scenario))
        self.world.note_sticks(now_ns, answer.sticks)
        self.publish(GAMEPAD_JOY.name, encode_sticks(now_ns, answer.sticks, answer.source))
        self.answered_ns = max(now_ns, self.answered_ns)


class ControllerNode(Node):
    """Runs the control program when its inputs and timers are in."""

    def __init__(self, world, role, name=''):
        super().__init__(world, role, name)
        parameters = world.parameters.of(ControllerParameters)
        self.brick = Brick(parameters, self, lambda one, other: one == other)
        self.messages = ControllerMessages(
            lambda topic: lambda stamp_ns, data: self.publish(topic.name, data)
        )
        self.is_running = True
        self.readers[CLOCK.name] = (lambda data: self.brick.on_clock(stamp_of(data)), 1, False)
        for topic, read in INPUT_READERS.items():
            self.readers[topic.name] = (self._receiver(topic.name, read), DEPTH, False)

    def _receiver(self, name, read):
        def receive(data):
            try:
                reading = read(data)
            except (ValueError, IndexError, OverflowError):
                return
            self.brick.on_sample(name, stamp_of(data), data, reading)

        return receive

    def on_run(self, run):
        self.is_running = True
        self.messages.begin()
        self.brick.join(run)

    def awaited(self):
        return self.brick.awaited()

    # What the brick decides

    def answer(self, stamp_ns, inputs, outputs, program):
        if self.is_running:
            self.world.on_tick(self, stamp_ns, inputs, outputs)
            self.messages.tick(stamp_ns, outputs, program)
            self.answered_ns = stamp_ns

    def resend(self, stamp_ns):
        self.messages.resend(stamp_ns)

    def object_to(self, name, stamp_ns):
        self.object(Objection.to_sample(name, stamp_ns))

    def abort(self, stamp_ns):
        self.is_running = False
        self.object(Objection('controller started in mid-run'))
        self.world.leave(self)

    def call_back(self, event, task):
        self.world.call_in(self.world.delay_s(), self, event, task)

    def close(self):
        if self.answered_ns:
            self.messages.stop_motors(self.answered_ns)


class RecorderNode(Node):
    """Records in memory, and acknowledges complete ticks.

    Attributes
    ----------
    file : dict of str to list
        What it has written: stamps and messages by topic.
    lost : list of str
        The losses that it reports.
    """

    def __init__(self, world, role, name=''):
        super().__init__(world, role, name)
        self.file, self.lost, self.has_objected = {}, [], False
        self.runs = []
        self._stamps = {}
        self.streams = [
            (
                topic.name,
                Stream(
                    topic.name,
                    period_ns=topic.period_ns,
                    is_clock=topic is CLOCK,
                    is_live=topic.publisher == PLANT,
                    is_same=is_same(topic.name) if topic.period_ns else None,
                ),
            )
            for topic in STREAM_TOPICS
        ]
        self.recording = RunRecording(self, lambda: self.streams)
        self._order, self._unread = ArrivalOrder(), {}
        self._is_poll_due = False
        for name, stream in self.streams:
            keeps = name in (RUN.name, RUN_STATUS.name, BATTERY_STATE.name)
            self.readers[name] = (self._receiver(name, stream), HISTORY, keeps)

    def _receiver(self, name, stream):
        def receive(*message):
            number = self.world.current_number
            arrival = (round(self.world.now_s * 1e9), (name, stream, message, number))
            self._unread.setdefault(name, []).append(arrival)
            self._poll_soon()

        return receive

    def _poll_soon(self):
        if not self._is_poll_due:
            self._is_poll_due = True
            self.world.call_in(POLL_S - self.world.now_s % POLL_S, self, self._poll)

    def _poll(self):
        self._is_poll_due = False
        self._write(math.ceil(self.world.now_s * 1e9))
        if self.recording.ticks.advance():
            self._acknowledge()

    def _write(self, until_ns=math.inf):
        recording = self.recording
        if recording.run is None:
            recording.gate.awaits_run = self.world.sees(self, RUN.name) > 0
        unread, self._unread = self._unread, {}
        for name, stream, message, number in self._order.merge(unread, until_ns):
            self._take(name, stream, message, number)

    def _take(self, name, stream, message, number):
        if name == RUN.name:
            (run,) = message
            if self.recording.announces(run):
                self.recording.gate.take(stream, run.start_ns, run.name.encode(), number)
        elif name == RUN_STATUS.name:
            self.recording.note_status(*message)
        else:
            (data,) = message
            stamp_ns = stamp_of(data)
            if name == MOTOR_DUTY.name and is_stop(data):
                self.recording.hold_stop(stream, stamp_ns, data, number)
            else:
                self.recording.gate.take(stream, stamp_ns, data, number)

    def on_run(self, run):
        self._write()
        self.file, self._stamps, self.has_objected = {}, {}, False
        self.runs.append(run.name)
        self.recording.join(run)
        # It begins with the motor stop of the run before.
        self.file.pop(MOTOR_DUTY.name, None)

    def on_call(self):
        if self.recording.ticks.acked_ns:
            self._acknowledge()

    def _acknowledge(self):
        self.world.on_acknowledged(self, self.recording.ticks.acked_ns)
        self.publish(RECORDER_ACK.name, self.recording.ticks.acked_ns)

    def keep(self, stream, log_ns, data, sequence):
        self.file.setdefault(stream.name, []).append((log_ns, data))
        self._stamps.setdefault(stream.name, set()).add(log_ns)

    def stamps(self, topic):
        """Return the stamps of a topic in the present run."""
        return self._stamps.get(topic, set())

    def report_loss(self, stream, sequence):
        self.lost.append(f'{stream.name}: before {sequence}')

    def has_several_publishers(self, stream):
        return self.world.sees(self, stream.name) > 1

    def raise_objection(self, stream, stamp_ns):
        self.has_objected = True
        self.object(Objection.to_sample(stream.name, stamp_ns))

    def close(self):
        self._write()
        self.recording.write_stop()


class PlantNode(Process):
    """Carries out the decisions of the master of the run.

    Attributes
    ----------
    founders : set of str
        The instances that take part in the run from its first tick on.
    """

    latched = MappingProxyType(
        {
            PARTICIPANTS.name: HISTORY,
            ROLL_CALL.name: 1,
            RUN.name: HISTORY,
            RUN_STATUS.name: HISTORY,
            BATTERY_STATE.name: HISTORY,
        }
    )

    def __init__(self, world, role=PLANT, name=''):
        super().__init__(world, role, name)
        parameters = world.parameters.of(PlantParameters)
        self.parameters = parameters
        self.founders = set()
        self._wakes = 0
        self._listens = {}
        self._heard = {}
        self.messages = PlantMessages(
            lambda topic: lambda stamp_ns, data: self._send(topic, stamp_ns, data)
        )
        for topic, on_message, depth, gets_earlier in (
            (MOTOR_DUTY, self._on_duty, DEPTH, False),
            (RECORDER_ACK, self._on_ack, 1, False),
            (PARTICIPANTS, self._on_announcement, HISTORY, True),
            (RUN, self._on_run(RUN), HISTORY, True),
            (ROLL_CALL, self._on_run(ROLL_CALL), HISTORY, True),
        ):
            self.readers[topic.name] = (on_message, depth, gets_earlier)
        token = f'{self.pid:x}'
        self.master = LockstepMaster(self, self, RUN_TOPICS, self._set_up, token, world.now_s)
        world.call_in(RESEND_S, self, self._on_time)

    def _set_up(self, start_ns):
        world = World.of(self.parameters)
        plant = Plant(self.parameters, start_ns, world)
        return RunSetup(self.parameters, plant, world, self.world.scenario, self.participant)

    # Events

    def dispatch(self, event, *what, **details):
        for action in event(self.world.now_s, *what, **details):
            self._carry_out(action)

    def _on_time(self):
        self.world.call_in(RESEND_S, self, self._on_time)
        self.dispatch(self.master.on_time)

    def _on_wake(self, number):
        if number == self._wakes:
            self.dispatch(self.master.on_wake)

    def _on_duty(self, data):
        try:
            duty = decode_duty(data)
        except ValueError:
            duty = None
        self.dispatch(self.master.on_duty, stamp_of(data), duty, data, is_stop=is_stop(data))

    def _on_ack(self, stamp_ns):
        self.dispatch(self.master.on_ack, stamp_ns)

    def _on_announcement(self, announcement):
        if announcement is None:
            self.dispatch(self.master.on_unreadable_announcement)
        else:
            self.dispatch(self.master.on_announcement, announcement)

    def _on_run(self, topic):
        return lambda run: self.dispatch(self.master.on_run, run.name, topic.name)

    # Actions

    def _send(self, topic, stamp_ns, data):
        if topic is RUN:
            self.publish(topic.name, RunIdentity(self.master.state()['run name'], stamp_ns))
        else:
            self.publish(topic.name, data)

    def _carry_out(self, action):
        messages = self.messages
        match action:
            case do.PublishTruth(truth, wall_hit, is_resend):
                messages.truth(truth, wall_hit=wall_hit, is_resend=is_resend)
                messages.send_unrecorded(truth)
            case do.ResendToDrivers(truth):
                messages.send_to_drivers(truth)
                messages.send_unrecorded(truth)
            case do.CallRoll(run, plant):
                self.publish(ROLL_CALL.name, run)
                self.publish(PARTICIPANTS.name, Announcement(plant, run.name))
            case do.AnnounceRun(run):
                messages.announce(run.start_ns, run.name)
            case do.PublishStatus():
                if not self.master.log.ticks:
                    self.founders = {each.participant.instance for each in action.members}
                self.publish(RUN_STATUS.name, run_status(action))
            case do.BeginRun(start_ns, world, ball_radius):
                messages.ball_radius = ball_radius
                messages.begin(start_ns, world)
            case do.StopMotors(last_ns):
                messages.stop_motors(last_ns)
            case do.WakeIn(delay_s):
                self._wakes += 1
                self.world.call_in(delay_s, self, self._on_wake, self._wakes)
            case do.CancelWake():
                self._wakes += 1

    # The graph, and the processes of this machine

    def is_complete(self):
        living = (each for each in self.world.nodes if each.is_alive)
        return all(self.world.has_discovered(self, each) for each in living)

    def present_nodes(self):
        return {
            each.instance: LocalNode(each.role, each.pid)
            for each in self.world.nodes
            if each.is_alive and isinstance(each, Node) and each.host == self.host
        }

    def publishers(self):
        found = {topic: [] for topic in NUMBER_OF}
        for each in self.world.seen(self):
            name = each.name if self.world.now_s >= each.named_s else ''
            for topic in each.topics:
                found[topic].append(each.publisher(topic, name))
        return found

    def count_publishers(self, topic):
        return self.world.sees(self, topic)

    def received(self, topics):
        for topic in topics:
            self._listens.setdefault(topic, self.world.now_s)
        heard, self._heard = self._heard, {}
        return [(topic, heard[topic]) for topic in sorted(topics) if topic in heard]

    def stop_listening(self):
        self._listens.clear()
        self._heard.clear()

    def overhear(self, topic, message):
        """Note the newest message on a topic that the plant listens to."""
        if topic in self._listens:
            stamped = message[0]
            if isinstance(stamped, bytes):
                self._heard[topic] = stamp_of(stamped)
            elif isinstance(stamped, int | RunIdentity):
                self._heard[topic] = getattr(stamped, 'start_ns', stamped)

    def observe(self, processes):
        observed = set(processes)
        living = (each for each in self.world.nodes if each.is_alive and each.host == self.host)
        threads = {each.pid: each.threads for each in living if each.pid in observed}
        return Observation(self.world.now_s, threads)

    def started_nodes(self):
        living = (each for each in self.world.started if each.is_alive)
        return [LocalNode(each.role, each.pid) for each in living]


KINDS = {
    **dict.fromkeys(DRIVER_NODES, DriverNode),
    GAMEPAD: GamepadNode,
    CONTROLLER: ControllerNode,
    RECORDER: RecorderNode,
    PLANT: PlantNode,
}


class ProtocolWorld:
    """A graph whose processes exchange messages through the network described above.

    Parameters
    ----------
    parameters : ParameterSet
    scenario : Scenario
    seed : object
        Seed of all delays and losses.
    keeps_log : bool
        Whether to keep the text of all events, not only its hash.

    Attributes
    ----------
    started : list of Process
        The nodes that the plant's command has started.
    lag_s : float
        Longest additional delay of a message at present.
    """

    kinds = KINDS

    def __init__(self, parameters, scenario, seed, *, keeps_log=False):
        self.parameters, self.scenario = parameters, scenario
        self.chance = random.Random(f'network {seed}')
        self.now_s = 1000.0
        self.processes = 0
        self.nodes, self.started = [], []
        self.lag_s = 0.0
        self.slow_discovery = 0.0
        self.current_number = 0
        self.plant = None
        self.watcher = None
        self._events, self._count = [], 0
        self._last_s, self._match_s = {}, {}
        self._readers = {}
        self._hash = hashlib.sha256()
        self.log = [] if keeps_log else None
        self._network = Process(self, 'network')
        self.sent = set()
        self.sticks = {}
        self.ticks = {}
        self.members = {}

    def announced(self, role):
        """Return the parameters that a node announces."""
        if role not in self.members:
            self.members[role] = self.parameters.of_node(role).values()
        return self.members[role]

    def note(self, text):
        """Write a line to the log."""
        line = f'{self.now_s:.9f} {text}\n'
        self._hash.update(line.encode())
        if self.log is not None:
            self.log.append(line)

    @property
    def log_sha256(self):
        return self._hash.hexdigest()

    # Processes

    def start(self, role, name='', kind=None):
        """Start a process, which the others discover after a while."""
        process = (kind or self.kinds[role])(self, role, name)
        chance = self.chance
        self.note(f'start {process.role} {process.pid}')
        for other in [*self.nodes, process]:
            for writer, reader in ((other, process), (process, other)):
                delay_s = chance.uniform(*DISCOVERY_S)
                if chance.random() < self.slow_discovery:
                    delay_s = chance.uniform(0.1, 1.5)
                delay_s = 0.0 if writer is reader else delay_s
                self._match_s[writer.pid, reader.pid] = self.now_s + delay_s
                self.call_in(delay_s, self._network, self._send_kept, writer, reader)
        process.named_s = self.now_s + chance.choice((0.0, 0.0, chance.uniform(0.0, NAME_S)))
        self.nodes.append(process)
        for topic in process.readers:
            self._readers.setdefault(topic, []).append(process)
        if isinstance(process, PlantNode):
            self.plant = process
        return process

    def _send_kept(self, writer, reader):
        for topic, messages in writer.kept.items():
            found = reader.readers.get(topic)
            if found and found[2] and (writer.is_alive or writer.gone_s > self.now_s):
                for number, message in messages:
                    self._transmit(writer, reader, topic, number, message)

    def kill(self, process):
        """Kill a process: the graph keeps it for a while, and its last messages may be lost."""
        self.note(f'kill {process.role} {process.pid}')
        process.is_alive, process.died_s = False, self.now_s
        process.gone_s = self.now_s + self.chance.uniform(1.5, LEASE_S)
        cuts_s = {}
        for event in sorted(self._events):
            if event[3] is process and event[2] is not process:
                reader = event[2].pid
                if reader not in cuts_s:
                    cuts_s[reader] = self.now_s + self.chance.choice((0.0, 1e-4, 1e-3, 9.0))
                if event[0] > cuts_s[reader]:
                    event[4] = None
        for reader in self.nodes:
            if any(event[3] is process for event in reader.held) and self.chance.random() < 0.5:
                reader.held = [event for event in reader.held if event[3] is not process]

    def leave(self, process):
        """End a process in an orderly way: its messages arrive, and it leaves the graph."""
        self.note(f'leave {process.role} {process.pid}')
        if not process.is_suspended:
            process.close()
        process.is_alive, process.died_s = False, self.now_s
        process.gone_s = self.now_s + self.chance.uniform(0.0, 0.05)

    def suspend(self, process, *, is_starved=False):
        """Suspend a process that is stopped, or that gets no processor."""
        self.note(f'{"starve" if is_starved else "suspend"} {process.role} {process.pid}')
        process.is_suspended = True
        if is_starved:
            process.starve()

    def resume(self, process):
        """Let a suspended process continue with what waits for it, the topics in any order."""
        self.note(f'resume {process.role} {process.pid}')
        process.is_suspended = False
        if process.is_starved:
            process.feed()
        held, process.held = process.held, []
        begun_s = {}
        for number, event in enumerate(held):
            topic = event[5]
            if topic not in begun_s:
                begun_s[topic] = self.now_s + self.chance.choice((1e-6, self.delay_s()))
            event[0] = begun_s[topic] + number * 1e-9
        self._events += held
        # Nothing that is on its way may overtake what has waited on the same way.
        newest_s = {}
        for event in sorted(self._events, key=operator.itemgetter(1)):
            _, _, reader, sender, _, topic, _, _ = event
            if reader is process and topic:
                way = sender.pid, process.pid, topic
                event[0] = newest_s[way] = max(event[0], newest_s.get(way, 0.0))
                self._last_s[way] = max(event[0], self._last_s.get(way, 0.0))
        heapq.heapify(self._events)

    # The graph

    def has_discovered(self, reader, writer):
        match_s = self._match_s[writer.pid, reader.pid]
        return match_s <= self.now_s and (writer.is_alive or match_s < writer.died_s)

    def seen(self, reader):
        """Return the processes in the graph of a reader, dead ones included."""
        return [
            each
            for each in self.nodes
            if (each.is_alive or each.gone_s > self.now_s) and self.has_discovered(reader, each)
        ]

    def sees(self, reader, topic):
        return sum(topic in each.topics for each in self.seen(reader))

    # Messages

    def delay_s(self):
        delay_s = self.chance.expovariate(1.0 / LATENCY_S)
        return delay_s + self.chance.uniform(0.0, self.lag_s) if self.lag_s else delay_s

    def publish(self, writer, topic, message):
        """Send a message to all readers that have discovered its publisher."""
        writer.numbers[topic] += 1
        number = writer.numbers[topic]
        if topic in PERIODIC and isinstance(writer, Node):
            self.sent.add((topic, stamp_of(message[0])))
        if depth := writer.latched.get(topic, 0):
            kept = writer.kept.setdefault(topic, [])
            kept.append((number, message))
            del kept[:-depth]
        plant = self.plant
        if plant and plant.is_alive and topic in plant._listens and plant is not writer:
            plant.overhear(topic, message)
        for reader in self._readers.get(topic, ()):
            if reader.is_alive and self._match_s[writer.pid, reader.pid] <= self.now_s:
                self._transmit(writer, reader, topic, number, message)

    def _transmit(self, writer, reader, topic, number, message):
        way = writer.pid, reader.pid, topic
        at_s = max(self.now_s + self.delay_s(), self._last_s.get(way, 0.0))
        self._last_s[way] = at_s
        self._push(at_s, reader, writer, reader.readers[topic][0], topic, number, message)

    def call_in(self, delay_s, process, event, *what):
        """Call a process after a time, unless it is dead by then."""
        self._push(self.now_s + delay_s, process, process, event, '', 0, what)

    def _push(self, at_s, process, sender, event, topic, number, what):
        self._count += 1
        heapq.heappush(
            self._events, [at_s, self._count, process, sender, event, topic, number, what]
        )

    @property
    def next_s(self):
        """The time of the next event [s]."""
        return self._events[0][0] if self._events else float('inf')

    def step(self):
        """Carry out the next event."""
        event = heapq.heappop(self._events)
        at_s, _, process, _, call, topic, number, what = event
        self.now_s = max(self.now_s, at_s)
        if call is None or not process.is_alive:
            return
        if process.is_suspended:
            self._hold(process, event)
            return
        self.note(f'{process.role} {process.pid} {topic or call.__name__} {number}')
        self.current_number = number
        call(*what)

    def _hold(self, process, event):
        topic = event[5]
        process.held.append(event)
        if topic:
            waiting = [each for each in process.held if each[5] == topic]
            if len(waiting) > process.readers[topic][1]:
                process.held.remove(waiting[0])

    # What a trial wants to know

    def note_sticks(self, stamp_ns, sticks):
        """Note an answer of a gamepad node."""
        self.sticks.setdefault(stamp_ns, set()).add(sticks)

    def on_tick(self, controller, stamp_ns, inputs, outputs):
        """Note a tick of a controller."""
        self.ticks[stamp_ns] = (controller, inputs, (*outputs.duty, outputs.delay_ns))
        if self.watcher:
            self.watcher.on_tick(controller, stamp_ns, inputs, outputs)

    def on_acknowledged(self, recorder, stamp_ns):
        """Note that a recorder acknowledges a tick."""
        if self.watcher:
            self.watcher.on_acknowledged(recorder, stamp_ns)
