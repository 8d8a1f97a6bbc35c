"""Replaying a recorded run: the controller with its inputs, or the whole robot."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby, repeat
from operator import attrgetter
from typing import Any, NamedTuple

from ballbot_ros.analysis.message_comparison import MessageComparator
from ballbot_ros.analysis.recorded_runs import (
    AnnouncedParameters,
    RecordedRun,
    RobotRecording,
    RunFinder,
    messages_by_epoch,
    robot_topics,
)
from ballbot_ros.analysis.recorded_scenario import PushPairs
from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.engine.brick_tasks import BrickTasks
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.compiled_loop import CompiledLoop, pays
from ballbot_ros.engine.law_runs import FAULTS
from ballbot_ros.engine.trajectory import Engine
from ballbot_ros.engine.tuned_program import TunedProgram
from ballbot_ros.errors import BallbotError, RecordingError
from ballbot_ros.parameters import GAMEPAD, ControllerParameters, ParameterSet, Value
from ballbot_ros.parameters.changes import PendingChanges
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.recording.batch import RawMessage
from ballbot_ros.recording.messages.conversions import decode_real_duty, decode_sticks, is_stop
from ballbot_ros.recording.messages.devices import INPUT_READERS, AnyDeviceMessages, device_inputs
from ballbot_ros.recording.messages.raw import Messages, Stamps, has_stamp, stamp_of
from ballbot_ros.recording.messages.run_messages import (
    ControllerMessages,
    RunColumns,
    RunMessages,
    Send,
)
from ballbot_ros.recording.messages.run_reports import decode_parameter_event
from ballbot_ros.recording.messages.topics import (
    ACCEPTED_PUSH,
    CLOCK,
    GAMEPAD_JOY,
    MOTOR_DUTY,
    PARAMETER_EVENTS,
    PARTICIPANTS,
    REPLAYED_TOPICS,
    RUN,
    RUN_STATUS,
    Topic,
)
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.brick.bluetooth import NEUTRAL
from ballbot_ros.robot.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.robot.plant.ground_truth import Push

_DECODED = {RUN, GAMEPAD_JOY, ACCEPTED_PUSH, MOTOR_DUTY, PARAMETER_EVENTS, *INPUT_READERS}


class RecordedStick(NamedTuple):
    """A stick's signal; `points` has the times [s] of its samples and their values, and an end."""

    points: tuple[Sequence[float], Sequence[float]]


