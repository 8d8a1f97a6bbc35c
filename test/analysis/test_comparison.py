"""Comparison of runs, and the gate against regressions."""

import base64
import csv
import gzip
import json
import re

import pytest

from ballbot_ros.analysis import interactive
from ballbot_ros.analysis.report import MEANINGS


@pytest.fixture(scope='module')
def other(make_run):
    """Like `short`, but started at a smaller pitch."""
    path, _ = make_run(
        'stationary', '--set=plant_sim.duration=3', '--set=plant_sim.start_pitch_x=0.05'
    )
    return path


def test_a_run_compared_with_itself_has_no_changes(command, short):
    status, stdout, stderr = command(
        'compare', short[0], short[0], '--json', '--fail-if=peak_pitch_deg>0%',
        '--fail-if=peak_pitch_deg<0',
    )  # fmt: skip
    assert (status, stderr) == (0, '')
    content = json.loads(stdout)
    assert list(content['metrics']) == list(MEANINGS)
    assert all(each['changes'][0] in (0.0, None) for each in content['metrics'].values())


def test_values_and_changes_are_those_of_the_files(command, short, other):
    _, stdout, _ = command('compare', short[0], other, '--json')
    pitch = json.loads(stdout)['metrics']['peak_pitch_deg']
    before, after = pitch['values']
    assert before == pytest.approx(short[1]['metrics']['peak_pitch_deg'])
    assert after < before
    assert pitch['changes'] == [pytest.approx(after - before)]
    assert pitch['changes_percent'] == [pytest.approx((after - before) / before * 100.0)]


@pytest.mark.parametrize(
    ('condition', 'expected'),
    [('peak_pitch_deg<5%', 1), ('peak_pitch_deg>5%', 0), ('peak_pitch_deg<0.1', 1),
     ('peak_pitch_deg<50%', 0)],
)  # fmt: skip
def test_a_change_that_is_too_large_is_status_1(command, short, other, condition, expected):
    status, stdout, _ = command('compare', short[0], other, '--fail-if', condition)
    assert status == expected
    assert (f'failed  {condition}' in stdout) == bool(expected)


def test_no_number_is_truncated_on_a_narrow_terminal(command, short, other, monkeypatch):
    monkeypatch.setenv('COLUMNS', '60')
    _, stdout, _ = command('compare', short[0], other, other, '--all')
    assert 'time in calibration' in stdout
    assert '…' not in stdout


def test_an_incomplete_run_fails_every_condition(command, short, tmp_path):
    path = tmp_path / 'cut.mcap'
    content = short[0].read_bytes()
    path.write_bytes(content[: len(content) * 3 // 4])
    assert command('compare', short[0], path)[0] == 0
    for pair in ((short[0], path), (path, short[0])):
        status, stdout, stderr = command('compare', *pair, '--fail-if=energy_j>1000%')
        assert status == 1
        assert 'prove nothing' in stdout
        assert 'This recording is not complete: cut off at byte' in stderr


def test_the_page_shows_all_runs(command, short, other, tmp_path):
    folder = tmp_path / 'out'
    status, stdout, _ = command('compare', short[0], other, short[0], '--output', folder)
    assert status == 0
    assert str(folder / 'index.html') in stdout
    page = (folder / 'index.html').read_text(encoding='utf-8')
    drawn = page_figures(page)
    assert drawn.keys() == {'history', 'path'}
    # All runs stay at zero in plane y.
    rows = [each['text'] for each in drawn['history']['layout']['annotations']]
    assert rows == ['body pitch x [°]', 'position x [cm]', 'duty x [%]']
    for figure in drawn.values():
        named = [each['name'][0] for each in figure['data'] if each.get('showlegend', True)]
        assert sorted(named) == ['A', 'B', 'C']
    for name in ('pitch', 'position', 'duty', 'track'):
        assert (folder / f'{name}.png').stat().st_size > 10_000
    with (folder / 'metrics.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert [row['metric'] for row in rows] == list(MEANINGS)
    assert all(row['A'] == row['C'] for row in rows)


def page_figures(page):
    """Return the interactive figures of a page."""
    packed = re.search('id="description">([^<]+)', page)[1]
    return json.loads(gzip.decompress(base64.b64decode(packed)))['figures']


def test_without_plotly_the_page_has_pictures(command, short, other, tmp_path, monkeypatch):
    monkeypatch.setattr(interactive, 'plotly_script', lambda: None)
    folder = tmp_path / 'out'
    assert command('compare', short[0], other, '--output', folder)[0] == 0
    page = (folder / 'index.html').read_text(encoding='utf-8')
    assert page.count('data:image/png;base64,') == 4
    assert 'http' not in page
    assert interactive.MISSING.partition('`')[0] in page


def test_it_begins_with_what_was_changed(command, short, other):
    _, stdout, _ = command('compare', short[0], other)
    first, second, *_ = stdout.splitlines()
    assert first == 'changed'
    assert second.split() == ['plant_sim.start_pitch_x', '0.0698131701', '→', '0.05']
    assert '(start_pitch_x 0.05)' in stdout
    assert 'identical duties' not in stdout
    assert json.loads(command('compare', short[0], other, '--json')[1])['changes'] == [
        {'name': 'plant_sim.start_pitch_x', 'values': ['0.0698131701', '0.05']}
    ]


def test_a_run_and_its_copy_have_identical_duties(command, short, copy, tmp_path):
    folder = tmp_path / 'out'
    _, stdout, _ = command('compare', short[0], copy(short[0]), '--output', folder)
    assert stdout.startswith('Nothing was changed')
    assert 'identical duties: A, B' in stdout
    assert 'metrics without a difference; --all shows them' in stdout
    assert 'peak pitch' not in stdout
    page = (folder / 'index.html').read_text(encoding='utf-8')
    for words in ('Nothing was changed', 'identical duties: A, B', '<details>', 'peak pitch'):
        assert words in page
    assert 'peak pitch' in command('compare', short[0], short[0], '--all')[1]


def test_a_mistake_is_one_line_and_status_2(command, short):
    for arguments, words in (
        ([short[0]], '2 … 26 recordings'),
        ([short[0], short[0], '--fail-if=nonsense'], 'not of the form'),
        ([short[0], short[0], '--fail-if=peak>5%'], 'unknown metric'),
        ([short[0], short[0], '--output', short[0].parent], 'not empty'),
    ):
        status, stdout, stderr = command('compare', *arguments)
        assert (status, stdout) == (2, '')
        assert len(stderr.splitlines()) == 1
        assert words in stderr
