"""The external inputs of each run in a recording, with which it can be replayed."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import groupby
from operator import attrgetter

from ballbot_ros.analysis.announced_parameters import AnnouncedParameters
from ballbot_ros.analysis.recorded_pushes import PushPairs
from ballbot_ros.analysis.recorded_runs import (
    RecordedRun,
    RobotRecording,
    RunFinder,
    messages_by_epoch,
)
from ballbot_ros.analysis.robot_topics import robot_topics
from ballbot_ros.errors import BallbotError
from ballbot_ros.messages.conversions import decode_sticks, stamp_ns
from ballbot_ros.messages.inputs import INPUT_READERS
from ballbot_ros.messages.motor_stop import is_stop
from ballbot_ros.messages.parameter_events import decode_parameter_event
from ballbot_ros.messages.raw import stamp_of
from ballbot_ros.messages.topics import (
    ACCEPTED_PUSH,
    CLOCK,
    GAMEPAD_JOY,
    MOTOR_DUTY,
    PARAMETER_EVENTS,
    PARTICIPANTS,
    RUN,
    RUN_STATUS,
    Topic,
)
from ballbot_ros.parameters import Value
from ballbot_ros.plant.ground_truth import Push
from ballbot_ros.recording.batch import RawMessage
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.timing import TICK_NS

_DECODED = {RUN, GAMEPAD_JOY, ACCEPTED_PUSH, MOTOR_DUTY, PARAMETER_EVENTS, *INPUT_READERS}


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
    def ticks(self) -> int:
        """Number of ticks with a duty."""
        return max(0, (self.last_ns - self.run.start_ns) // TICK_NS + 1)

    def sticks_at(self, time: float) -> tuple[int, int]:
        """Return the sticks at `time` [s] from the start of the run."""
        return self.sticks.get(self.run.start_ns + round(time * 1e9), (0, 0))

    def pushes_from(self, start_ns: int) -> Sequence[Push]:
        """Return the pushes of a run that begins at sim time `start_ns`."""
        later_ns = start_ns - self.run.start_ns
        return [
            replace(push, start_ns=push.start_ns + later_ns, end_ns=push.end_ns + later_ns)
            for push in self.pushes
        ]


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


@contextmanager
def recording_error_context(reader: RecordingReader, what: str, stamp_ns: int) -> Iterator[None]:
    """Add the place in the recording to errors about unusable values.

    Raises
    ------
    RecordingError
        If a value is not finite, out of the device's range, or missing.
    """
    try:
        yield
    except (BallbotError, IndexError, OverflowError, ValueError) as error:
        raise RecordingError(f'{reader.path}: {what} at {stamp_ns} ns: {error}') from None


def read_inputs(reader: RecordingReader) -> RecordedInputs:
    """Read everything needed to replay the runs of a recording.

    Raises
    ------
    RecordingError
        If it is not a recording of this robot, begins in mid-run, or has an unusable message.
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
        if topic is PARAMETER_EVENTS:
            with recording_error_context(reader, raw.topic, raw.stamp_ns):
                values = self.retunings.setdefault(stamp_of(raw.data), {})
                values.update(decode_parameter_event(raw.data))
            return
        message = reader.decode(raw)
        if topic is GAMEPAD_JOY:
            with recording_error_context(reader, raw.topic, raw.stamp_ns):
                self.sticks[stamp_ns(message)] = decode_sticks(raw.data)
            self.sources[stamp_ns(message)] = message.header.frame_id
        elif topic is MOTOR_DUTY:
            with recording_error_context(reader, raw.topic, raw.stamp_ns):
                self.duties[stamp_ns(message)] = int(message.vector.x), int(message.vector.y)
        else:
            self.pushes.add(message)

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
