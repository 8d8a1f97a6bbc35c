"""A recorded run: the series of each topic as compact columns."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.extraction import STAMPED_TOPICS, Extraction, Status, extract
from ballbot_ros.analysis.figure_parts import Interval, IntervalKind
from ballbot_ros.analysis.recorded_runs import RecordedRun
from ballbot_ros.analysis.recorded_scenario import (
    RecordedAttachments,
    RecordedPush,
    fault_intervals,
    known_faults,
    read_attachments,
    recorded_pushes,
)
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.scenario.task_timing import duty_rank, task_timing
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.errors import RecordingError, one_line
from ballbot_ros.lockstep.run_actions import Outcome, ParameterChange
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    ControllerParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.changes import IMPLEMENTATION, parse_succession, scheduled_at
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS, TICK_S
from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.messages.conversions import map_grid
from ballbot_ros.recording.messages.jobs import Jobs
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.recording.messages.topics import (
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_ODOM,
    Topic,
)
from ballbot_ros.recording.overview import TopicStatistics
from ballbot_ros.recording.rosbag2 import PARAMETERS
from ballbot_ros.recording.writer import RUN_OUTCOME
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.brick import Tone
from ballbot_ros.robot.world.floor_map import FloorMap, OccupancyGrid

Integers = NDArray[np.int64]
_REAL = (
    'A real robot: position and pitch are the estimates of its controller, at the packets of its '
    'data log. The true ones are unknown, so nothing is judged.'
)
_NO_PROGRAM = f"No {PARAMETERS} of its program is attached; the document's ball is assumed."
_NOTHING = np.full((0, 2), np.nan)
_NO_TICKS = Trajectory(np.zeros(0), _NOTHING, _NOTHING, _NOTHING)
_Event = TypeVar('_Event')


def seconds(stamps: Integers) -> Floats:
    """Return stamps [ns] in seconds."""
    return np.asarray(stamps * 1e-9, np.float64)


@dataclass(frozen=True)
class Series:
    """Samples of one topic in one run.

    Attributes
    ----------
    stamps : ndarray, shape (n,)
        Sim time [ns], increasing.
    time : ndarray, shape (n,)
        Time since the first tick of the run [s].
    values : ndarray, shape (n, k)
        The columns listed in :mod:`ballbot_ros.analysis.extraction`.
    """

    stamps: Integers
    time: Floats
    values: Floats

    def at(self, stamps: Integers) -> Floats:
        """Return the values at `stamps`, shape (m, k); NaN where there is no sample."""
        if np.array_equal(stamps, self.stamps):
            return self.values
        indices = np.searchsorted(self.stamps, stamps).clip(max=len(self.stamps) - 1)
        missing = self.stamps[indices] != stamps
        return np.where(missing[:, np.newaxis], np.nan, self.values[indices])

    def held(self, stamps: Integers) -> Floats:
        """Return the newest values at `stamps`, shape (m, k); NaN before the first sample."""
        rows = np.searchsorted(self.stamps, stamps, side='right') - 1
        return np.where(rows[:, np.newaxis] < 0, np.nan, self.values[rows.clip(min=0)])


@dataclass(frozen=True)
class RunData:
    """One run of a recording.

    Attributes
    ----------
    number, count : int
        Number of the run in the file, from 1, and number of runs.
    recorded : RecordedRun
        Where the run is in the file.
    trajectory : Trajectory
        The ticks with a sample of each of the three topics (true pitch, true position, duty) that
        was recorded; the columns of a topic that was not recorded are NaN. None of a real robot.
    motion : Trajectory
        What to show: the trajectory, or of a real robot the estimates of its controller.
    series : mapping of Topic to Series
        The topics of :data:`ballbot_ros.analysis.extraction.STAMPED_TOPICS` that have samples.
    grid : OccupancyGrid or None
        The recorded map.
    statuses : tuple
        The diagnostics: time [s] and report.
    pages : tuple of tuple
        The display: time [s] and text.
    tones : tuple of tuple
        Time [s] and tone.
    jobs : Jobs or None
        Those of the brick's tasks; None if the tasks took no time.
    decisions : tuple of Interval
        The moments that decide the properties of the scenario, once it is assessed.
    damage : str or None
        What the reader found missing in the file.
    missing_ticks : int
        Number of missing ticks from the start of the run to the last tick.
    reached_end : bool
        Whether the run is as long as its parameter `duration`, or the duration is unknown.
    failure : str
        Why the run failed, as recorded at its end; '' if it did not, or if it is unknown.
    """

    path: Path
    number: int
    count: int
    recorded: RecordedRun
    is_real: bool
    trajectory: Trajectory
    motion: Trajectory
    series: Mapping[Topic, Series]
    states: tuple[Interval, ...]
    grid: OccupancyGrid | None
    statuses: tuple[tuple[float, Status], ...]
    pages: tuple[tuple[float, str], ...]
    tones: tuple[tuple[float, Tone], ...]
    parameter_changes: tuple[ParameterChange, ...]
    topic_statistics: tuple[TopicStatistics, ...]
    attached: RecordedAttachments
    damage: str | None
    missing_ticks: int
    reached_end: bool
    notices: tuple[str, ...]
    plant: PlantParameters = field(default_factory=PlantParameters)
    failure: str = ''
    pushes: tuple[RecordedPush, ...] = ()
    wall_hits: tuple[Interval, ...] = ()
    jobs: Jobs | None = None
    decisions: tuple[Interval, ...] = ()

    @property
    def name(self) -> str:
        """Name of the recording; `ballbot run` names it after the scenario."""
        return self.path.stem

    @property
    def end(self) -> float:
        """Time of the last tick, or of a real robot's last packet [s]; 0 if there is none."""
        return float(self.motion.time[-1]) if len(self.motion.time) else 0.0

    @property
    def start_ns(self) -> int:
        """Sim time of the first tick [ns]."""
        return self.recorded.start_ns

    @property
    def floor(self) -> FloorMap | OccupancyGrid | None:
        """The attached map, which includes lines, or else the recorded grid, or else None."""
        floor_map = self.attached.floor_map
        return self.grid if floor_map is None else floor_map

    @property
    def marked(self) -> tuple[Interval, ...]:
        """What figures shade: calibration, pushes, wall hits, faults and moments of properties."""
        calibration = (each for each in self.states if each.name == OperatingState.CALIBRATION)
        # Those from outside first: where names have no room, theirs stay.
        pushes = sorted(self.pushes, key=lambda push: not push.is_external)
        shaded = (*calibration, *(push.interval for push in pushes), *self.wall_hits)
        faults = fault_intervals(self.attached.parameters, self.end)
        return (*shaded, *faults, *self.decisions)

    @property
    def outside_changes(self) -> tuple[ParameterChange, ...]:
        """The changes of parameters that are not part of the scenario."""
        text = self.attached.parameters.of(ControllerParameters).changes
        return tuple(
            each
            for each in self.parameter_changes
            if (each.name, each.value) not in scheduled_at(text, each.time)
        )

    @property
    def has_documents_program(self) -> bool:
        """Whether the controller is the document's program, with known parameters."""
        attached = self.attached
        return attached.has_parameters and attached.controller in DOCUMENTS_PROGRAM

    @property
    def intact(self) -> bool:
        """Whether every tick up to the last has its true state and its duty."""
        return self.missing_ticks == 0 and all(
            topic in self.series for topic in (PLANT_IMU, PLANT_ODOM, MOTOR_DUTY)
        )

    @property
    def is_driven(self) -> bool:
        """Whether sticks or the autonomous drive move the robot: its pitch need never settle."""
        sticks = self.series.get(GAMEPAD_JOY)
        is_steered = sticks is not None and bool(np.nan_to_num(sticks.values).any())
        drives = OperatingState.FORWARD, OperatingState.RIGHTWARD, OperatingState.BACKWARD
        return is_steered or any(each.name in drives for each in self.states)

    def samples(self, topic: Topic, stamps: Integers) -> Floats:
        """Return the values of a topic at `stamps`, shape (m, k); a real robot's are held."""
        series = self.series[topic]
        return series.held(stamps) if self.is_real else series.at(stamps)

    @property
    def complete(self) -> bool:
        """Whether the run is complete from the first to the last tick, or packet."""
        if self.is_real:
            return self.damage is None
        return self.intact and self.reached_end and self.damage is None

    @cached_property
    def duty_sha256(self) -> str | None:
        """SHA-256 of all int8 duty pairs, which identifies the run.

        None if ticks are missing in the recording, or the run was not in lockstep.
        """
        if not self.intact or self.damage or not self.plant.lockstep:
            return None
        return hashlib.sha256(self.trajectory.duty.astype(np.int8).tobytes()).hexdigest()

    @property
    def calibrated(self) -> float:
        """When the calibration ended [s]: a brick sends packets only from then on."""
        program = self.attached.parameters.of(ControllerParameters)
        return 0.0 if self.is_real else program.time_start * 1e-3

    def balancing(self, time: Floats) -> NDArray[np.bool_]:
        """Return a mask of the times [s] at which the controller was calibrated and in control."""
        runs = np.asarray(time >= self.calibrated)
        for each in self.states:
            if each.name in (OperatingState.CALIBRATION, OperatingState.OUT_OF_CONTROL):
                runs &= (time < each.start) | (time > each.end)
        return runs


