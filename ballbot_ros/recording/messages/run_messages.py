"""The messages of plant and controller, and all those of a run without a graph."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.document.axis import PlaneValues
from ballbot_ros.controllers.document.program import ControlProgram, ProgramState
from ballbot_ros.controllers.interface import OperatingState, Program
from ballbot_ros.engine.brick_tasks import BrickTasks
from ballbot_ros.engine.closed_loop import Tick
from ballbot_ros.engine.rows import columns_of, state_of
from ballbot_ros.parameters import ControllerParameters, ParameterSet, PlantParameters, Value
from ballbot_ros.parameters.timing import (
    BATTERY_PERIOD_NS,
    SLOW_PERIOD_NS,
    TASKS_PERIOD_NS,
    TICK_NS,
)
from ballbot_ros.recording.messages import topics
from ballbot_ros.recording.messages.conversions import (
    encode_accepted_push,
    encode_battery,
    encode_body,
    encode_clock,
    encode_controller_state,
    encode_controller_states,
    encode_duty,
    encode_header,
    encode_log,
    encode_map,
    encode_motors,
    encode_odometry,
    encode_sticks,
    encode_stop,
    encode_text,
    encode_tone,
    encode_wall_hit,
)
from ballbot_ros.recording.messages.devices import DEVICE_MESSAGES, encode_steps
from ballbot_ros.recording.messages.jobs import encode_jobs
from ballbot_ros.recording.messages.raw import Messages, Stamps
from ballbot_ros.recording.messages.run_reports import encode_parameter_event
from ballbot_ros.recording.messages.topics import Topic
from ballbot_ros.robot.brick.brick import NO_SAMPLE, NUMBERS_OF, DeviceOutputs, Inputs, from_numbers
from ballbot_ros.robot.brick.kernel import Job
from ballbot_ros.robot.plant.ground_truth import GroundTruth, Push
from ballbot_ros.robot.world.floor_map import occupancy_grid
from ballbot_ros.robot.world.world import World

if TYPE_CHECKING:
    from ballbot_ros.engine.compiled_loop import TickColumns

Send = Callable[[int, bytes], None]
"""Sends a message of a topic: its stamp [ns], and the message as CDR."""

MakeSend = Callable[[Topic], Send]
"""Returns the function that sends the messages of a topic."""

SendAll = Callable[[Stamps, Messages], None]
"""Sends messages of a topic that have the same length, and their stamps [ns]."""


class ControllerMessages:
    """Encodes and sends the controller's messages.

    `operating_state` is the last one sent, '' before the first tick.
    """

    def __init__(self, make: MakeSend) -> None:
        self.operating_state = ''
        self._duty = self._state = b''
        self._jobs: list[Job] = []
        self._send_duty = make(topics.MOTOR_DUTY)
        self._send_state = make(topics.CONTROLLER_STATE)
        self._send_operating_state = make(topics.OPERATING_STATE)
        self._send_log = make(topics.BLUETOOTH_TX)
        self._send_sound = make(topics.SOUND)
        self._send_lcd = make(topics.LCD)
        self._send_jobs = make(topics.BRICK_TASKS)
        self._send_event = make(topics.PARAMETER_EVENTS)

    def tick(self, now_ns: int, outputs: DeviceOutputs, program: Program) -> None:
        """Send the results of a tick at `now_ns` [ns]."""
        # Messages without a stamp go first, so that no reader sees them after the next tick.
        self.events(now_ns, outputs, program.operating_state)
        self.jobs(now_ns, outputs.jobs, program)
        self._duty = encode_duty(now_ns, outputs.duty, outputs.delay_ns)
        self._state = encode_controller_state(now_ns, program.x, program.y)
        self.resend(now_ns)

    def events(self, now_ns: int, outputs: DeviceOutputs, state: OperatingState) -> None:
        """Send the messages of a tick that are not periodic; the state only if it has changed."""
        if state != self.operating_state:
            self.operating_state = state.value
            self._send_operating_state(now_ns, encode_text(self.operating_state))
        for packet in outputs.log:
            self._send_log(now_ns, encode_log(packet))
        for tone in outputs.tones:
            self._send_sound(now_ns, encode_tone(now_ns, tone))
        for page in outputs.pages:
            self._send_lcd(now_ns, encode_text(page))

    def jobs(self, now_ns: int, jobs: Sequence[Job], program: Program) -> None:
        """Add the jobs of a tick; send all with the one that ends at a multiple of their period."""
        self._jobs += jobs
        if self._jobs and (now_ns + TICK_NS) % TASKS_PERIOD_NS == 0:
            names = [task.name for task in program.tasks]
            self._send_jobs(now_ns, encode_jobs(self._jobs, names))
            self._jobs = []

    def retuned(self, now_ns: int, values: Mapping[str, Value]) -> None:
        """Send that parameters have other values from the tick at `now_ns` [ns] on."""
        self._send_event(now_ns, encode_parameter_event(now_ns, values))

    def begin(self) -> None:
        """Begin a run: its first operating state counts as a change."""
        self.operating_state = ''
        self._jobs = []

    def resend(self, stamp_ns: int) -> None:
        """Send the periodic messages of the newest tick, which have the stamp `stamp_ns`."""
        self._send_duty(stamp_ns, self._duty)
        self._send_state(stamp_ns, self._state)

    def stop_motors(self, last_ns: int) -> None:
        """Publish that the motors are off from the tick after the last one."""
        stamp_ns = last_ns + TICK_NS
        self._send_duty(stamp_ns, encode_stop(stamp_ns))


class PlantMessages:
    """Encodes and sends the plant's messages."""

    def __init__(self, make: MakeSend) -> None:
        self.ball_radius = 0.0
        self.wall_hit = False
        self._battery_sample = b''
        self._send_clock = make(topics.CLOCK)
        self._send_run = make(topics.RUN)
        self._send_motors = make(topics.PLANT_JOINT_STATES)
        self._send_body = make(topics.PLANT_IMU)
        self._send_odometry = make(topics.PLANT_ODOM)
        self._send_slow_odometry = make(topics.PLANT_SLOW_ODOM)
        self._send_steps = make(topics.PLANT_STEPS)
        self._send_battery = make(topics.BATTERY_STATE)
        self._send_wall_hit = make(topics.WALL_HIT)
        self._send_accepted_push = make(topics.ACCEPTED_PUSH)
        self._send_map = make(topics.MAP)
        self._send_duty = make(topics.MOTOR_DUTY)

    def announce(self, start_ns: int, name: str) -> None:
        """Announce a run, so that its participants join it."""
        self._send_run(start_ns, encode_header(start_ns, name))

    def begin(self, start_ns: int, world: World | None) -> None:
        """Publish the initial state of a run."""
        if world:
            self._send_map(start_ns, encode_map(start_ns, occupancy_grid(world.map)))
        self.set_wall_hit(start_ns, wall_hit=False)

    def push(self, push: Push, number: int) -> None:
        """Publish the start and the end of a push, so that the run can be replayed."""
        for stamp, acts in ((push.start_ns, True), (push.end_ns, False)):
            self._send_accepted_push(stamp, encode_accepted_push(stamp, push, number, acts=acts))

    def truth(self, truth: GroundTruth, *, wall_hit: bool, is_resend: bool = False) -> None:
        """Send the plant's true state at a tick, and `wall_hit` if it has changed.

        With `is_resend`, also send the newest battery sample again, because a controller that has
        just joined waits for it.
        """
        stamp_ns = truth.stamp_ns
        self._send_clock(stamp_ns, encode_clock(stamp_ns))
        # Send the battery sample before the drivers' inputs: it marks the start of the run for the
        # controller.
        if stamp_ns % BATTERY_PERIOD_NS == 0:
            self._battery_sample = encode_battery(stamp_ns, truth.battery_voltage)
        if is_resend or stamp_ns % BATTERY_PERIOD_NS == 0:
            self._send_battery(stamp_ns, self._battery_sample)
        self.send_to_drivers(truth)
        if self.wall_hit != wall_hit:
            self.set_wall_hit(stamp_ns, wall_hit=wall_hit)

    def set_wall_hit(self, stamp_ns: int, *, wall_hit: bool) -> None:
        """Send whether the body touches a wall."""
        self.wall_hit = wall_hit
        self._send_wall_hit(stamp_ns, encode_wall_hit(wall_hit=wall_hit))

    def send_to_drivers(self, truth: GroundTruth) -> None:
        """Send the topics that the drivers answer."""
        stamp_ns = truth.stamp_ns
        self._send_body(stamp_ns, encode_body(truth))
        self._send_motors(stamp_ns, encode_motors(truth))
        self._send_odometry(stamp_ns, encode_odometry(truth, self.ball_radius))

    def send_unrecorded(self, truth: GroundTruth) -> None:
        """Send the topics that only drivers read.

        They are the odometry at the sampling times of the slow ones, and the latest physics steps,
        if samples have a dead time.
        """
        stamp_ns = truth.stamp_ns
        if stamp_ns % SLOW_PERIOD_NS == 0:
            self._send_slow_odometry(stamp_ns, encode_odometry(truth, self.ball_radius))
        if truth.steps:
            self._send_steps(stamp_ns, encode_steps(truth))

    def stop_motors(self, last_ns: int) -> None:
        """Publish that the motors are off from the tick after the last one."""
        stamp_ns = last_ns + TICK_NS
        self._send_duty(stamp_ns, encode_stop(stamp_ns))


