"""Many runs of a scenario that differ in numbers: of parameters, sticks or pushes."""

from __future__ import annotations

import hashlib
import math
from array import array
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.metrics import judge_property, measure_one
from ballbot_ros.analysis.signals import motion_signals
from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.compilation import CompilationError, compiled_and_kept
from ballbot_ros.engine.compiled_loop import are_timed, events_of, floor_of, rings_of
from ballbot_ros.engine.law_runs import FAULTS
from ballbot_ros.engine.rows import Column, RobotRows, Rows, are_finite
from ballbot_ros.engine.run import Events, RunLog, new_log, new_robots, tick_type
from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.scenario.properties import (
    CLEARANCE,
    DRIVE_MODES,
    OF_MOTION,
    Course,
    MotionSignals,
    Property,
)
from ballbot_ros.engine.scenario.scenario import Measure, Scenario
from ballbot_ros.engine.scenario.task_timing import COUNT
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.errors import ControllerError, StudyError, WorldError
from ballbot_ros.lab.studies.columns import OTHERS, measure_runs, other_signal, robustness_of
from ballbot_ros.lab.studies.events import fault_values, scenarios_of
from ballbot_ros.lab.studies.programs import Programs, naming_run, programs_of, with_values
from ballbot_ros.lab.studies.variables import DURATION
from ballbot_ros.parameters import DEVICES, PLANT, ControllerParameters, PlantParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS, TICK_NS
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.faults import Fault, all_faults
from ballbot_ros.robot.world.clearance import NO_WALLS, Walls, walls_around
from ballbot_ros.robot.world.world import World, half_cells, is_blocked
from ballbot_ros.run.spec import RunSpec
from ballbot_ros.run.tick_timer import TickTimer

_LOG_BYTES = 2**20
"""Size of the log of the runs that are simulated together: it stays in the processor's cache."""
_BYTES_A_TICK, _BYTES_OF_TIMING, _BYTES_OF_OTHERS = 34, 8 * COUNT, 8 * len(OTHERS)

RUNS_PER_CHECK = 200
"""Number of runs of a user's law after which another one is compared with the interpreter's."""

_PLACE = ('start_position_x', 'start_position_y', 'body_depth', 'body_width')


@dataclass(frozen=True)
class Samples:
    """What distinguishes runs from each other.

    Attributes
    ----------
    values : mapping of str to ndarray
        Values of parameters by ``node.param``, one for each run.
    events : mapping of str to ndarray
        The varied numbers of the scenario's sticks and pushes, one for each run.
    first : int
        Number of the first run, for error messages.
    """

    count: int
    values: Mapping[str, Column]
    events: Mapping[str, Column] = field(default_factory=dict)
    first: int = 0

    def part(self, first: int, last: int) -> Samples:
        """Return the samples of the runs from `first` up to, but not including, `last`."""
        return Samples(
            last - first,
            {name: column[first:last] for name, column in self.values.items()},
            {name: column[first:last] for name, column in self.events.items()},
            self.first + first,
        )


class Results(NamedTuple):
    """What is kept of runs; a row for each.

    Attributes
    ----------
    duty_sha256 : ndarray of uint8, shape (r, 32)
        Hashes of the duties.
    ticks : ndarray of int64, shape (r,)
        Numbers of ticks.
    failed : ndarray of bool, shape (r,)
        Whether a wall hit or a fault of the controller ended the run.
    fallen : ndarray of bool, shape (r,)
        Whether the robot has fallen.
    measured : ndarray of float64, shape (r, m)
        Values of the measures; NaN if there are no data.
    """

    duty_sha256: NDArray[np.uint8]
    ticks: NDArray[np.int64]
    failed: NDArray[np.bool_]
    fallen: NDArray[np.bool_]
    measured: Floats

    def part(self, runs: slice) -> Results:
        """Return the part of some runs, in the same memory."""
        return Results._make(column[runs] for column in self)

    @classmethod
    def empty(cls, runs: int, measures: int) -> Results:
        """Return results to be filled."""
        return cls(
            np.zeros((runs, hashlib.sha256().digest_size), np.uint8),
            np.zeros(runs, np.int64),
            np.zeros(runs, np.bool_),
            np.zeros(runs, np.bool_),
            np.full((runs, measures), math.nan),
        )


Advance = Callable[[int], None]
"""Called with the number of runs done since the last call; may raise an error to end the work."""


