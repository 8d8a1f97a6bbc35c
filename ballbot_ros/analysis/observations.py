"""What a run shows, in sentences: its limit cycles, and why the estimated pitch is off.

The document's program integrates the gyro's reading minus an offset, so its estimate of the pitch
is off on average. It measures the offset in the calibration, and moves it to later readings by a
low pass with the coefficient a = a_gd. With o_hat as the result of the calibration, its estimate is
psi_hat[k+1] = a psi_hat[k] + T a (reading[k] - o_hat). For the true offset o[k] of the gyro, the
error of the estimate follows

    e[k+1] = a e[k] + T a ((o[0] - o_hat) + (o[k] - o[0]) + (reading[k] - rate[k] - o[k]))
             - (1 - a) psi[k],

apart from the steps of the integration. It is linear, so each term has its own share in the mean
error, and so has the error at the first tick. An error of the calibration stays;
1 deg/s becomes T a / (1 - a) = 4 degrees of pitch.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.limit_cycle import LimitCycle, limit_cycles, lowest_hz
from ballbot_ros.analysis.loop_summary import RINGS, PredictedFrequency
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.analysis.run_metrics import pitch_error, position_error
from ballbot_ros.engine.devices import gyro_constants
from ballbot_ros.parameters import GYRO, ControllerParameters, GyroParameters
from ballbot_ros.parameters.timing import TICK_NS, TICK_S
from ballbot_ros.recording.messages.topics import (
    CONTROLLER_STATE,
    GYRO_IMU,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_ODOM,
)
from ballbot_ros.robot.brick.sensors import gyro_offset

RIGHT_DEG = 0.05
"""Smallest mean error that counts as one [°], and smallest part that is always named."""

_NAMED_SHARE = 0.1
"""Share of the sum of magnitudes from which on a smaller part of an error is named, too."""

_SHOWN_DEG = 0.005  # a smaller one would read 0.00
_NAMED_M = 0.001
_UNEXPLAINED_M = 0.0005  # as from the gear play, which the encoders do not see

_FIRST_ESTIMATE_DEG = 0.1
"""The first estimates are 0 except for a tick or two of noise [°]."""

_MIN_TICKS = 2
_ROWS = 2**13
"""Number of ticks in memory at once."""

_DRIFT_TICKS = 25  # a tenth of the fastest drift; in between, it is interpolated
_TOPICS = {CONTROLLER_STATE, GYRO_IMU, PLANT_IMU}


class OffsetParts(NamedTuple):
    """The mean error of the estimated pitch in a plane, by cause [°]; the sum is the mean error.

    Attributes
    ----------
    start_pitch : float
        The pitch at the first tick, which the program takes for 0. Its share fades in seconds.
    calibration : float
        The error of the calibration, whose share stays.
    drift : float
        The drift of the gyro since the calibration.
    noise : float
        Noise, rounding and dead time of the gyro.
    lasting_pitch : float
        True pitch that lasts, which the program takes for drift of the gyro.
    single_precision : float
        Rounding errors of the program; in a free-running run also readings that it missed.
    remainder : float
        The rest: the steps of the integration.
    """

    start_pitch: float
    calibration: float
    drift: float
    noise: float
    lasting_pitch: float
    single_precision: float
    remainder: float

    @property
    def total(self) -> float:
        """The mean error of the estimated pitch [°]."""
        return math.fsum(self)


class EstimatedTicks(NamedTuple):
    """Consecutive ticks while the controller balances; column 0 is plane x, 1 plane y.

    Attributes
    ----------
    estimate, pitch : ndarray, shape (n, 2)
        Estimated and true pitch [°].
    reading, rate : ndarray, shape (n, 2)
        Reading of the gyro and true pitch rate [deg/s].
    offset : ndarray, shape (n, 2)
        True offset of the gyro [deg/s], without noise and rounding.
    """

    estimate: NDArray[np.float64]
    pitch: NDArray[np.float64]
    reading: NDArray[np.float64]
    rate: NDArray[np.float64]
    offset: NDArray[np.float64]


class EstimateStart(NamedTuple):
    """What the estimate starts from, shape (2,) each.

    Attributes
    ----------
    estimate, pitch : ndarray
        Estimated and true pitch at the first tick [°].
    calibrated, offset : ndarray
        The gyro's offset at the first tick [deg/s], by the program's calibration and truly.
    """

    estimate: NDArray[np.float64]
    pitch: NDArray[np.float64]
    calibrated: NDArray[np.float64]
    offset: NDArray[np.float64]


def decompose(
    start: EstimateStart, blocks: Iterable[EstimatedTicks], count: int, a: float
) -> tuple[OffsetParts, OffsetParts]:
    """Return the mean error of the estimate by cause, for the planes x and y.

    Parameters
    ----------
    blocks : iterable of EstimatedTicks
        The ticks from the first one on, in blocks of any length, which bound the memory.
    count : int
        Number of ticks.
    a : float
        Coefficient of the low pass that moves the program's offset.
    """
    kept = _geometric_sum(a, np.array([float(count)]))
    sums = np.zeros((7, 2))
    # The first error fades by itself, and so does the first estimate of a program without rounding.
    sums[0] = kept * (start.estimate - start.pitch)
    sums[5] = -kept * start.estimate
    done = 0
    for block in blocks:
        sums += _sums(block, start, a, count - done)
        done += len(block.pitch)
    *known, error = sums / count
    known.append(error - np.sum(known, axis=0))
    x, y = (OffsetParts(*parts) for parts in np.transpose(known).tolist())
    return x, y


def _sums(block: EstimatedTicks, start: EstimateStart, a: float, left: int) -> NDArray[np.float64]:
    """Return what a block adds to the sums of the errors, by cause and in total, shape (7, 2).

    `left` is the number of ticks from the first one of the block on. What enters at a tick adds
    1 + a + a² + ... to the sum of the later errors.
    """
    later = left - 1.0 - np.arange(len(block.pitch), dtype=np.float64)
    weights = _geometric_sum(a, np.asarray(later, np.float64))
    gains = TICK_S * a * weights
    return np.array([
        np.zeros(2),
        gains.sum() * (start.offset - start.calibrated),
        gains @ (block.offset - start.offset),
        gains @ (block.reading - block.rate - block.offset),
        (a - 1.0) * weights @ block.pitch,
        block.estimate.sum(axis=0) - gains @ (block.reading - start.calibrated),
        (block.estimate - block.pitch).sum(axis=0),
    ])  # fmt: skip


def _geometric_sum(a: float, count: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 1 + a + ... + a^(count - 1)."""
    return count if a == 1.0 else np.asarray((1.0 - a**count) / (1.0 - a))


