"""The loop in words, numbers and pictures: the ideal one next to the one that runs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.drawing import (
    draw_line,
    frame_curves,
    label_time,
    legend_above,
    style_axes,
)
from ballbot_ros.analysis.figure_parts import (
    BLUE,
    GRAY,
    ORANGE,
    WIDTH,
    Line,
    Table,
    new_figure,
    png_of,
)
from ballbot_ros.analysis.run_figures import RenderedFigure
from ballbot_ros.controllers.design.linear_model import ideal_loop
from ballbot_ros.controllers.design.loop_analysis import LoopAnalysis, LoopResponse, Margins
from ballbot_ros.controllers.design.sampled_loop import FORCE, INPUTS, STICK, SampledLoop
from ballbot_ros.parameters import (
    ControllerParameters,
    EncoderParameters,
    GyroParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.timing import TICK_S

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ballbot_ros.controllers.design.loop_analysis import Limit, Pole

IDEAL, AS_IT_RUNS = 'ideal, continuous', 'as it runs'
"""Headings of the two loops."""


class MarginRow(NamedTuple):
    """A margin of both loops, and the frequency at which the one that runs oscillates."""

    name: str
    ideal: str
    sampled: str
    frequency: str


def margin_rows(ideal: LoopAnalysis, sampled: LoopAnalysis) -> list[MarginRow]:
    """Return the margins of the ideal loop next to those of the loop that runs."""
    columns = [_words(loop) for loop in (ideal, sampled)]
    return [MarginRow(*row) for row in zip(_NAMES, *columns, _frequencies(sampled), strict=True)]


_NAMES = (
    'gain', 'phase', 'dead time, motors', 'dead time, gyro', 'dead time, encoders',
    'disk margin', 'sensitivity peak',
)  # fmt: skip


def _words(loop: LoopAnalysis) -> list[str]:
    margins = loop.margins
    if margins is None:
        return ['not stable', *['–'] * (len(_NAMES) - 1)]
    return [
        f'{_number(margins.gain_low.value)} … {_number(margins.gain_high.value)}',
        f'{_number(margins.phase_deg.value)}°',
        *(f'{_number(each.value)} ms' if each else '–' for each in _dead_times(loop, margins)),
        _number(margins.disk),
        _number(margins.sensitivity.value),
    ]


def _frequencies(loop: LoopAnalysis) -> list[str]:
    margins = loop.margins
    if margins is None:
        return [''] * len(_NAMES)
    gains = [_hertz(each.hz) for each in (margins.gain_low, margins.gain_high)]
    return [
        ' … '.join(filter(None, gains)),
        _hertz(margins.phase_deg.hz),
        *(_hertz(each.hz) if each else '' for each in _dead_times(loop, margins)),
        '',
        _hertz(margins.sensitivity.hz),
    ]


def _dead_times(loop: LoopAnalysis, margins: Margins) -> tuple[Limit | None, ...]:
    """Return the additional dead times of motors, gyro and encoders that the loop bears."""
    samples = loop.samples
    return (
        margins.dead_time_ms,
        samples.gyro_dead_time_ms if samples else None,
        samples.encoder_dead_time_ms if samples else None,
    )


def findings(sampled: LoopAnalysis) -> Iterator[str]:
    """Yield what limits the loop that runs, a sentence each."""
    if pole := sampled.unstable:
        if pole.is_growing:
            how = f' at {_hertz(pole.oscillation_hz)}' if pole.oscillation_hz else ''
            yield f'Unstable: pole {complex_text(pole.value)} grows{how}.'
        else:
            yield f'Not stable: what belongs to the pole {complex_text(pole.value)} never decays.'
    if pole := sampled.ringing:
        yield (
            f'Rings at {_hertz(pole.oscillation_hz)}: pole {complex_text(pole.value)}, '
            f'damping {_number(pole.damping)}.'
        )
    if margins := sampled.margins:
        yield from _limits(sampled, margins)
    if samples := sampled.samples:
        yield (
            f'Noise of one count of the gyro gives {_number(samples.gyro_noise)} % duty, of the '
            f'encoder {_number(samples.encoder_noise)} %; rounding to whole counts '
            f'{_number(samples.rounding_noise)} % (standard deviations).'
        )


def _limits(loop: LoopAnalysis, margins: Margins) -> Iterator[str]:
    for change, limit in _changes(loop, margins):
        yield f'{change}: oscillates at {_hertz(limit.hz)}.'


def _changes(loop: LoopAnalysis, margins: Margins) -> Iterator[tuple[str, Limit]]:
    """Yield the changes at which the loop oscillates."""
    motors, gyro, encoders = _dead_times(loop, margins)
    for change, limit in (
        ('{} times the gain', margins.gain_high),
        ('{} times the gain', margins.gain_low),
        ('{} ms more dead time of the motors', motors),
        ('{} ms more dead time of the gyro', gyro),
        ('{} ms more dead time of the encoders', encoders),
    ):
        if limit and not math.isnan(limit.hz):
            yield change.format(_number(limit.value)), limit


RINGS = 'rings'


class PredictedFrequency(NamedTuple):
    """A frequency [Hz] at which a loop oscillates, and the reason: its own, or after a change."""

    hz: float
    reason: str


def predictions(sampled: LoopAnalysis) -> list[PredictedFrequency]:
    """Return the frequencies to look for in a run of the loop."""
    found = []
    if (pole := sampled.unstable) and pole.oscillation_hz:
        found.append(PredictedFrequency(pole.oscillation_hz, 'grows'))
    if pole := sampled.ringing:
        found.append(PredictedFrequency(pole.oscillation_hz, RINGS))
    if margins := sampled.margins:
        found += [
            PredictedFrequency(limit.hz, change) for change, limit in _changes(sampled, margins)
        ]
    return found


def neglected(parameters: ParameterSet) -> list[str]:
    """Return what a run with these parameters has and the linear model does not."""
    plant, own = parameters.of(PlantParameters), parameters.of(ControllerParameters)
    jitters = (
        plant.actuator_delay_jitter,
        parameters.of(GyroParameters).delay_jitter,
        parameters.of(EncoderParameters).delay_jitter,
    )
    present = {
        'the dead zone': plant.dead_zone > 0.0,
        'the gear play': plant.backlash > 0.0,
        'pwm_offset': own.pwm_offset > 0.0,
        'the draining battery': plant.battery_model == 'draining',
        'the variation of the dead times (jitter), which count with their means': any(jitters),
    }
    return [name for name, is_present in present.items() if is_present]


def complex_text(value: complex) -> str:
    """Return a pole, or the pair that it belongs to, with 4 digits."""
    real = f'{value.real + 0.0:.4g}'.replace('-', '−')
    if abs(value.imag) < 1e-9:
        return real
    return f'{real} ± {abs(value.imag):.4g}j'


def single_poles(poles: tuple[Pole, ...]) -> list[Pole]:
    """Return the poles with one of each conjugate pair."""
    return [pole for pole in poles if pole.value.imag >= 0.0]


def _number(value: float) -> str:
    if math.isinf(value):
        return '∞'
    return f'{value:.3g}'


def _hertz(hz: float) -> str:
    return '' if math.isnan(hz) else f'{hz:.3g} Hz'


_PUSH_N = 1.0
_SPEED_SHOWN, _TENTHS_SHOWN = 1.0, 10.0
"""Largest speed [m/s], and pitch [deg] and tenths of the duty [%], of a loop that is not stable."""

_ENDLESS = 1e6
"""State from which on the response of an unstable loop is not followed."""

_STEP_S, _PUSH_S = 8.0, 2.0
"""Length of the responses to the stick and to a push [s]."""

_IDEAL, _SAMPLED = Line(ORANGE, 1.2, '--', IDEAL), Line(BLUE, label=AS_IT_RUNS)
_DECADES = (0.1, 1, 10, 100)
_CIRCLE = np.exp(2j * np.pi * np.linspace(0.0, 1.0, 200))


def loop_table(parameters: ParameterSet) -> Table:
    """Return the frequency responses of the ideal loop and of the one that runs, both opened.

    Raises
    ------
    DesignError
        If the controller is another than the document's program.
    """
    sampled = LoopResponse(SampledLoop(parameters).open_loop())
    ideal = ideal_loop(parameters)(1j * sampled.frequencies)
    table = {'frequency_hz': sampled.frequencies / (2.0 * np.pi)}
    for name, values in (('ideal', ideal), ('sampled', sampled.values)):
        table[f'{name}_gain'] = np.abs(values)
        table[f'{name}_phase_deg'] = np.degrees(np.unwrap(np.angle(values)))
    return table


CAPTION = (
    'The loop of one plane, opened at the duty (above) and closed (below). Left: gain and phase; '
    'dotted at the frequencies at which it would oscillate. Right: Nyquist diagram with the point '
    '−1 and, in gray, the disk margin; the poles from tick to tick. Below: ball speed after a full '
    'stick; pitch and duty after a push.'
)


def render_loop(parameters: ParameterSet, analysis: LoopAnalysis) -> RenderedFigure:
    """Return the picture of the loop and its numbers; raises as :func:`loop_table` does."""
    table = loop_table(parameters)
    png = png_of(_draw_loop(parameters, analysis, table))
    return RenderedFigure('loop', 'The loop as it runs', CAPTION, png, table)


def _draw_loop(parameters: ParameterSet, analysis: LoopAnalysis, table: Table) -> Figure:
    """Draw the loop with these parameters: its analysis as it runs, and its responses."""
    loop = SampledLoop(parameters)
    figure = new_figure(WIDTH, 9.0)
    (gain, diagram), (phase, plane), (step, push) = figure.subplots(3, 2)
    _draw_gain(gain, table)
    _draw_phase(phase, table)
    if analysis.margins:
        _mark_limits(gain, phase, analysis.margins)
    _draw_diagram(diagram, table, analysis)
    _draw_poles(plane, parameters, loop)
    _draw_step(step, parameters, loop)
    _draw_push(push, parameters, loop)
    if analysis.unstable:
        step.set_ylim(-_SPEED_SHOWN, _SPEED_SHOWN)
        push.set_ylim(-_TENTHS_SHOWN, _TENTHS_SHOWN)
    return figure


def _draw_gain(axes: Axes, table: Table) -> None:
    for name, line in (('ideal', _IDEAL), ('sampled', _SAMPLED)):
        draw_line(axes, table['frequency_hz'], table[f'{name}_gain'], line)
    axes.axhline(1.0, color=GRAY, linewidth=0.8)
    axes.set_yscale('log')
    axes.set_ylim(0.1, 10.0)
    axes.set_yticks(_DECADES[:3], map(str, _DECADES[:3]))
    frame_curves(axes, 'gain of the open loop')
    _scale_frequency(axes, table)
    legend_above(axes, 1)


def _draw_phase(axes: Axes, table: Table) -> None:
    for name, line in (('ideal', _IDEAL), ('sampled', _SAMPLED)):
        degrees = table[f'{name}_phase_deg']
        crossover = int(np.argmin(abs(table[f'{name}_gain'] - 1.0)))
        turns = math.floor(degrees[crossover] / 360.0) + 1
        draw_line(axes, table['frequency_hz'], degrees - 360.0 * turns, line)
    axes.axhline(-180.0, color=GRAY, linewidth=0.8)
    axes.set_ylim(-400.0, 60.0)
    axes.set_yticks(range(-360, 1, 90))
    frame_curves(axes, 'phase [°]')
    _scale_frequency(axes, table)


def _scale_frequency(axes: Axes, table: Table) -> None:
    axes.set_xscale('log')
    axes.set_xlim(0.05, table['frequency_hz'][-1])
    axes.set_xticks(_DECADES, map(str, _DECADES))
    axes.set_xlabel('frequency [Hz]')


def _mark_limits(gain: Axes, phase: Axes, margins: Margins) -> None:
    """Mark the frequencies at which the loop would oscillate, with the change that it takes."""
    for limit, change in (
        (margins.gain_low, '× {:.3g}'),
        (margins.gain_high, '× {:.3g}'),
        (margins.dead_time_ms, '+ {:.3g} ms'),
    ):
        if math.isfinite(limit.hz):
            for axes in (gain, phase):
                axes.axvline(limit.hz, color=GRAY, linewidth=0.8, linestyle=':')
            gain.annotate(
                change.format(limit.value), (limit.hz, 0.98), (-2, 0), color=GRAY, rotation=90,
                fontsize='small', xycoords=('data', 'axes fraction'), textcoords='offset points',
                ha='right', va='top',
            )  # fmt: skip


def _draw_diagram(axes: Axes, table: Table, analysis: LoopAnalysis) -> None:
    """Draw the Nyquist diagram, and the disk around -1 that a stable loop keeps away from."""
    if analysis.margins:
        half = analysis.margins.disk / 2.0
        near, far = (1.0 - half) / (1.0 + half), (1.0 + half) / max(1.0 - half, 1e-3)
        disk = -(near + far) / 2.0 + (far - near) / 2.0 * _CIRCLE
        axes.fill(disk.real, disk.imag, color=GRAY, alpha=0.3, linewidth=0.0)
    for name, line in (('ideal', _IDEAL), ('sampled', _SAMPLED)):
        angle = np.radians(table[f'{name}_phase_deg'])
        values = table[f'{name}_gain'] * np.exp(1j * angle)
        draw_line(axes, values.real, values.imag, line)
    axes.plot(-1.0, 0.0, '+', color='black', markersize=9.0)
    axes.plot(_CIRCLE.real, _CIRCLE.imag, color=GRAY, linewidth=0.8)
    axes.set_xlim(-2.5, 2.0)
    axes.set_ylim(-2.0, 2.5)
    axes.set_aspect('equal')
    axes.set_xlabel('real part of the open loop')
    axes.set_ylabel('imaginary part')
    style_axes(axes)


def _draw_poles(axes: Axes, parameters: ParameterSet, loop: SampledLoop) -> None:
    """Draw the poles of both closed loops in the z plane."""
    ideal = ideal_loop(parameters)
    s = np.linalg.eigvals(ideal.A - ideal.B @ ideal.C)
    poles = np.exp(s[s.real < 1.0 / TICK_S] * TICK_S)  # faster ones lie far outside the circle
    axes.plot(_CIRCLE.real, _CIRCLE.imag, color=GRAY, linewidth=0.8)
    axes.plot(poles.real, poles.imag, 'o', color=ORANGE, fillstyle='none', label=IDEAL)
    poles = loop.poles()
    axes.plot(poles.real, poles.imag, 'x', color=BLUE, label=AS_IT_RUNS)
    axes.set_aspect('equal')
    axes.set_xlabel('real part of the pole z')
    axes.set_ylabel('imaginary part')
    style_axes(axes)
    legend_above(axes, 1)


def _draw_step(axes: Axes, parameters: ParameterSet, loop: SampledLoop) -> None:
    """Draw the speed of the ball after the stick is pushed fully forward."""
    own, plant = parameters.of(ControllerParameters), parameters.of(PlantParameters)
    time, states, _ = _respond(loop, STICK, np.full(_ticks(_STEP_S), float(own.gp_max)))
    speed = states[:, loop.states.index('theta_dot')] * plant.ball_radius
    target = math.radians(own.k_thetadot) * plant.ball_radius
    axes.axhline(target, color=GRAY, linewidth=0.8)
    draw_line(axes, time, speed, _SAMPLED)
    frame_curves(axes, 'speed after a full stick [m/s]')
    label_time(axes)


def _draw_push(axes: Axes, parameters: ParameterSet, loop: SampledLoop) -> None:
    """Draw pitch and duty after a push."""
    length = parameters.of(PlantParameters).push_duration
    force = np.zeros(_ticks(_PUSH_S))
    force[: _ticks(length)] = _PUSH_N
    time, states, duty = _respond(loop, FORCE, force)
    draw_line(
        axes, time, np.degrees(states[:, loop.states.index('psi')]), Line(BLUE, label='pitch [°]')
    )
    draw_line(axes, time, duty / 10.0, Line(ORANGE, 0.9, label='duty [10 %]'))
    frame_curves(axes, f'after {_PUSH_N:g} N for {length:g} s')
    label_time(axes)
    legend_above(axes)


def _ticks(time: float) -> int:
    return max(round(time / TICK_S), 1)


def _respond(
    loop: SampledLoop, source: str, values: NDArray[np.float64]
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return time [s], states and duty [%] of the closed loop for an input in each tick."""
    a, b = loop.closed()
    column = INPUTS.index(source)
    states = np.zeros((len(values), len(loop.states)))
    for tick, value in enumerate(values[:-1]):
        states[tick + 1] = a @ states[tick] + b[:, column] * value
        if np.abs(states[tick + 1]).max() > _ENDLESS:
            states[tick + 1 :] = np.nan
            break
    duty = states @ loop.c + loop.d[column] * values
    return np.arange(len(values)) * TICK_S, states, duty
