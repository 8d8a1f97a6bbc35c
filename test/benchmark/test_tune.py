"""The experiments of docs/tuning.md, cut short: each still runs and prints its table."""

import pytest
from click.testing import CliRunner

from benchmark import challenge, commissioning, redesign, search, tune

ROWS = {
    'speed': 3,
    'drive': 5,
    'track': 8,
    'gains': 2,
    'stand': 1,
    'redesign': 2,
    'searches': 2,
    'challenge': 9,
    'commissioning': 8,
}


@pytest.mark.parametrize('name', tune.EXPERIMENTS)
def test_an_experiment_prints_its_table(monkeypatch, name):
    for constant in ('DRIVE_S', 'STEP_S', 'STAND_S'):
        monkeypatch.setattr(tune, constant, 2.5)
    monkeypatch.setattr(tune, 'TRACK_S', 0.004)
    monkeypatch.setattr(tune, 'SEEDS', [1])
    monkeypatch.setattr(redesign, 'LOW_PASSES', [0.95])
    monkeypatch.setattr(redesign, 'VOLTAGE_WEIGHTS', [3.0])
    monkeypatch.setattr(redesign, 'scenario_names', lambda: ['stationary'])
    monkeypatch.setattr(redesign, 'QUIETEST', ('stationary', 'push'))  # short ones
    monkeypatch.setattr(redesign, 'STEP_DEG', 2.0)
    for constant, short in (
        ('SEEDS', 1), ('CANDIDATES', 8), ('ROBOTS', 1), ('BUDGET', 32),
        ('TUNINGS', [('quiet', 'python')]), ('FALSIFICATIONS', ['full_stick']),
    ):  # fmt: skip
        monkeypatch.setattr(search, constant, short)
    monkeypatch.setattr(challenge, 'scenario_names', lambda: ['stationary'])
    monkeypatch.setattr(challenge, 'ROBOTS', 4)
    monkeypatch.setattr(commissioning, 'ROBOTS', 1)
    short = {'rest_time': 61.0, 'step_time': 0.06, 'play_time': 0.06, 'tilt_time': 0.02}
    monkeypatch.setattr(commissioning, 'DURATIONS', short)
    result = CliRunner().invoke(tune.tune, [name])
    assert result.exception is None, result.output
    table = [line for line in result.output.splitlines() if line.startswith('|')]
    assert len(table) == 2 + ROWS[name]
    assert len({line.count(' | ') for line in table}) == 1


def test_the_option_of_the_identification_is_refused_for_other_experiments():
    result = CliRunner().invoke(tune.tune, ['stand', '--fine'])
    assert result.exit_code == 2
    assert '--fine is for identification only' in result.output
