"""The pictures of the maps of docs/control.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.drawing import draw_line, legend_above, style_axes
from ballbot_ros.analysis.style import BLUE, GRAY, ORANGE, WIDTH, Line, new_figure
from ballbot_ros.design.recoverable import RecoverableStates
from ballbot_ros.parameters import ParameterSet
from benchmark.basin import PITCH_DEG, RATE_DEG_S, Estimate, Start
from benchmark.stability import Cell, Grid, gain_limits, growth

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINE_GAINS, LINE_STEP_MS = 200, 0.025
"""Points of the predicted line."""

_PALE_BLUE, _PALE_ORANGE, _PALE_GRAY = '#CCE3F0', '#F3C7AA', '#BBBBBB'
_LIMIT = Line('black', 1.6, label='predicted limit')
_LIMIT_OF_MOTORS = Line('black', 1.6, label='limit of the motors')
_DUTY_TICKS = (2, 5, 10, 20, 50, 100)


def draw_stability(parameters: ParameterSet, layout: Grid, found: Sequence[Cell]) -> Figure:
    """Draw the map without and with rounding, and a section along the gain."""
    figure = new_figure(WIDTH, 7.0)
    cells = figure.add_gridspec(2, 2, height_ratios=[4, 3])
    exact = figure.add_subplot(cells[0, 0])
    rounded = figure.add_subplot(cells[0, 1], sharex=exact, sharey=exact)
    _draw_verdicts(exact, layout, found)
    image = _draw_duty(rounded, layout, found)
    bar = figure.colorbar(image, ax=rounded, label='duty, RMS [%]')
    bar.set_ticks(_DUTY_TICKS, labels=list(map(str, _DUTY_TICKS)))
    bar.minorticks_off()
    for axes in (exact, rounded):
        _draw_prediction(axes, parameters, layout)
    exact.set_ylabel('dead time of the motors [ms]')
    _draw_section(figure.add_subplot(cells[1, :]), parameters, layout, found)
    areas = {'stable': _PALE_BLUE, 'unstable': _PALE_ORANGE, 'falls': _PALE_GRAY}
    _legend(figure, _LIMIT, areas)
    return figure


def _matrix(layout: Grid, values: Sequence[Any]) -> NDArray[Any]:
    return np.array(values).reshape(len(layout.delays_ms), len(layout.gains))


def _draw_verdicts(axes: Axes, layout: Grid, found: Sequence[Cell]) -> None:
    from matplotlib.colors import ListedColormap

    stable = _matrix(layout, [cell.measured for cell in found])
    colours = ListedColormap([_PALE_ORANGE, _PALE_BLUE])
    axes.pcolormesh(layout.gains, layout.delays_ms, stable, cmap=colours, vmin=0, vmax=1)
    axes.set_title('without rounding: verdict of the run')


def _draw_duty(axes: Axes, layout: Grid, found: Sequence[Cell]) -> Any:
    from matplotlib.colors import LogNorm

    duty = _matrix(layout, [cell.duty_rms for cell in found])
    axes.set_facecolor(_PALE_GRAY)
    norm = LogNorm(_DUTY_TICKS[0], _DUTY_TICKS[-1])
    image = axes.pcolormesh(
        layout.gains, layout.delays_ms, np.ma.masked_invalid(duty), cmap='cividis', norm=norm
    )
    axes.set_title('with the rounding of the NXT: duty')
    return image


def _draw_prediction(axes: Axes, parameters: ParameterSet, layout: Grid) -> None:
    gains = np.linspace(layout.gains[0], layout.gains[-1], LINE_GAINS)
    delays = np.arange(0.0, layout.delays_ms[-1] + LINE_STEP_MS / 2.0, LINE_STEP_MS)
    rates = np.array([growth(parameters, gains, delay) for delay in delays])
    axes.contour(gains, delays, rates, levels=[1.0], colors=_LIMIT.color, linewidths=_LIMIT.width)
    axes.set_xlabel('gain')


def _draw_section(
    axes: Axes, parameters: ParameterSet, layout: Grid, found: Sequence[Cell]
) -> None:
    duty = _matrix(layout, [cell.duty_rms for cell in found])
    middle = len(layout.delays_ms) // 2
    for index, line in ((0, Line(BLUE)), (middle, Line(ORANGE))):
        delay = int(layout.delays_ms[index])
        draw_line(axes, layout.gains, duty[index], Line(line.color, label=f'dead time {delay} ms'))
        for limit in gain_limits(parameters, delay, *layout.gains[[0, -1]]):
            axes.axvline(limit, color=line.color, linewidth=1.0, linestyle=':')
    axes.set_yscale('log')
    axes.set_yticks(_DUTY_TICKS, map(str, _DUTY_TICKS))
    axes.set_xlim(layout.gains[0], layout.gains[-1])
    axes.set_xlabel('gain')
    axes.set_ylabel('duty, RMS [%]')
    axes.plot([], [], color=GRAY, linewidth=1.0, linestyle=':', label=_LIMIT.label)
    style_axes(axes)
    legend_above(axes, 3)


def draw_basin(limit: RecoverableStates, found: Sequence[Start]) -> Figure:
    """Draw the starts that recover, and those that the motors allow."""
    figure = new_figure(WIDTH, 4.4)
    both = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, estimate in zip(both, Estimate, strict=True):
        _draw_starts(axes, found, [start.recovers(estimate) for start in found])
        _draw_limit(axes, limit)
        axes.set_title(estimate.value)
        axes.set_xlabel('pitch [°]')
    both[0].set_ylabel('pitch rate [°/s]')
    _legend(figure, _LIMIT_OF_MOTORS, {'recovers': _PALE_BLUE, 'falls': _PALE_GRAY})
    return figure


def _draw_starts(axes: Axes, found: Sequence[Start], recovered: Sequence[bool]) -> None:
    from matplotlib.colors import ListedColormap

    pitches = np.unique([start.pitch_deg for start in found])
    rates = np.unique([start.rate_deg_s for start in found])
    matrix = np.array(recovered).reshape(len(rates), len(pitches))
    axes.pcolormesh(pitches, rates, matrix, cmap=ListedColormap([_PALE_GRAY, _PALE_BLUE]))


def _draw_limit(axes: Axes, limit: RecoverableStates) -> None:
    rate = np.array([-RATE_DEG_S, RATE_DEG_S])
    _, psi, _, psi_rate = limit.direction
    for sign in (-1.0, 1.0):
        draw_line(axes, (sign * np.degrees(1.0) - psi_rate * rate) / psi, rate, _LIMIT_OF_MOTORS)
    axes.set_xlim(-PITCH_DEG, PITCH_DEG)
    style_axes(axes)


def _legend(figure: Figure, line: Line, areas: Mapping[str, str]) -> None:
    """Put a legend above all axes: a line, and areas with their colours."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Line2D([], [], color=line.color, linewidth=line.width, label=line.label),
        *(Patch(color=color, label=label) for label, color in areas.items()),
    ]
    figure.legend(handles=handles, loc='outside upper center', ncols=4, frameon=False)
