"""The page of a study: its parts, its figures and its numbers."""

import csv
import io
import math
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from browsing import open_document, shared_browser
from html_pages import Page
from laws import refusal
from PIL import Image
from study_folders import EXPECTATIONS, NOW, PartRows, record, write_part, write_study

pytest.importorskip('pyarrow')
pytest.importorskip('SALib')

from ballbot_ros.analysis import interactive
from ballbot_ros.engine.scenario.scenario import Measure
from ballbot_ros.errors import BallbotError
from ballbot_ros.lab.studies.columns import ColumnKind, MeasureColumn, ResultColumn
from ballbot_ros.lab.studies.data_set import begin_or_resume
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.report import study_report
from ballbot_ros.lab.studies.runs import Results
from ballbot_ros.lab.studies.study_data import StudyData, wilson_interval

RUNS, PARTS = 3000, 3
NASTY = '<script>alert("x")</script> & Söhne'
TEXT = f"""
purpose: '{NASTY}'
scenario: stationary
sampling: random
vary:
  plant_sim.body_mass: {{uniform: [0.5, 0.9]}}
  controller.pwm_gain: {{log_uniform: [0.4, 1.6]}}
  plant_sim.actuator_delay: {{uniform: [0, 8]}}
  plant_sim.plant_model: {{list: [linear, nonlinear]}}
"""


def varied_record():
    """Return a study that theory knows something about."""
    shipped = job_of(read_study('delay_and_gain'), None).record
    return record(
        name='<b>tried</b>',
        text=TEXT,
        scenario=shipped.scenario,
        parameters=shipped.parameters,
        runs=RUNS,
        runs_per_part=RUNS // PARTS,
        varied=(
            ResultColumn('plant_sim.body_mass', unit='kg', meaning='mass of the body'),
            ResultColumn('controller.pwm_gain', unit='1'),
            ResultColumn('plant_sim.actuator_delay', ColumnKind.INTEGER, 'ms'),
            ResultColumn('plant_sim.plant_model', ColumnKind.TEXT),
        ),
        measures=tuple(
            MeasureColumn.of(each, EXPECTATIONS)
            for each in (
                Measure('peak_pitch_deg'),
                Measure('settling_time_s'),
                Measure('final_position_x_m', end=7.5),
                Measure('wall_clearance_m'),
            )
        ),
    )


def part_rows(study, part):
    random = np.random.default_rng(part)
    runs = len(study.numbers(part))
    mass, gain = (
        random.uniform(0.5, 0.9, runs),
        np.exp(random.uniform(np.log(0.4), np.log(1.6), runs)),
    )
    delay = random.integers(0, 9, runs)
    model = random.choice(np.array(['linear', 'nonlinear']), runs)
    pitch = 1.8 + 4.0 * gain + 2.0 * (model == 'linear') + 0.3 * delay
    pitch += random.normal(0.0, 0.5, runs)
    failed = random.random(runs) < 0.01
    settling = np.where(pitch > 9.0, np.nan, pitch / 3.0)
    final = random.normal(0.2, 0.05, runs)
    measured = np.column_stack([pitch, settling, final, np.full(runs, np.nan)])
    results = Results(
        random.integers(0, 256, (runs, 32), np.uint8), np.full(runs, 2500), failed, failed, measured
    )
    passed = ~failed & (pitch <= 8.0)
    return PartRows(random.integers(0, 2**63, runs), [mass, gain, delay, model], results, passed)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('studies') / "it's a study"
    study = varied_record()
    with begin_or_resume(folder, study, NOW) as begun:
        for part in range(PARTS):
            write_part(folder, study, part, part_rows(study, part))
        begun.finish(NOW)
    return folder


@pytest.fixture(scope='module')
def data(folder):
    return StudyData.open(folder)


@pytest.fixture(scope='module')
def report(data):
    return study_report(data)


@pytest.fixture(scope='module')
def page(report):
    return Page(report.page)


def rows_of_csv(content):
    return list(csv.DictReader(io.StringIO(content.decode())))


@pytest.fixture(scope='module')
def written(report, tmp_path_factory):
    folder = tmp_path_factory.mktemp('written') / 'report'
    report.write(folder)
    return folder


def test_the_page_is_well_formed_and_needs_nothing_else(page, written):
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert page.sources == []
    for link in page.links:
        assert link[1:] in page.ids if link.startswith('#') else (written / link).is_file(), link
    assert {'link', 'iframe', 'b'}.isdisjoint(page.tags)


def test_names_are_escaped(report, page):
    assert NASTY not in report.page
    assert NASTY in page.text
    assert '<b>tried</b>' in page.text


def test_the_page_has_each_part(data, page):
    assert {
        'varied', 'measures', 'maps', 'sensitivities', 'shares', 'distributions', 'worst', 'failed',
        'versions',
    } <= set(page.ids)  # fmt: skip
    totals = data.totals()
    low, high = wilson_interval(totals.passed, totals.runs)
    for text in (
        f'{100 * totals.passed / totals.runs:.3g} % passed',
        f'{100 * low:.3g} … {100 * high:.3g} %',
        'independent random numbers', 'log-uniform, 0.4 … 1.6', 'one of linear, nonlinear',
        'uniform, 0 … 8', 'mass of the body', '2026-01-02', '0' * 64, 'RBD-FAST', 'PAWN',
        'without quantisation', 'All else that varies has its median',
        'wall_clearance_m: 3,000 of 3,000 runs have no value and are left out.',
    ):  # fmt: skip
        assert text in page.text, text
    assert 'not finished' not in page.text


