"""The spectrum of duty and pitch, with the frequencies that the loop's analysis predicts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.drawing import draw_line, frame_curves, legend_above
from ballbot_ros.analysis.limit_cycle import Balancing
from ballbot_ros.analysis.loop_summary import PredictedFrequency
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.analysis.run_figures import RenderedFigure
from ballbot_ros.analysis.style import GRAY, PLANES, WIDTH, new_figure, png_of
from ballbot_ros.analysis.table import Table, plane_columns
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.recording.messages.topics import MOTOR_DUTY, PLANT_IMU

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MIN_SEGMENT, MAX_SEGMENT = 256, 8192
"""Shortest and longest segment of a spectrum [ticks]."""

_SEGMENTS = 3
"""Number of segments that a run is divided into, not counting those that overlap two of them."""

_ROW_INCH = 0.19
"""Height of the name of a predicted frequency."""

_DECADES = (0.01, 0.1, 1.0, 10.0, 100.0)
_DECADES_SHOWN = 5.0
"""Range of a vertical axis below the largest density."""

CAPTION = (
    'Amplitude density of duty and true body pitch while the robot balances: the square root of '
    'the power density, whose integral over the frequency is the variance.'
)
_PREDICTED = (
    ' Dotted: the frequencies at which the analysis of the loop says that it rings or grows, or '
    'would oscillate after a change of gain or dead time.'
)


def power_density(
    values: NDArray[Any], segment: int, step: float = TICK_S
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Return frequencies [Hz] and one-sided power density of each column, by Welch's method.

    The means of segments are removed; the segments overlap by half and have a Hann window. The
    integral of the density over the frequency is the variance. It is that of `scipy.signal.welch`,
    which takes a second to import and many times the memory.

    Parameters
    ----------
    values : ndarray, shape (n, k)
        Samples, one each `step` [s].
    segment : int
        Length of a segment, an even number of samples, at most n.

    Returns
    -------
    tuple of ndarray
        Shapes (segment / 2 + 1,) and (segment / 2 + 1, k).
    """
    window = np.hanning(segment + 1)[:-1, np.newaxis]
    power = np.zeros((segment // 2 + 1, values.shape[1]))
    starts = range(0, len(values) - segment + 1, segment // 2)
    for start in starts:
        part = values[start : start + segment]
        power += np.abs(np.fft.rfft(window * (part - part.mean(axis=0)), axis=0)) ** 2
    power[1:-1] *= 2.0  # those of the negative frequencies; the ends have none
    power *= step / (len(starts) * np.sum(window**2))
    return np.fft.rfftfreq(segment, step), power


def spectrum_table(run: RunData) -> Table:
    """Return the amplitude densities of duty [%/√Hz] and pitch [°/√Hz] while the robot balances.

    It is empty if duty or pitch are not recorded, or the robot did not balance for long enough.
    """
    balancing = Balancing.of(run)
    count = len(balancing.time)
    if count < MIN_SEGMENT or not {MOTOR_DUTY, PLANT_IMU} <= run.series.keys():
        return {}
    segment = min(max(count // _SEGMENTS // 2 * 2, MIN_SEGMENT), MAX_SEGMENT)
    frequency, duty = power_density(balancing.duty, segment)
    _, psi = power_density(balancing.psi, segment)
    return {
        'frequency_hz': frequency[1:],
        **plane_columns('duty', 'percent_per_sqrt_hz', np.sqrt(duty[1:])),
        **plane_columns('pitch', 'deg_per_sqrt_hz', np.degrees(np.sqrt(psi[1:]))),
    }


def render_spectrum(
    run: RunData, predictions: Sequence[PredictedFrequency]
) -> RenderedFigure | None:
    """Return the picture of the spectrum and its numbers; None if there are none."""
    table = spectrum_table(run)
    if not table:
        return None
    caption = CAPTION + _PREDICTED if predictions else CAPTION
    png = png_of(draw_spectrum(table, predictions))
    return RenderedFigure('spectrum', 'Spectrum', caption, png, table)


def draw_spectrum(table: Table, predictions: Sequence[PredictedFrequency]) -> Figure:
    """Draw a table of :func:`spectrum_table`, with the names of the predictions above it."""
    names = _ROW_INCH * len(predictions)
    figure = new_figure(WIDTH, 5.0 + names)
    strip, duty, pitch = figure.subplots(
        3, 1, sharex=True, height_ratios=[max(names, 0.01), 2.3, 2.3]
    )
    strip.set_axis_off()
    _draw_density(duty, table, 'duty_{}_percent_per_sqrt_hz', 'duty [%/√Hz]')
    _draw_density(pitch, table, 'pitch_{}_deg_per_sqrt_hz', 'body pitch [°/√Hz]')
    frequencies = table['frequency_hz']
    lowest = min([frequencies[0], *(each.hz / 1.2 for each in predictions)])
    strip.set_xscale('log')
    strip.set_xlim(lowest, frequencies[-1] * 1.03)
    ticks = [tick for tick in _DECADES if tick >= lowest]
    pitch.set_xticks(ticks, [f'{tick:g}' for tick in ticks])
    pitch.set_xlabel('frequency [Hz]')
    _mark_predictions(strip, (duty, pitch), predictions)
    legend_above(pitch)
    return figure


def _draw_density(axes: Axes, table: Table, column: str, label: str) -> None:
    """Draw the densities of both planes; that of a plane at rest is zero and has no curve."""
    highest = 0.0
    for plane, line, height in zip('xy', PLANES, (2.1, 2.0), strict=True):
        density = table[column.format(plane)]
        highest = max(highest, float(density.max()))
        shown = np.where(density > 0.0, density, np.nan)
        draw_line(axes, table['frequency_hz'], shown, line, height)
    frame_curves(axes, label)
    if highest > 0.0:
        axes.set_yscale('log')
        # Without formulas, which figures do not have, as 10⁻³ would be one.
        axes.yaxis.set_major_formatter('{x:g}')
        low, high = axes.get_ylim()
        axes.set_ylim(max(low, highest / 10.0**_DECADES_SHOWN), high)


def _mark_predictions(
    strip: Axes, rows: Sequence[Axes], predictions: Sequence[PredictedFrequency]
) -> None:
    """Mark frequencies in the rows, and name them in the strip, the highest one on top."""
    count = len(predictions)
    left, right = strip.get_xlim()
    strip.set_ylim(0.0, max(count, 1))
    for row, each in enumerate(sorted(predictions)):
        for axes in rows:
            axes.axvline(each.hz, color=GRAY, linewidth=0.9, linestyle=':')
        strip.plot(
            [each.hz] * 2, [0.0, row + 0.9], color=GRAY, linewidth=0.9, linestyle=':', clip_on=False
        )
        is_left = each.hz < (left * right) ** 0.5
        strip.annotate(
            f'{each.hz:.3g} Hz: {each.reason}', (each.hz, row + 0.5),
            (4 if is_left else -4, 0), color=GRAY, fontsize='small', textcoords='offset points',
            ha='left' if is_left else 'right', va='center',
        )  # fmt: skip
