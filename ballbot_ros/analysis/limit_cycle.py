"""The limit cycle of a run, and the spectrum of duty and pitch beside predicted frequencies."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.drawing import draw_line, frame_curves, legend_above
from ballbot_ros.analysis.figure_parts import GRAY, PLANES, WIDTH, Table, new_figure, png_of
from ballbot_ros.analysis.loop_summary import PredictedFrequency
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.analysis.run_figures import RenderedFigure
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.recording.messages.topics import CONTROLLER_STATE, MOTOR_DUTY, PLANT_IMU
from ballbot_ros.robot.arithmetic import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GAP_S = 1.5 * TICK_S


def balancing_ticks(run: RunData) -> slice:
    """Return the longest part of the trajectory in which the controller balances without a gap."""
    time = run.trajectory.time
    active = np.flatnonzero(run.balancing(time))
    is_gap = (np.diff(active) > 1) | (np.diff(time[active]) >= _GAP_S)
    ticks = max(np.split(active, np.flatnonzero(is_gap) + 1), key=len)
    return slice(int(ticks[0]), int(ticks[-1]) + 1) if ticks.size else slice(0, 0)


Samples = NDArray[np.float64]

MIN_SHARE = 0.25
"""Part of the variance of the duty that a limit cycle has at least."""

MAX_VARIATION = 0.2
"""Largest standard deviation of the lengths, and of the heights, of its cycles, of their mean."""

MIN_CYCLES = 5
"""Fewest whole cycles that show a limit cycle."""

MIN_COVER = 0.7
"""Part of the time that these cycles take at least."""

MAX_TICKS = 50_000
"""Newest ticks that are looked at, 200 s, which bounds work and memory."""

MIN_AMPLITUDE = 1.0
"""Smallest amplitude [%]: a duty is a whole percent."""

_BAND, _STEP = 3.0, 2.0**0.5
"""Ratio of the ends of a band of frequencies, and that of one band to the next."""

_CROSSING = 0.75
"""Level that a cycle passes, up and down, as a part of the standard deviation."""

_FINER = 4
"""Number of steps of a tick, to time crossings up to half the sampling rate."""

_EXTENT = 2.5, 97.5
"""Percentiles between which the values of a cycle count."""

_HARMONICS = 4.0
"""Frequency up to which the shape of a cycle counts, as a multiple of its band's end."""


class LimitCycle(NamedTuple):
    """A limit cycle of one plane.

    Attributes
    ----------
    hz : float
        Frequency [Hz].
    duty, pitch : float
        Amplitudes [%] and [°]: half of the range that 95 % of the values at the ticks are in.
    share : float
        Part of the variance of the duty in the band of frequencies around it.
    """

    hz: float
    duty: float
    pitch: float
    share: float


def limit_cycles(run: RunData) -> tuple[LimitCycle | None, LimitCycle | None]:
    """Return the limit cycles of planes x and y; None for a plane without one.

    An oscillation that the controller's reference has as well is no limit cycle: the robot is
    driven to and fro.
    """
    ticks, trajectory = _settled_ticks(run), run.trajectory
    duty, pitch = trajectory.duty[ticks].astype(float), np.degrees(trajectory.psi[ticks])
    reference = _reference_rate(run, trajectory.time[ticks])
    x, y = (_of_plane(duty[:, axis], pitch[:, axis], reference[:, axis]) for axis in range(2))
    return x, y


def lowest_hz(run: RunData) -> float:
    """Return the lowest frequency [Hz] that :func:`limit_cycles` can find; infinity if none."""
    settled = _settled_ticks(run)
    ticks = settled.stop - settled.start
    hz = (MIN_CYCLES + 1) / (ticks * TICK_S) if ticks else math.inf
    return hz if hz < 0.5 / TICK_S else math.inf


