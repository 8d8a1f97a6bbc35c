"""The maps of docs/control.md: stability over gain and dead time, and the basin of attraction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click
import numpy as np

from ballbot_ros.analysis.style import png_of
from ballbot_ros.analysis.table import Table, csv_of
from ballbot_ros.design.recoverable import recoverable_states
from ballbot_ros.design.sampled_loop import require_documents_program
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import ParameterSet
from benchmark.basin import Estimate, Start, starts
from benchmark.map_figures import draw_basin, draw_stability
from benchmark.stability import (
    Cell,
    Grid,
    cells,
    distance,
    gain_limits,
    grid,
    intervals,
    is_tolerable,
    predicted_intervals,
)
from benchmark.tables import print_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BASIN_COARSE, BASIN_FINE = (13, 9), (49, 41)
"""Numbers of pitches and pitch rates of a basin."""

STABILITY_COARSE, STABILITY_FINE = (10, 4), (73, 1)
"""Number of gains, and step of the dead times [ms], of a map of stability."""

DISTANCES = (-0.2, -0.1, -0.05, 0.0, 0.02, 0.05, 0.1, 0.2, 0.4)
"""Distances from a limit between which limit cycles are compared."""


class MapOptions(NamedTuple):
    """How a map is made.

    Attributes
    ----------
    parameters : ParameterSet
        Those of the robot, with ideal devices.
    fine : bool
        Whether the map has many cells.
    output : Path or None
        Folder for the picture and the numbers.
    """

    parameters: ParameterSet
    fine: bool = False
    output: Path | None = None


def stability(options: MapOptions) -> None:
    """Compare predicted and measured stability over gain and dead time of the motors."""
    parameters = options.parameters
    require_documents_program(parameters)
    layout = grid(parameters, *(STABILITY_FINE if options.fine else STABILITY_COARSE))
    found = list(cells(parameters, layout))
    rows = [list(group) for _, group in groupby(found, lambda cell: cell.delay_ms)]
    head = (
        'dead time', 'stable gains, predicted', 'measured without rounding', 'cells that differ',
        'with rounding: duty RMS where stable', 'falls',
    )  # fmt: skip
    print_table(head, [_delay_row(parameters, layout, row) for row in rows])
    differing = [cell for cell in found if cell.predicted != cell.measured]
    beyond = [cell for cell in differing if not is_tolerable(parameters, cell)]
    click.echo(
        f'\n{len(differing)} of {len(found)} cells differ without rounding, {len(beyond)} of them '
        'by more than 5 % of the gain.\n'
    )
    near_head = (
        'gain, from the limit', 'lower limit: duty RMS', 'pitch', 'falls',
        'upper limit: duty RMS', 'pitch', 'falls',
    )  # fmt: skip
    print_table(near_head, _distance_rows(parameters, layout, rows))
    if options.output:
        figure = draw_stability(parameters, layout, found)
        _write(options.output, 'stability', figure, _table(found))


def basin(options: MapOptions) -> None:
    """Compare the starts from which the robot recovers with what saturation allows."""
    require_documents_program(options.parameters)
    limit = recoverable_states(options.parameters)
    size = BASIN_FINE if options.fine else BASIN_COARSE
    found = list(starts(options.parameters, limit, *size))
    possible = [start for start in found if start.share < 1.0]
    rows = []
    for estimate in Estimate:
        safe = [start.share for start in found if start.recovers(estimate)]
        lost = [start.share for start in found if not start.recovers(estimate)]
        inside = sum(start.recovers(estimate) for start in possible)
        rows.append((
            estimate.value, f'{inside} of {len(possible)} ({100.0 * inside / len(possible):.0f} %)',
            f'{100.0 * min(lost):.0f} %', f'{100.0 * max(safe, default=0.0):.0f} %',
        ))  # fmt: skip
    head = (
        'start', 'recovered, of those that the motors allow',
        'smallest share of their limit that falls', 'largest that recovers',
    )  # fmt: skip
    print_table(head, rows)
    pitch, _, rate = np.degrees(1.0 / limit.direction[1:])
    click.echo(f'\nThe motors allow {pitch:.1f} deg at rest, or {rate:.1f} deg/s upright.')
    if options.output:
        _write(options.output, 'basin', draw_basin(limit, found), _table(found))


def _delay_row(parameters: ParameterSet, layout: Grid, row: Sequence[Cell]) -> tuple[object, ...]:
    gains = layout.gains.tolist()
    delay = row[0].delay_ms
    predicted = predicted_intervals(parameters, delay, gains[0], gains[-1])
    measured = intervals(gains, [cell.measured for cell in row])
    return (
        f'{delay} ms', _interval_text(predicted, '.3f'), _interval_text(measured, '.4g'),
        sum(cell.predicted != cell.measured for cell in row),
        _range_text([cell.duty_rms for cell in row if cell.measured], '.1f', ' %'),
        sum(cell.fell for cell in row),
    )  # fmt: skip


def _distance_rows(
    parameters: ParameterSet, layout: Grid, rows: Iterable[Sequence[Cell]]
) -> Iterable[tuple[object, ...]]:
    placed = [
        (distance(cell, limits), cell)
        for row in rows
        if len(limits := gain_limits(parameters, row[0].delay_ms, *layout.gains[[0, -1]]))
        for cell in row
    ]
    for low, high in pairwise(DISTANCES):
        texts: list[object] = []
        for is_upper in (False, True):
            group = [
                cell
                for where, cell in placed
                if where.is_upper == is_upper and low <= where.inside < high
            ]
            texts += [
                _range_text([cell.duty_rms for cell in group], '.1f', ' %'),
                _range_text([cell.peak_pitch for cell in group], '.1f', '°'),
                f'{sum(cell.fell for cell in group)} of {len(group)}',
            ]
        place = 'beyond' if high <= 0.0 else 'within'
        near, far = sorted((abs(low), abs(high)))
        yield (f'{place}, {100.0 * near:g} to {100.0 * far:g} %', *texts)


def _interval_text(found: Iterable[tuple[float, float]], digits: str) -> str:
    return ', '.join(f'{low:{digits}} … {high:{digits}}' for low, high in found) or 'none'


def _range_text(values: Iterable[float], digits: str, unit: str) -> str:
    known = [value for value in values if value == value]
    return f'{min(known):{digits}} … {max(known):{digits}}{unit}' if known else '–'


def _table(rows: Sequence[Cell] | Sequence[Start]) -> Table:
    columns = zip(*rows, strict=True)
    return dict(zip(rows[0]._fields, (np.array(each, float) for each in columns), strict=True))


def _write(folder: Path, name: str, figure: Figure, table: Table) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f'{name}.png').write_bytes(png_of(figure))
        (folder / f'{name}.csv').write_bytes(csv_of(table))
    except OSError as error:
        raise BallbotError(f'--output {folder}: {error.strerror}') from None
