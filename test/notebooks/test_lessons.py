"""The lessons run, and their checks tell right answers from wrong ones."""

import re
from pathlib import Path

import matplotlib as mpl
import pytest
from notebook_cells import notebook

from ballbot_ros.engine.compilation import can_compile

pytest.importorskip('pandas')
mpl.use('Agg')

__all__ = ['notebook']  # a fixture

FOLDER = Path(__file__).parents[2] / 'docs/notebooks'
LESSONS = sorted(FOLDER.glob('lesson_*.md'))
CELL = re.compile(r'^```\{code-cell\}\n(?::.*\n)*(.*?)^```$', re.MULTILINE | re.DOTALL)

LESS_RATE = [-0.01504899, -1.56981134, -0.02700482, 0.72 * -0.23249821]
RIGHT = {
    1: [7, 7.3],
    2: [58, 57.5],
    3: [
        {'controller.k_f': LESS_RATE},
        {'controller.k_f': LESS_RATE, 'controller.pwm_gain': 0.9},
    ],
    4: [(87.9, 90.6), (87.0, 90.0)],
    5: [21, 22],
}
WRONG = {
    1: [
        (6, 'a robot that starts at 6.5° still recovers'),
        (8, 'a robot that starts at 7.5° does not recover'),
        ('seven', "'seven' cannot be judged: "),
    ],
    2: [
        (
            125.0,
            '125 Hz is too high for the largest peak of a run with 4 ms of dead time, from 1 s on',
        ),
        (
            0.1,
            '0.1 Hz is too low for the largest peak of a run with 4 ms of dead time, from 1 s on',
        ),
    ],
    3: [
        ({}, 'the sampled loop is unstable with 4 ms of dead time'),
        ({'controller.pwm_gain': 0.78}, 'the duty RMS in stationary is 14.4 %, more than 13 %'),
        (
            {'controller.k_f': [*LESS_RATE[:3], 0.6 * -0.23249821]},
            'push does not pass: peak_pitch_deg ',
        ),
        ({'controller.a_d': 0.975}, 'change only k_f and pwm_gain, not controller.a_d'),
        ({'controller.k_f': [1.0]}, "{'controller.k_f': [1.0]} cannot be judged: "),
    ],
    4: [
        ((67.4, 70.7), 'too low: it does not meet the interval of 2000 other robots'),
        ((95.0, 97.0), 'too high: it does not meet the interval of 2000 other robots'),
        ((80, 95), '80 to 95 is not an interval of at most 4 points'),
        (89, '89 cannot be judged: '),
    ],
    5: [
        (38, 'with 34 ms not all of seeds 0, 1 and 2 pass'),
        (3, 'with 7 ms all of seeds 0, 1 and 2 pass'),
        (1000, '1000 cannot be judged: '),
    ],
}


@pytest.fixture
def lessons(monkeypatch):
    """Return the module of the checks, imported as in the folder of the lessons."""
    monkeypatch.syspath_prepend(str(FOLDER))
    import lessons

    return lessons


@pytest.fixture
def study(lessons):
    if not can_compile():
        pytest.skip('numba is not installed')


def cells(lesson):
    return CELL.findall(lesson.read_text(encoding='utf-8'))


@pytest.mark.usefixtures('study')
@pytest.mark.parametrize('lesson', LESSONS, ids=lambda lesson: lesson.stem)
def test_every_cell_runs_and_the_last_one_asks_for_an_answer(lesson, notebook, capsys):
    notebook.run(*cells(lesson))
    number = int(lesson.stem.split('_')[1])
    assert capsys.readouterr().out.endswith(f'lesson {number}: no answer yet\n')
    mpl.pyplot.close('all')


@pytest.mark.parametrize('number', sorted(RIGHT))
def test_a_check_accepts_right_answers_and_explains_wrong_ones(number, lessons, request, capsys):
    if number == 4:
        request.getfixturevalue('study')
    for answer in RIGHT[number]:
        lessons.check(number, answer)
        assert capsys.readouterr().out.startswith(f'lesson {number}: right: ')
    for answer, explanation in WRONG[number]:
        lessons.check(number, answer)
        assert capsys.readouterr().out.startswith(f'lesson {number}: wrong: {explanation}')


def test_the_check_of_lesson_4_asks_what_its_cells_ask(lessons, notebook):
    notebook.run('from lessons import DOCUMENT')
    notebook.run(re.search(r'^study = \{.*?^\}', LESSONS[3].read_text(), re.M | re.S)[0])
    notebook.study['parameters']['controller']['pwm_gain'] = 0.85
    assert notebook.study == lessons.STUDY


def test_the_course_links_all_lessons():
    links = re.findall(r'notebooks/(lesson_\w+\.md)', (FOLDER.parent / 'notebooks.md').read_text())
    assert links == [lesson.name for lesson in LESSONS]
