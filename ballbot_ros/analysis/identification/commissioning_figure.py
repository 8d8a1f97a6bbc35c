"""The picture of a commissioning: what the logs have, and what was fitted to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ballbot_ros.analysis.drawing import draw_line, legend_above, style_axes
from ballbot_ros.analysis.figure_parts import BLUE, GRAY, ORANGE, WIDTH, Line, new_figure, png_of
from ballbot_ros.analysis.identification.commissioning import Commissioning

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = BLUE, ORANGE
_SIZES = 5.0, 2.5
"""Of the points of both devices: those behind are larger, so that they can be seen."""

_HEIGHT = 3.2


def render_commissioning(found: Commissioning) -> bytes:
    """Return a PNG with a panel for each phase that told something."""
    panels: list[Callable[[Axes, Commissioning], None]] = []
    if all(found.rests.values()):
        panels.append(_draw_rests)
    if found.ramps:
        panels += [_draw_ramps, _draw_voltages]
    if found.plays:
        panels.append(_draw_plays)
    rows = -(-len(panels) // 2)
    figure = new_figure(WIDTH if len(panels) == 1 else 1.3 * WIDTH, _HEIGHT * rows)
    axes = figure.subplots(rows, min(2, len(panels)), squeeze=False).ravel()
    for each, draw in zip(axes, panels, strict=False):
        draw(each, found)
        style_axes(each)
        legend_above(each)
    for each in axes[len(panels) :]:
        each.remove()
    return png_of(figure)


def _draw_rests(axes: Axes, found: Commissioning) -> None:
    """Draw how far the gyros drift from their offsets."""
    for color, size, (name, rests) in zip(_COLOURS, _SIZES, found.rests.items(), strict=True):
        for number, rest in enumerate(rests):
            offset = rest.offset.value
            label = '' if number else name
            draw_line(axes, rest.time, rest.means - offset, Line(color, size, '.', label))
            draw_line(axes, rest.time, rest.drift_curve - offset, Line(color, 1.0))
    _label(axes, 'time at rest [s]', 'reading − offset [°/s]')


def _draw_ramps(axes: Axes, found: Commissioning) -> None:
    """Draw the speed over the duty, and the fit at the mean voltage of each log."""
    for color, size, (name, ramp) in zip(_COLOURS, _SIZES, found.ramps.items(), strict=False):
        draw_line(axes, ramp.duty, ramp.speed, Line(color, size, '.', name))
    for ramp in found.ramps.values():
        duty = np.linspace(-100.0, 100.0, 401)
        for number in np.unique(ramp.log):
            battery = float(ramp.battery[ramp.log == number].mean())
            draw_line(axes, duty, ramp.speed_at(duty, battery), Line(GRAY, 0.8))
    _label(axes, 'duty [%]', 'speed [rad/s]')


def _draw_voltages(axes: Axes, found: Commissioning) -> None:
    """Draw the speed at full duty over the voltage of the battery, as in figure 6-4."""
    for color, size, (name, ramp) in zip(_COLOURS, _SIZES, found.ramps.items(), strict=False):
        is_fast = np.abs(ramp.duty) > 50.0  # where a rounded angle matters little
        full = ramp.speed * ramp.speed_at(np.full_like(ramp.duty, 100.0), ramp.battery)
        full /= np.where(is_fast, ramp.speed_at(ramp.duty, ramp.battery), 1.0)
        draw_line(axes, ramp.battery[is_fast], full[is_fast], Line(color, size, '.', name))
        ends = np.array([ramp.battery.min() - 0.1, ramp.battery.max() + 0.1])
        draw_line(axes, ends, ramp.speed_at(np.full(2, 100.0), ends), Line(color, 1.0))
    _label(axes, 'battery [V]', 'speed at a duty of 100 % [rad/s]')


def _draw_plays(axes: Axes, found: Commissioning) -> None:
    """Draw what the first pulse after each reversal turned a motor less than the second."""
    for color, size, (name, turns) in zip(_COLOURS, _SIZES, found.plays.items(), strict=False):
        numbers = np.arange(1.0, len(turns) + 1.0)
        draw_line(axes, numbers, turns, Line(color, 1.5 * size, '.', name))
    (play,) = (each.estimate for each in found.parameters if each.name == 'backlash')
    low, high = (math.degrees(play.value + side * play.half_width) for side in (-1.0, 1.0))
    axes.axhspan(low, high, color=GRAY, alpha=0.3, linewidth=0.0, label='gear play')
    _label(axes, 'reversal', 'turned less by [°]')


def _label(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
