"""The page of a tuning: its figures and its numbers, those of made-up runs."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from html_pages import Page
from PIL import Image
from study_folders import NOW, PartRows, write_part

pytest.importorskip('pyarrow')

from ballbot_ros.controllers.design.loop_analysis import analyse_sampled, dead_time_margin_ms
from ballbot_ros.lab.search import report as of_tuning
from ballbot_ros.lab.search.charts import path_chart
from ballbot_ros.lab.search.objective import INFEASIBLE, Verdict
from ballbot_ros.lab.search.report import tuning_report
from ballbot_ros.lab.search.tune import TuningResult
from ballbot_ros.lab.search.tuning import read_tuning
from ballbot_ros.lab.studies.data_set import begin_or_resume
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.runs import Results
from ballbot_ros.lab.studies.study_data import wilson_interval

ROBOTS, POPULATION = 200, 4
TUNING = """
purpose: '<b>stands</b> & is quiet'
scenario: {scenario}
runs: 8
candidates: 12
population: 4
unseen: 200
vary:
  plant_sim.body_mass: {{uniform: [0.5, 0.9]}}
expectations: {{peak_pitch_deg: {{max: 5.0}}}}
tune: {tune}
objective:
  over: {over}
  sum: {{peak_pitch_deg: 1.0, duty_rms_percent: 0.1}}
limits: {limits}
"""
GAINS = """
  python:
    controller.pwm_gain: {log_uniform: [0.1, 10.0], start: 1.0}
    controller.k_f.1: {uniform: [-0.05, -0.01]}
    controller.kernel: {list: [false, true]}
