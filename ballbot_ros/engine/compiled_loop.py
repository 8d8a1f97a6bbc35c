"""Single runs by compiled code, and the tables that it works on."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.controllers.controller import LawController
from ballbot_ros.controllers.controller_program import ControllerProgram
from ballbot_ros.controllers.document.program import ControlProgram, ProgramState
from ballbot_ros.controllers.interface import Program
from ballbot_ros.engine.closed_loop import ClosedLoop, ExternalInputs
from ballbot_ros.engine.compilation import (
    can_compile,
    compile_in_background,
    compiled_and_kept,
    has_kept_code,
    is_loaded,
)
from ballbot_ros.engine.law_runs import LawCode, has_law, initial_state
from ballbot_ros.engine.plant import SavedPlant
from ballbot_ros.engine.plant_tick import PlantState, waiting_count
from ballbot_ros.engine.rows import (
    RobotRows,
    Rows,
    are_finite,
    columns_of,
    program_rows,
    rows_of,
    state_of,
)
from ballbot_ros.engine.run import (
    Events,
    FloorTables,
    Rings,
    RunLog,
    new_log,
    new_robots,
    simulate_runs,
    tick_type,
)
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.parameters import (
    CONTROLLER,
    DEVICES,
    ControllerParameters,
    EncoderParameters,
    GyroParameters,
    ParameterSet,
    PlantParameters,
    SonarParameters,
)
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_NS
from ballbot_ros.robot.brick.brick import Inputs
from ballbot_ros.robot.brick.fault_effects import fault_row
from ballbot_ros.robot.brick.faults import Fault, all_faults, late_steps
from ballbot_ros.robot.brick.kernel import kernel_size
from ballbot_ros.robot.brick.link import longest_analog_steps
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES, GroundTruth
from ballbot_ros.robot.world.world import World

MIN_TICKS = 25_000
"""The interpreter makes fewer ticks in the time in which compiled code is loaded."""

_ENDLESS_S = 1e9
"""Longer than any run; who calls the loop counts its ticks."""

_DOCUMENTS = 'python'

_asked = Counter[str]()
"""The number of ticks of this process's runs, by the name of their controller."""

_missing: dict[str, str] = {}
"""Code that would have paid, by its name on disk, and the name of its controller."""


def pays(ticks: int, program: Program) -> bool:
    """Return whether to make a run of a program by compiled code.

    The program is that of the document, or a law of this package. A user's law stays interpreted:
    nothing could end compiled code that does not return, and each change of a law would compile it
    again. The code must be there: in this process or, once the runs are worth loading it, on disk.
    """
    law = own_law(program)
    if not can_compile() or not (law or isinstance(program, ControlProgram)):
        return False
    name = f'{type(law).__module__}:{type(law).__qualname__}' if law else _DOCUMENTS
    _asked[name] += ticks
    if law is None and is_loaded(simulate_runs):
        return True
    if _asked[name] < MIN_TICKS:
        return False
    kept = LawCode(law).kept if law else simulate_runs.__qualname__
    if not has_kept_code(kept):
        _missing[kept] = name
        return False
    return True


def own_law(program: Program) -> LawController[Any] | None:
    """Return the controller of a program if it is a law of this package."""
    if isinstance(program, ControllerProgram) and program.loaded.code.is_ours:
        controller = program.controller
        if isinstance(controller, LawController) and has_law(type(controller)):
            return controller
    return None


def compile_for_the_next_time() -> None:
    """Let the code be compiled in the background that the runs so far would have been worth."""
    for kept, name in _missing.items():
        compile_in_background(kept, compile_runs, name)


def compile_runs(implementation: str = _DOCUMENTS) -> None:
    """Compile the code of runs of a controller, by its name, and keep it."""
    parameters = ParameterSet()
    parameters.set(CONTROLLER, 'implementation', implementation)
    loaded = compose_controller(parameters)
    program = implementation_for(parameters.of(ControllerParameters), loaded).make()
    loop = ClosedLoop(parameters, program=program)
    CompiledLoop(loop, program, parameters, Scenario()).advance(1)


class StickPoints(Protocol):
    """A stick's signal."""

    @property
    def points(self) -> tuple[Sequence[float], Sequence[float]]:
        """Times [s] and values, for :func:`~ballbot_ros.engine.scenario.scenario.signal_value`."""


class EventSource(ExternalInputs, Protocol):
    """External inputs of a run whose sticks are signals with points."""

    @property
    def vertical(self) -> StickPoints: ...  # noqa: D102
    @property
    def horizontal(self) -> StickPoints: ...  # noqa: D102


class TickColumns(NamedTuple):
    """Ticks of a run; what is a number of a tick is a column here.

    Attributes
    ----------
    truth : GroundTruth
        The true state before each tick.
    wall_hit : ndarray of bool
        As in :class:`~ballbot_ros.engine.closed_loop.Tick`.
    program : rows
        The states of the program after each tick: of the document's, or
        :class:`~ballbot_ros.engine.law_runs.LawState`.
    duty : ndarray of int64, shape (n, 2)
        The duties [%].
    delay_ns : ndarray of int64
        Time until they leave the brick.
    jobs : ndarray of int64, shape (n, m, 6)
        As in :func:`~ballbot_ros.engine.run.tick_type`.
    """

    truth: GroundTruth
    wall_hit: NDArray[np.bool_]
    inputs: Inputs
    program: Rows
    duty: NDArray[np.int64]
    delay_ns: NDArray[np.int64]
    jobs: NDArray[np.int64]


