"""The NXT brick: runs the control program on the devices' samples."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.time import Time
from rclpy.timer import Timer

from ballbot_ros.controllers.codegen.implementation import (
    Implementation,
    implementation_for,
    require_implementation,
)
from ballbot_ros.controllers.controller import every_tick
from ballbot_ros.controllers.controller_program import own_rows
from ballbot_ros.controllers.loading import load_controller
from ballbot_ros.engine.brick_tasks import BrickTasks
from ballbot_ros.errors import ControllerError
from ballbot_ros.lockstep.free_running import FreeRunningTicks
from ballbot_ros.lockstep.lockstep import DEPTH, DueTick, LockstepTicks, RunIdentity, SampleReaction
from ballbot_ros.lockstep.participants import SOURCE_HASH, TUNABLE, Objection
from ballbot_ros.nodes.base import NO_SAMPLE, BallbotNode
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    ControllerParameters,
    Parameter,
    ParameterError,
)
from ballbot_ros.parameters.changes import PendingChanges
from ballbot_ros.parameters.timing import MILLISECOND_NS, SECOND_NS, TICK_NS
from ballbot_ros.recording.messages.devices import INPUT_READERS, device_inputs
from ballbot_ros.recording.messages.raw import same_content, stamp_of
from ballbot_ros.recording.messages.run_messages import ControllerMessages
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CLOCK,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    MOTOR_DUTY,
    PARTICIPANTS,
    Topic,
)
from ballbot_ros.robot.brick.faults import faults_of
from ballbot_ros.robot.brick.schedule import TaskTiming


class TaskTimers:
    """A timer for each periodic task.

    Parameters
    ----------
    on_timer : callable
        Called with the name of a task when its timer fires.
    ticking : str
        The task whose timer makes the ticks, and so runs before the first one; '' in lockstep,
        where all timers start with the first tick, and :meth:`poll` calls the callbacks instead of
        the node's executor.
    """

    def __init__(
        self, node: Node, clock: Clock, on_timer: Callable[[str], None], ticking: str
    ) -> None:
        self._node, self._clock, self._on_timer, self._ticking = node, clock, on_timer, ticking
        self._is_polled = not ticking
        self._timers: dict[str, Timer] = {}

    def set(self, tasks: Iterable[TaskTiming]) -> None:
        """Replace the timers by those of other tasks."""
        for timer in self._timers.values():
            timer.destroy() if self._is_polled else self._node.destroy_timer(timer)
        self._timers = {
            name: self._create(name, period_ms) for name, _, period_ms in tasks if period_ms
        }

    def _create(self, task: str, period_ms: int) -> Timer:
        if self._is_polled:
            group = self._node.default_callback_group
            return Timer(
                self._callback(task), group, period_ms * MILLISECOND_NS, self._clock,
                context=self._node.context, autostart=False,
            )  # fmt: skip
        return self._node.create_timer(
            period_ms * 1e-3,
            self._callback(task),
            clock=self._clock,
            autostart=task == self._ticking,
        )

    def _callback(self, task: str) -> Callable[[], None]:
        return lambda: self._on_timer(task)

    def poll(self) -> None:
        """Call the callbacks of the timers that are due."""
        for timer in list(self._timers.values()):
            if timer.is_ready():
                timer.handle.call_timer()
                timer.callback()

    def stop(self) -> None:
        """Stop the timers, which are not in phase with a new run; its ticks restart them."""
        for name, timer in self._timers.items():
            if name != self._ticking:
                timer.cancel()

    def restart(self, tasks: Iterable[str]) -> None:
        """Restart the timers of some tasks, which then fire one period from now."""
        for task in tasks:
            self._timers[task].reset()


class ControllerNode(BallbotNode[ControllerParameters]):
    """Answers the inputs of every tick with one ``motor_duty`` that has the same stamp.

    Each periodic task has a timer that releases it. In lockstep the timers run on ``/clock``, and a
    tick runs when its inputs have arrived and the due tasks are released. Free running, they run on
    the wall clock, and each callback of task_ts1's timer runs a tick on the newest samples.
    ``lockstep/`` decides what a sample or a callback leads to; the node carries it out.
    """

    def __init__(
        self,
        parameters: ControllerParameters | None = None,
        make_implementation: Callable[[ControllerParameters], Implementation] = implementation_for,
    ) -> None:
        super().__init__(ControllerParameters, parameters, use_sim_time=True)
        self._make_implementation = make_implementation
        self._implementation = make_implementation(self.parameters)
        self._program = self._implementation.make()
        self._tasks = BrickTasks(self.parameters)
        self._program_parameters = self.parameters
        self._changes = PendingChanges(())
        self._lockstep = self.parameters.lockstep
        if self._lockstep:
            self.require_sim_time('in lockstep its timers run on /clock')
        self._lockstep_ticks = LockstepTicks(
            {topic.name: topic.period_ns for topic in INPUT_READERS},
            first=BATTERY_STATE.name,
            every_tick=GYRO_IMU.name,
            is_same={topic.name: same_content(topic.type_name) for topic in INPUT_READERS},
            tick_ns=TICK_NS,
        )
        self._free_ticks = FreeRunningTicks(
            every_tick=every_tick(self._implementation.tasks),
            clock=GYRO_IMU.name,
            needed=[topic.name for topic in (GYRO_IMU, JOINT_STATES, BATTERY_STATE)],
            sticks=GAMEPAD_JOY.name,
            tick_ns=TICK_NS,
        )
        self._gate = (self._lockstep_ticks if self._lockstep else self._free_ticks).gate
        self._resends = 0
        self._is_running = True
        self._messages = ControllerMessages(lambda topic: self.output(topic).send)
        self._task_timers = TaskTimers(
            self,
            self.get_clock() if self._lockstep else self._steady,
            self._on_timer,
            ticking='' if self._lockstep else every_tick(self._implementation.tasks),
        )
        self._task_timers.set(self._implementation.tasks)
        if self._lockstep:
            # In the place of rclpy's subscription, the only one so far: the executor would pass the
            # time to another thread, and be woken by it for each timer.
            for each in list(self.subscriptions):
                self.destroy_subscription(each)
            self.subscribe(CLOCK, self._on_clock, raw=True)
        self._participation = Participation(self, self._on_run)
        # In lockstep receive all messages about one tick, also a second sample of an input.
        depth = DEPTH if self._lockstep else 1
        for topic, reader in INPUT_READERS.items():
            self.subscribe(topic, self._input_callback(topic, reader), depth=depth, raw=True)

    def _on_clock(self, data: bytes) -> None:
        try:
            now = Time(nanoseconds=stamp_of(data), clock_type=ClockType.ROS_TIME)
        except NO_SAMPLE as error:
            self.warn_malformed(CLOCK, error)
            return
        self.get_clock().set_ros_time_override(now)
        self._task_timers.poll()

    def further_parameters(self, parameters: ControllerParameters) -> Iterable[Parameter]:
        """Return the parameters that only this controller has."""
        name = parameters.implementation
        return () if name in DOCUMENTS_PROGRAM else own_rows(load_controller(name))

    def announced_values(self) -> Mapping[str, object]:
        """Return what can be tuned, and the hash of a controller other than the document's."""
        loaded = self._implementation.loaded
        source = {SOURCE_HASH: loaded.code.source.sha256} if loaded else {}
        return {TUNABLE: [row.name for row in self._implementation.tunable], **source}

    def awaited(self) -> Mapping[str, int | None]:
        """Return the inputs that the next tick in lockstep lacks."""
        return self._lockstep_ticks.awaited()

    def check(self, parameters: ControllerParameters) -> None:
        """Check that everything the control program needs is available."""
        # Leave building the program to the next run: it takes seconds, and would stall this run.
        before, after = self.parameters.implementation, parameters.implementation
        if before != after and not {before, after} <= set(DOCUMENTS_PROGRAM):
            raise ParameterError(
                f'{self.get_name()}.implementation: {after!r} takes another node: start it with '
                f'-p implementation:={after}'
            )
        require_implementation(after)
        self._implementation.check(parameters)
        faults_of(parameters, [task.name for task in self._implementation.tasks])

    def on_parameters_changed(self) -> None:
        """Let other faults act; what the program takes over waits for its next tick."""
        self._participation.change_faults(self._tasks.faults)

    def is_live(self, row: Parameter) -> bool:
        """Return whether the program takes over a new value during a run."""
        return row in self._implementation.tunable or self.is_of_run(row)

    def apply_parameters(self) -> None:
        """Apply the new parameter values at the start of a run."""
        super().apply_parameters()
        if self.parameters != self._implementation.parameters:
            self._implementation = self._make_implementation(self.parameters)
            self._task_timers.set(self._implementation.tasks)

    def _on_timer(self, task: str) -> None:
        if self._lockstep:
            tick = self._lockstep_ticks.on_timer(task, self.get_clock().now().nanoseconds)
        else:
            tick = self._free_ticks.on_timer(task, time.monotonic_ns())
        if tick:
            self._run(tick)

    def _input_callback(
        self, topic: Topic, reader: Callable[[bytes], Any]
    ) -> Callable[[bytes], None]:
        name = topic.name

        def receive(data: bytes) -> None:
            try:
                stamp, reading = stamp_of(data), reader(data)
            except NO_SAMPLE:
                # For example, the joint states of another robot in the same domain.
                self.warn(f'{name}: ignored a message that no device of the brick can send')
                return
            if self._lockstep:
                self._take(name, stamp, data, reading)
            else:
                self._free_ticks.take(name, stamp, reading, time.monotonic_ns())

        return receive

    def _on_run(self, run: RunIdentity) -> None:
        self._program = self._implementation.make()
        self._tasks = BrickTasks(self.parameters, run.start_ns)
        self._program_parameters = self.parameters
        self._changes = PendingChanges.of(self.parameters, run.start_ns)
        self._is_running = True
        self._messages.begin()
        tasks = self._implementation.tasks
        if self._lockstep:
            self._lockstep_ticks.begin(run.start_ns, tasks, self._tasks.changes)
        else:
            self._free_ticks.begin(run.start_ns, tasks)
        self._task_timers.stop()

    def _take(self, name: str, stamp: int, data: bytes, reading: object) -> None:
        reaction = self._lockstep_ticks.take(name, stamp, data, reading)
        if isinstance(reaction, DueTick):
            self._run(reaction)
        elif reaction is SampleReaction.RESEND:
            self._resends += 1
            self._messages.resend(stamp)
        elif reaction is SampleReaction.FORCE_RELEASES:
            if tick := self._lockstep_ticks.force():
                self._run(tick)
        elif reaction is SampleReaction.OBJECT:
            self._participation.raise_objection(Objection.to_sample(name, stamp))
        elif reaction is SampleReaction.MISSED_START:
            self._on_missed_start(stamp)

    def _on_missed_start(self, stamp: int) -> None:
        """Restart the program in mid-run if `rejoin` allows it; otherwise object, and fail."""
        reaction = self._lockstep_ticks.on_missed_start(
            stamp, now_ns=self.get_clock().now().nanoseconds, rejoin=self.parameters.rejoin
        )
        at = f'in mid-run, at {stamp / SECOND_NS:.3f} s'
        if reaction is SampleReaction.RESTART:
            self.get_logger().warning(f'restarts {at}')
        elif reaction is SampleReaction.ABORT:
            problem = (
                f'{CONTROLLER} started {at}, without the state of earlier ticks (rejoin: true '
                'allows a restart)'
            )
            self._abort(problem)

    def _abort(self, problem: str) -> None:
        """Fail the run, and end."""
        self._is_running = False
        self._participation.raise_objection(Objection(problem))
        self.finish()
        self.fail(problem)

    def _run(self, tick: DueTick) -> None:
        """Run the tasks of a tick, and publish the results."""
        if not self._is_running:
            return
        # Start the timers before the answer, which may let the clock advance.
        if tick.untimed:
            self._start_timers(tick)
        inputs = device_inputs(lambda topic: self._gate.newest(topic.name))
        try:
            self._retune(tick.time_ns)
            outputs = self._tasks.tick(self._program, tick.time_ns, inputs, tick.tasks)
        except ControllerError as error:
            self._abort(str(error))
            return
        self._messages.tick(tick.time_ns, outputs, self._program)
        self.count_sample(tick.time_ns)

    def _retune(self, now_ns: int) -> None:
        """Let the program take over parameters that were set since the last tick, or change now."""
        if values := self._changes.due(now_ns):
            self.parameters = self._implementation.changed(self.parameters, values)
        if self.parameters is self._program_parameters:
            return
        before = {**self._program_parameters.values(), 'faults': self.parameters.faults}
        self._program_parameters = self.parameters
        changed = {
            name: value for name, value in self.parameters.values().items() if value != before[name]
        }
        if changed:
            self._messages.retuned(now_ns, changed)
            self._program.retune(self.parameters)

    def _start_timers(self, tick: DueTick) -> None:
        """Restart the timers that have not released their tasks."""
        # Timers count from /clock. If it has not reached the tick yet, restart them later, at a
        # tick for which they have failed to release a task.
        if not self._lockstep or self.get_clock().now().nanoseconds == tick.time_ns:
            self._task_timers.restart(tick.untimed)

    def diagnose(self) -> Mapping[str, object]:
        """Return the operating state and the counts of callbacks, late ticks and resends."""
        fired = (self._lockstep_ticks.releases if self._lockstep else self._free_ticks).fired
        periods = {
            name: period_ms for name, _, period_ms in self._implementation.tasks if period_ms
        }
        content: dict[str, object] = {
            'operating state': self._messages.operating_state,
            f'timer callbacks {"/".join(map(str, periods.values()))} ms': '/'.join(
                str(fired[name]) for name in periods
            ),
            'forced releases': self._lockstep_ticks.releases.forced,
            'late ticks': self._free_ticks.late_ticks,
            'resends': self._resends,
        }
        if self._implementation.loaded:
            times = self._implementation.times
            content |= {
                'ticks longer than 4 ms': times.slow,
                'longest tick [ms]': f'{times.longest_ms:.3f}',
            }
        return content

    def close(self) -> None:
        """Switch off the motors, and wait until an objection has reached the plant."""
        if problem := self._implementation.times.problem:
            self.get_logger().warning(problem)
        if self.now_ns:
            self._messages.stop_motors(self.now_ns)
        self.flush(MOTOR_DUTY, PARTICIPANTS)
