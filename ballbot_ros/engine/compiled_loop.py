"""Runs of the document's program by compiled code, and the tables that it works on."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.document.program import ControlProgram, ProgramState
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.compilation import (
    can_compile,
    compile_in_background,
    compiled_and_kept,
    is_kept,
    is_loaded,
)
from ballbot_ros.engine.plant import SavedPlant
from ballbot_ros.engine.plant_tick import STEP_VALUES, PlantState, waiting_count
from ballbot_ros.engine.rows import RobotRows, Rows, columns_of, program_rows, rows_of, state_of
from ballbot_ros.engine.run import (
    Events,
    FloorTables,
    Rings,
    RunLog,
    new_robots,
    simulate_runs,
    tick_type,
)
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.parameters import (
    DEVICES,
    ControllerParameters,
    EncoderParameters,
    GyroParameters,
    ParameterSet,
    PlantParameters,
    SonarParameters,
)
from ballbot_ros.parameters.timing import FIRST_TICK_NS
from ballbot_ros.robot.brick.brick import Inputs
from ballbot_ros.robot.plant.ground_truth import GroundTruth, Push
from ballbot_ros.robot.world.world import World

MIN_TICKS = 25_000
"""The interpreter makes fewer ticks in the time in which compiled code is loaded."""

_ENDLESS_S = 1e9
"""Longer than any run; who calls the loop counts its ticks."""

_asked = Counter[str]()
"""The number of ticks of this process's runs."""


def pays(ticks: int) -> bool:
    """Return whether to make a run of the document's program by compiled code.

    The code must be there: in this process or, once the runs are worth loading it, on disk.
    """
    if not can_compile():
        return False
    _asked['ticks'] += ticks
    is_worth_loading = _asked['ticks'] >= MIN_TICKS
    return is_loaded(simulate_runs) or (is_worth_loading and is_kept(simulate_runs))


def compile_for_the_next_time() -> None:
    """Let the code be compiled in the background if the runs so far would have been worth it."""
    if _asked['ticks'] >= MIN_TICKS:
        compile_in_background(simulate_runs, compile_runs)


def compile_runs() -> None:
    """Compile the code of runs, and keep it."""
    parameters = ParameterSet()
    program = ControlProgram(parameters.of(ControllerParameters))
    loop = ClosedLoop(parameters, program=program)
    CompiledLoop(loop, program, parameters, Scenario()).advance(1)


class StickPoints(Protocol):
    """A stick's signal."""

    @property
    def points(self) -> tuple[Sequence[float], Sequence[float]]:
        """Times [s] and values, for :func:`~ballbot_ros.engine.scenario.scenario.signal_value`."""


class EventSource(Protocol):
    """Sticks and pushes of a run, from a scenario or a recording."""

    @property
    def vertical(self) -> StickPoints: ...  # noqa: D102
    @property
    def horizontal(self) -> StickPoints: ...  # noqa: D102

    def pushes_from(self, start_ns: int) -> Sequence[Push]:
        """Return the pushes of a run that begins at sim time `start_ns`."""


class TickColumns(NamedTuple):
    """Ticks of a run; what is a number of a tick is a column here.

    Attributes
    ----------
    truth : GroundTruth
        The true state before each tick.
    wall_hit : ndarray of bool
        As in :class:`~ballbot_ros.engine.closed_loop.Tick`.
    inputs : Inputs
        The samples.
    program : rows
        The states of the program after each tick.
    """

    truth: GroundTruth
    wall_hit: NDArray[np.bool_]
    inputs: Inputs
    program: Rows


