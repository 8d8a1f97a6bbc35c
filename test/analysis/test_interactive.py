"""The interactive figures of a report: one time axis, without a network, on any screen."""

import io
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from browsing import open_document, shared_browser
from packed_columns import unpacked
from PIL import Image

from ballbot_ros.analysis.figure_parts import BLUE, DARKER, PLANES, Interval, IntervalKind, Line
from ballbot_ros.analysis.interactive import (
    MAX_ROWS,
    Events,
    PackedNumbers,
    history_figure,
    lanes_of,
    merged_rows,
    track_figure,
)
from ballbot_ros.analysis.recorded_scenario import RecordedPush
from ballbot_ros.analysis.report import report_document
from ballbot_ros.analysis.run_figures import figure_contents, track_marks

PUSH = RecordedPush(1.5, 1.7, (0.0, 2.0), (0.0, 0.0), is_external=True)
ROWS = 9
"""Rows of curves of a run with all topics."""

HIT = Interval(2.0, 2.1, 'wall hit', IntervalKind.WALL_HIT)


@pytest.fixture(scope='module')
def eventful(driven_assessment):
    """A run with a push and a wall hit."""
    return replace(driven_assessment.run, pushes=(PUSH,), wall_hits=(HIT,))


@pytest.fixture(scope='module')
def numbers():
    return PackedNumbers()


@pytest.fixture(scope='module')
def history(eventful, numbers):
    return history_of(eventful, figure_contents(eventful), numbers)


def history_of(run, contents, numbers):
    events = Events(run.end, lanes_of(run), run.marked)
    return history_figure(merged_rows(contents), events, numbers)


def curves(figure):
    return [each for each in figure['data'] if 'packed' in each]


def test_a_run_of_which_only_the_track_is_known_has_a_page():
    assert history_figure([], Events(0.0), PackedNumbers())['data'] == []


def test_all_curves_share_one_time_axis(history):
    assert 'xaxis' in history['layout']
    assert not any(key.startswith('xaxis') and key != 'xaxis' for key in history['layout'])
    assert not any('xaxis' in each for each in history['data'])
    used = {each['yaxis'] for each in curves(history)}
    assert len(used) == ROWS
    assert used <= {f'y{key[5:]}' for key in history['layout'] if key.startswith('yaxis')}


def test_rows_do_not_overlap(history):
    axes = [each for key, each in history['layout'].items() if key.startswith('yaxis')]
    domains = sorted(each['domain'] for each in axes)
    assert domains[0][0] >= 0.0
    assert domains[-1][1] <= 1.0
    for (_, top), (bottom, _) in pairwise(domains):
        assert top < bottom


def test_a_curve_that_several_pictures_show_is_there_once(history):
    labels = [each['hovertemplate'] for each in curves(history)]
    assert len(labels) == len(set(labels))
    assert 'position x: %{y:.2~f} cm<extra></extra>' in labels
    assert 'position x reference: %{y:.2~f} cm<extra></extra>' in labels
    assert 'sticks y: %{y:.2~f} %<extra></extra>' in labels


def test_the_planes_have_their_colours_everywhere(history):
    for each in curves(history):
        words = each['hovertemplate'].partition(':')[0].split()
        for plane, line in zip('xy', PLANES, strict=True):
            if plane in words:
                assert each['line']['color'] in (line.color, DARKER[line.color])


def test_the_legend_names_each_kind_of_curve_once_in_one_order(history):
    named = sorted(
        (each['legendrank'], each['name']) for each in curves(history) if each['showlegend']
    )
    assert [name for _, name in named] == [
        'plane x', 'plane y', 'commanded', 'reference', 'estimated', 'reading − offset',
    ]  # fmt: skip


def test_pushes_and_wall_hits_are_shaded_and_described(history):
    shaded = {
        (each['x0'], each['x1']) for each in history['layout']['shapes'] if 'fillcolor' in each
    }
    assert {(PUSH.start, PUSH.end), (HIT.start, HIT.end)} <= shaded
    (lanes,) = (each['intervals'] for each in history['data'] if 'intervals' in each)
    words = {text for *_, text in lanes}
    assert {'outside push: 2 N right', 'wall hit', 'calibration'} <= words


def test_the_track_has_the_map_its_ends_pushes_and_hits(eventful, numbers):
    contents = {each.figure.name: each.table for each in figure_contents(eventful)}
    marks = track_marks(eventful)
    figure = track_figure([(contents['track'], Line(BLUE))], eventful.floor, marks, numbers)
    named = {each['name']: each for each in figure['data'] if 'name' in each}
    assert named.keys() == {'track', 'start', 'end', 'push', 'wall hit', 'ball'}
    track = named['track']['packed']
    x, time = (unpacked(numbers, track[name]) for name in ('x', 'customdata'))
    at_push = np.interp(PUSH.start, time, x)
    assert named['push']['x'] == [pytest.approx(at_push, abs=0.1)]