def read_run(
    path: str | Path,
    number: int | None = None,
    progress: ProgressCallback = lambda done, total: None,
) -> RunData:
    """Read a run of a recording; of a damaged file, the part before the damage.

    Runs are numbered from 1 in the file; None means the last. From time to time `progress` is
    called with the number of messages read and their total. It raises RecordingError if the file
    can't be read, is not a recording of a ballbot, or has no such run.
    """
    with open_recording(path) as recording:
        attached = read_attachments(recording.attachments())
        extraction = extract(recording, progress)
        damage = recording.damage
        outcome = recording.metadata().get(RUN_OUTCOME, {})
    runs = extraction.runs
    if number is None:
        number = len(runs)
    if not 1 <= number <= len(runs):
        known = 'run 1' if len(runs) == 1 else f'runs 1 … {len(runs)}'
        raise RecordingError(f'{path}: run {number} not found; the file has {known}')
    failure = ''  # the outcome is that of the last run
    if number == len(runs) and outcome.get('outcome') == Outcome.FAILED.value:
        failure = one_line(outcome.get('reason', ''))
    return run_data(Path(path), extraction, attached, number, damage=damage, failure=failure)


def _changes(
    extraction: Extraction, run: RecordedRun, before: ParameterSet, told: ParameterSet
) -> Iterator[ParameterChange]:
    """Yield what changed in the controller during a run, and the controller that took over.

    Then come the faults that nodes were given during the run: those in the parameters that they
    `told` and not in those from `before` it.
    """
    changes = list(_events(extraction.retunings, run))
    if after := parse_succession(told.of(ControllerParameters).changes):
        changes.append((after.time, {IMPLEMENTATION: after.values[IMPLEMENTATION]}))
    for time, values in sorted(changes, key=itemgetter(0)):
        for name, value in values.items():
            yield ParameterChange(time, CONTROLLER, name, value)
    known = known_faults(before)
    yield from (ParameterChange.of_fault(each) for each in known_faults(told) if each not in known)


