"""The tasks, the parameters of an environment, and the commanded speeds of an episode.

They compute the values of one robot, or in columns those of many.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.controllers.codegen.implementation import check_load
from ballbot_ros.controllers.controller import TICK
from ballbot_ros.engine.scenario.reader import IDEAL, load_profile
from ballbot_ros.engine.scenario.scenario import Segment, StickSignal
from ballbot_ros.errors import EnvironmentConfigurationError, short_repr
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    ROBOT_CLASSES,
    ControllerParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.brick_time import KernelChoice, LinkParameters, TaskCosts
from ballbot_ros.parameters.files import (
    Parameters,
    assign_values,
    plain_values,
    read_parameter_file,
)
from ballbot_ros.parameters.nodes import DeviceSeed
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.brick.faults import all_faults
from ballbot_ros.robot.brick.schedule import TaskTiming

TOLERATED_PITCH_RAD = 0.035
TOLERATED_DISTANCE_M = 0.05
TOLERATED_SPEED_M_PER_S = 0.05
TOLERATED_DUTY_PERCENT = 42.4
"""Length of the vector of both duties."""

Numbers = Any
"""A number, or a column of them."""

Vector = tuple[Numbers, ...]

Parts = dict[str, Numbers]
"""The parts of a reward, by the names that they have in the info."""


@dataclass(frozen=True)
class Task:
    """A task.

    Attributes
    ----------
    duration : float
        Time after which an episode is truncated, unless another one is given [s].
    largest_pitch : float
        Largest random pitch at the start, in each plane [rad].
    drives : bool
        Whether speeds are commanded.
    reward : callable
        Returns the reward of a step, and its parts, for the true state that it ends in, the
        velocity that was commanded [m/s] and the duty [%].
    """

    name: str
    duration: float
    largest_pitch: float
    drives: bool
    reward: Callable[[Vector, Vector, Vector], tuple[Numbers, Parts]]


def _closeness(x: Numbers, y: Numbers, tolerated: float) -> Numbers:
    """Return how small a vector is: 1 for zero, 0.5 for one of `tolerated` length."""
    scale = tolerated * tolerated
    return scale / (scale + x * x + y * y)


def _balance_reward(state: Vector, commanded: Vector, duty: Vector) -> tuple[Numbers, Parts]:
    x, y, _, _, pitch_x, pitch_y, *_ = state
    upright = _closeness(pitch_x, pitch_y, TOLERATED_PITCH_RAD)
    near = _closeness(x, y, TOLERATED_DISTANCE_M)
    calm = _closeness(duty[0], duty[1], TOLERATED_DUTY_PERCENT)
    return 0.4 * upright + 0.4 * near + 0.2 * calm, {
        'reward_upright': upright,
        'reward_near': near,
        'reward_calm': calm,
    }


def _drive_reward(state: Vector, commanded: Vector, duty: Vector) -> tuple[Numbers, Parts]:
    _, _, velocity_x, velocity_y, pitch_x, pitch_y, *_ = state
    upright = _closeness(pitch_x, pitch_y, TOLERATED_PITCH_RAD)
    follow = _closeness(
        velocity_x - commanded[0], velocity_y - commanded[1], TOLERATED_SPEED_M_PER_S
    )
    calm = _closeness(duty[0], duty[1], TOLERATED_DUTY_PERCENT)
    return 0.3 * upright + 0.5 * follow + 0.2 * calm, {
        'reward_upright': upright,
        'reward_follow': follow,
        'reward_calm': calm,
    }


BALANCE = Task('Balance', 10.0, math.radians(4.0), False, _balance_reward)
DRIVE = Task('Drive', 20.0, math.radians(1.0), True, _drive_reward)


FIRST_COMMAND_S = 1.0
COMMAND_PERIOD_S = 3.0
LARGEST_PERCENT = 100


class SpeedCommand(NamedTuple):
    """A commanded speed.

    Attributes
    ----------
    time_s : float
        When it begins [s], from the release of the robot; it lasts until the next one.
    x_percent, y_percent : int
        Share of the full speed in planes x and y: whole numbers, -100 ... 100.
    """

    time_s: float
    x_percent: int
    y_percent: int


Commands = tuple[SpeedCommand, ...]


def random_commands(generator: np.random.Generator, duration: float) -> Commands:
    """Return a new random command every 3 s, the first after 1 s, for an episode of `duration` [s].

    Both shares are uniform whole numbers.
    """
    count = max(0, math.ceil((duration - FIRST_COMMAND_S) / COMMAND_PERIOD_S))
    shares = generator.integers(-LARGEST_PERCENT, LARGEST_PERCENT, size=(count, 2), endpoint=True)
    return tuple(
        SpeedCommand(FIRST_COMMAND_S + index * COMMAND_PERIOD_S, x, y)
        for index, (x, y) in enumerate(shares.tolist())
    )


def checked_commands(given: object) -> Commands:
    """Return commands that were given as (time, x, y) each; refuse others."""
    try:
        commands = tuple(_checked(*each) for each in given)  # type: ignore[attr-defined]
    except (TypeError, ValueError, OverflowError):
        commands = None
    if commands is None or any(a.time_s >= b.time_s for a, b in pairwise(commands)):
        raise EnvironmentConfigurationError(
            f'options: commands: {short_repr(given)} are not (time_s, x_percent, y_percent) each, '
            f'with rising times from 0 on and whole percents within ±{LARGEST_PERCENT}'
        )
    return commands


def _checked(time_s: float, x: int, y: int) -> SpeedCommand:
    if not 0.0 <= time_s < math.inf or any(
        share != int(share) or abs(share) > LARGEST_PERCENT for share in (x, y)
    ):
        raise ValueError
    return SpeedCommand(float(time_s), int(x), int(y))


def stick_signal(values: Iterable[tuple[float, int]], release_s: float) -> StickSignal:
    """Return the signal of times from the release on [s] and values; each lasts until the next."""
    points = [(release_s + time, value) for time, value in values]
    times = [time for time, _ in points] + [math.inf]
    return StickSignal(
        [
            Segment.step('command', start, end, value)
            for (start, value), end in zip(points, times[1:], strict=True)
        ]
    )


STEPS_MS = (TICK_MS, 5 * TICK_MS)
"""The periods that an environment can have [ms]."""

MAX_DURATION_S = 1e5

SETTINGS = ('time_start', 'k_thetadot', 'gp_max')
"""The controller's parameters that have an effect on calibration and commands."""

