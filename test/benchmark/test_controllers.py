"""The tables on the page of controllers are those of `ballbot compare`."""

from ballbot_ros.engine.scenario.reader import scenario_names
from benchmark import controllers
from benchmark.controllers import CONTROLLERS, PAGE, PROFILES, cells, compare

ROWS = [
    [cell.strip() for cell in line.strip('|\n').split('|')]
    for line in PAGE.read_text(encoding='utf-8').partition(controllers.BEGIN)[2].splitlines()
    if line.startswith('|')
]


def test_the_page_has_every_scenario_with_both_profiles():
    rows = {(row[0].strip('`'), row[1]) for row in ROWS[2:] if len(row) == 2 + len(CONTROLLERS)}
    assert rows == {(name, profile) for name in scenario_names() for profile in PROFILES}


def test_the_row_of_a_scenario_is_what_compare_finds(tmp_path):
    chosen = ('document', 'quiet', 'lqg')
    found = cells(compare(tmp_path, 'stationary', '--profile', 'ideal', controllers=chosen))
    (row,) = (row[2:] for row in ROWS if row[:2] == ['`stationary`', 'ideal'])
    assert [row[list(CONTROLLERS).index(name)] for name in chosen] == found


def test_a_row_shows_what_is_missing_or_not_met():
    metrics = {
        'duty_rms_percent': {'values': [1.25, None]},
        'energy_j': {'values': [0.126, 2.0]},
        'peak_pitch_deg': {'values': [3.04, 60.0]},
    }
    runs = [{'outcome': 'passed'}, {'outcome': 'expectations not met'}]
    assert cells({'runs': runs, 'metrics': metrics}) == ['1.2 / 0.13 / 3.0', '– / 2.00 / 60.0 ✗']


def test_a_range_is_one_value_if_all_are_equal():
    assert controllers._range([5.93, 5.94], 1) == '5.9'
    assert controllers._range([9.4, 9.9, 10.2], 1) == '9.4 to 10.2'
    assert controllers._range([None, 1.0], 1) == '– to 1.0'
