"""Sim time: its units, the periods of steps, ticks and samples, and the start of a run."""

from __future__ import annotations

MILLISECOND_NS = 1_000_000
SECOND_NS = 1_000_000_000

STEP_NS = MILLISECOND_NS
"""Step of the plant's integration."""

STEPS_PER_TICK = 4
TICK_NS = STEPS_PER_TICK * STEP_NS
TICK_S = TICK_NS / SECOND_NS
TICK_MS = TICK_NS // MILLISECOND_NS
"""Period of the lockstep, of the gyro, encoder and duty samples, and of task_ts1."""

SLOW_PERIOD_NS = 20 * MILLISECOND_NS
"""Period of the sonar and gamepad samples and of the wall hit test (Appendix B.3)."""

BATTERY_PERIOD_NS = 100 * MILLISECOND_NS
"""Period of the battery samples. A run begins at a multiple of it, with all tasks in phase."""

TASKS_PERIOD_NS = 100 * MILLISECOND_NS
"""Period of the messages of the brick's jobs."""

FIRST_TICK_NS = SECOND_NS
"""Start of the first run; not 0, which means 'no time yet' to ROS."""

RESEND_S = 0.1
"""Wall-clock time without progress after which the plant sends its newest tick again, and period at
which it checks its time limits [s]."""

FREE_RUNNING_SILENCE_S = 0.5
"""In free-running mode, silence after which the controller assumes a neutral stick, and the plant
zero duty [s]."""

MAX_LEAD_TICKS = 50
"""Ticks that the plant may be ahead of the recorder."""


def next_start_ns(now_ns: int) -> int:
    """Return the start of a new run: the next multiple of 100 ms after `now_ns`.

    It is more than 20 ms ahead, so that no node mistakes the first sample of the new run for the
    next sample of the previous run.
    """
    return ((now_ns + SLOW_PERIOD_NS) // BATTERY_PERIOD_NS + 1) * BATTERY_PERIOD_NS
