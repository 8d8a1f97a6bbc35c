"""The picture of an identification: values with their intervals, and correlations of errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ballbot_ros.analysis.drawing import style_axes
from ballbot_ros.analysis.figure_parts import BLUE, GRAY, ORANGE, WIDTH, new_figure, png_of
from ballbot_ros.analysis.identification.identification import (
    Identifiability,
    Identification,
    IdentifiedParameter,
)
from ballbot_ros.robot.arithmetic import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROW, _MIN_HEIGHT = 0.62, 2.6
"""Height of a parameter's row, and of the smallest picture [inch]."""

_MARGIN = 0.08
"""Space on both sides of the values, as a part of their range."""

_DARK = 0.6
"""Correlation from which its number is white."""


def render_identification(found: Identification) -> bytes:
    """Return a PNG: estimates next to start and recorded value, correlations of their errors.

    At least one parameter must have been estimated.
    """
    rows = found.estimated
    figure = new_figure(WIDTH, max(_MIN_HEIGHT, 0.8 + _ROW * len(rows)))
    ((left, right),) = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.0, 0.9))
    # Each has its own axis: one that changes by its whole value would hide the other intervals.
    values = left.subplots(len(rows), 1, squeeze=False)[:, 0]
    for axes, row in zip(values, rows, strict=True):
        _draw_value(axes, row)
    entries: dict[str, Any] = {}
    for axes in values:
        handles, labels = axes.get_legend_handles_labels()
        entries.update(zip(labels, handles, strict=True))
    left.legend(
        entries.values(), entries, loc='outside upper center', ncols=len(entries), frameon=False,
        fontsize='small', columnspacing=1.0, handletextpad=0.4,
    )  # fmt: skip
    _draw_correlations(right.subplots(), found.correlation, [row.name for row in rows])
    return png_of(figure)


def _draw_value(axes: Axes, row: IdentifiedParameter) -> None:
    assert row.value is not None
    half_width = row.half_width if math.isfinite(row.half_width) else 0.0
    shown = [row.start, row.value - half_width, row.value + half_width]
    axes.plot(row.start, 0.0, '|', color=GRAY, markersize=14.0, label='start')
    if row.recorded is not None:
        axes.plot(
            row.recorded, 0.0, 'o', color=ORANGE, fillstyle='none', markersize=9.0,
            label='recorded',
        )  # fmt: skip
        shown.append(row.recorded)
    axes.errorbar(
        row.value, 0.0, xerr=half_width, fmt='.', capsize=4.0,
        color=BLUE if row.verdict is Identifiability.IDENTIFIED else GRAY,
        label='95 % interval' if row.verdict is Identifiability.IDENTIFIED else 'uncertain',
    )  # fmt: skip
    margin = _MARGIN * (max(shown) - min(shown))
    axes.set_xlim(min(shown) - margin, max(shown) + margin)
    axes.locator_params(axis='x', nbins=4)
    axes.ticklabel_format(axis='x', useOffset=False)
    axes.set_yticks([0.0], [f'{row.name}\n[{row.unit}]'])
    axes.tick_params(axis='x', labelsize='small')
    style_axes(axes)


def _draw_correlations(axes: Axes, correlation: Floats, names: Sequence[str]) -> None:
    axes.imshow(correlation, cmap='RdBu_r', vmin=-1.0, vmax=1.0)
    for row, values in enumerate(correlation):
        for column, value in enumerate(values):
            axes.text(
                column, row, f'{value:.2f}'.replace('-', '−'), ha='center', va='center',
                fontsize='small', color='white' if abs(value) > _DARK else 'black',
            )  # fmt: skip
    axes.set_xticks(range(len(names)), names, rotation=45, ha='right', rotation_mode='anchor')
    axes.set_yticks(range(len(names)), names)
    axes.set_title('correlation of the errors', fontsize='medium')
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0.0)
