"""The tasks of the control program, as the OIL file has them."""

from __future__ import annotations

from typing import NamedTuple

PROGRAM_NAME = 'NXT BALLBOT'
"""First line of the display."""


class TaskTiming(NamedTuple):
    """When a task runs.

    Attributes
    ----------
    name : str
        Name in the OIL file, and of the function.
    priority : int
        Larger runs first.
    period_ms : int
        Cycle of its alarm; 0 for a task that runs once at the start.
    """

    name: str
    priority: int
    period_ms: int


TS1_MS, TS2_MS, TS3_MS, LCD_MS = 4, 20, 100, 500

TASKS = (
    TaskTiming('task_init', 5, 0),
    TaskTiming('task_ts1', 4, TS1_MS),
    TaskTiming('task_ts2', 3, TS2_MS),
    TaskTiming('task_ts3', 2, TS3_MS),
    TaskTiming('task_lcd', 1, LCD_MS),
)
"""The Python program's schedule and the generated OIL file are both made from this."""
