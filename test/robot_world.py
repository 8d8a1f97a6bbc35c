"""The complete robot without ROS: master of the run, devices, controller and its timers.

Messages of one topic to one reader keep their order; between topics and readers any order is
possible, and a test may delay a topic for any time.
"""

import operator
import random
from dataclasses import asdict
from functools import partial

import parts
from lockstep_world import DRIVERS, ROLES, LockstepWorld, data_of

from ballbot_ros.controllers.document.axis import task_timings
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.engine.brick_tasks import BrickTasks
from ballbot_ros.lockstep import run_actions as do
from ballbot_ros.lockstep.lockstep import DueTick, LockstepTicks, SampleReaction
from ballbot_ros.lockstep.lockstep_master import LockstepMaster
from ballbot_ros.parameters import CONTROLLER, GAMEPAD, PLANT, ControllerParameters, PlantParameters
from ballbot_ros.parameters.timing import BATTERY_PERIOD_NS, MILLISECOND_NS, TICK_NS
from ballbot_ros.recording.messages.devices import DEVICE_MESSAGES, INPUT_READERS, device_inputs
from ballbot_ros.recording.messages.topics import BATTERY_STATE, GAMEPAD_JOY, GYRO_IMU
from ballbot_ros.robot.brick.brick import MotorDuty
from ballbot_ros.robot.brick.sensors import battery_mv


class Driver:
    """Answers each truth of a run that it has joined."""

    def __init__(self, topic, read, answer):
        self._topic, self._read, self._answer = topic, read, answer
        self.start_ns = None

    def join(self, run):
        self.start_ns = run.start_ns

    def on_truth(self, truth):
        now = truth.stamp_ns
        if self.start_ns is None or now < self.start_ns or now % self._topic.period_ns:
            return
        self._answer(self._topic, now, self._read(truth, now - self.start_ns))


