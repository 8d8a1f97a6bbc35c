"""The picture of a loop: Bode and Nyquist diagram, poles, step of the reference, a push."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis import drawing
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
from ballbot_ros.analysis.loop_summary import AS_IT_RUNS, IDEAL
from ballbot_ros.analysis.run_figures import RenderedFigure
from ballbot_ros.controllers.design.linear_model import ideal_loop
from ballbot_ros.controllers.design.loop_analysis import LoopAnalysis, LoopResponse, Margins
from ballbot_ros.controllers.design.sampled_loop import FORCE, INPUTS, STICK, SampledLoop
from ballbot_ros.parameters import ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.arithmetic import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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

    It raises DesignError if the controller is another than the document's program.
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
    png = png_of(draw_loop(parameters, analysis, table))
    return RenderedFigure('loop', 'The loop as it runs', CAPTION, png, table)


def draw_loop(parameters: ParameterSet, analysis: LoopAnalysis, table: Table) -> Figure:
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
        drawing.draw_line(axes, table['frequency_hz'], table[f'{name}_gain'], line)
    axes.axhline(1.0, color=GRAY, linewidth=0.8)
    axes.set_yscale('log')
    axes.set_ylim(0.1, 10.0)
    axes.set_yticks(_DECADES[:3], map(str, _DECADES[:3]))
    drawing.frame_curves(axes, 'gain of the open loop')
    _scale_frequency(axes, table)
    drawing.legend_above(axes, 1)


def _draw_phase(axes: Axes, table: Table) -> None:
    for name, line in (('ideal', _IDEAL), ('sampled', _SAMPLED)):
        degrees = table[f'{name}_phase_deg']
        crossover = int(np.argmin(abs(table[f'{name}_gain'] - 1.0)))
        turns = math.floor(degrees[crossover] / 360.0) + 1
        drawing.draw_line(axes, table['frequency_hz'], degrees - 360.0 * turns, line)
    axes.axhline(-180.0, color=GRAY, linewidth=0.8)
    axes.set_ylim(-400.0, 60.0)
    axes.set_yticks(range(-360, 1, 90))
    drawing.frame_curves(axes, 'phase [°]')
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
        drawing.draw_line(axes, values.real, values.imag, line)
    axes.plot(-1.0, 0.0, '+', color='black', markersize=9.0)
    axes.plot(_CIRCLE.real, _CIRCLE.imag, color=GRAY, linewidth=0.8)
    axes.set_xlim(-2.5, 2.0)
    axes.set_ylim(-2.0, 2.5)
    axes.set_aspect('equal')
    axes.set_xlabel('real part of the open loop')
    axes.set_ylabel('imaginary part')
    drawing.style_axes(axes)


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
    drawing.style_axes(axes)
    drawing.legend_above(axes, 1)


def _draw_step(axes: Axes, parameters: ParameterSet, loop: SampledLoop) -> None:
    """Draw the speed of the ball after the stick is pushed fully forward."""
    own, plant = parameters.of(ControllerParameters), parameters.of(PlantParameters)
    time, states, _ = _respond(loop, STICK, np.full(_ticks(_STEP_S), float(own.gp_max)))
    speed = states[:, loop.states.index('theta_dot')] * plant.ball_radius
    target = math.radians(own.k_thetadot) * plant.ball_radius
    axes.axhline(target, color=GRAY, linewidth=0.8)
    drawing.draw_line(axes, time, speed, _SAMPLED)
    drawing.frame_curves(axes, 'speed after a full stick [m/s]')
    drawing.label_time(axes)


def _draw_push(axes: Axes, parameters: ParameterSet, loop: SampledLoop) -> None:
    """Draw pitch and duty after a push."""
    length = parameters.of(PlantParameters).push_duration
    force = np.zeros(_ticks(_PUSH_S))
    force[: _ticks(length)] = _PUSH_N
    time, states, duty = _respond(loop, FORCE, force)
    drawing.draw_line(
        axes, time, np.degrees(states[:, loop.states.index('psi')]), Line(BLUE, label='pitch [°]')
    )
    drawing.draw_line(axes, time, duty / 10.0, Line(ORANGE, 0.9, label='duty [10 %]'))
    drawing.frame_curves(axes, f'after {_PUSH_N:g} N for {length:g} s')
    drawing.label_time(axes)
    drawing.legend_above(axes)


def _ticks(time: float) -> int:
    return max(round(time / TICK_S), 1)


def _respond(
    loop: SampledLoop, source: str, values: NDArray[np.float64]
) -> tuple[NDArray[Any], Floats, Floats]:
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
