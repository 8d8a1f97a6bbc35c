"""Maps have the counts of the rows, and their boundary is where half of the runs pass."""

import numpy as np
import pytest

from ballbot_ros.analysis.figure_parts import png_of
from ballbot_ros.lab.studies.charts import MOST_BINS, ShareChart, histogram_edges
from ballbot_ros.lab.studies.columns import ColumnKind, MeasureColumn, ResultColumn
from ballbot_ros.lab.studies.maps import PassMap, contour_lines, map_bins
from ballbot_ros.lab.studies.survey import Axis, CellCounts, Extent


def axis(values, kind=ColumnKind.FLOAT, bins=20, **options):
    extent = Extent()
    for part in np.array_split(np.asarray(values), 3):
        extent.add(part)
    return Axis.of(ResultColumn('x', kind, 'kg'), extent, len(values), bins, **options)


def counted(x, y, xs, ys, passed):
    places = y.places(ys) * x.cells + x.places(xs)
    shape = (y.cells, x.cells)
    runs, good = (
        np.bincount(each, minlength=x.cells * y.cells) for each in (places, places[passed])
    )
    return CellCounts(runs.reshape(shape), good.reshape(shape))


def test_the_boundary_of_a_step_over_levels_is_between_them():
    levels = np.linspace(0.0, 1.0, 21)
    xs, ys = (each.ravel() for each in np.meshgrid(levels, levels))
    x, y = axis(xs, is_grid=True), axis(ys, is_grid=True)
    shown = PassMap(x, y, counted(x, y, xs, ys, xs < 0.42))
    (line,) = shown.boundary
    np.testing.assert_allclose(line[:, 0], 0.425)
    assert (line[:, 1].min(), line[:, 1].max()) == (0.0, 1.0)
    assert '1 run in each cell' in shown.caption()
    table = shown.table()
    assert list(table)[-4:] == ['runs', 'passed', 'share_passed', 'smoothed_share']
    never = PassMap(x, y, counted(x, y, xs, ys, xs < -1))
    assert never.boundary == []
    assert 'There is no boundary' in never.caption()


def test_the_boundary_of_random_samples_is_that_of_a_step():
    random = np.random.default_rng(1)
    xs, ys = random.random((2, 20_000))
    x, y = (axis(each, bins=map_bins(20_000)) for each in (xs, ys))
    noise = random.normal(0.0, 0.05, 20_000)
    shown = PassMap(x, y, counted(x, y, xs, ys, xs + 0.5 * ys + noise < 0.8))
    points = np.concatenate(shown.boundary)
    assert len(points) > 20
    np.testing.assert_allclose(points[:, 0] + 0.5 * points[:, 1], 0.8, atol=0.04)


def test_cells_without_runs_are_blank():
    random = np.random.default_rng(1)
    xs, ys = random.random((2, 4000))
    corner = (xs > 0.49) & (ys > 0.49)
    xs, ys = xs[~corner], ys[~corner]
    x, y = axis(xs, bins=10), axis(ys, bins=10)
    shown = PassMap(x, y, counted(x, y, xs, ys, xs < 0.7))
    assert np.isnan(shown.counts.share).sum() == 25
    assert np.isnan(shown.smoothed[-1, -1])
    assert '25 of 100 cells are blank' in shown.caption()
    # No boundary is drawn where there is nothing to separate.
    assert np.concatenate(shown.boundary)[:, 1].max() < 0.8


def test_between_whole_numbers_lines_run_in_the_middle():
    values = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    (line,) = contour_lines(np.arange(3.0), np.arange(3.0), values, 0.9, (True, True))
    corners = {(round(a, 3), round(b, 3)) for a, b in line.tolist()}
    assert corners >= {(1.5, -0.5), (1.5, 1.5), (0.5, 1.5), (0.5, 2.5)}