def run_data(
    path: Path,
    extraction: Extraction,
    attached: RecordedAttachments,
    number: int = 1,
    *,
    damage: str | None = None,
    failure: str = '',
) -> RunData:
    """Return a run of what was extracted from a recording; RecordingError if it has no ticks."""
    runs = extraction.runs
    run = runs[number - 1]
    before, attached = attached, attached.for_run(run.name, extraction.announced)
    notices = [*extraction.notices, *attached.notices]
    if len(runs) > 1:
        notices.append(f'The file holds {len(runs)} runs; this is run {number}.')
    series = _series(extraction, run)
    if not series:
        raise RecordingError(f'{path}: run {number} of {len(runs)} has no ticks')
    parts = _events(extraction.jobs, run)
    jobs = Jobs.joined([each for _, each in parts]) if parts else None
    plant = attached.parameters.of(PlantParameters)
    has_map = bool(plant.map) or not extraction.announced.has_parameters(run.name)
    if extraction.is_real:
        notices = [_REAL, *(each for each in notices if not each.startswith('No '))]
        if not attached.has_parameters:
            notices.append(_NO_PROGRAM)
        radius = attached.parameters.of(ControllerParameters).ball_radius
        plant = PlantParameters(hold_time=0.0, ball_radius=radius)
        trajectory, missing = _NO_TICKS, 0
        motion = _estimated_motion(series, radius)
    else:
        trajectory, missing = _trajectory(series, run.start_ns, plant.lockstep)
        motion = trajectory
    if jobs is not None and MOTOR_DUTY in series:
        controller = attached.parameters.of(ControllerParameters)
        timing = _timing(series[MOTOR_DUTY], trajectory, jobs, parts[-1][0], controller)
        trajectory = motion = replace(trajectory, timing=timing)
    last = motion.time[-1] if len(motion.time) else 0.0
    if not attached.has_parameters and PLANT_ODOM in series:
        x, y = map(float, series[PLANT_ODOM].values[0])
        plant = replace(plant, start_position_x=x, start_position_y=y)
    if not plant.lockstep:
        notices.append(
            'A free-running run: the file does not say which duties acted; the newest one of each '
            'tick is shown.'
        )
    ticks = round(plant.duration * SECOND_NS) // TICK_NS
    reached_end = (len(trajectory.time) and round(last * SECOND_NS) // TICK_NS + 1 >= ticks) > 0
    return RunData(
        path=path,
        number=number,
        count=len(runs),
        recorded=run,
        is_real=extraction.is_real,
        trajectory=trajectory,
        motion=motion,
        series=series,
        states=tuple(
            Interval(start, end, state)
            for start, end, state in _lasting(extraction.states, run, last)
            if end > start
        ),
        grid=_grid(extraction, run) if has_map else None,
        statuses=_events(extraction.statuses, run),
        pages=_events(extraction.pages, run),
        tones=_events(extraction.tones, run),
        parameter_changes=tuple(_changes(extraction, run, before.parameters, attached.parameters)),
        topic_statistics=tuple(extraction.topic_statistics.values()),
        attached=attached,
        damage=damage,
        missing_ticks=missing,
        reached_end=extraction.is_real or bool(reached_end),
        notices=tuple(notices),
        plant=plant,
        failure=failure,
        pushes=_pushes(extraction, run, last, attached.scenario),
        wall_hits=tuple(
            Interval(start, end, 'wall hit', IntervalKind.WALL_HIT)
            for start, end, is_hit in _lasting(extraction.wall_hits, run, last)
            if is_hit
        ),
        jobs=jobs,
    )


def _series(extraction: Extraction, run: RecordedRun) -> dict[Topic, Series]:
    """Return the samples of a run by topic; topics with equal stamps share stamps and times."""
    found: dict[Topic, Series] = {}
    for topic in STAMPED_TOPICS:
        stamps, values = extraction.buffers[topic].epoch(run.epoch)
        first, last = np.searchsorted(stamps, [run.start_ns, run.end_ns])
        if first == last:
            continue
        stamps = stamps[first:last]
        for other in found.values():
            if np.array_equal(stamps, other.stamps):
                stamps, time = other.stamps, other.time
                break
        else:
            # Compute the time as the log of a run without recording does, for equal numbers.
            time = seconds(stamps) - run.start_ns * 1e-9
        found[topic] = Series(stamps, time, values[first:last])
    return found


def _trajectory(
    series: Mapping[Topic, Series], start: int, lockstep: bool
) -> tuple[Trajectory, int]:
    """Return the complete ticks, and the number of missing ones up to the last."""
    sources = [topic for topic in (PLANT_IMU, PLANT_ODOM, MOTOR_DUTY) if topic in series]
    duty = series.get(MOTOR_DUTY)
    if not lockstep and len(sources) > 1 and duty is not None:
        sources.remove(MOTOR_DUTY)  # its stamps are not those of ticks; the newest duty acts
    if not sources:
        return _NO_TICKS, 0
    stamps = series[sources[0]].stamps
    for topic in sources[1:]:
        if not np.array_equal(stamps, series[topic].stamps):
            stamps = np.intersect1d(stamps, series[topic].stamps, assume_unique=True)
    absent = np.broadcast_to(np.nan, (len(stamps), 2))
    psi = series[PLANT_IMU].at(stamps)[:, :2] if PLANT_IMU in series else absent
    position = series[PLANT_ODOM].at(stamps) if PLANT_ODOM in series else absent
    duties: NDArray[Any] = absent
    if duty is not None:
        held = stamps
        if MOTOR_DUTY not in sources:
            indices = np.searchsorted(duty.stamps, stamps, side='right') - 1
            held = duty.stamps[indices.clip(min=0)]
        duties = duty.at(held)[:, :2]
    missing = 0
    if len(stamps):
        missing = int((stamps[-1] - start) // TICK_NS + 1 - len(stamps))
    return Trajectory(seconds(stamps) - start * 1e-9, position, psi, duties), max(0, missing)


def _estimated_motion(series: Mapping[Topic, Series], ball_radius: float) -> Trajectory:
    """Return what a real robot's controller took for its motion."""
    state = series.get(CONTROLLER_STATE)
    if state is None:
        return _NO_TICKS
    estimates = state.values.astype(float)
    duty = np.full((len(state.time), 2), np.nan)
    if MOTOR_DUTY in series:
        duty = series[MOTOR_DUTY].at(state.stamps)[:, :2].astype(float)
    return Trajectory(state.time, ball_radius * estimates[:, [0, 2]], estimates[:, [1, 3]], duty)


def _timing(
    duty: Series,
    trajectory: Trajectory,
    jobs: Jobs,
    last: float,
    controller: ControllerParameters,
) -> Floats:
    """Return the timing of the ticks up to the time [s] of the last message with jobs."""
    tasks, task, *columns = jobs
    ticks = int(np.searchsorted(trajectory.time, last + TICK_S / 2))
    rows = np.searchsorted(duty.time, trajectory.time[:ticks] - TICK_S / 2)
    rows = rows.clip(max=len(duty.time) - 1)  # of a free-running controller
    table = np.column_stack([np.array([*map(duty_rank, tasks)])[task], *columns])
    delays_ns = 1000 * np.rint(1e6 * duty.values[rows, 2]).astype(np.int64)
    return task_timing(controller, table, duty.stamps[rows], trajectory.duty[:ticks], delays_ns)


def _events(
    events: list[tuple[int, int, _Event]], run: RecordedRun
) -> tuple[tuple[float, _Event], ...]:
    """Return the events of a run with their times [s]."""
    return tuple(
        ((stamp - run.start_ns) / SECOND_NS, event)
        for epoch, stamp, event in events
        if run.has(epoch, stamp)
    )


def _lasting(
    published: list[tuple[int, int, _Event]], run: RecordedRun, last: float
) -> Iterator[tuple[float, float, _Event]]:
    """Yield begin and end [s] of what each event says, which holds until the next event."""
    events = _events(published, run)
    ends = [time for time, _ in events[1:]] + [float(last) + TICK_S]
    for (time, content), end in zip(events, ends, strict=False):  # one more end if no event
        yield time, end, content


def _pushes(
    extraction: Extraction, run: RecordedRun, last: float, scenario: Scenario | None
) -> tuple[RecordedPush, ...]:
    announced = extraction.pushes[run.epoch].pushes
    pushes = [push for push in announced if run.has(run.epoch, push.start_ns)]
    scheduled = scenario.pushes_from(run.start_ns) if scenario else ()
    found = recorded_pushes(pushes, scheduled, run.start_ns)
    # The pushes of a scenario are announced at its start, also those after an early end.
    return tuple(push for push in found if push.start <= last)


def _grid(extraction: Extraction, run: RecordedRun) -> OccupancyGrid | None:
    """Return the last map published before the end of a run."""
    published = [
        message
        for epoch, stamp, message in extraction.maps
        if (epoch, stamp) < (run.epoch, run.end_ns)
    ]
    if not published:
        return None
    message = published[-1]
    info = message.info
    if len(message.data) != info.width * info.height or not info.resolution > 0.0:
        return None
    return map_grid(message)
