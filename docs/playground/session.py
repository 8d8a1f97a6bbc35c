"""A run that a page steers: it can go back to any moment, and go on from there.

It calls this package as any program does. Only maps come as tables, which need no image and no
scipy: see :class:`Floor`.
"""

from __future__ import annotations

import struct
from array import array
from collections import deque
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.engine.brick_tasks import BrickTasks
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.golden import load_golden
from ballbot_ros.engine.plant import SavedPlant
from ballbot_ros.engine.scenario.reader import ScenarioReader, load_scenario
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.parameters import ControllerParameters, PlantParameters
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.robot.brick.bluetooth import sticks_of
from ballbot_ros.robot.plant.ground_truth import Push
from ballbot_ros.robot.world.world import World

MAPS = Path(__file__).parent / 'maps'

MARK_TICKS = 25
"""Ticks from one moment to which the page can go back to the next: 0.1 s."""

KEPT_MARKS = 1200
"""Number of these moments: 2 minutes."""

ROW = 'time', 'x', 'y', 'pitch_x', 'pitch_y', 'duty_x', 'duty_y', 'gain', 'end'
"""The numbers of a tick: s, m, rad, %, in plane signs; `end`: 1 has fallen, 2 has hit a wall."""


class Floor:
    """A floor with the walls of a map, from the tables which docs/playground/build.py writes."""

    def __init__(self, name: str) -> None:
        data = (MAPS / name).read_bytes()
        rows, columns = struct.unpack_from('<2i', data)
        middle = 8 + 4 * rows * columns
        self.walls_as_numbers = (
            _table(data[8:middle], rows, columns),
            _table(data[middle:], rows + 1, columns + 1),
        )

    def touching(self, position: object) -> tuple[str, ...]:
        """Return nothing: the page does not name the parts of the body that hit a wall."""
        return ()


def _table(data: bytes, rows: int, columns: int) -> memoryview:
    return memoryview(data).cast('B').cast('i', (rows, columns))


def use_tables() -> None:
    """Take the floor of a map from its table; the maps were checked when the page was built."""
    World.of = lambda plant: Floor(plant.map) if plant.map else None
    ScenarioReader._check_world = lambda reader, parameters: None


class Inputs:
    """The stick on the page while somebody holds it, else those of the scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self.held: tuple[int, int] | None = None

    def sticks_at(self, time: float) -> tuple[int, int]:
        """Return the sticks at a time [s] from the start of the run."""
        return self.held or self._scenario.sticks_at(time)

    def pushes_from(self, start_ns: int) -> list[Push]:
        """Return the pushes of the scenario."""
        return self._scenario.pushes_from(start_ns)


class Mark(NamedTuple):
    """A moment to which the run can go back."""

    ticks: int
    plant: SavedPlant
    program: ControlProgram
    tasks: BrickTasks
    gain: float


class Session:
    """A run of a shipped scenario.

    Attributes
    ----------
    duration : float
        That of the scenario [s]; the run can go on.
    gain : float
        By which the gain of the duty is multiplied.
    """

    def __init__(self, name: str) -> None:
        scenario = load_scenario(name)
        self._parameters = scenario.parameters.of(ControllerParameters)
        self._plant_parameters = scenario.parameters.of(PlantParameters)
        self.duration = self._plant_parameters.duration
        self._inputs = Inputs(scenario)
        self._loop = ClosedLoop(scenario.parameters, self._inputs)
        self._ticks = 0
        self._marks: deque[Mark] = deque(maxlen=KEPT_MARKS)
        self.gain = 1.0

    def advance(self, ticks: int) -> array[float]:
        """Run some ticks, fewer if a wall ends the run; return the numbers of each, see `ROW`."""
        loop, rows = self._loop, array('d')
        for _ in range(ticks):
            if loop.plant.stopped:
                break
            if self._ticks % MARK_TICKS == 0:
                self._mark()
            truth, _, _, outputs = loop.tick()
            rows.extend((
                self._ticks * TICK_NS / SECOND_NS, *truth.position, *truth.psi, *outputs.duty,
                self.gain, 1 if loop.plant.fallen else 2 if loop.plant.stopped else 0,
            ))  # fmt: skip
            self._ticks += 1
        return rows

    def _mark(self) -> None:
        # Where the run went back to, the mark is from before all that has been changed there.
        if not self._marks or self._marks[-1].ticks < self._ticks:
            loop = self._loop
            program, tasks = loop.program.copy(), loop.tasks.copy()
            self._marks.append(
                Mark(self._ticks, loop.plant.save_state(), program, tasks, self.gain)
            )

    def go_back(self, time: float) -> float:
        """Go back to the last mark up to a time [s], or to the first one; return its time."""
        wanted = time * SECOND_NS / TICK_NS
        while len(self._marks) > 1 and self._marks[-1].ticks > wanted:
            self._marks.pop()
        mark = self._marks[-1]
        self._ticks, self.gain = mark.ticks, mark.gain
        self._loop.plant.restore_state(mark.plant)
        self._loop.program, self._loop.tasks = mark.program.copy(), mark.tasks.copy()
        return mark.ticks * TICK_NS / SECOND_NS

    def hold(self, forward: float, rightward: float) -> None:
        """Hold the stick, -1 ... 1 each; in the middle, the scenario's sticks apply again."""
        sticks = sticks_of(forward, rightward, self._parameters.gp_max)
        self._inputs.held = sticks if any(sticks) else None

    def push(self, x: float, y: float) -> None:
        """Push the body with a force [N] in plane signs."""
        start_ns = self._loop.plant.time_ns
        end_ns = start_ns + round(self._plant_parameters.push_duration * SECOND_NS)
        self._loop.plant.push(Push(start_ns, end_ns, (x, y)))

    def scale_gain(self, factor: float) -> None:
        """Multiply the gain of the duty, as the parameter ``controller.pwm_gain`` has it."""
        self.gain = factor
        gain = self._parameters.pwm_gain * factor
        self._loop.program.retune(self._parameters.with_values({'pwm_gain': gain}))


def duty_sha256(name: str, duration: float) -> str:
    """Return the hash of the duties of a scenario; `duration` [s], or 0 for the scenario's."""
    scenario = load_scenario(name)
    loop, log = ClosedLoop(scenario.parameters, scenario), TrajectoryLog(keep=False)
    for tick in loop.ticks(duration or scenario.parameters.of(PlantParameters).duration):
        log.add(tick.truth, *tick.outputs.duty)
    return log.duty_sha256


def golden_sha256(name: str) -> str:
    """Return the hash that every machine must reproduce."""
    return load_golden().scenarios[name]
