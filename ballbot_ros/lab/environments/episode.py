"""Robots from the start of an episode on: one by the interpreter, or many by compiled code."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.controllers.controller import Duty
from ballbot_ros.controllers.policy import (
    NOTHING_OBSERVED,
    DrivingObservation,
    ObserverState,
    observation_of,
    observed,
    percent,
)
from ballbot_ros.engine.compilation import (
    can_compile,
    compile_in_background,
    compiled_and_kept,
    is_kept,
    is_loaded,
)
from ballbot_ros.engine.compiled_loop import floor_of, points_of, rings_of
from ballbot_ros.engine.devices import numbers_of
from ballbot_ros.engine.moved_robots import (
    MOVED_ROBOT,
    PARAMETERS,
    TrueState,
    move_robot,
    move_robots,
    true_state,
)
from ballbot_ros.engine.plant_tick import PlantState, initial_state, plant_constants, waiting_count
from ballbot_ros.engine.rows import RobotRows, state_of
from ballbot_ros.engine.run import clear_rings, longest_age, robot_constants
from ballbot_ros.lab.environments.configuration import BALANCE
from ballbot_ros.lab.environments.setup import DEVICES as DEVICES_OBSERVED
from ballbot_ros.lab.environments.setup import Setup, Start
from ballbot_ros.parameters import DEVICES, ControllerParameters, PlantParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_MS
from ballbot_ros.robot.brick.job_times import job_times, kernel_constants
from ballbot_ros.robot.brick.kernel import kernel_size
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES
from ballbot_ros.robot.world.world import World

MANY_TICKS = 100_000
"""The interpreter makes them in a quarter of the time that compiling takes."""

_interpreted = Counter[str]()
"""The number of ticks that the interpreter has made."""

NEUTRAL_FROM_THEN = (np.inf, 0.0)
"""A point of a stick signal that follows all others."""


class EpisodeState(NamedTuple):
    """Everything in an episode that changes with time."""

    start: Start
    plant: PlantState
    observer: ObserverState
    rings: tuple[tuple[float, ...], ...]
    measured: DrivingObservation
    true: TrueState


@dataclass(frozen=True)
class EnvironmentState:
    """The state of an environment: pass it to ``restore_state``.

    It can be pickled. Its content is not part of the interface.
    """

    configuration: tuple[tuple[str, object], ...]
    episode: EpisodeState
    steps: int
    over: bool
    generator: Mapping[str, Any]


def compile_moves() -> None:
    """Compile the code that moves robots, and keep it."""
    MovedRobots(Setup(BALANCE, DEVICES_OBSERVED, TICK_MS, None, None, None), 1).move()


def has_compiled_code() -> bool:
    """Return whether there is compiled code for robots of environments."""
    return can_compile() and (is_loaded(move_robots) or is_kept(move_robots))


class _InterpretedEpisode:
    """The robot under the duties of a policy, in the order of the node graph, by the interpreter.

    In each tick the duty acts, and then the devices are sampled. An episode begins when the gyros
    are calibrated; until then the robot is held still, with the motors off.

    Attributes
    ----------
    start : Start
        What differs from other episodes.
    duty : tuple of int
        That of the last step [%].
    measured, true : tuple of float
        Observation of the devices and true state after it.
    """

    start: Start
    measured: DrivingObservation
    true: TrueState

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self.duty: Duty = (0, 0)

    def begin(self, start: Start) -> None:
        """Begin an episode: the robot is held until the time of the first action."""
        if _interpreted['ticks'] > MANY_TICKS:
            compile_in_background(move_robots.__qualname__, compile_moves)
        self._prepare(start)
        self._move(self._setup.held_ticks + 1, is_new=True)

    def _prepare(self, start: Start) -> None:
        self.start = start
        values = self._setup.parameters_at(start)
        plant = values.of(PlantParameters)
        world = World.of(plant)
        self._walls: tuple[Any, Any] = world.walls_as_numbers if world else ((), ())
        constants = self._constants = robot_constants(
            plant_constants(numbers_of(plant), FIRST_TICK_NS),
            *(numbers_of(values.of(each)) for each in DEVICES),
        )
        waiting = waiting_count(
            constants.plant.actuator_delay + constants.plant.actuator_jitter,
            constants.plant.has_late_duties,
        )
        settings = numbers_of(values.of(ControllerParameters))
        self._times, self._kernel_law = job_times(settings), kernel_constants(settings)
        self._kernel = [0] * (kernel_size(1) if constants.plant.has_late_duties else 0)
        age = longest_age(constants)
        self._effects_ns, self._duties = [0] * waiting, [0] * (2 * waiting)
        self._steps = [0.0] * (STEP_VALUES * (age + 1) if age else 0)
        clear_rings(constants.plant, self._effects_ns, self._steps)
        sticks = self._setup.scenario(start)
        self._points = (*sticks.vertical.points, *sticks.horizontal.points)
        self._state = initial_state(constants.plant, FIRST_TICK_NS)
        self._observer = NOTHING_OBSERVED
        self.duty = 0, 0

    def step(self, action: Sequence[float]) -> None:
        """Apply the duty of an action, two finite numbers, for a step; a wall hit ends it."""
        self.duty = percent(action[0]), percent(action[1])
        self._move(self._setup.ticks)

    def _move(self, ticks: int, *, is_new: bool = False) -> None:
        settings = self._setup.settings
        _interpreted['ticks'] += ticks
        self._state, observer = move_robot(
            self._constants, settings.time_start, is_new, self._state, self._observer,
            *self.duty, self._times, self._kernel_law, ticks, *self._points,
            self._effects_ns, self._duties, self._steps, self._kernel, *self._walls,
        )  # fmt: skip
        self.measured = observation_of(observer, settings)
        self.true = true_state(self._constants.plant, self._state)
        self._observer = observed(observer)

    @property
    def is_over(self) -> bool:
        """Whether the robot has fallen, or hit a wall."""
        return self._state.is_fallen or self._state.is_stopped

    def save_state(self) -> EpisodeState:
        """Return the present state."""
        rings = (
            tuple(self._effects_ns), tuple(self._duties), tuple(self._steps), tuple(self._kernel)
        )  # fmt: skip
        return EpisodeState(
            self.start, self._state, self._observer, rings, self.measured, self.true
        )

    def restore_state(self, state: EpisodeState) -> None:
        """Continue from a state."""
        self._prepare(state.start)
        _, self._state, self._observer, rings, self.measured, self.true = state
        self._effects_ns, self._duties, self._steps, self._kernel = map(list, rings)  # type: ignore[assignment]


class MovedRobots:
    """The robots of many episodes, rows of MOVED_ROBOT with their rings, moved by compiled code.

    Raises
    ------
    CompilationError
        If numba is not installed.
    """

    def __init__(self, setup: Setup, count: int) -> None:
        self._setup = setup
        self._run = compiled_and_kept(move_robots)
        parameters = RobotRows(setup.parameters, {}, count)
        self.rows = np.zeros(count, MOVED_ROBOT)
        for name, cls in PARAMETERS.items():
            self.rows[name] = parameters[cls]
        self._floor = floor_of(World.of(setup.parameters.of(PlantParameters)))
        self.rings = rings_of(parameters, 1)
        self._sticks = [np.zeros((count, 0, 2)) for _ in range(2)]

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy or another process needs; compiled code can't be pickled."""
        return {name: value for name, value in vars(self).items() if name != '_run'}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._run = compiled_and_kept(move_robots)

    def begin(self, at: int, start: Start) -> None:
        """Let a robot begin an episode with the next move, which is to hold it."""
        row = self.rows[at]
        for name in PARAMETERS:
            if 'seed' in row[name].dtype.names:
                row[name]['seed'] = start.seed
        plant = row['plant_parameters']
        plant['start_pitch_x'], plant['start_pitch_y'] = start.pitch
        sticks = self._setup.scenario(start)
        for number, signal in enumerate((sticks.vertical, sticks.horizontal)):
            points = points_of([signal])[0]
            if (missing := len(points) - self._sticks[number].shape[1]) > 0:
                self._sticks[number] = np.pad(self._sticks[number], ((0, 0), (0, missing), (0, 0)))
                self._sticks[number][:, -missing:] = NEUTRAL_FROM_THEN
            table = self._sticks[number]
            table[at] = NEUTRAL_FROM_THEN
            table[at, : len(points)] = points
        row['has_begun'], row['ticks'], row['action'] = False, self._setup.held_ticks + 1, 0.0

    def move(self) -> None:
        """Move the robots."""
        self._run(self._floor, *self._sticks, self.rings, self.rows)