def ignore(runs: int) -> None:
    """Show no progress."""


class OrdinarySimulator:
    """Simulates runs one by one by the ordinary loop, whatever the controller.

    All are like the run of the specification, but for their samples.
    """

    def __init__(self, spec: RunSpec, measures: Sequence[Measure | Property]) -> None:
        self._spec = spec
        self._measures = measures

    def simulate(self, samples: Samples, advance: Advance = ignore) -> Results:
        """Return the results of runs.

        It raises BallbotError if a value is not allowed, a start position is blocked, or a
        controller can't be made.
        """
        results = Results.empty(samples.count, len(self._measures))
        self.simulate_into(results, samples, advance)
        return results

    def simulate_into(self, results: Results, samples: Samples, advance: Advance = ignore) -> None:
        """Write the results of runs, with the same errors."""
        scenarios = scenarios_of_runs(self._spec, samples)
        for run in range(samples.count):
            values: dict[str, object] = {
                name: column[run] for name, column in samples.values.items()
            }
            scenario = scenarios[run] if scenarios else self._spec.scenario
            values |= fault_values(scenario, self._spec.scenario)
            with naming_run(samples.first + run):
                self._simulate(run, values, scenario, results)
            advance(1)

    def _simulate(
        self, run: int, values: Mapping[str, object], scenario: Scenario, results: Results
    ) -> None:
        parameters = with_values(self._spec.parameters, values)
        loaded = compose_controller(parameters)
        plant = parameters.of(PlantParameters)
        controller = parameters.of(ControllerParameters)
        implementation = implementation_for(controller, loaded)
        loop = ClosedLoop(parameters, scenario, program=implementation.make())
        log = TrajectoryLog(controller)
        failed, others = False, array('d')
        has_others = need_others(self._measures)
        try:
            with TickTimer(loaded, plant):
                for tick in loop.ticks(plant.duration):
                    log.add(tick.truth, *tick.outputs.duty, tick.outputs)
                    if has_others:
                        readings = (*tick.inputs.gyro, *tick.inputs.revolutions)
                        others.extend((*tick.truth.psi_rate, *readings))
        except ControllerError:
            failed = True
        trajectory = log.trajectory()
        walls = loop.world.walls if loop.world else NO_WALLS
        results.duty_sha256[run] = np.frombuffer(bytes.fromhex(log.duty_sha256), np.uint8)
        results.ticks[run] = log.ticks
        results.failed[run] = failed or loop.plant.stopped
        results.fallen[run] = loop.plant.fallen
        rows = np.array(others).reshape(1, -1, len(OTHERS))
        signals = motion_signals(trajectory, walls, lambda: None)
        signals = signals._replace(other=partial(other_signal, rows))
        course = Course(scenario.events, controller.mode)
        for number, each in enumerate(self._measures):
            results.measured[run, number] = (
                judge_property(each, signals, plant, course).robustness
                if isinstance(each, Property)
                else measure_one(each, trajectory, plant, walls)
            )


