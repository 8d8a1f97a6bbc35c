"""The brick's processor: pieces of jobs, their numbers, and the part of the report on them."""

import csv
import re

import numpy as np
import pytest
from browsing import open_document, shared_browser

from ballbot_ros.analysis.assessment import assess
from ballbot_ros.analysis.processor import ended, pieces, sets_duty, task_times, utilisation
from ballbot_ros.analysis.processor_figures import processor_of
from ballbot_ros.analysis.report import report_page, write_report
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.analysis.run_figures import figure_contents
from ballbot_ros.controllers.controller import IDLE
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.recording.messages.jobs import encode_jobs, jobs_in
from ballbot_ros.recording.messages.raw import decoder
from ballbot_ros.recording.messages.topics import BRICK_TASKS
from ballbot_ros.robot.brick.job_times import kernel_constants
from ballbot_ros.robot.brick.kernel import Job

decode = decoder(BRICK_TASKS.type_name)
SLOW = (
    'controller.processor_clock=27', 'controller.display_time=1e5', 'controller.time_variation=1',
)  # fmt: skip
"""The task of the display takes longer than its period, and all others interrupt it."""


def jobs_of(*jobs, tasks=('high', 'middle', 'low')):
    return jobs_in(decode(encode_jobs(jobs, tasks)))


HIGH, MIDDLE = Job('high', 4000, 4010, 4100), Job('middle', 4000, 4100, 4300)


@pytest.mark.parametrize(
    ('jobs', 'expected'),
    [
        ([HIGH], [(0, 4010, 4100)]),
        ([HIGH, MIDDLE], [(0, 4010, 4100), (1, 4100, 4300)]),
        # Preempted by both, which follow each other after an interrupt.
        (
            [HIGH, MIDDLE, Job('low', 3000, 3900, 4400, 300)],
            [(2, 3900, 4000), (0, 4010, 4100), (1, 4100, 4300), (2, 4300, 4400)],
        ),
        # One preempts the one that preempts, and a whole millisecond passes in each.
        (
            [
                Job('high', 2000, 2010, 3500, 10),
                Job('middle', 1000, 1010, 3600, 1500),
                Job('low', 0, 10, 3700, 2600),
            ],
            [
                (2, 10, 1000), (1, 1010, 2000), (0, 2010, 3000), (0, 3010, 3500), (1, 3500, 3600),
                (2, 3600, 3700),
            ],
        ),
        ([Job('high', 4000, 4000, 4000)], [(0, 4000, 4000)]),
        ([], []),
    ],
)  # fmt: skip
def test_jobs_that_begin_and_end_meanwhile_take_the_processor(jobs, expected):
    found = pieces(jobs_of(*jobs), 10)
    assert [*map(tuple, found.T.tolist())] == expected


def test_utilisation_is_the_share_of_jobs_and_interrupts():
    parts = np.array([[0, 1, 2], [0, 900, 2500], [500, 1400, 3000]])
    edges = np.array([0, 1000, 2000, 3000, 4000])
    assert utilisation(parts, edges, 0.0, 0) == pytest.approx([0.6, 0.4, 0.5, 0.0])
    assert utilisation(parts, edges, 0.0, 20) == pytest.approx([0.62, 0.42, 0.52, 0.02])
    assert utilisation(parts, edges, 0.5, 20) == pytest.approx([0.81, 0.71, 0.76, 0.51])


def test_the_times_of_a_task_are_those_of_its_jobs():
    many = [Job('high', 4000 * n, 4000 * n + 10, 4000 * n + 10 + n) for n in range(1, 101)]
    lost = Job('low', 8000, 8000, 8000, is_lost=True)
    low = Job('low', 4000, 4100, 9000, 1000)
    high, middle, last = task_times(jobs_of(*many, lost, low))
    assert high == ('high', 100, 0, [1.0, 50.0, 99.0, 100.0], [11.0, 60.0, 109.0, 110.0])
    assert middle[:3] == ('middle', 0, 0)
    assert np.isnan([middle.execution, middle.response]).all()
    assert last == ('low', 1, 1, [3900.0] * 4, [5000.0] * 4)


def test_the_tasks_that_set_the_duty_are_known_or_all_but_idle():
    for tasks, expected in (
        (('task_init', 'task_ts1', 'task_lcd'), [False, True, False]),
        (('fast', 'slow', IDLE), [True, True, False]),
    ):
        jobs = jobs_of(*(Job(each, 0, 10, 20) for each in tasks), tasks=tasks)
        assert sets_duty(jobs).tolist() == expected


@pytest.fixture(scope='module')
def slow(make_run):
    """A run on a slow processor, with lost alarms."""
    sets = (f'--set={each}' for each in ('plant_sim.duration=3', *SLOW))
    return make_run('hardware_standing', *sets)[0]


@pytest.fixture(scope='module')
def assessment(slow):
    return assess(read_run(slow))


@pytest.fixture(scope='module')
def folder(assessment, tmp_path_factory):
    folder = tmp_path_factory.mktemp('report')
    write_report(assessment, folder)
    return folder