class CompiledLoop:
    """Moves a closed loop of the document's program by compiled code, from its first tick on.

    Parameters
    ----------
    loop : ClosedLoop
        A loop that nothing else moves.
    program : ControlProgram
        Its program.
    parameters : ParameterSet
    events : Scenario or EventSource
        Its sticks and pushes.

    Attributes
    ----------
    program : ControlProgram

    Raises
    ------
    CompilationError
        If numba is not installed.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        program: ControlProgram,
        parameters: ParameterSet,
        events: EventSource,
    ) -> None:
        self._plant, self.program = loop.plant, program
        self._run = compiled_and_kept(simulate_runs)
        rows = RobotRows(parameters, {}, 1)
        rows[PlantParameters]['duration'] = _ENDLESS_S
        self._tables = (
            rows[PlantParameters], rows[GyroParameters], rows[EncoderParameters],
            rows[SonarParameters], program_rows(rows[ControllerParameters]),
            floor_of(loop.world), events_of([events]),
        )  # fmt: skip
        self._rings = rings_of(rows)
        self._robots = new_robots(1, rows_of([program.state]))

    def advance(self, ticks: int) -> RunLog:
        """Make up to some ticks, fewer if the run ends; return what they were."""
        log, _ = self._advance(ticks, 0)
        return log

    def trace(self, ticks: int) -> tuple[RunLog, TickColumns]:
        """Make ticks as :meth:`advance` does; return also everything in them."""
        log, rows = self._advance(ticks, ticks)
        plant = columns_of(PlantState, rows['plant'])
        volts: Any = np.asarray(plant.volts, np.float32).astype(np.float64)
        return log, TickColumns(
            self._plant.truth_of(plant, volts),
            np.asarray(plant.in_contact),
            columns_of(Inputs, rows['inputs']),
            rows['program'],
        )

    def _advance(self, ticks: int, traced: int) -> tuple[RunLog, Rows]:
        log = RunLog(
            np.zeros((1, ticks, 2)), np.zeros((1, ticks, 2)), np.zeros((1, ticks, 2), np.int8)
        )
        traces = np.zeros((1, traced), tick_type(self._robots.dtype['program']))
        before = int(self._robots['ticks'][0])
        self._run(*self._tables, self._rings, log, traces, self._robots, ticks)
        done = int(self._robots['ticks'][0]) - before
        self._update_loop()
        return RunLog(*(each[0, :done] for each in log)), traces[0, :done]

    def _update_loop(self) -> None:
        robot = self._robots[0]
        saved = self._plant.save_state()
        state = state_of(PlantState, robot['plant'])
        self._plant.restore_state(
            SavedPlant(
                # All pushes are in its table again; the next tick removes those that have ended.
                state._replace(pushes=len(saved.push_times) // 2),
                saved.push_times,
                saved.push_forces,
                *(tuple(each[0].tolist()) for each in self._rings),
            )
        )
        self.program.state = state_of(ProgramState, robot['program'])


def floor_of(world: World | None) -> FloorTables:
    """Return the walls for the compiled code."""
    if world is None:
        nothing = np.zeros((0, 0), np.int32)
        return FloorTables(nothing, nothing)
    return FloorTables(world.footprint.sides, world.footprint.walls_before)


def rings_of(rows: RobotRows) -> Rings:
    """Return the empty rings of robots."""
    plants = rows[PlantParameters]
    delays = plants['actuator_delay'] + plants['actuator_delay_jitter']
    waiting = waiting_count(int(delays.max(initial=0)))
    ages = [rows[each]['delay'] + rows[each]['delay_jitter'] for each in DEVICES]
    longest = max(int(each.max(initial=0)) for each in ages)
    kept = STEP_VALUES * (longest + 1) if longest else 0
    count = len(plants)
    return Rings(
        np.zeros((count, waiting), np.int64),
        np.zeros((count, 2 * waiting), np.int64),
        np.zeros((count, kept)),
    )


def events_of(sources: Sequence[EventSource]) -> Events:
    """Return pushes and sticks for the compiled code; the first axis is that of the sources."""
    pushes = [each.pushes_from(FIRST_TICK_NS) for each in sources]
    most = max(map(len, pushes))
    # What is missing begins and ends at time 0, before the run.
    times, forces = np.zeros((len(pushes), most, 2), np.int64), np.zeros((len(pushes), most, 4))
    for run, each in enumerate(pushes):
        for number, push in enumerate(each):
            times[run, number] = push.start_ns, push.end_ns
            forces[run, number] = (*push.force, *push.torque)
    return Events(
        times.reshape(len(pushes), 2 * most),
        forces.reshape(len(pushes), 4 * most),
        points_of([each.vertical for each in sources]),
        points_of([each.horizontal for each in sources]),
    )


def points_of(signals: Sequence[StickPoints]) -> NDArray[np.float64]:
    """Return the points of stick signals as in :class:`~ballbot_ros.engine.run.Events`."""
    points = [np.transpose(each.points) for each in signals]
    table = np.zeros((len(points), max(map(len, points)), 2))
    # What is missing is neutral, after the last point.
    table[:, :, 0] = math.inf
    for run, each in enumerate(points):
        table[run, : len(each)] = each
    return table
