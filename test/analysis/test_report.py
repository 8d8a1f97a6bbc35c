"""The report: a self-contained page, its figures and numbers."""

import base64
import csv
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from matplotlib.image import imread

from ballbot_ros.analysis import interactive, report
from ballbot_ros.analysis.assessment import assess
from ballbot_ros.analysis.figure_parts import MAX_FIGURE_ROWS, envelope, every_nth
from ballbot_ros.analysis.metrics import Verdict
from ballbot_ros.analysis.page import number_text
from ballbot_ros.analysis.report import loop_of, report_document, report_page, write_report
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.analysis.run_figures import FIGURES, MIN_AXIS_SPAN, figure_contents
from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.lockstep.run_actions import ParameterChange
from ballbot_ros.parameters import CONTROLLER, ParameterSet
from ballbot_ros.recording.messages.run_reports import encode_parameter_event
from ballbot_ros.recording.messages.topics import CONTROLLER_STATE, PARAMETER_EVENTS
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.robot.world.floor_map import OccupancyGrid

VOID = {'meta', 'img', 'br', 'link'}


class Page(HTMLParser):
    """Parses a page, and fails if its elements are not nested."""

    def __init__(self, text):
        super().__init__()
        self.open, self.seen, self.text = [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.seen if name == tag]


@pytest.fixture(scope='module')
def folder(driven_assessment, tmp_path_factory):
    folder = tmp_path_factory.mktemp('report') / 'new'
    write_report(driven_assessment, folder)
    return folder


@pytest.fixture(scope='module')
def page(folder):
    return Page((folder / 'index.html').read_text(encoding='utf-8'))


def test_the_page_is_self_contained(page, folder):
    assert not any('src' in each for each in page.all('script'))
    assert not page.all('link')
    assert all(each['src'].startswith('data:image/png;base64,') for each in page.all('img'))
    for link in page.all('a'):
        target = link['href']
        assert target.startswith('#') or (folder / target).is_file()
    style = (folder / 'index.html').read_text(encoding='utf-8').partition('</style>')[0]
    assert '@media print' in style
    assert not re.search(r'https?:|url\(|@import', style)


def test_the_page_is_accessible(page):
    headings = [int(tag[1]) for tag, _ in page.seen if re.fullmatch(r'h[1-6]', tag)]
    assert headings[0] == 1
    assert headings.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(headings))
    assert all(len(each['alt']) > 20 for each in page.all('img'))
    assert all('scope' in each for each in page.all('th'))
    assert page.all('html')[0]['lang'] == 'en'
    targets = {each.get('id') for _, each in page.seen}
    assert all(each['href'][1:] in targets for each in page.all('a') if each['href'][0] == '#')


def test_every_figure_has_an_image_file_and_a_table(folder):
    for name in [*(figure.name for figure in FIGURES), 'spectrum', 'loop']:
        picture = imread(folder / f'{name}.png')
        assert picture.shape[1] == 1200
        assert np.ptp(picture[..., :3]) > 0.5
        header, *rows = csv.reader((folder / f'{name}.csv').read_text().splitlines())
        assert rows
        assert all(len(row) == len(header) for row in rows)
        unit = re.compile(r'.*_(s|m|cm|deg|percent|v|deg_per_s|m_per_s|hz|gain)')
        assert all(unit.fullmatch(column) or column == 'state' for column in header)


def test_the_page_has_interactive_figures_and_pictures_of_the_others(page, folder):
    assert [each['id'] for each in page.all('div') if 'id' in each] == ['history', 'path']
    assert [each['id'] for each in page.all('figure') if 'id' in each] == ['spectrum', 'loop']
    for name, image in zip(('spectrum', 'loop'), page.all('img'), strict=True):
        shown = imread(BytesIO(base64.b64decode(image['src'].partition(',')[2])))
        kept = imread(folder / f'{name}.png')
        assert np.abs(shown[..., :3] - kept[..., :3]).mean() < 0.01
    links = {each['href'] for each in page.all('a')}
    assert {f'{figure.name}.{kind}' for figure in FIGURES for kind in ('png', 'csv')} <= links


@pytest.fixture(scope='module')
def without_plotly(short_assessment, tmp_path_factory):
    """Return folder and document of a run, which have the same pictures: they are drawn once."""
    folder = tmp_path_factory.mktemp('without_plotly')
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(interactive, 'plotly_script', lambda: None)
        patched.setattr(report, 'draw_figures', once(report.draw_figures))
        write_report(short_assessment, folder)
        return folder, report_document(short_assessment)


