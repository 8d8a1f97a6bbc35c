"""Sim time: when runs begin and which samples are due."""

from __future__ import annotations

from ballbot_ros.plant.truth import TICK_NS

FIRST_TICK_NS = 1_000_000_000
"""Start of the first run. Zero means 'no time yet' to ROS."""

SLOW_NS = 20_000_000
"""Period of sonar and gamepad samples."""

BATTERY_NS = 100_000_000
"""Period of battery samples, and the grid on which runs begin: all tasks are then in phase."""

FREE_RUNNING_SILENCE_S = 0.5
"""Free running, silence after which the controller takes stick zero and the plant duty zero [s]."""

MAX_LEAD_TICKS = 50
"""Ticks that the plant may be ahead of the recorder."""

MILLISECOND_NS = 1_000_000
SECOND_NS = 1_000_000_000

__all__ = [
    'BATTERY_NS',
    'FIRST_TICK_NS',
    'FREE_RUNNING_SILENCE_S',
    'MAX_LEAD_TICKS',
    'MILLISECOND_NS',
    'SECOND_NS',
    'SLOW_NS',
    'TICK_NS',
    'next_start_ns',
]


def next_start_ns(now_ns: int) -> int:
    """Return the start of a new run: the next multiple of 100 ms after `now_ns`.

    It is more than 20 ms ahead, so that nobody takes its first sample for the next one of the
    run before.
    """
    return ((now_ns + SLOW_NS) // BATTERY_NS + 1) * BATTERY_NS