@pytest.mark.parametrize(
    ('values', 'kind', 'options', 'cells', 'is_level'),
    [
        (np.linspace(0, 1, 101).repeat(50), ColumnKind.FLOAT, {'is_grid': True}, 101, True),
        (np.linspace(0, 1, 5000), ColumnKind.FLOAT, {}, 20, False),
        (np.linspace(0, 1, 5), ColumnKind.FLOAT, {}, 20, False),
        (np.arange(900) % 9, ColumnKind.INTEGER, {}, 9, True),
        (np.arange(1000), ColumnKind.INTEGER, {}, 20, False),
        (np.array(['b', 'a', 'b']), ColumnKind.TEXT, {}, 2, True),
        (np.array([f'word {n:03}' for n in range(400)]), ColumnKind.TEXT, {}, 400, True),
        (np.array([1.5, 1.5]), ColumnKind.FLOAT, {}, 1, True),
        (np.array([1.5]), ColumnKind.FLOAT, {}, 1, False),
        (np.array([0.1, 0.1]), ColumnKind.FLOAT, {'is_log': True}, 1, True),
        (np.geomspace(1e-5, 1e-1, 5000), ColumnKind.FLOAT, {'is_log': True}, 20, False),
    ],
)
def test_axes(values, kind, options, cells, is_level):
    found = axis(values, kind, **options)
    assert (found.cells, found.levels is not None) == (cells, is_level)
    assert len(found.middles) == len(found.shown) == cells
    places = found.places(values)
    assert set(places) <= set(range(cells))
    if found.is_words:
        assert found.shown[places].tolist() == values.tolist()
    else:
        assert found.edges[0] > 0.0 or not found.is_log
        low, high = found.edges[places], found.edges[places + 1]
        assert ((low <= values) & (values <= high)).all()
    if len(values) > cells > 2:
        assert np.bincount(places, minlength=cells).max() <= 2.1 * len(values) / cells


def test_the_shares_of_a_variable_have_wilsons_intervals():
    chart = ShareChart(axis(np.arange(30) % 3, ColumnKind.INTEGER), CellCounts(
        np.array([10, 0, 10]), np.array([10, 0, 5]))
    )  # fmt: skip
    table = chart.table()
    assert table['share_passed'].tolist()[::2] == [1.0, 0.5]
    np.testing.assert_allclose(table['low_95'], [0.7225, np.nan, 0.2366], atol=1e-4)
    np.testing.assert_allclose(table['high_95'], [1.0, np.nan, 0.7634], atol=1e-4)
    assert png_of(chart.figure().draw()).startswith(b'\x89PNG')


def test_many_levels_and_words_can_be_drawn():
    many = axis(np.linspace(0, 1, 60).repeat(3), is_grid=True)
    words = axis(np.array(['a long word for an axis', 'another long word of it', 'c'] * 5),
                 ColumnKind.TEXT)  # fmt: skip
    assert many.cells > MOST_BINS
    for each in (many, words):
        counts = CellCounts(np.full(each.cells, 3), np.full(each.cells, 1))
        assert png_of(ShareChart(each, counts).figure().draw()).startswith(b'\x89PNG')
    counts = CellCounts(np.full((3, 60), 2), np.full((3, 60), 1))
    both = PassMap(many, words, counts)
    assert both.boundary == []
    assert png_of(both.figure().draw()).startswith(b'\x89PNG')


def test_a_histogram_shows_the_core_and_near_bounds():
    values = np.concatenate([np.random.default_rng(1).normal(5.0, 1.0, 990), np.full(10, 600.0)])
    extent = Extent()
    extent.add(values)
    edges = histogram_edges(MeasureColumn('m', maximum=9.0), extent, values)
    assert edges[-1] > 9.0
    assert edges[-1] < 12.0
    far = histogram_edges(MeasureColumn('m', maximum=90.0), extent, values)
    assert far[-1] < 12.0
    empty = histogram_edges(MeasureColumn('m'), Extent(), np.array([np.nan]))
    assert (np.diff(empty) > 0).all()
