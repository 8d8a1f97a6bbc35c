"""Gain and dead time: where the loop is stable, predicted and in runs without and with rounding.

Without rounding, a run is judged by its growth: the robot starts at a pitch so small that the duty
can grow a thousandfold before it reaches its limit. With the rounding of the NXT every run ends in
a limit cycle, so its amplitude is measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.design.loop_analysis import analyse_sampled
from ballbot_ros.design.sampled_loop import LoopDelays, SampledLoop
from ballbot_ros.design.state_feedback import DesignError
from ballbot_ros.parameters import CONTROLLER, PLANT, ControllerParameters, ParameterSet
from ballbot_ros.simulation.closed_loop import ClosedLoop
from ballbot_ros.timing import TICK_MS, TICK_S
from benchmark.unquantised import run_unquantised

Floats = NDArray[np.float64]

GAIN_BEYOND, MS_BEYOND = 0.25, 2 * TICK_MS
"""How far a map extends beyond the margins: part of the gain, and dead time [ms]."""

GAIN_LIMIT = 4.0
"""Largest gain of a map, for loops without an upper limit."""

RUN_S = 30.0
"""Length of a run [s]: ten periods of the slowest oscillation of the document's loop."""

WINDOW_S = RUN_S / 4.0
"""Length of the windows whose largest duties are compared, the last two of a run [s]."""

STEADY_S = 10.0
"""The end of a run in which a limit cycle is measured [s]."""

EXACT_PITCH_DEG, ROUNDED_PITCH_DEG = 1e-3, 0.5
"""Pitch at the start [deg] without and with rounding."""

TOLERANCE = 0.05
"""Part of the gain by which prediction and run may differ."""

_SCAN = 2000
"""Number of gains between which limits are sought."""


class Grid(NamedTuple):
    """The gains, as factors of the loop's, and the dead times of the motors [ms] of a map."""

    gains: Floats
    delays_ms: NDArray[np.int64]


class RoundedRun(NamedTuple):
    """The end of a run with the rounding of the NXT, plane x.

    Attributes
    ----------
    duty_rms : float
        Root mean square of the duty [%].
    saturated : float
        Share of duties at ±100 %.
    peak_pitch : float
        Largest pitch [deg].
    fell : bool
        Whether the robot fell; the others are then NaN.
    """

    duty_rms: float
    saturated: float
    peak_pitch: float
    fell: bool


class Cell(NamedTuple):
    """A cell of the map.

    Attributes
    ----------
    gain, delay_ms : float and int
        Factor of the loop's gain, and dead time of the motors.
    predicted, measured : bool
        Whether the loop is stable, by its poles and in a run without rounding.
    duty_rms, saturated, peak_pitch, fell
        The :class:`RoundedRun` with rounding.
    """

    gain: float
    delay_ms: int
    predicted: bool
    measured: bool
    duty_rms: float
    saturated: float
    peak_pitch: float
    fell: bool


class Distance(NamedTuple):
    """Where a cell is, relative to the nearest gain at which the loop becomes unstable.

    Attributes
    ----------
    inside : float
        Part of the gain that is left to the limit; negative beyond it.
    is_upper : bool
        Whether the loop is unstable above the limit.
    """

    inside: float
    is_upper: bool


def grid(parameters: ParameterSet, gains: int, delay_step_ms: int) -> Grid:
    """Return a grid that contains the limits of the loop and what is a little beyond.

    Parameters
    ----------
    gains : int
        Number of gains.

    Raises
    ------
    DesignError
        If the loop is unstable, or the controller is not the document's program.
    """
    margins = analyse_sampled(parameters).margins
    if margins is None:
        raise DesignError('the loop is unstable: a map needs gains with which it is stable')
    lowest = margins.gain_low.value * (1.0 - GAIN_BEYOND)
    highest = min(margins.gain_high.value * (1.0 + GAIN_BEYOND), GAIN_LIMIT)
    longest = math.ceil(min(margins.dead_time_ms.value, 100.0 - MS_BEYOND)) + MS_BEYOND
    return Grid(
        np.linspace(round(lowest, 1), round(highest, 1), gains),
        np.arange(0, longest + 1, delay_step_ms),
    )


def growth(parameters: ParameterSet, gains: Floats, delay_ms: float) -> Floats:
    """Return the predicted growth of the loop's motions per tick for each gain."""
    delays = replace(LoopDelays.of(parameters), actuator=delay_ms)
    growth: Floats = np.abs(SampledLoop(parameters, delays).poles(gains)).max(axis=-1)
    return growth


