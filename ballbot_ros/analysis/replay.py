"""Replaying a recorded run: the controller with its inputs, or the whole robot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

from ballbot_ros.analysis.message_comparison import MessageComparator
from ballbot_ros.analysis.recorded_inputs import RunInputs, recording_error_context
from ballbot_ros.analysis.recorded_runs import RobotRecording
from ballbot_ros.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.codegen.implementation import implementation_for
from ballbot_ros.controllers.loading import public_reference
from ballbot_ros.messages.controller_messages import ControllerMessages
from ballbot_ros.messages.devices import DEVICE_MESSAGES, AnyDeviceMessages
from ballbot_ros.messages.inputs import INPUT_READERS, device_inputs
from ballbot_ros.messages.run_messages import RunMessages
from ballbot_ros.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    BLUETOOTH_TX,
    CLOCK,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    LCD,
    MAP,
    MOTOR_DUTY,
    OPERATING_STATE,
    PARAMETER_EVENTS,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    SOUND,
    WALL_HIT,
    Topic,
)
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterError, ParameterSet
from ballbot_ros.recording.batch import RawMessage
from ballbot_ros.simulation.closed_loop import ClosedLoop, Tick
from ballbot_ros.timing import MILLISECOND_NS, TICK_NS

CONTROLLER_TOPICS = (
    PARAMETER_EVENTS, MOTOR_DUTY, CONTROLLER_STATE, OPERATING_STATE, BLUETOOTH_TX, SOUND, LCD,
)  # fmt: skip
ALL_TOPICS = (
    MAP, ACCEPTED_PUSH, CLOCK, PLANT_IMU, PLANT_JOINT_STATES, PLANT_ODOM, BATTERY_STATE, WALL_HIT,
    *(device.sample for device in DEVICE_MESSAGES), GAMEPAD_JOY, *CONTROLLER_TOPICS,
)  # fmt: skip
"""The compared topics, in the order in which a tick causes their messages."""


class ReplayedTick(NamedTuple):
    """A controller's outputs for recorded inputs, at a sim time [ns]."""

    stamp_ns: int
    inputs: DeviceInputs
    outputs: DeviceOutputs


EVENTS = (WALL_HIT, OPERATING_STATE, BLUETOOTH_TX, LCD)
"""Topics without stamps: only the order of their messages shows which run they belong to."""


class _RetunedProgram:
    """A controller's program, whose parameters change at the ticks at which they have changed.

    Attributes
    ----------
    program : Program
    """

    def __init__(
        self,
        recording: RobotRecording,
        inputs: RunInputs,
        parameters: ParameterSet,
        messages: ControllerMessages | RunMessages,
    ) -> None:
        self._reader, self._retunings = recording.reader, inputs.retunings
        self._parameters, self._messages = ParameterSet(), messages
        self._parameters.update(parameters)
        self._implementation = implementation_for(parameters.of(ControllerParameters))
        self.program = self._implementation.make()

    def repeat(self, now_ns: int) -> None:
        """Repeat the changes before the tick at `now_ns` [ns]."""
        values = self._retunings.get(now_ns)
        if not values:
            return
        with recording_error_context(self._reader, PARAMETER_EVENTS.name, now_ns):
            for name, value in values.items():
                self._parameters.set(CONTROLLER, name, value)
            parameters = self._parameters.of(ControllerParameters)
            for name in values.keys() - {row.name for row in self._implementation.tunable}:
                raise ParameterError(
                    f"{CONTROLLER}.{name} can't change during a run of "
                    f'{public_reference(self._implementation.parameters.implementation)}'
                )
            self._implementation.check(parameters)
            self._messages.retuned(now_ns, values)
            self.program.retune(parameters)