def test_the_pieces_of_a_run_are_disjoint_and_as_long_as_its_jobs_run(assessment):
    run = assessment.run
    done = ended(run.jobs)
    parameters = run.attached.parameters.of(ControllerParameters)
    job, start, end = pieces(done, kernel_constants(parameters).interrupt_us)
    assert np.all(start[1:] >= end[:-1])
    lengths = np.bincount(job, end - start, minlength=len(done.task))
    assert np.array_equal(lengths, done.end - done.start - done.preempted)
    assert (done.preempted > 0).sum() > 20


def test_the_report_tells_of_tasks_and_utilisation(assessment, folder):
    page = (folder / 'index.html').read_text(encoding='utf-8')
    part = page[page.index('<section id="processor">') :].partition('</section>')[0]
    for name in assessment.run.jobs.tasks:
        assert f'<code>{name}</code>' in part
    assert task_times(assessment.run.jobs)[-1].lost > 0
    assert re.search(r'task_ts1: jobs begin \d+ … \d+ µs', part)
    assert re.search(r'Jobs, interrupts and the bus take [\d.]+ % of the processor', part)
    assert 'id="timeline" class="chart"' in part
    assert '#processor' in page


def test_its_figures_are_pictures_and_tables(folder):
    for name in ('timeline', 'utilisation', 'ages'):
        assert (folder / f'{name}.png').stat().st_size > 10_000
    with (folder / 'timeline.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    lanes = {each['lane'] for each in rows}
    assert {'link reads', 'interrupts', 'task_ts1', 'link sends', 'duty acts'} <= lanes
    # The window has the whole of the longest response.
    longest = max(
        float(each['job_end_s']) - float(each['release_s'])
        for each in rows
        if each['lane'] == 'task_ts1'
    )
    page = (folder / 'index.html').read_text(encoding='utf-8')
    assert f'{round(longest * 1e6)} µs (standard' in page
    assert sum(each['lane'] == 'interrupts' for each in rows) in (100, 101)
    lines = (folder / 'utilisation.csv').read_text(encoding='utf-8').splitlines()
    assert len(lines) == 1 + 30  # one for each 100 ms


def test_without_interactive_figures_the_part_has_pictures(assessment):
    page = report_page(assessment, [], processor=processor_of(assessment.run))
    part = page[page.index('<section id="processor">') :].partition('</section>')[0]
    assert part.count('<img') == 2


@pytest.mark.parametrize(
    ('parameter', 'lanes', 'ages'),
    [
        ('kernel', {'interrupts'}, {'duties'}),
        ('link', {'link reads', 'link sends'}, {'gyro_values', 'duties'}),
    ],
)
def test_kernel_and_link_alone_have_their_own_lanes(make_run, parameter, lanes, ages):
    both = [f'--set={node}={value}' for node, value in (
        ('plant_sim.duration', '2'), (f'plant_sim.{parameter}', 'true'),
    )]  # fmt: skip
    run = read_run(make_run('stationary', *both)[0])
    timeline, histograms = (each.table for each in processor_of(run).figures)
    assert set(timeline['lane']) - {*run.jobs.tasks, 'duty acts'} == lanes
    assert histograms.keys() == {'from_ms', 'to_ms', *ages}
    names = [each.figure.name for each in figure_contents(run)]
    assert ('utilisation' in names) == (parameter == 'kernel')


def test_a_run_whose_tasks_take_no_time_has_no_such_part(short_assessment, short_document):
    assert processor_of(short_assessment.run).figures == []
    assert 'id="processor"' not in short_document
    assert 'id="timeline"' not in short_document


def test_runs_with_and_without_jobs_can_be_compared(command, slow, short, tmp_path):
    status, _, stderr = command('compare', slow, short[0], '--output', tmp_path / 'compared')
    assert (status, stderr) == (0, '')


@pytest.mark.usefixtures('needs_browser')
def test_the_timeline_follows_the_other_figures_and_zooms_by_itself(folder):
    shown = "document.getElementById('timeline').layout.xaxis.range"
    zoomed = "Plotly.relayout('{}', {{'xaxis.range': [{}, {}]}})"

    def wait_for_range(page, low, high):
        condition = f'Math.abs({shown}[0] - {low}) + Math.abs({shown}[1] - {high}) < 1e-6'
        page.wait_for_function(condition)

    with shared_browser() as browser:
        page = open_document(browser, folder / 'index.html')
        first = page.evaluate(shown)
        assert first[1] - first[0] == pytest.approx(0.1)
        page.evaluate(zoomed.format('history', 1.2, 2.2))
        wait_for_range(page, 1.2, 1.3)
        page.evaluate(zoomed.format('history', 1.2, 1.202))
        wait_for_range(page, 1.2, 1.202)
        page.evaluate(zoomed.format('timeline', 1.5, 1.54))
        wait_for_range(page, 1.5, 1.54)
        bars = page.evaluate("document.getElementById('timeline').data[1].base.length")
        assert bars >= 40 + 40 + 10  # interrupts, frames, and jobs of task_ts1
        page.evaluate(zoomed.format('history', 0, 3))
        wait_for_range(page, *first)
        assert page.faults == []
        page.context.close()