def test_worst_and_failed_runs_have_a_command(data, page):
    quoted = "'" + str(data.path).replace("'", "'\"'\"'") + "'"
    failed = list(data.failed())
    assert f'{len(failed)} runs ended early; the first 10' in page.text
    numbers = [each.number for name in ('peak_pitch_deg', 'settling_time_s')
               for each in data.worst(name, 3)]  # fmt: skip
    for number in [*numbers, *failed[:10]]:
        assert f'ballbot study rerun {quoted} {number} ' in page.text
    row = data.row(numbers[0])
    assert f'plant_sim.body_mass = {row.varied["plant_sim.body_mass"]:.4g} kg' in page.text


def test_every_figure_is_on_the_page(report, page):
    charts = [each for each in page.ids if each.startswith('chart_')]
    assert sorted(charts) == sorted(f'chart_{each.name}' for each in report.figures)


def test_without_plotly_the_page_has_the_pictures(data, monkeypatch):
    monkeypatch.setattr(interactive, 'plotly_script', lambda: None)
    report = study_report(data)
    page = Page(report.page)
    assert len(page.sources) == len(report.figures)
    assert all(each.startswith('data:image/png;base64,') for each in page.sources)
    assert 'script' not in page.tags
    assert 'ballbot_ros[report]' in page.text


def test_a_browser_draws_every_chart_and_tells_its_numbers(needs_browser, report, written):
    with shared_browser() as browser:
        page = open_document(browser, written / 'index.html', 390, 'dark')
        drawn = page.locator('.chart').evaluate_all(
            "all => all.filter(each => each.querySelector('.main-svg')).map(each => each.id)"
        )
        assert sorted(drawn) == sorted(f'chart_{each.name}' for each in report.figures)
        assert page.locator('#chart_sensitivity .colorbar').count() == 1
        assert page.evaluate('document.documentElement.scrollWidth') == 390
        point = page.locator('#chart_share__plant_sim\\.plant_model .point').first
        point.scroll_into_view_if_needed()
        box = point.bounding_box()
        page.mouse.move(box['x'] + box['width'] / 2, box['y'] + box['height'] / 2)
        hover = page.locator('.hoverlayer .hovertext')
        hover.wait_for()
        assert re.fullmatch(r'linear: [\d.]+ \([\d.]+ … [\d.]+\) %', hover.text_content())
        assert page.faults == []
        page.context.close()


def test_every_figure_is_a_picture_with_numbers(report, written):
    names = [each.name for each in report.figures]
    assert len(set(names)) == len(names)
    for name in names:
        with Image.open(written / f'{name}.png') as image:
            assert image.format == 'PNG'
            image.load()
            assert len(image.convert('L').getcolors(256)) > 10, name
        assert rows_of_csv((written / f'{name}.csv').read_bytes()), name
    kinds = [name.partition('__')[0] for name in names]
    # The body's mass has no influence.
    assert kinds.count('map') == 3
    assert kinds.count('share') == 4
    assert kinds.count('distribution') == 3  # one measure has no value at all


def test_the_numbers_of_a_map_are_those_of_the_rows(data, written):
    name = 'map__controller.pwm_gain__plant_sim.plant_model'
    rows = rows_of_csv((written / f'{name}.csv').read_bytes())
    frame = data.table().to_pydict()
    gain, passed = np.array(frame['controller.pwm_gain']), np.array(frame['passed'])
    linear = np.array(frame['plant_sim.plant_model']) == 'linear'
    mine = [each for each in rows if each['plant_sim.plant_model'] == 'linear']
    assert sum(int(each['runs']) for each in mine) == linear.sum()
    edges = np.geomspace(gain.min(), gain.max(), len(mine) + 1)
    assert [int(each['passed']) for each in mine] == np.histogram(
        gain[linear & passed], edges
    )[0].tolist()  # fmt: skip
    for each in mine:
        assert float(each['share_passed']) == pytest.approx(int(each['passed']) / int(each['runs']))


def test_the_numbers_of_a_distribution_are_those_of_the_rows(data, written):
    rows = rows_of_csv((written / 'distribution__settling_time_s.csv').read_bytes())
    values = data.column('settling_time_s')
    assert sum(int(each['passed']) + int(each['not_passed']) for each in rows) == (
        np.isfinite(values).sum()
    )
    inner = rows[1:-1]
    edges = [float(each['low']) for each in inner] + [float(inner[-1]['high'])]
    counted = [int(each['passed']) + int(each['not_passed']) for each in inner]
    expected = np.histogram(values[np.isfinite(values)], edges)[0]
    # The file has nine digits of an edge.
    assert np.abs(np.array(counted) - expected).max() <= 1
    assert (rows[0]['low'], rows[-1]['high']) == ('-inf', 'inf')