def once(draw):
    drawn = []

    def figures(*arguments):
        if not drawn:
            drawn.extend(draw(*arguments))
        return drawn.copy()

    return figures


def test_without_plotly_the_page_has_all_pictures_and_says_how_to_get_the_others(without_plotly):
    folder, _ = without_plotly
    page = Page((folder / 'index.html').read_text(encoding='utf-8'))
    assert not page.all('script')
    assert len(page.all('img')) == len(list(folder.glob('*.png'))) > 5
    assert 'ballbot_ros[report]' in ''.join(page.text)


def test_the_document_needs_no_other_file(short_document):
    page = Page(short_document)
    assert page.all('script')
    assert len(page.all('img')) == 2
    assert all(each['href'].startswith('#') for each in page.all('a'))


def test_the_document_without_plotly_needs_no_other_file(without_plotly):
    _, document = without_plotly
    page = Page(document)
    assert not page.all('script')
    assert len(page.all('img')) == 11
    assert all(each['href'].startswith('#') for each in page.all('a'))


def test_every_axis_has_a_unit(driven_assessment):
    unit = re.compile(r'.* \[(s|cm|cm/s|°|%|V|°/s)\]')
    for figure in FIGURES:
        table = figure.table(driven_assessment.run)
        drawn = figure.draw(driven_assessment.run, table, figure.panels)
        labels = [
            label
            for axes in drawn.axes
            for label in (axes.get_xlabel(), axes.get_ylabel())
            if label not in ('', 'operating state')
        ]
        assert len(labels) >= 1
        assert all(unit.fullmatch(label) for label in labels), labels


def test_the_table_shows_the_metrics_of_the_run(folder, driven):
    with (folder / 'metrics.csv').open(encoding='utf-8') as file:
        rows = {row['metric']: row['value'] for row in csv.DictReader(file)}
    for name in METRICS:
        expected = driven[1]['metrics'][name]
        assert (rows[name] == '') == (expected is None)
        if expected is not None:
            assert float(rows[name]) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_the_page_shows_parameters_versions_and_verdicts(page):
    text = ' '.join(' '.join(page.text).split())
    for words in ('k_thetadot', 'motor_resistance', 'ballbot_ros', '✓ met', 'peak pitch', 'energy'):
        assert words in text
    assert text.index('noise') < text.index('k_thetadot'), 'the changed parameters come first'


def test_the_page_shows_the_margins_of_both_loops(page, driven_assessment):
    loop = loop_of(driven_assessment.run)
    assert loop.margins[0].ideal == '0.495 … ∞'
    assert loop.findings[0].startswith('Rings at 125 Hz')
    text = ' '.join(' '.join(page.text).split())
    for words in (loop.margins[0].sampled, *loop.findings):
        assert words in text


def test_the_margins_are_those_of_the_runs_parameters(driven_assessment):
    run = driven_assessment.run
    parameters = ParameterSet()
    parameters.set('plant_sim', 'actuator_delay', 4)
    parameters.set('plant_sim', 'dead_zone', 2.0)
    loop = loop_of(replace(run, attached=replace(run.attached, parameters=parameters)))
    assert loop.findings == ['Unstable: pole 0.1299 ± 1.116j grows at 57.9 Hz.']
    assert loop.neglected == ['the dead zone']


@pytest.mark.parametrize('case', ['pid', 'external', 'no parameters'])
def test_a_loop_that_is_unknown_is_left_out(driven_assessment, case):
    attached = driven_assessment.run.attached
    if case == 'pid':
        parameters = ParameterSet()
        parameters.set('controller', 'implementation', 'pid')
        attached = replace(attached, parameters=parameters)
    elif case == 'external':
        attached = replace(attached, external={'controller': 'theirs 1.0'})
    else:
        attached = replace(attached, has_parameters=False)
    run = replace(driven_assessment.run, attached=attached)
    assert loop_of(run) is None
    page = Page(report_page(replace(driven_assessment, run=run), []))
    assert 'margins' not in {each.get('id') for each in page.all('section')}