"""


def tuning_of(folder, **changes):
    words = {'scenario': 'stationary', 'tune': GAINS, 'over': 0.75, 'limits': '{}', **changes}
    path = folder / 'tried.yaml'
    path.write_text(TUNING.format(**words), 'utf-8')
    return read_tuning(str(path))


def made_up(folder, study, pitch, duty, fallen):
    """Write a study with these values, (r,)."""
    record = replace(job_of(replace(study, runs=ROBOTS), folder).record, runs_per_part=ROBOTS)
    names = [each.name for each in record.measures]
    measured = np.zeros((ROBOTS, len(names)))
    for name, column in (('peak_pitch_deg', pitch), ('duty_rms_percent', duty)):
        measured[:, names.index(name)] = column
    hashes, ticks = np.zeros((ROBOTS, 32), np.uint8), np.full(ROBOTS, 2500)
    results = Results(hashes, ticks, np.zeros(ROBOTS, bool), fallen, measured)
    seeds = np.arange(ROBOTS)
    varied = [np.linspace(0.5, 0.9, ROBOTS), seeds][: len(record.varied)]
    with begin_or_resume(folder, record, NOW) as begun:
        passed = ~fallen & (pitch <= 5.0)
        write_part(folder, record, 0, PartRows(seeds, varied, results, passed))
        begun.finish(NOW)


def result_of(tuning, folder, costs, unseen, points=None, around=None):
    """Return a result with these costs, and `unseen` values of start and best candidate."""
    count, dimensions = len(costs), len(tuning.tuned)
    if points is None:
        points = np.random.default_rng(1).random((count, dimensions))
    verdicts = Verdict(
        costs,
        np.where(costs < INFEASIBLE, costs, 9.0),
        np.zeros(count),
        np.full((count, len(tuning.objective.limits)), 20.0),
    )
    if around is None:
        around = np.full((dimensions, 6), costs.min() + 0.1)
    result = TuningResult(tuning, folder, points, verdicts, int(np.argmin(costs)), around)
    for which, values in zip(('before', 'after'), unseen, strict=True):
        for study, path in zip(tuning.studies, result.studies(which), strict=True):
            made_up(path, study, *values)
    return result


COSTS = np.array([5.0, 4.0, 2.5 * INFEASIBLE, 6.0, 3.0, 7.0, 3.5, 8.0, 2.0, 2.5, 9.0, 4.5])
AROUND = np.array([
    [2.1, 2.1, 2.05, 2.0, 1.9, 2.3],
    [1.2 * INFEASIBLE, 4.0, 2.5, 2.2, 2.3, 2.4],
    [2.0, 2.0, 2.0, 2.0, 2.0, 2.9],
])  # fmt: skip


@pytest.fixture(scope='module')
def unseen():
    """Return pitch, duty and fall of start and tuned values."""
    random = np.random.default_rng(7)
    fallen = np.arange(ROBOTS) < 7
    return (
        (random.uniform(2.0, 8.0, ROBOTS), random.uniform(10.0, 20.0, ROBOTS), fallen),
        (random.uniform(1.0, 4.0, ROBOTS), random.uniform(20.0, 30.0, ROBOTS), fallen[::-1]),
    )


@pytest.fixture(scope='module')
def result(unseen, tmp_path_factory):
    folder = tmp_path_factory.mktemp('tried')
    limits = '{dead_time_margin_ms: {min: 2.0}, duty_rms_percent: {max: 25.0}}'
    points = np.random.default_rng(1).random((len(COSTS), 3))
    tuning = tuning_of(folder, limits=limits)
    points[0], points[8] = tuning.start, (0.4, 0.995, 0.9)
    return result_of(tuning, folder / 'it is', COSTS, unseen, points, AROUND)


@pytest.fixture(scope='module')
def report(result):
    return tuning_report(result)


@pytest.fixture(scope='module')
def page(report):
    return Page(report.page)


def table_of(report, name):
    figure = next(each for each in report.figures if each.name == name)
    return {key: np.asarray(column) for key, column in figure.table.items()}


def text(value, digits=4):
    return f'{value:.{digits}g}'.replace('-', '−')


def test_the_page_is_well_formed_and_has_all_figures(report, page, tmp_path):
    report.write(tmp_path / 'report')
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    for link in page.links:
        assert link[1:] in page.ids if link[0] == '#' else (tmp_path / 'report' / link).is_file()
    assert '<b>stands</b> & is quiet' in page.text
    names = [each.name for each in report.figures]
    parameters = ('controller.pwm_gain', 'controller.k_f.1', 'controller.kernel')
    assert names == [
        'convergence',
        *(f'path__{each}' for each in parameters),
        'robots__peak_pitch_deg', 'robots__duty_rms_percent',
        *(f'around__{each}' for each in parameters),
    ]  # fmt: skip
    assert set(names) <= set(page.ids)
    for each in names:
        with Image.open(tmp_path / 'report' / f'{each}.png') as image:
            assert len(image.convert('L').getcolors(256)) > 10, each
        assert len(list(csv.reader(io.StringIO((tmp_path / 'report' / f'{each}.csv').read_text()))))


def test_the_head_says_what_the_objective_is_on_robots_not_seen(unseen, page):
    values = []
    for pitch, duty, fallen in unseen:
        ranked = np.sort(np.where(fallen, np.inf, pitch + 0.1 * duty))
        values.append(ranked[int(np.ceil(0.75 * (ROBOTS - 1)))])
    change = text(100.0 * (values[1] / values[0] - 1.0), 3)
    assert f'Objective {text(values[0])} → {text(values[1])} ({change} %)' in page.text
    assert '12 candidates; the best one breaks a limit' in page.text
    terms = '1 × peak_pitch_deg + 0.1 × duty_rms_percent'
    assert f'75 % quantile over the robots of {terms}' in page.text
    assert f'objective 5 2 {text(values[0])} {text(values[1])}' in page.text
    # The limits of the search are those of the made-up verdicts: all are kept.
    duty = np.sort(unseen[1][1])[int(np.ceil(0.75 * (ROBOTS - 1)))]
    broken = (
        f'duty_rms_percent is {text(duty)} instead of ≤ 25, {text(4.0 * duty - 100.0, 3)} % off'
    )
    assert f'{broken}, on robots not seen' in page.text
    assert page.text.count('break a limit:') == 1
    assert 'robots without a value ≤ 25 % 0 % 0 % 3.5 % 3.5 %' in page.text


def test_both_have_their_distribution_on_robots_not_seen(unseen, page, report):
    for words, (pitch, duty, fallen) in zip(('start', 'tuned'), unseen, strict=True):
        for name, values in (('peak_pitch_deg [°]', pitch), ('duty_rms_percent [%]', duty)):
            quantiles = np.quantile(values, (0.05, 0.25, 0.5, 0.75, 0.95)).tolist()
            shown = ' '.join(f'{each:.3f}' for each in [*quantiles, values.max()])
            assert f'{name} {words} {shown} 0' in page.text
        passed = int((~fallen & (pitch <= 5.0)).sum())
        low, high = wilson_interval(passed, ROBOTS)
        interval = f'{100 * low:.3g} … {100 * high:.3g} %'
        share = f'{100 * passed / ROBOTS:.3g} % passed; 95 % interval (Wilson) {interval}'
        assert f'{words} {share} 7 0' in page.text
    table = table_of(report, 'robots__peak_pitch_deg')
    for words, (pitch, _, _) in zip(('start', 'tuned'), unseen, strict=True):
        mine = table['values'] == words
        for value, share in zip(table['badness'][mine], table['percent_at_least_as_bad'][mine],
                                strict=True):  # fmt: skip
            assert share == pytest.approx(100.0 * np.mean(pitch >= value))
        assert table['badness'][mine].max() == pitch.max()


def test_parameters_have_their_place_and_a_warning_at_an_end(page):
    low, high = -0.05, -0.01
    gain = text(10.0 ** (2.0 * 0.4 - 1.0))
    assert f'controller.pwm_gain 0.1 … 10, logarithmic 1 {gain} 40 %' in page.text
    tuned = text(low + 0.995 * (high - low))
    assert f'{text(low)} … {text(high)} −0.01505 {tuned} 100 %' in page.text
    assert 'controller.kernel false, true false true Before' in page.text
    assert page.text.count('lies at an end of its range') == 1
    assert 'controller.k_f.1 lies at an end of its range' in page.text


def test_convergence_and_paths_are_those_of_the_candidates(result, report, page):
    table = table_of(report, 'convergence')
    assert table['candidates'].tolist() == [4, 8, 12]
    assert table['best'].tolist() == [4.0, 3.0, 2.0]
    assert table['quantile_50_percent'].tolist() == [5.0, 5.25, 3.5]
    assert '1 of 12 candidates break a limit and are left out' in page.text
    path = table_of(report, 'path__controller.pwm_gain')
    gains = 10.0 ** (2.0 * result.points[:, 0] - 1.0)
    assert path['best'] == pytest.approx(gains[[1, 4, 8]])
    assert path['quantile_95_percent'] == pytest.approx(gains.reshape(3, 4).max(axis=1))
    kernel = table_of(report, 'path__controller.kernel')
    assert kernel['best'].tolist() == (result.points[[1, 4, 8], 2] >= 0.5).tolist()


def test_the_most_influential_parameter_comes_first(page, report):
    assert 'A change of one parameter alone is better than the answer' in page.text
    rows = ('controller.k_f.1 breaks a limit 4 2.5 2.2 2.3 2.4 breaks a limit',
            'controller.kernel 2 2 2 2 2 2.9 0.9',
            'controller.pwm_gain 2.1 2.1 2.05 2 1.9 2.3 0.3')  # fmt: skip
    places = [page.text.index(each) for each in rows]
    assert places == sorted(places)
    table = table_of(report, 'around__controller.k_f.1')
    # Upwards it ends after half a percent.
    assert table['change_percent'] == pytest.approx([-10.0, -5.0, -2.0, 0.0, 0.5, 0.5, 0.5])
    assert table['breaks_a_limit'].tolist() == [True] + [False] * 6
    assert table['cost'][1:4].tolist() == [4.0, 2.5, 2.0]


def test_margins_are_those_of_both_loops(result, page):
    parameters = result.tuning.studies[0].spec.parameters
    both = [with_values(parameters, result.values(each)) for each in (0, result.best)]
    limits = list(map(dead_time_margin_ms, both))
    assert f'dead_time_margin_ms ≥ 2 20 20 {text(limits[0])} {text(limits[1])}' in page.text
    assert f'dead time, motors {limits[0]:.3g} ms {limits[1]:.3g} ms' in page.text
    disks = [analyse_sampled(each).margins.disk for each in both]
    assert f'disk margin {disks[0]:.3g} {disks[1]:.3g}' in page.text


def test_the_worst_runs_and_the_values_have_commands(result, unseen, page):
    folder, (pitch, duty, _) = result.folder, unseen[1]
    for values in (pitch, duty):
        for number in np.argsort(-values)[:3]:
            assert f"ballbot study rerun '{folder}/after' {number} " in page.text
    assert f"ballbot run stationary --params '{folder}/tuned.yaml'" in page.text
    assert f"ballbot study report '{folder}/search'" in page.text
    assert 'not an installed one' not in page.text


def test_a_search_in_which_all_break_a_limit_and_a_start_that_falls(unseen, tmp_path):
    (_, duty, _), tuned = unseen
    nothing, fallen = np.full(ROBOTS, np.nan), np.ones(ROBOTS, bool)
    tuning = tuning_of(
        tmp_path, scenario='[stationary, hardware_standing]', tune=GAINS.rpartition('   ')[0]
    )
    costs = INFEASIBLE * np.linspace(2.0, 1.25, 8)
    result = result_of(tuning, tmp_path / 'out', costs, ((nothing, duty, fallen), tuned))
    report = tuning_report(result)
    page = Page(report.page)
    assert 'Objective – → ' in page.text
    assert '100 % of the robots fall' not in page.text  # only the tuned values count
    assert '8 of 8 candidates break a limit: the costs are by how much' in page.text
    assert table_of(report, 'convergence')['best'] == pytest.approx(
        costs[[3, 7]] / INFEASIBLE - 1.0
    )
    assert 'None: the best candidate breaks a limit.' in page.text
    for name in ('stationary', 'hardware_standing'):
        assert f'ballbot study report {tmp_path}/out/search/{name}' in page.text
        table = table_of(report, f'robots__{name}__peak_pitch_deg')
        assert set(table['values']) == {'tuned'}
    assert 'peak_pitch_deg [°] start – – – – – – 200' in page.text


def test_another_controller_has_no_margins(unseen, tmp_path, monkeypatch):
    tune = '{pid: {controller.user.position_i: {log_uniform: [0.001, 0.02]}}}'
    tuning = tuning_of(tmp_path, tune=tune, over='worst')
    result = result_of(tuning, tmp_path / 'out', np.array([1.0, 2.0, 3.0, 4.0]), unseen[::-1])
    page = Page(tuning_report(result).page)
    assert 'controller.user.position_i 1/s 0.001 … 0.02, logarithmic' in page.text
    chart, _ = path_chart(tuning.tuned[0], result.points[:, 0], result.verdicts.cost, POPULATION)
    assert chart.y.is_log
    assert 0.0008 < chart.y.low < 0.001 < 0.02 < chart.y.high < 0.025
    assert 'None: the loop as it runs is known for the document' in page.text
    assert 'No candidate is better than the start' in page.text
    assert 'The worst of more robots is worse by itself' in page.text
    assert 'On robots not seen by the search, fewer runs of stationary pass' in page.text
    assert '--controller' not in page.text
    monkeypatch.setattr(of_tuning, 'is_installed', lambda _: False)
    page = Page(tuning_report(result).page)
    worst = np.argmax(unseen[0][0])
    assert f'rerun {tmp_path}/out/after {worst} --controller pid ' in page.text
    assert 'The controller is not an installed one' in page.text