def replay_controller(
    recording: RobotRecording,
    inputs: RunInputs,
    parameters: ParameterSet,
    comparator: MessageComparator,
) -> Iterator[ReplayedTick]:
    """Feed recorded samples to a controller with these parameters, and compare its messages.

    Yields
    ------
    ReplayedTick
        Each tick, as soon as its inputs are complete.

    Raises
    ------
    RecordingError
        If a sample can't be decoded, or has a value that its device can't send.
    """
    reader, run = recording.reader, inputs.run
    samples: dict[Topic, dict[int, Any]] = {topic: {} for topic in INPUT_READERS}
    sink = partial(comparator.add_replayed, epoch=run.epoch)
    messages = ControllerMessages(lambda topic: partial(sink, topic))
    retuned = _RetunedProgram(recording, inputs, parameters, messages)
    program = retuned.program
    now = run.start_ns
    for topic, raw in _messages(recording, inputs):
        comparator.add_recorded(topic, raw.stamp_ns, raw.data, run.epoch)
        if topic not in INPUT_READERS:
            continue
        with recording_error_context(reader, raw.topic, raw.stamp_ns):
            samples[topic][raw.stamp_ns] = INPUT_READERS[topic](raw.data)
        while now <= inputs.last_ns and all(
            now in samples[due] for due in INPUT_READERS if now % due.period_ns == 0
        ):
            readings = device_inputs(lambda each: samples[each].pop(now, None))  # noqa: B023
            elapsed = now - run.start_ns
            retuned.repeat(now)
            with recording_error_context(reader, 'the inputs', now):
                outputs = program.tick(elapsed // MILLISECOND_NS, now // MILLISECOND_NS, readings)
                messages.tick(now, outputs, program)
            yield ReplayedTick(now, readings, outputs)
            now += TICK_NS


def replay_run(
    recording: RobotRecording,
    inputs: RunInputs,
    parameters: ParameterSet,
    comparator: MessageComparator,
    recorded_devices: Iterable[AnyDeviceMessages] = (),
) -> Iterator[Tick]:
    """Run the whole robot with its parameters, recorded sticks and pushes; compare all messages.

    Parameters
    ----------
    recorded_devices : iterable of DeviceMessages
        The devices that are not simulated: their recorded samples are used.

    Yields
    ------
    Tick
        Each tick of the closed loop.
    """
    run = inputs.run
    samples = {
        each.device.field: _samples(recording, inputs, each.sample) for each in recorded_devices
    }

    def replayed(topic: Topic, stamp_ns: int, data: bytes) -> None:
        # Leave out stamped messages after the last tick with a duty: a push may end later, and in
        # a run without a duty only events are compared.
        if stamp_ns <= inputs.last_ns or topic in EVENTS:
            comparator.add_replayed(topic, stamp_ns, data, run.epoch)

    messages = RunMessages(lambda topic: partial(replayed, topic), parameters)
    retuned = _RetunedProgram(recording, inputs, parameters, messages)
    loop = ClosedLoop(parameters, inputs, run.start_ns, retuned.program, samples)
    messages.begin(run.start_ns, loop.world, loop.pushes)
    for topic, raw in _messages(recording, inputs):
        comparator.add_recorded(topic, raw.stamp_ns, raw.data, run.epoch)
        # Do not run ahead of the recording, so that few messages wait for their counterparts.
        while topic is CLOCK and loop.plant.time_ns <= raw.stamp_ns:
            retuned.repeat(loop.plant.time_ns)
            tick = loop.tick()
            source = inputs.sources.get(tick.truth.stamp_ns, '')
            messages.tick(tick, loop.program, source)
            yield tick


def _samples(recording: RobotRecording, inputs: RunInputs, topic: Topic) -> dict[int, Any]:
    """Return the readings of a device in a run, by their stamps [ns]."""
    readings = {}
    for epoch, _, raw in recording.messages([topic], inputs.run.start_ns):
        if epoch == inputs.run.epoch and raw.stamp_ns <= inputs.last_ns:
            with recording_error_context(recording.reader, raw.topic, raw.stamp_ns):
                readings[raw.stamp_ns] = INPUT_READERS[topic](raw.data)
    return readings


def compare_events(
    recording: RobotRecording, runs: Iterable[RunInputs], comparator: MessageComparator
) -> None:
    """Add the events to a comparator, in each epoch up to the end of the last of the `runs`."""
    ends = {each.run.epoch: max(each.run.start_ns, each.last_ns) for each in runs}
    for epoch, topic, raw in recording.messages(EVENTS):
        if epoch in ends and raw.stamp_ns <= ends[epoch]:
            comparator.add_recorded(topic, raw.stamp_ns, raw.data, epoch)


def _messages(recording: RobotRecording, inputs: RunInputs) -> Iterator[tuple[Topic, RawMessage]]:
    """Iterate over the stamped messages of a run."""
    stamped = [topic for topic in ALL_TOPICS if topic not in EVENTS]
    for epoch, topic, raw in recording.messages(stamped, inputs.run.start_ns):
        if epoch == inputs.run.epoch and raw.stamp_ns <= inputs.last_ns:
            yield topic, raw