def test_the_sensitivities_are_those_of_the_rows(written):
    rows = rows_of_csv((written / 'sensitivity.csv').read_bytes())
    found = {(each['variable'], each['result']): each for each in rows}
    assert len(rows) == 4 * 5
    gain = float(found['controller.pwm_gain', 'peak_pitch_deg']['first_order'])
    model = float(found['plant_sim.plant_model', 'peak_pitch_deg']['first_order'])
    # 4 times the gain, 2 for one of both models, 0.3 times the dead time, noise.
    log_range = math.log(4.0)
    mean = 1.2 / log_range
    variance = 16.0 * ((1.6**2 - 0.4**2) / 2.0 / log_range - mean**2)
    total = variance + 1.0 + 0.09 * 80.0 / 12.0 + 0.25
    assert gain == pytest.approx(variance / total, abs=0.04)
    assert model == pytest.approx(1.0 / total, abs=0.04)
    assert found['plant_sim.body_mass', 'wall_clearance_m']['first_order'] == ''


def test_an_unfinished_study_says_so_first(tmp_path):
    write_study(tmp_path / 'study', parts=[0, 2])
    page = Page(study_report(StudyData.open(tmp_path / 'study')).page)
    assert '15 of 25 runs are done' in page.text
    assert page.text.index('not finished') < page.text.index('% passed')


def write_study_of_seeds(folder):
    """Write a study that varies nothing else, whose report has the fewest figures."""
    study = record(varied=(), runs=30)
    with begin_or_resume(folder, study, NOW) as begun:
        for part in range(3):
            write_part(folder, study, part, replace(part_rows(study, part), varied=[]))
        begun.finish(NOW)


def test_small_studies_and_studies_of_seeds_alone_have_a_page(tmp_path):
    write_study(tmp_path / 'few')
    page = Page(study_report(StudyData.open(tmp_path / 'few')).page)
    assert 'No indices: they need at least 200 runs' in page.text
    assert "since the parameters can't be read here" in page.text
    write_study_of_seeds(tmp_path / 'seeds')
    page = Page(study_report(StudyData.open(tmp_path / 'seeds')).page)
    assert {'maps', 'sensitivities', 'shares', 'varied'}.isdisjoint(page.ids)


def test_a_study_that_always_passes_has_a_page(tmp_path):
    whole = varied_record()
    study = replace(
        whole, runs=300, runs_per_part=100, varied=whole.varied[1:3], measures=whole.measures[:1]
    )
    with begin_or_resume(tmp_path / 'study', study, NOW) as begun:
        for part in range(PARTS):
            rows = part_rows(study, part)
            good = np.zeros(len(rows.passed), bool)
            measured = rows.results.measured[:, :1]
            results = rows.results._replace(failed=good, fallen=good, measured=measured)
            rows = replace(rows, varied=rows.varied[1:3], results=results, passed=~good)
            write_part(tmp_path / 'study', study, part, rows)
        begun.finish(NOW)
    page = Page(study_report(StudyData.open(tmp_path / 'study')).page)
    assert 'Passing has no index: all runs pass, or none.' in page.text
    assert 'There is no boundary' in page.text
    assert 'None: every run was completed.' in page.text


def test_the_command_replaces_only_an_earlier_report(command, tmp_path):
    study = tmp_path / 'study'
    write_study_of_seeds(study)
    for _ in range(2):
        status, text, _ = command('study', 'report', study)
        assert (status, text) == (0, f'report  {study}/report/index.html\n')
    (study / 'report/notes.txt').write_text('mine', encoding='utf-8')
    status, _, errors = command('study', 'report', study)
    assert status == 2
    assert 'already exists and is not empty' in errors
    status, _, _ = command('study', 'report', study, '--output', tmp_path / 'new')
    assert status == 0
    assert (tmp_path / 'new/index.html').exists()


def test_mistakes_are_told_on_one_line(command, folder, tmp_path, monkeypatch):
    empty = tmp_path / 'begun'
    with begin_or_resume(empty, record(), NOW):
        pass
    (tmp_path / 'file').touch()
    cases = [
        ((tmp_path,), 'not the folder of a study'),
        ((empty,), 'has no results yet'),
        ((folder, '--output', tmp_path / 'file/inner'), 'file: not a folder'),
    ]
    for words, message in cases:
        status, text, errors = command('study', 'report', *words)
        assert (status, text, errors.count('\n')) == (2, '', 1), words
        assert errors.startswith('error: ')
        assert message in errors
    monkeypatch.setitem(sys.modules, 'SALib.analyze', None)
    status, _, errors = command('study', 'report', folder)
    assert (status, 'ballbot_ros[study]' in errors) == (2, True)


def test_a_damaged_part_is_an_error(tmp_path):
    study = write_study(tmp_path / 'study')
    part = tmp_path / 'study/parts' / study.part_name(1)
    content = bytearray(part.read_bytes())
    content[len(content) // 2] ^= 1
    part.write_bytes(content)
    text = refusal(BallbotError, study_report, StudyData.open(tmp_path / 'study'))
    assert study.part_name(1) in text