def test_text_from_a_file_is_escaped(short_assessment):
    purpose = '<script>alert("x")</script> & more'
    attached = replace(short_assessment.run.attached, scenario=Scenario(purpose=purpose))
    run = replace(short_assessment.run, attached=attached, notices=('<b>bold</b>',))
    page = Page(report_page(replace(short_assessment, run=run), []))
    assert not page.all('script')
    assert not page.all('b')
    assert purpose in ''.join(page.text)


def test_a_missing_topic_leaves_out_its_figure(short, copy):
    run = read_run(copy(short[0], wanted=lambda name: name not in ('/gyro', '/operating_state')))
    names = {each.figure.name for each in figure_contents(run)}
    assert names == {figure.name for figure in FIGURES} - {'gyro', 'operating_state', 'sticks'}


def test_the_commanded_speed_is_that_of_the_sticks(driven_assessment):
    run = driven_assessment.run
    command = next(figure for figure in FIGURES if figure.name == 'command')
    table = command.table(run)
    full_m_per_s = np.radians(380.0) * 0.026
    for time, expected in ((1.5, 0.0), (4.0, 1.0), (7.0, 0.0), (10.0, -1.0), (18.0, 0.0)):
        row = np.searchsorted(table['time_s'], time)
        speed = table['commanded_speed_x_m_per_s'][row]
        assert speed == pytest.approx(expected * full_m_per_s, abs=1e-5), time
    position = table['position_x_m']
    assert np.trapezoid(table['speed_x_m_per_s'][1:], dx=0.004) == pytest.approx(
        position[-1] - position[0], abs=5e-4
    )
    error = table['speed_x_m_per_s'] - table['reference_speed_x_m_per_s']
    still = table['speed_y_m_per_s'] - table['reference_speed_y_m_per_s']
    rms = np.sqrt((np.nanmean(error**2) + np.nanmean(still**2)) / 2.0)
    assert driven_assessment.metrics['speed_error_rms_m_per_s'] == pytest.approx(rms, rel=1e-6)


def test_a_controller_without_references_has_no_figure_of_them(short, copy):
    def only_estimates(raw, number):
        if raw.topic != '/controller/state':
            return raw.data
        message = new_message(CONTROLLER_STATE.type_name)
        stamp_s, stamp_ns = divmod(raw.stamp_ns, 10**9)
        message.header.stamp.sec, message.header.stamp.nanosec = stamp_s, stamp_ns
        message.position, message.velocity = np.zeros(4), np.zeros(4)
        return encoder(CONTROLLER_STATE.type_name)(message)

    run = read_run(copy(short[0], edit=only_estimates))
    names = {each.figure.name for each in figure_contents(run)}
    assert names == {each.name for each in FIGURES} - {'command', 'sticks'}
    assert np.isnan(assess(run).metrics['speed_error_rms_m_per_s'])


def test_the_track_is_drawn_over_the_recorded_map(short_assessment):
    cells = np.zeros((40, 60), np.int8)
    cells[:, -10:] = 100  # a wall from 20 cm to 30 cm ahead
    grid = OccupancyGrid(60, 40, 0.01, (-0.3, -0.2), cells)
    track = next(figure for figure in FIGURES if figure.name == 'track')
    run = replace(short_assessment.run, grid=grid)
    drawn = track.draw(run, track.table(run), track.panels)
    (walls,) = drawn.axes[0].get_images()
    assert walls.get_extent() == pytest.approx([-30.0, 30.0, -20.0, 20.0])
    assert walls.get_array()[:, -10:].count() == cells[:, -10:].size
    assert walls.get_array()[:, :-10].count() == 0


@given(st.integers(MAX_FIGURE_ROWS + 1, 3 * MAX_FIGURE_ROWS), st.integers(0, 2**32 - 1))
def test_a_long_series_keeps_its_extremes(count, seed):
    values = np.random.default_rng(seed).normal(size=count)
    time = np.arange(count) * 0.004
    table = envelope(time, {'x': values})
    assert len(table['x']) < MAX_FIGURE_ROWS
    assert (table['x'].min(), table['x'].max()) == (values.min(), values.max())
    assert np.all(np.diff(table['time_s']) >= 0.0)
    way = every_nth(time, {'x': values})
    assert len(way['x']) <= MAX_FIGURE_ROWS + 1
    assert (way['x'][0], way['x'][-1]) == (values[0], values[-1])


@given(st.floats(allow_nan=False))
def test_a_number_survives_conversion_to_text(value):
    text = number_text(value).replace('−', '-').replace('∞', 'inf')
    assert float(text) == pytest.approx(value, rel=5e-3, abs=0.0 if abs(value) < 0.1 else 6e-4)