class Timer:
    """A timer on the controller's clock, with the behaviour of rcl's timers."""

    def __init__(self, period_ms):
        self.period_ns = period_ms * MILLISECOND_NS
        self.next_ns = None

    def is_ready(self, now_ns):
        return self.next_ns is not None and self.next_ns <= now_ns

    def start(self, now_ns):
        self.next_ns = now_ns + self.period_ns

    def call(self, now_ns):
        """Take a callback; earlier ones that are overdue are skipped."""
        self.next_ns += self.period_ns
        if self.next_ns <= now_ns:
            self.next_ns += -(-(now_ns - self.next_ns) // self.period_ns) * self.period_ns


class Brick:
    """The controller, whose timers use the plant's clock.

    Its `hands` carry out what it decides, like the controller's node.

    Attributes
    ----------
    dropped : set of str
        Tasks whose next callback is lost.
    forced : int
        Number of releases made without a timer.
    """

    def __init__(self, parameters, hands, is_same=operator.eq):
        self._parameters, self._hands = parameters, hands
        self._tasks = task_timings(parameters.ts2_period, parameters.ts3_period)
        self._ticks = LockstepTicks(
            {topic.name: topic.period_ns for topic in INPUT_READERS},
            first=BATTERY_STATE.name,
            every_tick=GYRO_IMU.name,
            is_same=dict.fromkeys((topic.name for topic in INPUT_READERS), is_same),
            tick_ns=TICK_NS,
        )
        self._timers = {each.name: Timer(each.period_ms) for each in self._tasks if each.period_ms}
        self._now_ns = 0
        self.dropped = set()

    @property
    def forced(self):
        return self._ticks.releases.forced

    def join(self, run):
        self._program = ControlProgram(self._parameters)
        self._brick = BrickTasks(self._parameters)
        self._ticks.begin(run.start_ns, self._tasks)
        for timer in self._timers.values():
            timer.next_ns = None

    def on_clock(self, now_ns):
        # The node polls its timers; that their callbacks wait, and may come too late, is harder.
        self._now_ns = now_ns
        for task, timer in self._timers.items():
            if timer.is_ready(now_ns):
                self._hands.call_back(self.on_timer, task)

    def on_timer(self, task):
        timer = self._timers[task]
        if not timer.is_ready(self._now_ns):
            return
        timer.call(self._now_ns)
        if task in self.dropped:
            self.dropped.remove(task)
        else:
            self.release(task)

    def release(self, task):
        if tick := self._ticks.on_timer(task, self._now_ns):
            self._run(tick)

    def shift(self, task):
        """Set a timer off its schedule."""
        if self._timers[task].next_ns is not None:
            self._timers[task].next_ns += TICK_NS // 2

    def on_sample(self, name, stamp_ns, data, reading):
        reaction = self._ticks.take(name, stamp_ns, data, reading)
        if reaction is SampleReaction.FORCE_RELEASES:
            reaction = self._ticks.force()
        if isinstance(reaction, DueTick):
            self._run(reaction)
        elif reaction is SampleReaction.RESEND:
            self._hands.resend(stamp_ns)
        elif reaction is SampleReaction.OBJECT:
            self._hands.object_to(name, stamp_ns)
        elif reaction is SampleReaction.MISSED_START:
            rejoin = self._parameters.rejoin
            missed = self._ticks.on_missed_start(stamp_ns, now_ns=self._now_ns, rejoin=rejoin)
            if missed is SampleReaction.ABORT:
                self._hands.abort(stamp_ns)

    def awaited(self):
        return self._ticks.awaited()

    def _run(self, tick):
        if self._now_ns == tick.time_ns:
            for task in tick.untimed:
                self._timers[task].start(tick.time_ns)
        inputs = device_inputs(lambda topic: self._ticks.gate.newest(topic.name))
        outputs = self._brick.tick(self._program, tick.time_ns, inputs, tick.tasks)
        self._hands.answer(tick.time_ns, inputs, outputs, self._program)


class Hands:
    """Carries out the decisions of a controller that no stranger disturbs."""

    def __init__(self, world):
        self._world = world
        self._duties = {}

    def answer(self, stamp_ns, inputs, outputs, program):
        self._duties = {stamp_ns: MotorDuty(*outputs.duty, outputs.delay_ns)}
        self.resend(stamp_ns)

    def resend(self, stamp_ns):
        world, duty = self._world, self._duties[stamp_ns]
        world.nodes[CONTROLLER].samples.add(stamp_ns)
        data = data_of(stamp_ns, duty)
        world.send(world.master.on_duty, stamp_ns, duty, data, route=(CONTROLLER, PLANT))

    def call_back(self, event, task):
        self._world.send(event, task, route=(CONTROLLER, CONTROLLER, task))


class RobotWorld(LockstepWorld):
    """A run of the robot whose messages have random delays.

    A node that hangs neither sends nor receives; messages on their way arrive when it resumes. If
    it leaves, they are lost.

    Parameters
    ----------
    parameters : ParameterSet
    scenario : Scenario
    seed : int
        Seed of the order in which messages arrive.
    """

    def __init__(self, parameters, scenario=None, seed=0):
        self.parameter_set = parameters
        self._chance = random.Random(seed)
        self.robot = {}
        super().__init__(scenario, **asdict(parameters.of(PlantParameters)))

    def start(self, *roles, generation=0, **changes):
        for role in roles or ROLES:
            values = self.parameter_set.of_node(role).values() if role in DRIVERS else {}
            super().start(role, generation=generation, parameters=values, **changes)
            if role in self.makers:
                self.robot[role] = self.makers[role]()
        return self

    @property
    def makers(self):
        """The function that creates the robot's part of each role."""
        return {
            **{each.sample.publisher: partial(self._make_device, each) for each in DEVICE_MESSAGES},
            GAMEPAD: self._make_gamepad,
            CONTROLLER: self._make_controller,
        }

    def _make_device(self, messages):
        device = messages.device
        parameters = self.parameter_set.of(device.parameters)
        read, sampled = device.make(parameters), parts.sampled(device, parameters)
        return self._driver(
            messages.sample.publisher,
            messages.sample,
            lambda truth, _: read(sampled(truth), truth.stamp_ns),
        )

    def _make_gamepad(self):
        return self._driver(
            GAMEPAD,
            GAMEPAD_JOY,
            lambda _, elapsed_ns: self.scenario.sticks_at(elapsed_ns * 1e-9),
        )

    def _driver(self, role, topic, read):
        def answer(topic, stamp_ns, reading):
            self.nodes[role].samples.add(stamp_ns)
            self._sample(topic, stamp_ns, reading, role)

        return Driver(topic, read, answer)

    def _make_controller(self):
        return Brick(self.parameter_set.of(ControllerParameters), Hands(self))

    def leave(self, role):
        super().leave(role)
        kept = [each for each in self.in_flight if role not in each[1][0]]
        self.in_flight.clear()
        self.in_flight.extend(kept)

    def _join(self, node, run):
        super()._join(node, run)
        if node.role in self.robot:
            self.robot[node.role].join(run)

    # Messages

    def send(self, event, *what, route=()):
        """Send a message on its route: sender, reader and topic."""
        self.in_flight.append((event, (route, *what)))

    def receive(self, event, route, *what):
        if isinstance(event.__self__, LockstepMaster):
            self.dispatch(event, *what)
        else:
            event(*what)

    def arriving(self):
        first = {}
        hung = {role for role, node in self.nodes.items() if node.is_hung}
        for index, (event, (route, *_)) in enumerate(self.in_flight):
            if not hung.intersection(route):
                first.setdefault((event, route), index)
        return self._chance.choice(list(first.values())) if first else None

    def _sample(self, topic, stamp_ns, reading, sender):
        route = (sender, CONTROLLER, topic.name)
        brick = self.robot.get(CONTROLLER)
        if brick:
            data = repr(reading)
            self.send(brick.on_sample, topic.name, stamp_ns, data, reading, route=route)

    def _carry_out(self, action):
        super()._carry_out(action)
        if isinstance(action, do.PublishTruth):
            stamp_ns = action.truth.stamp_ns
            if CONTROLLER in self.robot:
                self.send(
                    self.robot[CONTROLLER].on_clock, stamp_ns, route=('', CONTROLLER, 'clock')
                )
            if stamp_ns % BATTERY_PERIOD_NS == 0:
                reading = battery_mv(action.truth.battery_voltage)
                self._sample(BATTERY_STATE, stamp_ns, reading, '')

    def _answer(self, truth):
        for role, part in self.robot.items():
            if role != CONTROLLER:
                self.send(part.on_truth, truth, route=('', role, 'truth'))