_OF_TIME = {each.name for cls in (KernelChoice, LinkParameters, TaskCosts) for each in fields(cls)}
_ONE_TASK = (TaskTiming(TICK, 1, TICK_MS),)

_NODES = {cls.node for cls in ROBOT_CLASSES}
_OF_AN_EPISODE = {
    **{
        f'{cls.node}.seed': 'the seed or the options of reset'
        for cls in ROBOT_CLASSES
        if issubclass(cls, DeviceSeed)
    },
    f'{PLANT}.start_pitch_x': 'the options of reset',
    f'{PLANT}.start_pitch_y': 'the options of reset',
    f'{PLANT}.duration': 'the argument duration',
}


def parameters_of_environment(profile: str | None, given: Parameters | None) -> ParameterSet:
    """Return the parameters of a device profile with other values for some.

    Raises
    ------
    BallbotError
        If a profile, file or value is not valid, or a value has no effect.
    """
    parameters = ParameterSet(load_profile(IDEAL if profile is None else profile))
    if isinstance(given, Mapping):
        values = plain_values(given)
        _check_effect(values)
        assign_values(parameters, values)
    elif isinstance(given, str | os.PathLike) and os.fspath(given):
        parameters.update(read_parameter_file(os.fspath(given)))
    elif given is not None:
        raise EnvironmentConfigurationError(
            f'parameters: {short_repr(given)} is neither a mapping nor a file'
        )
    check_load(parameters.of(ControllerParameters), _ONE_TASK)
    if faults := all_faults(parameters.of):
        raise ParameterError(f'{faults[0]}: environments have no faults')
    return parameters


def _check_effect(values: Mapping[str, object]) -> None:
    for target in values:
        node, _, name = target.partition('.')
        for own, remedy in _OF_AN_EPISODE.items():
            if target == own or (node == '/**' and own.endswith(f'.{name}')):
                raise ParameterError(f'{target} has no effect here: use {remedy}')
        if node == CONTROLLER and name not in (*SETTINGS, *_OF_TIME):
            raise ParameterError(
                f'{target} has no effect here; of the {CONTROLLER} only {", ".join(SETTINGS)} and '
                "those of the brick's time have"
            )
        if node and name and node not in _NODES and node != '/**':
            raise ParameterError(
                f'{target} has no effect here; only the parameters of {", ".join(sorted(_NODES))}'
            )


def check_step(step_ms: int) -> int:
    """Return the period of an environment [ms]; refuse one that it can't have."""
    if (
        not isinstance(step_ms, int | np.integer)
        or isinstance(step_ms, bool)
        or step_ms not in STEPS_MS
    ):
        allowed = ' or '.join(map(str, STEPS_MS))
        raise EnvironmentConfigurationError(f'step_ms: {step_ms!r} is not {allowed}')
    return int(step_ms)


def steps_of(duration: float, step_ms: int) -> int:
    """Return the number of steps in an episode of `duration` [s]."""
    is_number = isinstance(duration, int | float | np.integer | np.floating)
    if (
        isinstance(duration, bool)
        or not is_number
        or not (step_ms / 1000.0 <= duration <= MAX_DURATION_S)
    ):
        raise EnvironmentConfigurationError(
            f'duration: {short_repr(duration)} is not within {step_ms / 1000.0:g} … '
            f'{MAX_DURATION_S:g} s'
        )
    return round(duration * 1000.0 / step_ms)


def check_hold(parameters: ParameterSet) -> None:
    """Refuse a robot that is let go before or after the gyros are calibrated."""
    hold_s = parameters.of(PlantParameters).hold_time
    release = release_s(parameters.of(ControllerParameters))
    if not math.isclose(hold_s, release):
        raise EnvironmentConfigurationError(
            f'{PLANT}.hold_time: the robot is held for {hold_s:g} s, but calibrated for '
            f'{release:g} s (controller.time_start)'
        )


def release_s(settings: ControllerParameters) -> float:
    """Return when the first action acts [s], from the start of the run."""
    ticks = max(1, -(-settings.time_start // TICK_MS))
    return ticks * TICK_MS / 1000.0


def fingerprint(parameters: ParameterSet) -> tuple[tuple[str, object], ...]:
    """Return the values of all parameters that have an effect and are the same in all episodes."""
    return tuple(
        (target, value)
        for cls in ROBOT_CLASSES
        for name, value in parameters.of(cls).values().items()
        if (target := f'{cls.node}.{name}') not in _OF_AN_EPISODE
        and (cls is not ControllerParameters or name in SETTINGS)
    )