RUN_NAME = '1'
"""Name of the run: without a graph there is one run, and no other plant."""


class RunMessages:
    """Creates the messages that the nodes would publish, in causal order."""

    def __init__(self, make: MakeSend, parameters: ParameterSet) -> None:
        self.plant = PlantMessages(make)
        self.plant.ball_radius = parameters.of(PlantParameters).ball_radius
        self._devices = []
        for each in DEVICE_MESSAGES:
            encode = each.encoder(parameters.of(each.device.parameters))
            self._devices.append((attrgetter(each.device.field), encode, make(each.sample)))
        self._send_sticks = make(topics.GAMEPAD_JOY)
        self.controller = ControllerMessages(make)

    def begin(self, start_ns: int, world: World | None, pushes: Iterable[Push]) -> None:
        """Create the messages at the start of a run."""
        self.plant.announce(start_ns, RUN_NAME)
        self.plant.begin(start_ns, world)
        for number, push in enumerate(pushes, 1):
            self.plant.push(push, number)

    def tick(self, tick: Tick, program: Program, source: str = topics.SCENARIO) -> None:
        """Create the messages of a tick; `source` names the input in command."""
        now_ns = tick.truth.stamp_ns
        self.plant.truth(tick.truth, wall_hit=tick.wall_hit)
        inputs = tick.inputs
        for reading_of, encode, send in self._devices:
            reading = reading_of(inputs)
            if reading is not None:
                send(now_ns, encode(now_ns, reading))
        if inputs.sticks is not None:
            self._send_sticks(now_ns, encode_sticks(now_ns, inputs.sticks, source))
        self.controller.tick(now_ns, tick.outputs, program)