class CompiledSimulator:
    """Simulates runs by compiled code; those in which a law fails, by the ordinary loop.

    It raises BallbotError if numba is not installed, or the map can't be read.
    """

    def __init__(
        self, spec: RunSpec, measures: Sequence[Measure | Property], programs: Programs
    ) -> None:
        self._spec, self._programs = spec, programs
        self._ordinary = OrdinarySimulator(spec, measures)
        self._measures = measures
        self._world = World.of(spec.plant)
        self._floor = floor_of(self._world)
        if self._world:
            # Most studies have one body.
            self._walls = lru_cache(1)(partial(walls_around, self._world.map))
        self._until_check = 0  # number of runs
        self._measure = {
            each.metric: compiled_and_kept(
                measure_runs, each.metric, {'metric': METRICS[each.metric].compute}
            )
            for each in measures
            if isinstance(each, Measure)
        }

    def simulate(self, samples: Samples, advance: Advance = ignore) -> Results:
        """Return the results of runs.

        It raises BallbotError if a value is not allowed, or a start position is blocked.
        """
        try:
            return self._simulate_compiled(samples, advance)
        except CompilationError:  # of a controller's law
            return self._ordinary.simulate(samples, advance)

    def _simulate_compiled(self, samples: Samples, advance: Advance) -> Results:
        results = Results.empty(samples.count, len(self._measures))
        values = self._programs.of_robots(samples.values)
        rows = RobotRows(self._spec.parameters, values, samples.count)
        durations = rows[PlantParameters]['duration']
        ticks = max((round(each * SECOND_NS) // TICK_NS for each in durations.tolist()), default=0)
        is_timed = are_timed(rows)
        programs = self._programs.rows(rows, samples.values, samples.count, samples.first)
        has_others = need_others(self._measures)
        bytes_a_tick = _BYTES_A_TICK + has_others * _BYTES_OF_OTHERS
        together = max(1, _LOG_BYTES // (max(ticks, 1) * bytes_a_tick))
        try:
            time = time_of(ticks)
            log = new_log(together, ticks, is_timed=is_timed, has_others=has_others)
        except MemoryError:
            size = together * ticks * (bytes_a_tick + is_timed * _BYTES_OF_TIMING) / 1e9
            raise StudyError(
                f'runs of {ticks * TICK_NS / SECOND_NS:g} s need {size:.2g} GB on each core, more '
                'than this machine has left'
            ) from None
        self._check_starts(rows, samples.values, samples.first)
        scenarios = scenarios_of_runs(self._spec, samples)
        events = events_of(scenarios or [self._spec.scenario])
        faults = faults_of_runs(self._spec, scenarios)
        courses = self._courses(rows, scenarios)
        pieces = ((each, *part) for each in programs for part in each.parts(together))
        for program, runs, constants, states in pieces:
            part = Events(*(each[runs] for each in events)) if scenarios else events
            robots = new_robots(len(constants), states)
            done = results.part(runs)
            try:
                of_runs = rows.part(runs)
                rings = rings_of(
                    of_runs, self._programs.tasks, faults[runs] if faults[1:] else faults
                )
                program.simulate(
                    of_runs[PlantParameters], *(of_runs[each] for each in DEVICES),
                    of_runs[ControllerParameters], constants, self._floor, part, rings, log,
                    np.zeros((len(robots), 0), tick_type(states.dtype)), robots, log.duty.shape[1],
                )  # fmt: skip
                self._measure_runs(of_runs, log, time, robots, done)
                self._judge(of_runs, courses[runs], log, time, done)
                doubtful = ~are_finite(robots['program'])
            except FAULTS:
                doubtful = np.ones(len(robots), np.bool_)
            for run in np.flatnonzero(doubtful).tolist():
                alone = samples.part(runs.start + run, runs.start + run + 1)
                self._ordinary.simulate_into(done.part(slice(run, run + 1)), alone)
            advance(len(constants))
        if self._programs.are_users and self._until_check <= 0:
            self._check_first(samples, results)
            self._until_check = RUNS_PER_CHECK
        self._until_check -= samples.count
        return results

    def _check_first(self, samples: Samples, results: Results) -> None:
        """Raise StudyError if the interpreter gives another first run.

        It differs from compiled code in whole numbers of more than 64 bits, and in what
        mathematical functions refuse.
        """
        interpreted = self._ordinary.simulate(samples.part(0, 1))
        if interpreted.duty_sha256[0].tobytes() != results.duty_sha256[0].tobytes():
            raise StudyError(
                f'run {samples.first}: the compiled law gives other duties than the interpreter: '
                'let whole numbers have at most 63 bits, or write the law as a method tick'
            )

    def _check_starts(self, rows: RobotRows, varied: Container[str], first: int) -> None:
        """Raise StudyError if the body of a robot begins in a wall; runs count from `first`."""
        if self._world is None or not any(f'{PLANT}.{name}' in varied for name in _PLACE):
            return
        plants = rows[PlantParameters]
        places = np.stack([plants[name] for name in _PLACE], axis=1)
        for run, (x, y, depth, width) in enumerate(places.tolist(), first):
            footprint = self._world.footprint._replace(
                half_u=half_cells(depth), half_v=half_cells(width)
            )
            on_map = self._world.map.contains(self._world.map.point((x, y)))
            if not on_map or is_blocked(footprint, (x, y)):
                try:
                    World(self._world.map, depth, width).check_start((x, y))
                except WorldError as error:
                    raise StudyError(f'{error} (run {run})') from None

    def _measure_runs(
        self, rows: RobotRows, log: RunLog, time: Floats, ends: Rows, results: Results
    ) -> None:
        """Write the results of simulated runs, but for the properties."""
        plants = rows[PlantParameters]
        results.ticks[:] = ends['ticks']
        results.failed[:] = ends['plant']['is_stopped']
        results.fallen[:] = ends['plant']['is_fallen']
        for run, ticks in enumerate(ends['ticks'].tolist()):
            digest = hashlib.sha256(log.duty[run, :ticks]).digest()
            results.duty_sha256[run] = np.frombuffer(digest, np.uint8)
        starts = np.stack([plants['start_position_x'], plants['start_position_y']], axis=1)
        values = np.zeros(len(plants))
        for number, each in enumerate(self._measures):
            if isinstance(each, Property):
                continue
            for runs, walls in self._walls_of(plants, each.metric == CLEARANCE):
                part = RunLog(*(each[runs] for each in log))
                self._measure[each.metric](
                    plants[runs], starts[runs], ends[runs], part, time, walls,
                    each.start, each.end, values[runs],
                )  # fmt: skip
            results.measured[:, number] = values

    def _courses(self, rows: RobotRows, scenarios: Sequence[Scenario]) -> list[Course]:
        """Return what the properties need to know of each run; nothing without properties."""
        if not any(isinstance(each, Property) for each in self._measures):
            return []
        modes = [DRIVE_MODES[each] for each in rows[ControllerParameters]['mode'].tolist()]
        events = [each.events for each in scenarios or [self._spec.scenario] * len(modes)]
        return list(map(Course, events, modes))

    def _judge(
        self,
        rows: RobotRows,
        courses: list[Course],
        log: RunLog,
        time: Floats,
        results: Results,
    ) -> None:
        """Evaluate the properties in simulated runs."""
        plants = rows[PlantParameters]
        for number, each in enumerate(self._measures):
            if not isinstance(each, Property):
                continue
            for runs, walls in self._walls_of(plants, CLEARANCE in each.signals):
                motion = log.position[runs], log.psi[runs], log.duty[runs]
                other = partial(other_signal, log.others[runs])
                signals = MotionSignals(time, *motion, other, walls)
                holds, ticks = plants['hold_time'][runs].tolist(), results.ticks[runs].tolist()
                found = robustness_of(each, signals, holds, ticks, courses[runs])
                results.measured[runs, number] = found

    def _walls_of(self, plants: Rows, needs_walls: bool) -> Iterator[tuple[slice, Walls]]:
        """Yield the walls for the bodies of consecutive runs; only the clearance needs them."""
        if self._world is None or not needs_walls:
            yield slice(len(plants)), NO_WALLS
            return
        first = 0
        sizes = zip(plants['body_depth'].tolist(), plants['body_width'].tolist(), strict=True)
        for (depth, width), alike in groupby(sizes):
            last = first + len(list(alike))
            yield slice(first, last), self._walls(half_cells(depth), half_cells(width))
            first = last


Simulator = OrdinarySimulator | CompiledSimulator


def simulator_for(spec: RunSpec, measures: Sequence[Measure | Property]) -> Simulator:
    """Return the fastest simulator of a specification's runs."""
    programs = programs_of(spec)
    if programs is None or programs.problem():
        return OrdinarySimulator(spec, measures)
    return CompiledSimulator(spec, measures, programs)


def scenarios_of_runs(spec: RunSpec, samples: Samples) -> Sequence[Scenario]:
    """Return the sticks and pushes of each run; nothing if they are those of the specification.

    They are made here, from numbers, since they would take much longer to send to other machines.
    It raises StudyError if pushes and sticks of a run are not possible; the message names the run.
    """
    if not samples.events:
        return ()
    durations = samples.values.get(DURATION, np.full(samples.count, spec.plant.duration))
    return scenarios_of(spec.scenario, samples.events, durations, samples.first)


def faults_of_runs(spec: RunSpec, scenarios: Sequence[Scenario]) -> list[tuple[Fault, ...]]:
    """Return the faults of each run, or one item for all."""
    own, given = all_faults(spec.parameters.of), spec.scenario.faults
    return [own if each.faults == given else each.faults for each in scenarios] or [own]


def need_others(measures: Iterable[Measure | Property]) -> bool:
    """Return whether properties need signals that do not follow from the motion."""
    signals = (each.signals for each in measures if isinstance(each, Property))
    return not {name for names in signals for name in names} <= OF_MOTION.keys()


def time_of(ticks: int) -> Floats:
    """Return the time of each tick since the first [s], as a trajectory has it."""
    stamps = (FIRST_TICK_NS + TICK_NS * np.arange(ticks)) * 1e-9
    return stamps - stamps[:1]
