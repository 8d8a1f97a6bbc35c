"""How long the jobs of the brick take."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ballbot_ros.robot.brick.kernel import TICK_US, KernelConstants

CLOCK_MHZ = 48.055
"""Clock of a brick, at which the times of the platform's calls are known."""

BUS_INTERRUPTS = 0.0384
"""Interrupts of the sonar's bus per microsecond."""


class JobTimes(NamedTuple):
    """Times on a processor that is interrupted by the bus only [µs].

    Attributes
    ----------
    init, calibration, control, stop, obstacle, state, display : float
        Those of the paths of the document's tasks.
    log, tone : float
        Additions for a log packet and a tone.
    own : float
        A task of another controller, with its calls of the platform.
    variation : float
        Largest random addition, as a share.
    sonar : int
        How long a reading of the sonar keeps the bus.
    """

    init: float
    calibration: float
    control: float
    stop: float
    obstacle: float
    state: float
    display: float
    log: float
    tone: float
    own: float
    variation: float
    sonar: int


def is_timed(p: Any) -> bool:
    """Return whether tasks take time or duties pass the link, by the parameters of a controller."""
    timed: bool = p.lockstep and (p.kernel or p.link)
    return timed


def free_clock(p: Any) -> float:
    """Return the clock that the interrupts of the bus leave [MHz], as for :func:`job_times`."""
    clock_mhz: float = p.processor_clock - BUS_INTERRUPTS * p.bus_cycles
    return clock_mhz


def job_times(p: Any) -> JobTimes:
    """Return the times for the parameters of ``controller``; no time without a kernel.

    The parameters are a row or a namespace, and their :func:`interrupt_load` is below 1.
    """
    if not p.kernel:
        return JobTimes(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
    clock_mhz = free_clock(p)
    each, call = p.cycles_per_instruction / clock_mhz, CLOCK_MHZ / clock_mhz
    return JobTimes(
        each * p.init_instructions, each * p.calibration_instructions,
        each * p.control_instructions, each * p.stop_instructions,
        each * p.obstacle_instructions, each * p.state_instructions,
        each * p.display_instructions + call * p.display_time,
        each * p.log_instructions + call * p.bluetooth_time,
        each * p.tone_instructions + call * p.tone_time,
        call * p.tick_time, p.time_variation, round(p.sonar_time),
    )  # fmt: skip


def kernel_constants(p: Any) -> KernelConstants:
    """Return the constants of the kernel for the parameters of ``controller``, as above."""
    call = CLOCK_MHZ / free_clock(p) if p.kernel else 0.0
    return KernelConstants(
        math.ceil(call * p.interrupt_time), math.ceil(call * p.link_time),
        round(p.motor_latency), p.link, p.kernel and p.kernel_defect,
    )  # fmt: skip


def bus_share(p: Any) -> float:
    """Return the share of the processor that the interrupts of the bus take; 0 without a kernel."""
    return BUS_INTERRUPTS * p.bus_cycles / p.processor_clock if p.kernel else 0.0


def interrupt_load(p: Any) -> Any:
    """Return the share of the processor that interrupts take; the parameters may be columns."""
    calls = CLOCK_MHZ * p.interrupt_time / TICK_US
    return (BUS_INTERRUPTS * p.bus_cycles + calls) / p.processor_clock


def load_of(p: Any, instructions: Any, call_us: Any, period_us: Any) -> Any:
    """Return the share of the processor that a task takes on average.

    Parameters
    ----------
    instructions, call_us : float
        Instructions of a job, and time of its calls of the platform [µs].
    period_us : float
        Period of the task [µs].
    """
    cycles = p.cycles_per_instruction * instructions + CLOCK_MHZ * call_us
    return (1.0 + 0.5 * p.time_variation) * cycles / p.processor_clock / period_us


def whole_time(times: JobTimes, time_us: float, chance: float) -> int:
    """Return the whole microseconds of a job; `chance` is a uniform number for its variation."""
    return math.ceil(time_us * (1.0 + times.variation * chance))