class RunColumns:
    """Creates the messages of many ticks at once, topic by topic: those of :class:`RunMessages`.

    `messages` creates those before and after these ticks; `make_all` returns the function that
    sends many messages of a topic.
    """

    def __init__(
        self,
        messages: RunMessages,
        make: MakeSend,
        make_all: Callable[[Topic], SendAll],
        parameters: ParameterSet,
    ) -> None:
        self._plant, self._controller = messages.plant, messages.controller
        self._make, self._make_all = make, make_all
        self._tasks = BrickTasks(parameters.of(ControllerParameters))
        self._devices = [
            (each.device, each.encoder(parameters.of(each.device.parameters)), each.sample)
            for each in DEVICE_MESSAGES
        ]

    def ticks(self, columns: TickColumns, program: Program, source: str = topics.SCENARIO) -> None:
        """Create the messages of ticks; `source` names the input in command.

        A program other than the document's makes the ticks, too, to publish what it does in them.
        """
        stamps = np.asarray(columns.truth.stamp_ns)
        self._truth(columns.truth, stamps, columns.wall_hit)
        self._inputs(columns.inputs, stamps, source)
        if isinstance(program, ControlProgram):
            self._outputs(columns, stamps, program)
        else:
            self._repeat(columns.inputs, stamps, program)

    def _send(self, topic: Topic, stamps: Stamps, messages: object) -> None:
        self._make_all(topic)(stamps, cast('Messages', messages))

    def _truth(self, truth: GroundTruth, stamps: Stamps, wall_hit: NDArray[np.bool_]) -> None:
        self._send(topics.CLOCK, stamps, encode_clock(truth.stamp_ns))
        due = stamps % BATTERY_PERIOD_NS == 0
        columns: Any = stamps[due], np.asarray(truth.battery_voltage)[due]
        self._send(topics.BATTERY_STATE, stamps[due], encode_battery(*columns))
        self._send(topics.PLANT_IMU, stamps, encode_body(truth))
        self._send(topics.PLANT_JOINT_STATES, stamps, encode_motors(truth))
        self._send(topics.PLANT_ODOM, stamps, encode_odometry(truth, self._plant.ball_radius))
        before = np.concatenate([[self._plant.wall_hit], wall_hit[:-1]])
        for at in np.flatnonzero(wall_hit != before):
            self._plant.set_wall_hit(int(stamps[at]), wall_hit=bool(wall_hit[at]))

    def _inputs(self, inputs: Inputs, stamps: Stamps, source: str) -> None:
        for device, encode, topic in self._devices:
            columns = [np.asarray(getattr(inputs, name)) for name in NUMBERS_OF[device.field]]
            due = columns[0] != NO_SAMPLE
            at, readings = stamps[due], [each[due] for each in columns]
            if device.period_ns == TICK_NS:
                self._send(topic, at, encode(at, readings))
                continue
            send, rows = self._make(topic), zip(*(each.tolist() for each in readings), strict=True)
            for stamp_ns, row in zip(at.tolist(), rows, strict=True):
                send(stamp_ns, encode(stamp_ns, row if len(row) > 1 else row[0]))
        vertical, horizontal = np.asarray(inputs.vertical), np.asarray(inputs.horizontal)
        due = vertical != NO_SAMPLE
        at, sticks = stamps[due], (vertical[due], horizontal[due])
        self._send(topics.GAMEPAD_JOY, at, encode_sticks(at, sticks, source))

    def _repeat(self, columns: Inputs, stamps: Stamps, program: Program) -> None:
        rows = zip(*(np.asarray(each).tolist() for each in columns), strict=True)
        for now_ns, row in zip(stamps.tolist(), rows, strict=True):
            outputs = self._tasks.tick(program, now_ns, from_numbers(Inputs(*row)))
            self._controller.tick(now_ns, outputs, program)

    def _outputs(self, columns: TickColumns, stamps: Stamps, program: ControlProgram) -> None:
        rows = columns.program
        states = columns_of(ProgramState, rows)
        deciding = rows[['control_mode', 'flag_avoid', 'flag_auto']]
        has_event = np.append(True, deciding[1:] != deciding[:-1])
        has_event |= states.has_logged | states.has_started_tone | states.has_drawn
        has_event |= states.distance_tone_hz > 0
        for at in np.flatnonzero(has_event):
            state = state_of(ProgramState, rows[at])
            outputs, operating_state = program.outputs_of(state), program.operating_state_of(state)
            self._controller.events(int(stamps[at]), outputs, operating_state)
        duties: Any = stamps, tuple(columns.duty.T), columns.delay_ns
        self._send(topics.MOTOR_DUTY, stamps, encode_duty(*duties))
        x = PlaneValues(*states.x, *states.estimates_x)
        y = PlaneValues(*states.y, *states.estimates_y)
        self._send(topics.CONTROLLER_STATE, stamps, encode_controller_states(stamps, x, y))
        if self._tasks.is_timed:
            for now_ns, rows in zip(stamps.tolist(), columns.jobs.tolist(), strict=True):
                jobs = [Job.of(program.tasks, numbers) for numbers in rows if any(numbers)]
                self._controller.jobs(now_ns, jobs, program)
