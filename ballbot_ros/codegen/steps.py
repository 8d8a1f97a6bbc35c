"""Random device inputs for testing the compiled program."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ballbot_ros.brick.brick import UINT32, DeviceInputs
from ballbot_ros.brick.units import NO_DATA_CM, NO_ECHO_CM
from ballbot_ros.controller.tasks import TS1_MS

_OFFSET = 600
_SONAR_MS, _BATTERY_MS = 20, 100
_STEEPEST = 2**31 - 1


class Step(NamedTuple):
    """Inputs of a control program at one tick."""

    elapsed_ms: int
    systick_ms: int
    inputs: DeviceInputs


class InputSequence(NamedTuple):
    """Inputs of consecutive ticks, with a name."""

    name: str
    steps: Sequence[Step]


def random_steps(seed: int, ticks: int, *, wild: bool) -> Iterator[Step]:
    """Yield random inputs that depend on `seed` alone.

    The devices deliver at their own rates, sometimes in between or not at all. The system time
    starts anywhere, often shortly before it wraps around.

    Parameters
    ----------
    seed, ticks : int
    wild : bool
        Whether readings jump over the full ranges of their types, beyond those of the devices;
        otherwise they stay near balance.
    """
    draw = random.Random(seed)
    start = draw.choice((1000, draw.randrange(2**32), 2**32 - draw.randrange(4 * ticks + 4)))
    gyro = [_OFFSET, _OFFSET]
    revolutions = [0, 0]
    battery = 8003
    for tick in range(ticks):
        elapsed = tick * TS1_MS
        for plane in (0, 1):
            gyro[plane] = _OFFSET + round(draw.gauss(0.0, 2.0))
            revolutions[plane] += round(draw.gauss(0.0, 3.0))
            if wild and draw.random() < 0.1:
                gyro[plane] = draw.choice((0, 1023, 65535, draw.randrange(1024)))
            if wild and draw.random() < 0.05:
                limit = draw.choice((100, 2000, _STEEPEST))
                revolutions[plane] = draw.randint(-limit, limit)
            revolutions[plane] = max(-_STEEPEST, min(_STEEPEST, revolutions[plane]))
        if wild and draw.random() < 0.02:
            battery = draw.choice((0, 573, 574, 65535, draw.randrange(65536)))
        inputs = DeviceInputs(
            gyro=(gyro[0], gyro[1]),
            revolutions=(revolutions[0], revolutions[1]),
            sonar_cm=_distance(draw) if elapsed % _SONAR_MS == 0 else None,
            battery_mv=battery if elapsed % _BATTERY_MS == 0 else None,
            sticks=_sticks(draw, wild) if draw.random() < 0.2 else None,
        )
        yield Step(elapsed, (start + elapsed) & UINT32, inputs)


def _distance(draw: random.Random) -> int:
    return draw.choice((NO_ECHO_CM, NO_ECHO_CM, NO_DATA_CM, 0, draw.randrange(NO_ECHO_CM)))


def _sticks(draw: random.Random, wild: bool) -> tuple[int, int]:
    low, high = (-128, 127) if wild else (-100, 100)
    return draw.choice((low, 0, high, draw.randint(low, high))), draw.randint(low, high)