def _settled_ticks(run: RunData) -> slice:
    """Return the ticks to look at.

    The first quarter of the time is left out, since the robot is caught there, and all up to the
    last push of the scenario.
    """
    ticks = balancing_ticks(run)
    first = max(ticks.start + (ticks.stop - ticks.start) // 4, ticks.stop - MAX_TICKS)
    for push in run.attached.scenario.pushes if run.attached.scenario else ():
        end = push.time + push.duration
        first = max(first, int(np.searchsorted(run.trajectory.time, end, 'right')))
    return slice(min(first, ticks.stop), ticks.stop)


def _reference_rate(run: RunData, time: Samples) -> Samples:
    """Return the ball rates [deg/s] of the controller's reference at times [s]; 0 without one."""
    if not time.size or CONTROLLER_STATE not in run.series:
        return np.zeros((len(time), 2))
    state = run.series[CONTROLLER_STATE]
    samples = np.searchsorted(state.time, time - 0.5 * TICK_S).clip(max=len(state.time) - 1)
    return np.asarray(np.degrees(np.nan_to_num(state.values[samples, 8:10].astype(float))))


def _of_plane(duty: Samples, pitch: Samples, reference: Samples) -> LimitCycle | None:
    found = find_limit_cycle(duty, pitch)
    if found is None:
        return None
    driven = find_limit_cycle(reference, pitch)
    if driven and abs(driven.hz - found.hz) <= MAX_VARIATION * found.hz:
        return None
    return found


def find_limit_cycle(duty: Samples, pitch: Samples) -> LimitCycle | None:
    """Return the limit cycle of a plane, None if there is none.

    A limit cycle has a good part of the variance of the duty, and its cycles are equally long and
    high. The ringing that noise keeps alive has cycles of every height; a transient, cycles that
    fade. The samples are duty [%] and body pitch [°] at each tick.
    """
    # An even number of ticks: an odd one has no frequency of half the sampling rate.
    duty, pitch = duty[len(duty) % 2 :], pitch[len(pitch) % 2 :]
    if len(duty) < 2 * MIN_CYCLES:
        return None
    spectrum = _Spectrum(duty)
    for share, band in spectrum.strongest_bands():
        wave = spectrum.wave(band)
        starts = _cycle_starts(wave)
        if len(starts) <= MIN_CYCLES:
            continue
        lengths, heights = np.diff(starts), _heights(wave, starts)
        if (
            _variation(lengths) > MAX_VARIATION
            or _variation(heights) > MAX_VARIATION
            or lengths.sum() < MIN_COVER * _FINER * len(duty)
        ):
            continue
        # The shape with harmonics, at the ticks: a duty has no values between them.
        shape = band[0], band[1] * _HARMONICS
        amplitude, swing = (
            # Without slow motions a wave may overshoot, where the duty is saturated.
            min(_extent(_Spectrum(values).wave(shape, 1)), float(np.ptp(values)) / 2.0)
            for values in (duty, pitch)
        )
        if amplitude < MIN_AMPLITUDE:
            continue
        # A crossing that noise hides makes one length of two.
        whole = lengths[lengths < 1.5 * np.median(lengths)]
        hz = _FINER / (TICK_S * float(whole.mean()))
        return LimitCycle(hz, amplitude, swing, share)
    return None


class _Spectrum:
    """The spectrum of samples without their trend, to take bands of frequencies from."""

    def __init__(self, values: Samples) -> None:
        self._count = count = len(values)
        ticks = np.arange(count)
        trend = np.polyfit(ticks, values, 1) if count > 1 else [0.0]
        self._values = np.fft.rfft(values - np.polyval(trend, ticks))
        self._hz = np.fft.rfftfreq(count, TICK_S)
        self._power = np.abs(self._values) ** 2
        if count % 2 == 0:
            self._power[-1] /= 2.0  # one value, where other frequencies have two

    def strongest_bands(self) -> Iterator[tuple[float, tuple[float, float]]]:
        """Yield bands of frequencies [Hz] and their shares of the variance, the largest first."""
        total = float(self._power.sum())
        found = []
        high = 0.5 / TICK_S
        while total > 0.0 and high * self._count * TICK_S > MIN_CYCLES:
            band = high / _BAND, high
            share = float(self._power[self._within(band)].sum()) / total
            if share >= MIN_SHARE:
                found.append((share, band))
            high /= _STEP
        yield from sorted(found, reverse=True)

    def wave(self, band: tuple[float, float], finer: int = _FINER) -> Samples:
        """Return the part of the samples in a band, with `finer` values for each of them."""
        part = np.where(self._within(band), self._values, 0.0)
        if self._count % 2 == 0 and finer > 1:
            part[-1] /= 2.0
        return np.fft.irfft(part, finer * self._count) * finer

    def _within(self, band: tuple[float, float]) -> NDArray[np.bool_]:
        low, high = band
        return np.asarray((self._hz > low) & (self._hz < high * 1.000001))


def _cycle_starts(wave: Samples) -> NDArray[np.intp]:
    """Return where cycles start: above a level, after a time below its negative."""
    level = _CROSSING * wave.std()
    outside = np.flatnonzero(abs(wave) > level)
    signs = np.sign(wave[outside])
    return outside[1:][np.diff(signs) > 0.0]


def _heights(wave: Samples, starts: NDArray[np.intp]) -> Samples:
    """Return the distance from lowest to highest value of each cycle, from start to start."""
    highest, lowest = (each.reduceat(wave, starts)[:-1] for each in (np.maximum, np.minimum))
    return np.asarray(highest - lowest)


def _extent(wave: Samples) -> float:
    low, high = np.percentile(wave, _EXTENT)
    return float(high - low) / 2.0


def _variation(values: Floats) -> float:
    return float(values.std() / values.mean())


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


def power_density(values: NDArray[Any], segment: int) -> tuple[Floats, Floats]:
    """Return frequencies [Hz] and one-sided power density of the values at ticks, shape (n,).

    Its integral over the frequency is the variance. Segments have `segment` ticks.
    """
    from scipy.signal import welch  # which takes a second to import

    frequency, power = welch(values, 1.0 / TICK_S, 'hann', segment)
    return frequency, power


def spectrum_table(run: RunData) -> Table:
    """Return the amplitude densities of duty [%/√Hz] and pitch [°/√Hz] while the robot balances.

    It is empty if duty or pitch are not recorded, or the robot did not balance for long enough.
    """
    ticks = balancing_ticks(run)
    count = ticks.stop - ticks.start
    if count < MIN_SEGMENT or not {MOTOR_DUTY, PLANT_IMU} <= run.series.keys():
        return {}
    segment = min(max(count // _SEGMENTS // 2 * 2, MIN_SEGMENT), MAX_SEGMENT)
    pitch = np.degrees(run.trajectory.psi[ticks])
    signals = {'duty_{}_percent': run.trajectory.duty[ticks], 'pitch_{}_deg': pitch}
    table = {}
    for name, values in signals.items():
        for plane, column in zip('xy', values.T, strict=True):
            frequency, power = power_density(column, segment)
            table['frequency_hz'] = frequency[1:]
            table[f'{name.format(plane)}_per_sqrt_hz'] = np.sqrt(power[1:])
    return table


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