def test_a_long_run_keeps_its_peaks_in_few_rows(driven_assessment, numbers):
    run = driven_assessment.run
    contents = figure_contents(run)
    long = np.zeros(20_000)
    long[7_001] = 42.0
    table = {'time_s': np.arange(20_000) * 0.004, 'duty_x_percent': long, 'duty_y_percent': -long}
    duty = next(each for each in contents if each.figure.name == 'duty')
    figure = history_of(run, [duty._replace(table=table)], numbers)
    x, y = (unpacked(numbers, each['packed']['y']) for each in curves(figure))
    assert len(x) <= MAX_ROWS
    assert x.max() == 42.0
    assert y.min() == -42.0


@pytest.fixture(scope='module')
def document(eventful, driven_assessment, tmp_path_factory):
    path = tmp_path_factory.mktemp('document') / 'report.html'
    path.write_text(report_document(replace(driven_assessment, run=eventful)), encoding='utf-8')
    return path


def test_the_document_is_small(document):
    assert document.stat().st_size < 2.5e6


@pytest.fixture(scope='module')
def browser(needs_browser):
    with shared_browser() as browser:
        yield browser


@pytest.fixture
def opened(browser, document):
    pages = []

    def open_page(*arguments, **options):
        pages.append(open_document(browser, document, *arguments, **options))
        return pages[-1]

    yield open_page
    for page in pages:
        page.context.close()


def test_it_opens_from_a_file_without_errors_and_requests(opened):
    page = opened()
    assert page.locator('#history .nsewdrag').count() == ROWS + 1
    assert page.faults == []


def test_zooming_into_one_row_zooms_all(opened):
    page = opened()
    page.locator('#history').scroll_into_view_if_needed()
    box = page.locator('#history .nsewdrag').nth(3).bounding_box()
    y = box['y'] + box['height'] / 2
    page.mouse.move(box['x'] + box['width'] * 0.25, y)
    page.mouse.down()
    page.mouse.move(box['x'] + box['width'] * 0.5, y, steps=5)
    page.mouse.up()
    page.wait_for_function("document.getElementById('history').layout.xaxis.range[0] > 1")
    low, high = page.evaluate("document.getElementById('history').layout.xaxis.range")
    end = page.evaluate("Math.max(...document.getElementById('history').data.at(-1).x)")
    assert low == pytest.approx(0.25 * end, abs=0.02 * end)
    assert high == pytest.approx(0.5 * end, abs=0.02 * end)
    shown = page.evaluate(
        "Object.values(document.getElementById('history')._fullLayout._plots)"
        '.map((plot) => plot.xaxis.range)'
    )
    assert len(shown) == ROWS + 1
    assert all(each == [low, high] for each in shown)


def test_the_hover_shows_the_values_of_all_rows_and_the_ball_on_the_track(opened):
    page = opened()
    page.locator('#history').scroll_into_view_if_needed()
    box = page.locator('#history .nsewdrag').nth(2).bounding_box()
    page.mouse.move(box['x'] + box['width'] / 2, box['y'] + box['height'] / 2)
    page.locator('#history .hoverlayer .legend').wait_for()
    text = page.locator('#history .hoverlayer').text_content()
    for words in ('position x:', 'body pitch y:', 'duty x:', 'sticks x:', 'speed x reference:'):
        assert words in text
    page.wait_for_function("document.getElementById('path').data.at(-1).x.length === 1")
    assert page.faults == []


@pytest.mark.parametrize('width', [390, 1200])
def test_nothing_scrolls_sideways(opened, width):
    page = opened(width)
    assert page.evaluate('document.documentElement.scrollWidth') == width


@pytest.mark.parametrize('scheme', ['light', 'dark'])
def test_a_table_that_goes_on_beyond_an_edge_has_a_shadow_there(opened, scheme):
    page = opened(390, scheme=scheme)
    wide = page.locator('table').evaluate_all('all => all.map(t => t.scrollWidth > 400)')
    table = page.locator('table').nth(wide.index(True))

    def shadows():
        """Return how far the left and the right edge differ from the middle."""
        picture = Image.open(io.BytesIO(table.screenshot())).convert('L')
        columns = np.median(np.asarray(picture, float), axis=0)
        return [abs(columns[x] - np.median(columns)) > 20.0 for x in (2, -3)]

    assert shadows() == [False, True]
    for left, expected in (('t.scrollWidth / 2 - 195', [True, True]), ('9999', [True, False])):
        table.evaluate(f't => {{ t.scrollLeft = {left} }}')
        assert shadows() == expected


def test_page_and_figures_follow_the_colour_scheme(opened):
    page = opened(scheme='dark')
    colour = "document.getElementById('history').data.find((d) => d.name === 'plane x').line.color"
    paper = 'getComputedStyle(document.body).backgroundColor'
    dark = page.evaluate(f'[{colour}, {paper}]')
    page.emulate_media(color_scheme='light')
    page.wait_for_function(f'{colour} !== "{dark[0]}"')
    assert page.evaluate(colour) == PLANES[0].color
    assert page.evaluate(paper) == 'rgb(255, 255, 255)' != dark[1]