def estimate_offset(
    run: RunData,
) -> tuple[EstimateStart, tuple[OffsetParts, OffsetParts]] | None:
    """Return what the estimated pitch starts from, and its mean error by cause in planes x and y.

    It is None with the controller or gyro of another package, if a_gd changed during the run, if
    topics or ticks are missing, and if the robot never balanced.
    """
    is_changed = any(each.name == 'a_gd' for each in run.parameter_changes)
    if not run.has_documents_program or GYRO in run.attached.external or is_changed:
        return None
    if not run.series.keys() >= _TOPICS:
        return None
    truth = run.series[PLANT_IMU]
    ticks = np.flatnonzero(run.balancing(truth.time))
    if len(ticks) < _MIN_TICKS:
        return None
    first, end, count = int(ticks[0]), int(ticks[-1]) + 1, len(ticks)
    del ticks
    # The program's constant, which is in single precision.
    a = float(np.float32(run.attached.parameters.of(ControllerParameters).a_gd))
    start = _start(run, first, a)
    lasts = truth.stamps[end - 1] - truth.stamps[first]
    if lasts != (count - 1) * TICK_NS or np.any(np.abs(start.estimate) > _FIRST_ESTIMATE_DEG):
        return None  # a gap, or the first ticks are missing
    blocks = (_ticks(run, slice(row, min(row + _ROWS, end))) for row in range(first, end, _ROWS))
    parts = decompose(start, blocks, count, a)
    return (start, parts) if np.isfinite(parts).all() else None