def test_the_command_writes_next_to_the_recording_and_overwrites_nothing(
    command, short, copy, monkeypatch
):
    monkeypatch.setattr(report, 'draw_figures', lambda run, contents: [])  # others look at them
    path = copy(short[0])
    status, stdout, stderr = command('report', path, '--json')
    assert (status, stderr) == (0, '')
    content = json.loads(stdout)
    assert content['outcome'] == short[1]['outcome']
    assert content['report'] == str(path.with_name('copy_report') / 'index.html')
    before = (path.with_name('copy_report') / 'index.html').read_bytes()
    status, stdout, stderr = command('report', path)
    assert status == 2
    assert len(stderr.splitlines()) == 1
    assert 'copy_report' in stderr
    assert (path.with_name('copy_report') / 'index.html').read_bytes() == before


def test_a_damaged_recording_is_reported_with_a_banner(command, short, tmp_path, monkeypatch):
    monkeypatch.setattr(report, 'draw_figures', lambda run, contents: [])
    path = tmp_path / 'cut.mcap'
    content = short[0].read_bytes()
    path.write_bytes(content[: len(content) * 3 // 4])
    status, stdout, stderr = command('report', path, '--output', tmp_path / 'out')
    assert status == 0
    assert 'not complete: cut off at byte' in stderr
    assert stdout.startswith('incomplete')
    page = Page((tmp_path / 'out/index.html').read_text(encoding='utf-8'))
    assert any('not complete: cut off' in text for text in page.text)


def test_a_mistake_is_one_line_and_status_2(command, short, tmp_path):
    other = tmp_path / 'other.mcap'
    other.write_text('text')
    for arguments, words in (
        ([other], 'not an MCAP file'),
        ([short[0], '--output', other], 'other.mcap'),
        (
            [short[0], '--run', '2', '--output', tmp_path / 'x'],
            'run 2 not found; the file has run 1\n',
        ),
        ([short[0], '--run', '0'], '--run'),
        ([], 'RECORDING'),
    ):
        status, stdout, stderr = command('report', *arguments)
        assert (status, stdout) == (2, ''), arguments
        assert len(stderr.splitlines()) == 1
        assert words in stderr


def test_the_axes_of_a_plane_at_rest_are_not_magnified(short_assessment):
    gyro = next(figure for figure in FIGURES if figure.name == 'gyro')
    run = short_assessment.run
    drawn = gyro.draw(run, gyro.table(run), gyro.panels)
    for axes in drawn.axes:
        low, high = axes.get_ylim()
        assert high - low >= MIN_AXIS_SPAN * 0.999


def test_the_page_says_which_parameters_changed_on_the_way(short, copy):
    recording, _ = short
    name = f'/{PARAMETER_EVENTS.name}'
    stamp = 2_500_000_000
    event = encode_parameter_event(stamp, {'k_f': (1.0, 2.0, 3.0, 4.0), 'dst_thr': 20})
    run = read_run(
        copy(recording, first=[(name, stamp, event)], types={name: PARAMETER_EVENTS.type_name})
    )
    k_f, dst_thr = run.parameter_changes
    assert k_f == ParameterChange(1.5, CONTROLLER, 'k_f', (1.0, 2.0, 3.0, 4.0))
    assert dst_thr == ParameterChange(1.5, CONTROLLER, 'dst_thr', 20)
    without_expectations = replace(run, attached=replace(run.attached, scenario=Scenario()))
    assert assess(without_expectations).outcome is Verdict.CHANGED
    unchanged = replace(without_expectations, parameter_changes=())
    assert (assess(unchanged).outcome, assess(unchanged).reason) == (Verdict.PASSED, '')
    changed = assess(run)
    assert changed.outcome is Verdict.NOT_MET
    assert changed.as_json()['parameter_changes'] == [k_f.as_json(), dst_thr.as_json()]
    text = ' '.join(' '.join(Page(report_page(changed, [])).text).split())
    words = '; controller.k_f was set to 1, 2, 3, 4 at 1.500 s (tick 375); controller.dst_thr'
    assert words in text
    assert re.search(r'1\.5\d* 375 k_f 1, 2, 3, 4 1\.5\d* 375 dst_thr 20', text)
    plain = ' '.join(Page(report_page(assess(unchanged), [])).text)
    assert 'was set to' not in plain
