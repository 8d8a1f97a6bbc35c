"""Commanded speeds of an episode."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ballbot_ros.environments.errors import EnvironmentConfigurationError
from ballbot_ros.errors import short_repr
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.scenario.signal import Segment, StickSignal

FIRST_COMMAND_S = 1.0
COMMAND_PERIOD_S = 3.0
LARGEST_PERCENT = 100


class Command(NamedTuple):
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


Commands = tuple[Command, ...]


def random_commands(generator: np.random.Generator, duration: float) -> Commands:
    """Return a new random command every 3 s, the first after 1 s, for an episode of `duration` [s].

    Both shares are uniform whole numbers.
    """
    count = max(0, math.ceil((duration - FIRST_COMMAND_S) / COMMAND_PERIOD_S))
    shares = generator.integers(-LARGEST_PERCENT, LARGEST_PERCENT, size=(count, 2), endpoint=True)
    return tuple(
        Command(FIRST_COMMAND_S + index * COMMAND_PERIOD_S, x, y)
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


def _checked(time_s: float, x: int, y: int) -> Command:
    if not 0.0 <= time_s < math.inf or any(
        share != int(share) or abs(share) > LARGEST_PERCENT for share in (x, y)
    ):
        raise ValueError
    return Command(float(time_s), int(x), int(y))


def scenario_of(commands: Commands, release_s: float) -> Scenario:
    """Return the sticks that give the commands; the robot is released at `release_s` [s]."""
    return Scenario(
        vertical=_signal(((each.time_s, -each.x_percent) for each in commands), release_s),
        horizontal=_signal(((each.time_s, each.y_percent) for each in commands), release_s),
    )


def _signal(values: Iterable[tuple[float, int]], release_s: float) -> StickSignal:
    points = [(release_s + time, value) for time, value in values]
    times = [time for time, _ in points] + [math.inf]
    return StickSignal(
        [
            Segment('command', [(start, value), (end, value)])
            for (start, value), end in zip(points, times[1:], strict=True)
        ]
    )