def _start(run: RunData, row: int, a: float) -> EstimateStart:
    """Return what the estimate starts from at a row of the truth.

    The program moves its offset towards the reading before it subtracts it, so its rate is
    a (reading - offset). Its pitch is proportional to how far the offset has moved.
    """
    ticks = _ticks(run, slice(row, row + 1))
    stamps = run.series[PLANT_IMU].stamps[row : row + 1]
    rate = np.degrees(run.series[CONTROLLER_STATE].at(stamps)[0, 4:6], dtype=np.float64)
    estimate, calibrated = ticks.estimate[0], ticks.reading[0]
    if a:  # if not, the offset is always the reading
        calibrated = calibrated - rate / a - estimate * (1.0 - a) / (a * TICK_S)
    return EstimateStart(estimate, ticks.pitch[0], calibrated, ticks.offset[0])


def _ticks(run: RunData, rows: slice) -> EstimatedTicks:
    """Return the ticks of some rows of the truth; NaN where samples are missing."""
    truth = run.series[PLANT_IMU]
    stamps, true = truth.stamps[rows], np.degrees(truth.values[rows])
    estimate = run.series[CONTROLLER_STATE].at(stamps)[:, [1, 3]]
    gyro = gyro_constants(run.attached.parameters.of(GyroParameters))
    known = np.append(stamps[:-1:_DRIFT_TICKS], stamps[-1])
    offsets = [
        [gyro_offset(plane, stamp) for stamp in known.tolist()] for plane in (gyro.x, gyro.y)
    ]
    return EstimatedTicks(
        np.degrees(estimate, dtype=np.float64),
        true[:, :2],
        np.degrees(run.series[GYRO_IMU].at(stamps), dtype=np.float64),
        true[:, 2:],
        np.column_stack([np.interp(stamps, known, column) for column in offsets]),
    )


def offset_reasons(run: RunData) -> list[str]:
    """Return how far the estimated pitch is off the true one and why, a sentence for each plane.

    The list is empty if topics are missing, or the robot never balanced. If the causes are unknown,
    as with another controller, a sentence has only the offset.
    """
    found = estimate_offset(run)
    if found is None:
        errors = np.degrees(pitch_error(run))
        errors = errors[np.isfinite(errors).all(axis=1)]
        means = errors.mean(axis=0).tolist() if len(errors) else []
        return [f'{_how_far(plane, mean)}.' for plane, mean in enumerate(means)]
    sentences = []
    start, both = found
    for plane, parts in enumerate(both):
        causes = '; '.join(_causes(run, start, parts, plane))
        sentences.append(
            f'{_how_far(plane, parts.total)}{": " if causes else ""}{causes}.'
            f'{_position_offset(run, plane, parts.total)}'
        )
    return sentences


def _how_far(plane: int, mean: float) -> str:
    """Return the mean error of a plane [°] in words."""
    if abs(mean) < RIGHT_DEG:
        how = f'right within {RIGHT_DEG:g}° on average'
    else:
        how = f'{abs(mean):.2f}° {"above" if mean > 0.0 else "below"} the true one on average'
    return f'Plane {"xy"[plane]}: the estimated pitch is {how}'


