"""Charts: what the page is told is what the picture shows."""

import json
from itertools import pairwise

import numpy as np
import pytest

from ballbot_ros.analysis.chart import (
    Bars,
    Chart,
    ChartFigure,
    Contour,
    ErrorBars,
    HeatMap,
    Scale,
    VerticalLine,
)
from ballbot_ros.analysis.figure_parts import BLUE, ORANGE, Line, png_of

NUMBERS = Scale('gain', 0.5, 2.5)
LOG = Scale('mass [kg]', 0.1, 10.0, is_log=True)
WORDS = Scale('model', -0.5, 1.5, words=('linear', 'nonlinear'))
SHARE = Scale('passed [%]', -2.0, 102.0)


def described(*charts):
    """Return the figure of the page, after it was drawn and was JSON."""
    figure = ChartFigure(charts, 4.0, 3.0)
    assert png_of(figure.draw()).startswith(b'\x89PNG')
    return json.loads(json.dumps(figure.description(), allow_nan=False))


def cells(x=(0.5, 1.5, 2.5), y=(0.1, 1.0, 10.0), **options):
    values = np.array([[100.0, np.nan], [0.0, 33.3333333]])
    return HeatMap(np.array(x), np.array(y), values, 'passed [%]', '%', 100.0, 'cividis', **options)


def test_cells_keep_their_edges_and_numbers():
    found = described(Chart(NUMBERS, LOG, [cells(runs=np.array([[2, 0], [4, 3]]))]))
    (trace,) = found['data']
    assert (trace['x'], trace['y']) == ([0.5, 1.5, 2.5], [0.1, 1.0, 10.0])
    assert trace['z'] == [[100.0, None], [0.0, 33.3333333]]
    assert trace['customdata'] == [[2, 0], [4, 3]]
    assert found['layout']['xaxis']['range'] == [0.5, 2.5]
    assert found['layout']['yaxis']['type'] == 'log'
    assert found['layout']['yaxis']['range'] == [-1.0, 1.0]


def test_cells_between_words_have_them_as_names():
    grid = cells((-0.5, 0.5, 1.5), (-0.5, 0.5, 1.5), with_numbers=True)
    downward = Scale('', 1.5, -0.5, words=('a', 'b'))
    found = described(Chart(WORDS, downward, [grid]), Chart(WORDS, downward, [grid], 'second'))
    assert [each['x'] for each in found['data']] == [['linear', 'nonlinear']] * 2
    assert [each['xaxis'] for each in found['data']] == ['x', 'x2']
    assert [each.get('showscale', True) for each in found['data']] == [True, False]
    assert found['data'][0]['text'] == [['100.00', '–'], ['.00', '33.33']]
    assert found['layout']['yaxis']['range'] == [1.5, -0.5]
    assert [each['text'] for each in found['layout']['annotations']] == ['second']


def test_bars_stand_on_those_before_with_marks_and_what_is_beyond():
    edges = np.array([0.5, 1.0, 2.5])
    layers = [
        Bars(edges, np.array([3, 1]), BLUE, 'passed'),
        Bars(edges, np.array([0, 2]), ORANGE, 'not passed'),
        VerticalLine(1.2, Line(BLUE, 1.6, ':')),
    ]
    found = described(Chart(NUMBERS, Scale('runs', 0.0, 4.0), layers, beyond=(0, 1200)))
    assert found['layout']['barmode'] == 'stack'
    assert [each['y'] for each in found['data']] == [[3, 1], [0, 2]]
    assert found['data'][0]['customdata'] == [[0.5, 1.0], [1.0, 2.5]]
    (mark,) = found['layout']['shapes']
    assert (mark['x0'], mark['line']['dash']) == (1.2, 'dot')
    assert [each['text'] for each in found['layout']['annotations']] == ['1,200 →']


def test_large_numbers_and_short_axes_keep_their_digits():
    edges = np.linspace(1234567.0, 1234567.3, 4)
    bars = Bars(edges, np.array([1234567, 0, 1]), BLUE, 'passed')
    (trace,) = described(Chart(Scale('', edges[0], edges[-1]), Scale('', 0.0, 2e6), [bars]))['data']
    assert trace['y'] == [1234567, 0, 1]
    assert trace['customdata'] == [list(each) for each in pairwise(edges.tolist())]
    assert '%{customdata[0]:.4~f}' in trace['hovertemplate']


def test_the_page_shows_words_as_they_are():
    words = ('<b>bold</b>', '$x$ & y')
    scale = Scale('<i>z</i>', -0.5, 1.5, words=words)
    y = np.array([1.0, 2.0])
    found = described(
        Chart(scale, SHARE, [ErrorBars(np.array([0.0, 1.0]), y, y, y, '%', False)], '<')
    )
    escaped = ['&lt;b&gt;bold&lt;/b&gt;', '$x$ &amp; y']
    assert found['data'][0]['x'] == found['layout']['xaxis']['categoryarray'] == escaped
    assert found['layout']['xaxis']['title']['text'] == '&lt;i&gt;z&lt;/i&gt;'
    assert found['layout']['annotations'][0]['text'] == '&lt;'


def test_marks_and_arrows_belong_to_their_chart():
    empty = Chart(NUMBERS, SHARE, [])
    marked = Chart(NUMBERS, SHARE, [VerticalLine(1.0, Line(BLUE))], beyond=(7, 0))
    layout = described(empty, marked)['layout']
    assert [each['xref'] for each in layout['shapes']] == ['x2']
    (arrow,) = layout['annotations']
    assert (arrow['text'], arrow['x']) == ('← 7', layout['xaxis2']['domain'][0])


@pytest.mark.parametrize('joined', [False, True])
def test_points_have_their_intervals(joined):
    y = np.array([50.0, np.nan])
    points = ErrorBars(np.array([0.0, 1.0]), y, y - 10.0, y + 5.0, '%', joined)
    *band, points = described(Chart(WORDS, SHARE, [points]))['data']
    assert points['x'] == ['linear', 'nonlinear']
    assert points['y'] == [50.0, None]
    assert points['customdata'] == [[40.0, 55.0], [None, None]]
    if joined:
        assert [each['y'][0] for each in band] == [40.0, 55.0]
    else:
        assert points['error_y']['arrayminus'] == [10.0, None]
        assert points['error_y']['array'] == [5.0, None]


def test_lines_of_one_name_have_one_entry_in_the_legend():
    white, limit = Line('white', 1.4, label='50 % pass'), Line(ORANGE, 1.8, '--', 'limit')
    points = np.array([[0.5, 0.1], [2.5, 10.0]])
    layers = [Contour(points, white, 'black'), Contour(points, white, 'black'),
              Contour(points, limit, 'white')]  # fmt: skip
    figure = ChartFigure([Chart(NUMBERS, LOG, layers)], 4.0, 3.0)
    (legend,) = figure.draw().legends
    assert [each.get_text() for each in legend.get_texts()] == ['50 % pass', 'limit']
    named = [each for each in figure.description()['data'] if each['showlegend']]
    assert [each['name'] for each in named] == ['50 % pass', 'limit']
    assert named[0]['line']['color'] != 'white'