class _CompiledEpisode:
    """The same by compiled code."""

    start: Start
    duty: Duty
    measured: DrivingObservation
    true: TrueState

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._robots = MovedRobots(setup, 1)
        row = self._row = self._robots.rows[0]
        self._action, self._is_over = row['action'], self._robots.rows['is_over']
        self._duty, self._measured, self._true = row['duty'], row['measured'], row['true']
        self.duty = 0, 0

    def begin(self, start: Start) -> None:
        """Begin an episode."""
        self.start = start
        self._robots.begin(0, start)
        self._move()
        self._row['ticks'] = self._setup.ticks

    def step(self, action: Sequence[float]) -> None:
        """Apply the duty of an action for a step."""
        self._action[0], self._action[1] = action
        self._move()

    def _move(self) -> None:
        self._robots.move()
        self.duty = tuple(self._duty.tolist())
        self.measured = tuple(self._measured.tolist())
        self.true = tuple(self._true.tolist())

    @property
    def is_over(self) -> bool:
        """Whether the robot has fallen, or hit a wall."""
        is_over: bool = self._is_over.item()
        return is_over

    def save_state(self) -> EpisodeState:
        """Return the present state."""
        return EpisodeState(
            self.start,
            state_of(PlantState, self._row['plant']),
            state_of(ObserverState, self._row['observer']),
            tuple(tuple(each[0].tolist()) for each in self._robots.rings[:-1]),  # without faults
            self.measured,
            self.true,
        )

    def restore_state(self, state: EpisodeState) -> None:
        """Continue from a state."""
        self.begin(state.start)
        _, plant, observer, rings, self.measured, self.true = state
        self._row['plant'], self._row['observer'] = plant, observer
        for ring, saved in zip(self._robots.rings[:-1], rings, strict=True):
            ring[0] = saved


Episode = _InterpretedEpisode | _CompiledEpisode


def new_episode(setup: Setup) -> Episode:
    """Return an episode by compiled code, if it is at hand, or by the interpreter."""
    return _CompiledEpisode(setup) if has_compiled_code() else _InterpretedEpisode(setup)