class CompiledLoop:
    """Moves a closed loop by compiled code, from its first tick on; CompilationError without numba.

    Parameters
    ----------
    loop : ClosedLoop
        A loop that nothing else moves.
    program : Program
        Its program; :func:`pays` says which it may be. A law does not follow: it stays as it was
        before the first tick, unless who uses the loop lets it make the ticks, too.
    events : Scenario or EventSource
        Its sticks and pushes.
    """

    def __init__(
        self, loop: ClosedLoop, program: Program, parameters: ParameterSet, events: EventSource
    ) -> None:
        self._plant, self._tasks, self.program = loop.plant, loop.tasks, program
        rows = RobotRows(parameters, {}, 1)
        rows[PlantParameters]['duration'] = _ENDLESS_S
        if law := own_law(program):
            self._run = LawCode(law).compile()
            programs, state = rows_of([law.in_force]), rows_of([initial_state(law)])
        else:
            assert isinstance(program, ControlProgram)
            self._run = compiled_and_kept(simulate_runs)
            programs, state = program_rows(rows[ControllerParameters]), rows_of([program.state])
        self._tables = (
            rows[PlantParameters], rows[GyroParameters], rows[EncoderParameters],
            rows[SonarParameters], rows[ControllerParameters], programs,
            floor_of(loop.world), events_of([events]),
        )  # fmt: skip
        self._rings = rings_of(rows, len(program.tasks), [all_faults(parameters.of)])
        self._robots = new_robots(1, state)

    def advance(self, ticks: int) -> RunLog:
        """Make up to some ticks, fewer if the run ends; return what they were.

        It raises one of FAULTS if a law fails in them; the loop then is as it was before them.
        """
        log, _ = self._advance(ticks, 0)
        return log

    def trace(self, ticks: int) -> tuple[RunLog, TickColumns]:
        """Make ticks as :meth:`advance` does; return also everything in them."""
        log, rows = self._advance(ticks, ticks)
        plant = columns_of(PlantState, rows['plant'])
        volts: Any = np.asarray(plant.measured_volts, np.float32).astype(np.float64)
        return log, TickColumns(
            self._plant.truth_of(plant, volts),
            np.asarray(plant.in_contact),
            columns_of(Inputs, rows['inputs']),
            rows['program'],
            rows['duty'],
            rows['delay_ns'],
            rows['jobs'],
        )

    def _advance(self, ticks: int, traced: int) -> tuple[RunLog, Rows]:
        log = new_log(1, ticks, is_timed=self._rings.kernel.size > 0)
        traces = np.zeros((1, traced), tick_type(self._robots.dtype['program']))
        before = int(self._robots['ticks'][0])
        self._run(*self._tables, self._rings, log, traces, self._robots, ticks)
        done = int(self._robots['ticks'][0]) - before
        if not are_finite(self._robots['program'])[0]:
            raise ArithmeticError('the state of a law is not finite')
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
                *(tuple(each[0].tolist()) for each in (*self._rings[:3], self._rings.faults)),
            )
        )
        if isinstance(self.program, ControlProgram):
            self.program.state = state_of(ProgramState, robot['program'])
            last_ns, kernel = state.time_ns - TICK_NS, self._rings.kernel[0].tolist()
            self._tasks.restore_state(self.program, last_ns, kernel)


def floor_of(world: World | None) -> FloorTables:
    """Return the walls for the compiled code."""
    if world is None:
        nothing = np.zeros((0, 0), np.int32)
        return FloorTables(nothing, nothing)
    return FloorTables(*map(np.asarray, world.walls_as_numbers))


def are_timed(rows: RobotRows) -> bool:
    """Return whether some robots have a kernel or a link."""
    plants = rows[PlantParameters]
    return bool((plants['kernel'] | plants['link']).any())


def rings_of(rows: RobotRows, tasks: int, faults: Sequence[Sequence[Fault]] = ((),)) -> Rings:
    """Return the empty rings of robots whose programs have a number of tasks.

    The faults are those of all robots, or of each.
    """
    plants, gyros = rows[PlantParameters], rows[GyroParameters]
    delays = plants['actuator_delay'] + plants['actuator_delay_jitter']
    is_timed = are_timed(rows)
    count, waiting = len(plants), waiting_count(int(delays.max(initial=0)), is_timed)
    ages = [rows[each]['delay'] + rows[each]['delay_jitter'] for each in DEVICES]
    longest_link = longest_analog_steps(True, float(gyros['converter_period'].max(initial=0.0)))
    ages[DEVICES.index(GyroParameters)] += np.where(gyros['link'], longest_link, 0)
    longest = max(int(each.max(initial=0)) for each in ages)
    longest += max(map(late_steps, faults))
    # What is missing begins and ends at time 0, before the run.
    fault_rows = [fault_row(each, FIRST_TICK_NS) for each in faults]
    size = max(map(len, fault_rows))
    fault_table = np.zeros((count, size))
    fault_table[:] = [each + [0.0] * (size - len(each)) for each in fault_rows]
    kept = STEP_VALUES * (longest + 1) if longest else 0
    return Rings(
        np.zeros((count, waiting), np.int64),
        np.zeros((count, 2 * waiting), np.int64),
        np.zeros((count, kept)),
        np.zeros((count, kernel_size(tasks) if is_timed else 0), np.int64),
        fault_table,
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