@dataclass(frozen=True)
class RunInputs:
    """A recorded run and its external inputs.

    Attributes
    ----------
    last_ns : int
        Sim time of the last tick with a duty [ns]; one tick before the start if there is none.
    sticks : mapping of int to tuple of int
        The gamepad's sticks by stamp [ns].
    sources : mapping of int to str
        The input in command, by stamp [ns].
    duties : mapping of int to tuple of int
        The duties [%] by stamp [ns].
    pushes : sequence of Push
        The pushes that acted, from the scenario or from outside.
    retunings : mapping of int to mapping of str to Value
        The controller's parameters that changed during the run: their new values by name, by the
        stamp [ns] of the tick from which they apply.
    """

    run: RecordedRun
    last_ns: int
    sticks: Mapping[int, tuple[int, int]]
    sources: Mapping[int, str]
    duties: Mapping[int, tuple[int, int]]
    pushes: Sequence[Push]
    retunings: Mapping[int, Mapping[str, Value]]

    @property
    def only_source(self) -> str | None:
        """The input in command, '' if there was none; None if there were several."""
        found = {*self.sources.values()} or {''}
        return found.pop() if len(found) == 1 else None

    @property
    def ticks(self) -> int:
        """Number of ticks with a duty."""
        return max(0, (self.last_ns - self.run.start_ns) // TICK_NS + 1)

    def sticks_at(self, time: float) -> tuple[int, int]:
        """Return the sticks at `time` [s] from the start of the run."""
        return self.sticks.get(self.run.start_ns + round(time * 1e9), NEUTRAL)

    @property
    def vertical(self) -> RecordedStick:
        """The vertical stick."""
        return self._stick(0)

    @property
    def horizontal(self) -> RecordedStick:
        """The horizontal stick."""
        return self._stick(1)

    def _stick(self, number: int) -> RecordedStick:
        start_ns = self.run.start_ns
        stamps_ns = range(start_ns, self.last_ns + 1, SLOW_PERIOD_NS)
        values = [float(self.sticks.get(each, NEUTRAL)[number]) for each in stamps_ns]
        times = [(each - start_ns) * 1e-9 for each in stamps_ns]
        return RecordedStick(([*times, math.inf], [*values, 0.0]))

    def pushes_from(self, start_ns: int) -> Sequence[Push]:
        """Return the pushes of a run that begins at sim time `start_ns`."""
        later_ns = start_ns - self.run.start_ns
        return [
            replace(push, start_ns=push.start_ns + later_ns, end_ns=push.end_ns + later_ns)
            for push in self.pushes
        ]


class RunToRepeat(NamedTuple):
    """A recorded run: its recording, its inputs and its parameters."""

    recording: RobotRecording
    inputs: RunInputs
    parameters: ParameterSet

    @property
    def implementation(self) -> str:
        """Name of the controller."""
        return str(self.parameters.of(ControllerParameters).implementation)

    def without_changes_of(self, name: str) -> RunToRepeat:
        """Return the run without the recorded changes of a parameter of the controller."""
        retunings = {
            stamp: {each: value for each, value in values.items() if each != name}
            for stamp, values in self.inputs.retunings.items()
        }
        return self._replace(inputs=replace(self.inputs, retunings=retunings))


@dataclass(frozen=True)
class RecordedInputs:
    """The data of a recording that are needed to replay its runs, in the order of the file."""

    recording: RobotRecording
    runs: tuple[RunInputs, ...]
    announced: AnnouncedParameters

    def has_begun(self, run: RecordedRun) -> bool:
        """Return whether the plant published the first tick of a run, even if no duty answered."""
        clocks = self.recording.messages([CLOCK], run.start_ns)
        stamps = (each.raw.stamp_ns for each in clocks if each.epoch == run.epoch)
        return next(stamps, None) == run.start_ns


class _RecordingErrorContext(NamedTuple):
    """Adds the place in the recording to errors about unusable values.

    It raises RecordingError if a value is not finite, out of the device's range, or missing. It is
    entered several times in a tick, and faster than a generator.
    """

    reader: RecordingReader
    what: str
    stamp_ns: int

    def __enter__(self) -> None:
        """Begin to use values."""

    def __exit__(self, cls: object, error: BaseException | None, trace: object) -> None:
        """Add the place to an error."""
        if isinstance(error, BallbotError | IndexError | OverflowError | ValueError):
            place = f'{self.reader.path}: {self.what} at {self.stamp_ns} ns'
            raise RecordingError(f'{place}: {error}') from None


def read_inputs(reader: RecordingReader) -> RecordedInputs:
    """Read everything needed to replay the runs of a recording.

    It raises RecordingError if the file is not a recording of this robot, begins in mid-run, or has
    an unusable message.
    """
    topics = robot_topics(reader)
    for name in topics.wrong_types:
        if topics.by_name[name] in _DECODED:
            raise RecordingError(f'{reader.path}: {topics.mismatch(name)}')
    finder, announced = RunFinder(reader), AnnouncedParameters()
    epochs: defaultdict[int, _EpochInputs] = defaultdict(_EpochInputs)
    wanted = (
        RUN_STATUS, PARTICIPANTS, GAMEPAD_JOY, ACCEPTED_PUSH, MOTOR_DUTY, PARAMETER_EVENTS,
    )  # fmt: skip
    for epoch, topic, raw in messages_by_epoch(reader, topics, finder, wanted):
        if topic in (PARTICIPANTS, RUN_STATUS):
            announced.add(topic, raw.data)
        elif topic is not MOTOR_DUTY or not is_stop(raw.data):
            epochs[epoch].add(reader, topic, raw)
    inputs: list[RunInputs] = []
    for epoch, runs in groupby(finder.runs(), key=attrgetter('epoch')):
        inputs += epochs[epoch].of_runs(reader, list(runs))
    if not inputs:
        raise _begins_in_mid_run(reader)
    return RecordedInputs(RobotRecording(reader, topics, finder.epochs), tuple(inputs), announced)


def _begins_in_mid_run(reader: RecordingReader) -> RecordingError:
    return RecordingError(f'{reader.path}: begins in mid-run')


@dataclass
class _EpochInputs:
    """The external inputs in one epoch of the file, by stamp [ns]."""

    sticks: dict[int, tuple[int, int]] = field(default_factory=dict)
    sources: dict[int, str] = field(default_factory=dict)
    duties: dict[int, tuple[int, int]] = field(default_factory=dict)
    pushes: PushPairs = field(default_factory=PushPairs)
    retunings: dict[int, dict[str, Value]] = field(default_factory=dict)

    def add(self, reader: RecordingReader, topic: Topic, raw: RawMessage) -> None:
        if topic is ACCEPTED_PUSH:
            self.pushes.add(reader.decode(raw))
            return
        if topic is GAMEPAD_JOY:
            self.sources[stamp_of(raw.data)] = reader.decode(raw).header.frame_id
        with _RecordingErrorContext(reader, raw.topic, raw.stamp_ns):
            if topic is PARAMETER_EVENTS:
                values = self.retunings.setdefault(stamp_of(raw.data), {})
                values.update(decode_parameter_event(raw.data))
            elif topic is MOTOR_DUTY:
                x, y = decode_real_duty(raw.data)
                self.duties[stamp_of(raw.data)] = int(x), int(y)
            else:
                self.sticks[stamp_of(raw.data)] = decode_sticks(raw.data)

    def of_runs(self, reader: RecordingReader, runs: Sequence[RecordedRun]) -> list[RunInputs]:
        """Return the inputs of each run of the epoch.

        Messages of different topics have no fixed order in a file, so the stamps decide which run
        a message belongs to.
        """
        starts = [run.start_ns for run in runs]
        if not runs[0].is_announced or min(self.duties, default=starts[0]) < starts[0]:
            raise _begins_in_mid_run(reader)
        last = [start - TICK_NS for start in starts]
        for stamp in self.duties:
            number = bisect_right(starts, stamp) - 1
            last[number] = max(last[number], stamp)
        pushes: list[list[Push]] = [[] for _ in runs]
        for push in self.pushes.pushes:
            pushes[bisect_right(starts, push.start_ns) - 1].append(push)
        return [
            RunInputs(run, last_ns, self.sticks, self.sources, self.duties, acted, self.retunings)
            for run, last_ns, acted in zip(runs, last, pushes, strict=True)
        ]


class ReplayedTick(NamedTuple):
    """A controller's outputs for recorded inputs, at a sim time [ns]."""

    stamp_ns: int
    inputs: DeviceInputs
    outputs: DeviceOutputs


EVENTS = [topic for topic in REPLAYED_TOPICS if not has_stamp(topic.type_name)]
"""Topics without stamps: only the order of their messages shows which run they belong to."""

STAMPED_TOPICS = [topic for topic in REPLAYED_TOPICS if topic not in EVENTS]


class _RetunedProgram(TunedProgram):
    """A controller's program, whose parameters change at the ticks at which they have changed."""

    def __init__(self, job: RunToRepeat, messages: ControllerMessages) -> None:
        self._reader, self._messages = job.recording.reader, messages
        start_ns = job.inputs.run.start_ns
        changes = sorted(each for each in job.inputs.retunings.items() if each[0] >= start_ns)
        implementation = implementation_for(job.parameters.of(ControllerParameters))
        super().__init__(implementation, PendingChanges(changes))

    def repeat(self, now_ns: int) -> None:
        """Repeat the changes before the tick at `now_ns` [ns]."""
        if (next_ns := self.changes.next_ns) is None or next_ns > now_ns:
            return
        with _RecordingErrorContext(self._reader, PARAMETER_EVENTS.name, now_ns):
            if values := self.advance(now_ns):
                self._messages.retuned(now_ns, values)


def replay_controller(job: RunToRepeat, comparator: MessageComparator) -> Iterator[ReplayedTick]:
    """Feed recorded samples to a controller with the run's parameters, and compare its messages.

    It yields each tick as soon as its inputs are complete, and raises RecordingError if a sample
    can't be decoded, or has a value that its device can't send.
    """
    reader, inputs, run = job.recording.reader, job.inputs, job.inputs.run
    samples: dict[Topic, dict[int, Any]] = {topic: {} for topic in INPUT_READERS}

    def replayed(topic: Topic, stamp_ns: int, data: bytes) -> None:
        comparator.add_replayed(topic, [stamp_ns], [data], run.epoch)

    messages = ControllerMessages(lambda topic: partial(replayed, topic))
    retuned = _RetunedProgram(job, messages)
    program = retuned.program
    tasks = BrickTasks(job.parameters.of(ControllerParameters), run.start_ns)
    now = run.start_ns
    for topic, raw in _messages(job, STAMPED_TOPICS):
        comparator.add_recorded(topic, [raw.stamp_ns], [raw.data], run.epoch)
        if topic not in INPUT_READERS:
            continue
        with _RecordingErrorContext(reader, raw.topic, raw.stamp_ns):
            samples[topic][raw.stamp_ns] = INPUT_READERS[topic](raw.data)
        while now <= inputs.last_ns and all(
            now in samples[due] for due in INPUT_READERS if now % due.period_ns == 0
        ):
            readings = device_inputs(lambda each: samples[each].pop(now, None))  # noqa: B023
            retuned.repeat(now)
            with _RecordingErrorContext(reader, 'the inputs', now):
                outputs = tasks.tick(program, now, readings)
                messages.tick(now, outputs, program)
            yield ReplayedTick(now, readings, outputs)
            now += TICK_NS


def replay_run(
    job: RunToRepeat, comparator: MessageComparator, recorded_devices: Iterable[AnyDeviceMessages]
) -> Iterator[Engine]:
    """Run the whole robot with its parameters, recorded sticks and pushes; compare all messages.

    The recorded devices are not simulated: their recorded samples are used. It yields what has
    computed each tick of the closed loop.
    """
    samples = {each.device.field: _samples(job, each.sample) for each in recorded_devices}
    robot = _Robot(job, comparator, samples)
    run, last_ns = job.inputs.run, job.inputs.last_ns
    blocks = job.recording.blocks(STAMPED_TOPICS, run.start_ns, last_ns)
    for epoch, topic, stamps_ns, data in blocks:
        if epoch == run.epoch:
            comparator.add_recorded(topic, stamps_ns, data, epoch)
            # Do not run ahead of the recording, so that few messages wait for their counterparts.
            if topic is CLOCK:
                yield from robot.run_to(max(stamps_ns))


class _Robot:
    """The robot of a recorded run, which compares its messages.

    The samples are as those of :class:`~ballbot_ros.engine.closed_loop.ClosedLoop`.
    """

    def __init__(
        self,
        job: RunToRepeat,
        comparator: MessageComparator,
        samples: Mapping[str, Mapping[int, object]],
    ) -> None:
        self._inputs = inputs = job.inputs
        parameters = ParameterSet()
        parameters.update(job.parameters)
        # The recorded sticks are those that have passed the gamepad's faults.
        parameters.set(GAMEPAD, 'faults', '')
        start_ns, epoch = inputs.run.start_ns, inputs.run.epoch

        def replayed(topic: Topic, stamp_ns: int, data: bytes) -> None:
            # Leave out stamped messages after the last tick with a duty: a push may end later, and
            # in a run without a duty only events are compared.
            if stamp_ns <= inputs.last_ns or topic in EVENTS:
                comparator.add_replayed(topic, [stamp_ns], [data], epoch)

        def all_replayed(topic: Topic, stamps_ns: Stamps, messages: Messages) -> None:
            comparator.add_replayed(topic, stamps_ns.tolist(), messages.tolist(), epoch)

        def make(topic: Topic) -> Send:
            return partial(replayed, topic)

        self._messages = RunMessages(make, parameters)
        self._retuned = _RetunedProgram(
            job._replace(parameters=parameters), self._messages.controller
        )
        program = self._retuned.program
        self._loop = ClosedLoop(parameters, inputs, start_ns, program, samples)
        self._messages.begin(start_ns, self._loop.world, self._loop.pushes)
        self._compiled: CompiledLoop | None = None
        source = inputs.only_source
        self._source = source or ''
        is_plain = start_ns == FIRST_TICK_NS and not samples and not inputs.retunings
        if is_plain and source is not None and pays(inputs.ticks, program):
            self._compiled = CompiledLoop(self._loop, program, parameters, inputs)
            self._columns = RunColumns(
                self._messages, make, lambda topic: partial(all_replayed, topic), parameters
            )

    def run_to(self, last_ns: int) -> Iterator[Engine]:
        """Make the ticks up to a stamp [ns], as :func:`replay_run` does."""
        loop, inputs = self._loop, self._inputs
        if self._compiled and loop.plant.time_ns <= last_ns:
            ticks, done = (last_ns - loop.plant.time_ns) // TICK_NS + 1, 0
            with suppress(*FAULTS):  # of a law; the interpreter tells them
                log, columns = self._compiled.trace(ticks)
                done = len(log.duty)
            if done:
                self._columns.ticks(columns, loop.program, self._source)
            if done < ticks:
                self._compiled = None  # which ends a run at a wall hit
            yield from repeat(Engine.COMPILED, done)
        while loop.plant.time_ns <= last_ns:
            now_ns = loop.plant.time_ns
            self._retuned.repeat(now_ns)
            self._messages.tick(loop.tick(), loop.program, inputs.sources.get(now_ns, ''))
            yield Engine.INTERPRETED


def _samples(job: RunToRepeat, topic: Topic) -> dict[int, object]:
    """Return the readings of a device in a run, by their stamps [ns]."""
    readings = {}
    for _, raw in _messages(job, [topic]):
        with _RecordingErrorContext(job.recording.reader, raw.topic, raw.stamp_ns):
            readings[raw.stamp_ns] = INPUT_READERS[topic](raw.data)
    return readings


def compare_events(
    recording: RobotRecording, runs: Iterable[RunInputs], comparator: MessageComparator
) -> None:
    """Add the events to a comparator, in each epoch up to the end of the last of the `runs`."""
    ends = {each.run.epoch: max(each.run.start_ns, each.last_ns) for each in runs}
    for epoch, topic, raw in recording.messages(EVENTS):
        if epoch in ends and raw.stamp_ns <= ends[epoch]:
            comparator.add_recorded(topic, [raw.stamp_ns], [raw.data], epoch)


def _messages(job: RunToRepeat, wanted: Collection[Topic]) -> Iterator[tuple[Topic, RawMessage]]:
    """Iterate over the messages of some stamped topics in a run."""
    run, last_ns = job.inputs.run, job.inputs.last_ns
    for epoch, topic, raw in job.recording.messages(wanted, run.start_ns):
        if epoch == run.epoch and raw.stamp_ns <= last_ns:
            yield topic, raw
