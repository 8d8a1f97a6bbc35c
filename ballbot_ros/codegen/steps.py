"""Random device inputs for testing the compiled program."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ballbot_ros.brick.brick import UINT32_MASK, DeviceInputs
from ballbot_ros.brick.units import NO_DATA_CM, NO_ECHO_CM
from ballbot_ros.controllers.document.tasks import TS1_MS
from ballbot_ros.timing import BATTERY_PERIOD_NS, MILLISECOND_NS, SLOW_PERIOD_NS

_OFFSET = 600
_SONAR_MS = SLOW_PERIOD_NS // MILLISECOND_NS
_BATTERY_MS = BATTERY_PERIOD_NS // MILLISECOND_NS
_MAX_INT32 = 2**31 - 1


class ProgramInput(NamedTuple):
    """Inputs of a control program at one tick."""

    elapsed_ms: int
    systick_ms: int
    inputs: DeviceInputs


class InputSequence(NamedTuple):
    """Inputs of consecutive ticks, with a name."""

    name: str
    steps: Sequence[ProgramInput]


def random_steps(seed: int, ticks: int, *, out_of_range: bool) -> Iterator[ProgramInput]:
    """Yield random inputs that depend on `seed` alone.

    The sonar and the battery deliver at their own rates, stick packets arrive at random ticks. The
    system time starts anywhere, often shortly before it wraps around. Readings stay near balance
    or, if `out_of_range`, jump over the full ranges of their types, beyond those of the devices.
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
            if out_of_range and draw.random() < 0.1:
                gyro[plane] = draw.choice((0, 1023, 65535, draw.randrange(1024)))
            if out_of_range and draw.random() < 0.05:
                limit = draw.choice((100, 2000, _MAX_INT32))
                revolutions[plane] = draw.randint(-limit, limit)
            revolutions[plane] = max(-_MAX_INT32, min(_MAX_INT32, revolutions[plane]))
        if out_of_range and draw.random() < 0.02:
            battery = draw.choice((0, 573, 574, 65535, draw.randrange(65536)))
        inputs = DeviceInputs(
            gyro=(gyro[0], gyro[1]),
            revolutions=(revolutions[0], revolutions[1]),
            sonar_cm=_distance(draw) if elapsed % _SONAR_MS == 0 else None,
            battery_mv=battery if elapsed % _BATTERY_MS == 0 else None,
            sticks=_sticks(draw, out_of_range) if draw.random() < 0.2 else None,
        )
        yield ProgramInput(elapsed, (start + elapsed) & UINT32_MASK, inputs)


def _distance(draw: random.Random) -> int:
    return draw.choice((NO_ECHO_CM, NO_ECHO_CM, NO_DATA_CM, 0, draw.randrange(NO_ECHO_CM)))


def _sticks(draw: random.Random, out_of_range: bool) -> tuple[int, int]:
    low, high = (-128, 127) if out_of_range else (-100, 100)
    return draw.choice((low, 0, high, draw.randint(low, high))), draw.randint(low, high)
