"""Limits that linear theory predicts for pairs of varied parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from ballbot_ros.design.recoverable import recoverable_states
from ballbot_ros.design.sampled_loop import SampledLoop
from ballbot_ros.design.state_feedback import DesignError
from ballbot_ros.parameters import CONTROLLER, GYRO, PLANT, EncoderParameters, ParameterSet
from ballbot_ros.plant.model import PhysicalParameters
from ballbot_ros.studies.axes import Axis
from ballbot_ros.studies.columns import ColumnKind
from ballbot_ros.studies.contours import Lines, contour_lines
from ballbot_ros.studies.runs import with_values

Floats = NDArray[np.float64]
Field = Callable[[float, float], float]
"""Of the values of both variables; positive beyond the limit."""

COARSE, DOUBLINGS = 17, 3
"""Points of an axis at which a limit is sought, and how often the grid is refined near it."""

_PITCHES = {(f'{PLANT}.start_pitch_{plane}', f'{PLANT}.start_pitch_rate_{plane}') for plane in 'xy'}

LOOP_PARAMETERS = frozenset(
    [
        *(f'{PLANT}.{each.name}' for each in fields(PhysicalParameters)),
        *(
            f'{PLANT}.{name}'
            for name in (
                'battery_voltage', 'voltage_slope', 'voltage_offset', 'actuator_delay',
                'actuator_delay_jitter',
            )
        ),
        *(
            f'{node}.{name}'
            for node in (GYRO, EncoderParameters.node)
            for name in ('delay', 'delay_jitter')
        ),
        *(f'{CONTROLLER}.{name}' for name in ('pwm_gain', 'k_i', 'a_d', 'a_gd')),
        *(f'{CONTROLLER}.k_f.{number}' for number in (1, 2, 3, 4)),
    ]
)  # fmt: skip
"""Parameters whose effect on stability :class:`SampledLoop` knows."""


@dataclass(frozen=True)
class Prediction:
    """A predicted limit on a map.

    Attributes
    ----------
    label : str
        For the legend.
    sentence : str
        What it is, and what it assumes.
    lines : list of ndarray, shape (n, 2) each
        The limit, as values of both variables; empty if it is nowhere on the map.
    """

    label: str
    sentence: str
    lines: Lines


def predict(parameters: ParameterSet, x: Axis, y: Axis) -> Prediction | None:
    """Return the limit over two varied parameters, or None if theory knows none.

    Parameters
    ----------
    parameters : ParameterSet
        Those of the study, with a value for all that varies.
    x, y : Axis
        The axes of the map.
    """
    names = x.column.name, y.column.name
    if x.is_words or y.is_words:
        return None
    try:
        if names in _PITCHES or names[::-1] in _PITCHES:
            return _recoverable(parameters, x, y)
        if LOOP_PARAMETERS.issuperset(names):
            return _stable(parameters, x, y)
    except DesignError:
        pass
    return None


def _recoverable(parameters: ParameterSet, x_axis: Axis, y_axis: Axis) -> Prediction:
    limit = recoverable_states(parameters)
    turned = (x_axis.column.name, y_axis.column.name) not in _PITCHES
    x, y = (np.linspace(each.edges[0], each.edges[-1], COARSE) for each in (x_axis, y_axis))
    columns, rows = np.meshgrid(x, y)
    pitch, rate = (rows, columns) if turned else (columns, rows)
    zero = np.zeros_like(pitch)
    # The share has a kink at 0; its two sides are planes, of which a coarse grid is exact.
    signed = np.stack([zero, pitch, zero, rate], axis=-1) @ limit.direction
    lines = [*contour_lines(x, y, signed, 1.0), *contour_lines(x, y, signed, -1.0)]
    return Prediction(
        'limit of the motors',
        'The dashed line is the limit beyond which no controller can recover, since the motors at '
        'full voltage are too weak: by the linear model, with the ball at rest and the battery '
        "at its voltage at the start; it ignores the controller's own limits.",
        lines,
    )


def _stable(parameters: ParameterSet, x_axis: Axis, y_axis: Axis) -> Prediction:
    axes = x_axis, y_axis
    names = [each.column.name for each in axes]
    kinds = [each.column.kind is ColumnKind.INTEGER for each in axes]

    def growth(x: float, y: float) -> float:
        pair = zip(names, (x, y), kinds, strict=True)
        changed = {name: round(value) if whole else value for name, value, whole in pair}
        loop = SampledLoop(with_values(parameters, changed))
        return float(np.abs(loop.poles()).max()) - 1.0

    x, y, excess = refined(growth, [_start(each) for each in axes], kinds)
    lines = contour_lines(x, y, excess, 0.0, (x_axis.is_stepped, y_axis.is_stepped))
    sentence = (
        'The dashed line is where the sampled loop becomes unstable (largest pole of magnitude 1): '
        'by the linear model, without quantisation, saturation, dead zone and gear play.'
    )
    if not lines:
        verdict = 'stable' if (excess < 0.0).all() else 'unstable'
        sentence = (
            f'By the linear model of the sampled loop, without quantisation, saturation, dead zone '
            f'and gear play, the loop is {verdict} all over this map.'
        )
    return Prediction('predicted stability limit', sentence, lines)


def _start(axis: Axis) -> Floats:
    """Return the values of an axis from which a limit is sought."""
    if axis.column.kind is ColumnKind.INTEGER:
        return axis.span.astype(float)
    return np.linspace(axis.span[0], axis.span[-1], COARSE)


def refined(
    field: Field, axes: Sequence[Floats], fixed: Sequence[bool], doublings: int = DOUBLINGS
) -> tuple[Floats, Floats, Floats]:
    """Return values of a field on a grid that is fine enough for its zeros.

    The field is evaluated on a coarse grid, then at points between only where it changes its sign.
    The growth of a loop is that of its fastest pole, which changes abruptly from one to another: a
    coarse grid would have the limits in the wrong place.

    Parameters
    ----------
    field : callable
        Of both coordinates.
    axes : sequence of ndarray
        Ascending coordinates of the coarse grid, x and y.
    fixed : sequence of bool
        Whether no coordinates are added to an axis.

    Returns
    -------
    tuple of ndarray, shapes (n,), (m,) and (m, n)
        Coordinates x and y, and the values; far from zeros they are interpolated.
    """
    x, y = axes
    values = np.array([[field(a, b) for a in x.tolist()] for b in y.tolist()])
    exact = np.ones(values.shape, bool)
    for _ in range(doublings):
        finer_x, finer_y = (
            axis if is_fixed or len(axis) < 2 else _with_middles(axis)
            for axis, is_fixed in zip((x, y), fixed, strict=True)
        )
        wide = np.array([np.interp(finer_x, x, row) for row in values])
        finer = np.array([np.interp(finer_y, y, column) for column in wide.T]).T
        beyond = (finer > 0.0).astype(np.int8)
        near = maximum_filter(beyond, 3) != minimum_filter(beyond, 3)
        known = np.zeros(finer.shape, bool)
        known[np.ix_(np.isin(finer_y, y), np.isin(finer_x, x))] = exact
        for row, column in np.argwhere(near & ~known).tolist():
            finer[row, column] = field(float(finer_x[column]), float(finer_y[row]))
        x, y, values, exact = finer_x, finer_y, finer, known | near
    return x, y, values


def _with_middles(axis: Floats) -> Floats:
    result = np.empty(2 * len(axis) - 1)
    result[::2], result[1::2] = axis, (axis[1:] + axis[:-1]) / 2.0
    return result


def usual_values(columns: Mapping[str, NDArray[Any]]) -> dict[str, object]:
    """Return a value for each variable: the median of numbers, else the most frequent one."""
    values: dict[str, object] = {}
    for name, column in columns.items():
        if column.dtype.kind == 'f':
            values[name] = float(np.median(column))
        elif column.dtype.kind in 'iu':
            values[name] = int(np.quantile(column, 0.5, method='lower'))
        else:
            found, counts = np.unique(column, return_counts=True)
            values[name] = found[np.argmax(counts)].item()
    return values