def gain_limits(parameters: ParameterSet, delay_ms: float, lowest: float, highest: float) -> Floats:
    """Return the gains in a range at which the loop changes between stable and unstable."""
    gains = np.linspace(lowest, highest, _SCAN)
    rates = np.log(growth(parameters, gains, delay_ms))
    (before,) = np.nonzero(rates[1:] * rates[:-1] < 0.0)
    parts = rates[before] / (rates[before] - rates[before + 1])
    limits: Floats = gains[before] + parts * (gains[before + 1] - gains[before])
    return limits


def changed(parameters: ParameterSet, gain: float, delay_ms: int, pitch_deg: float) -> ParameterSet:
    """Return parameters with this factor of the gain, dead time and pitch at the start."""
    result = ParameterSet()
    result.update(parameters)
    result.set(CONTROLLER, 'pwm_gain', gain * parameters.of(ControllerParameters).pwm_gain)
    result.set(PLANT, 'actuator_delay', delay_ms)
    result.set(PLANT, 'start_pitch_x', math.radians(pitch_deg))
    return result


def is_stable(parameters: ParameterSet, gain: float, delay_ms: int) -> bool:
    """Return whether a run without rounding decays.

    It does not if the duty reaches its limit, or if the largest duty of the last quarter is not
    smaller than that of the quarter before.
    """
    values = changed(parameters, gain, delay_ms, EXACT_PITCH_DEG)
    values.set(PLANT, 'hold_time', 0.0)
    ticks, window = round(RUN_S / TICK_S), round(WINDOW_S / TICK_S)
    duties = np.abs(run_unquantised(values, ticks, until_saturated=True).duties)
    if len(duties) < ticks:
        return False
    return bool(duties[-window:].max() < duties[-2 * window : -window].max())


def rounded_run(parameters: ParameterSet, gain: float, delay_ms: int) -> RoundedRun:
    """Return how a run with the rounding of the NXT ends."""
    loop = ClosedLoop(changed(parameters, gain, delay_ms, ROUNDED_PITCH_DEG))
    duties, pitches = [], []
    for tick in loop.ticks(RUN_S):
        if loop.plant.fallen:
            return RoundedRun(math.nan, math.nan, math.nan, fell=True)
        duties.append(tick.outputs.duty[0])
        pitches.append(tick.truth.psi[0])
    steady = slice(-round(STEADY_S / TICK_S), None)
    duty, pitch = np.array(duties[steady], float), np.degrees(pitches[steady])
    return RoundedRun(
        duty_rms=math.sqrt(np.mean(duty**2)),
        saturated=float(np.mean(np.abs(duty) == 100.0)),
        peak_pitch=float(np.abs(pitch).max()),
        fell=False,
    )


def cells(parameters: ParameterSet, grid: Grid) -> Iterator[Cell]:
    """Yield the cells of a map, those of the shortest dead time first."""
    for delay in map(int, grid.delays_ms):
        predicted = growth(parameters, grid.gains, delay) < 1.0
        for gain, stable in zip(grid.gains.tolist(), predicted.tolist(), strict=True):
            measured = is_stable(parameters, gain, delay)
            yield Cell(gain, delay, stable, measured, *rounded_run(parameters, gain, delay))


def is_tolerable(parameters: ParameterSet, cell: Cell) -> bool:
    """Return whether the run's verdict is predicted for its gain, or one within the tolerance."""
    gains = cell.gain * np.linspace(1.0 - TOLERANCE, 1.0 + TOLERANCE, 101)
    predicted = growth(parameters, gains, cell.delay_ms) < 1.0
    return bool((predicted == cell.measured).any())


def distance(cell: Cell, limits: Floats) -> Distance:
    """Return where a cell is, relative to the nearest of the limits at its dead time."""
    ratios = cell.gain / limits
    nearest = float(ratios[np.argmin(np.abs(np.log(ratios)))])
    is_upper = (nearest < 1.0) == cell.predicted
    return Distance(1.0 - nearest if is_upper else nearest - 1.0, is_upper)


def intervals(gains: Sequence[float], stable: Sequence[bool]) -> list[tuple[float, float]]:
    """Return the first and last gain of each interval of stable ones."""
    edges = np.diff(np.array([False, *stable, False]).astype(int))
    firsts, ends = np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist()
    return [(gains[first], gains[end - 1]) for first, end in zip(firsts, ends, strict=True)]


def predicted_intervals(
    parameters: ParameterSet, delay_ms: float, lowest: float, highest: float
) -> list[tuple[float, float]]:
    """Return the intervals of a range of gains in which the loop is stable."""
    edges = [lowest, *gain_limits(parameters, delay_ms, lowest, highest).tolist(), highest]
    middles = np.array([(low + high) / 2.0 for low, high in pairwise(edges)])
    stable = growth(parameters, middles, delay_ms) < 1.0
    return [pair for pair, inside in zip(pairwise(edges), stable.tolist(), strict=True) if inside]
