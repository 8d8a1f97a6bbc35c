"""The tasks of the control program, for the schedule and the OIL file."""

from __future__ import annotations

from ballbot_ros.brick.schedule import TaskTiming
from ballbot_ros.timing import TICK_MS

PROGRAM_NAME = 'NXT BALLBOT'
"""First line of the display."""

TASK_TS1 = 'task_ts1'
TS1_MS = TICK_MS
"""Period of task_ts1: the tick of the plant."""

LCD_MS = 500


def task_timings(ts2_ms: int, ts3_ms: int) -> tuple[TaskTiming, ...]:
    """Return the tasks; the periods of ts2 and ts3 are parameters.

    Both the Python program's schedule and the generated OIL file are derived from them.
    """
    return (
        TaskTiming('task_init', 5, 0),
        TaskTiming(TASK_TS1, 4, TS1_MS),
        TaskTiming('task_ts2', 3, ts2_ms),
        TaskTiming('task_ts3', 2, ts3_ms),
        TaskTiming('task_lcd', 1, LCD_MS),
    )