def _causes(run: RunData, begin: EstimateStart, parts: OffsetParts, plane: int) -> Iterator[str]:
    """Yield the causes that are worth naming, the largest first."""
    error = float(begin.calibrated[plane] - begin.offset[plane])
    start = f'{begin.pitch[plane]:.2f}'.replace('-', '−')
    has_noise = run.attached.parameters.of(GyroParameters).noise > 0.0
    texts = {
        'start_pitch': f'the pitch of {start}° at the start, which the program takes for 0',
        'calibration': f'the calibration, whose gyro offset is {abs(error):.2f} deg/s too '
        f'{"high" if error > 0.0 else "low"}',
        'drift': 'the drift of the gyro since the calibration',
        'noise': f"the {'noise and ' if has_noise else ''}rounding of the gyro's readings",
        'lasting_pitch': 'lasting pitch, which the program takes for drift of the gyro',
        'single_precision': "the program's rounding in single precision"
        f'{"" if run.plant.lockstep else ", and readings that it missed"}',
        'remainder': 'the steps of the integration',
    }
    named = RIGHT_DEG
    if abs(parts.total) >= RIGHT_DEG:
        share = _NAMED_SHARE * sum(map(abs, parts))
        named = min(named, max(share, _SHOWN_DEG))
    for name, part in sorted(parts._asdict().items(), key=lambda each: -abs(each[1])):
        if abs(part) >= named:
            yield f'{_signed(part, 2)}° from {texts[name]}'


def _position_offset(run: RunData, plane: int, mean: float) -> str:
    """Return a sentence on the position if the mean error of the pitch [°] puts it off, or ''.

    The program adds its pitch to the angle of the encoder, which counts from the pitch at the
    start. So the estimated angle of the ball is off by the pitch at the start plus the error.
    """
    if PLANT_ODOM not in run.series:
        return ''
    errors = position_error(run)[:, plane]
    offset = float(errors[np.isfinite(errors)].mean()) if np.isfinite(errors).any() else 0.0
    radius = run.attached.parameters.of(ControllerParameters).ball_radius
    start = float(run.series[PLANT_IMU].values[0, plane])
    expected = radius * (start + math.radians(mean))
    if abs(offset) < _NAMED_M or abs(offset - expected) > _UNEXPLAINED_M:
        return ''
    return (
        ' The estimated position, which includes the pitch since the start times the radius of '
        f'the ball, is off by {_signed(offset * 1e3, 1)} mm on average.'
    )


def _signed(value: float, digits: int) -> str:
    return f'{value:+.{digits}f}'.replace('-', '−')


_NEAR_OCTAVES = 0.5
"""Distance up to which a predicted frequency is named with a limit cycle."""


def limit_cycle_sentences(run: RunData, predicted: Sequence[PredictedFrequency]) -> list[str]:
    """Return a sentence for each limit cycle, or that there is none.

    Without the controller's state, a limit cycle would look like a drive to and fro.
    """
    lowest = lowest_hz(run)
    if not {MOTOR_DUTY, PLANT_IMU, CONTROLLER_STATE} <= run.series.keys() or math.isinf(lowest):
        return []
    cycles = zip('xy', limit_cycles(run), strict=True)
    found = [_sentence(plane, cycle, predicted) for plane, cycle in cycles if cycle]
    explained = [
        f' The linear model of the loop rings at {each.hz:.3g} Hz: that oscillation dies away '
        'after each disturbance, whereas a limit cycle lasts.'
        for each in predicted
        if each.reason == RINGS
    ]
    return found or [f'No limit cycle found above {lowest:.2g} Hz.{"".join(explained)}']


def _sentence(plane: str, cycle: LimitCycle, predicted: Sequence[PredictedFrequency]) -> str:
    amplitudes = f'duty ±{cycle.duty:.3g} %, pitch ±{cycle.pitch:.2g}°'
    sentence = f'Limit cycle at {cycle.hz:.3g} Hz in plane {plane}: {amplitudes}.'
    near = [each for each in predicted if abs(math.log2(each.hz / cycle.hz)) < _NEAR_OCTAVES]
    if near:
        nearest = min(near, key=lambda each: abs(math.log2(each.hz / cycle.hz)))
        sentence += f' The nearest predicted frequency is {nearest.hz:.3g} Hz ({nearest.reason}).'
    return sentence
