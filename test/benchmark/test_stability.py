"""Stability over gain and dead time: what the model predicts is what runs show."""

import math

import numpy as np
import pytest
from click.testing import CliRunner

from ballbot_ros.design.state_feedback import DesignError
from ballbot_ros.parameters import CONTROLLER, ParameterSet
from benchmark import maps, stability, tune
from benchmark.stability import Cell, Grid

NEAR = (0.95, 0.98, 1.02, 1.05)
LOWEST, HIGHEST = 0.4, 1.4


@pytest.mark.parametrize('delay_ms', [0, 1, 3, 4, 7, 8, 12])
def test_close_to_its_limits_the_loop_without_rounding_is_as_stable_as_predicted(delay_ms):
    parameters = ParameterSet()
    limits = stability.gain_limits(parameters, delay_ms, LOWEST, HIGHEST)
    assert limits.size
    for gain in np.outer(limits, NEAR).ravel():
        (predicted,) = stability.growth(parameters, np.array([gain]), delay_ms) < 1.0
        assert stability.is_stable(parameters, gain, delay_ms) == predicted, gain


def test_a_map_goes_beyond_the_margins():
    layout = stability.grid(ParameterSet(), 10, 4)
    np.testing.assert_allclose(layout.gains, np.linspace(0.4, 1.3, 10))
    np.testing.assert_array_equal(layout.delays_ms, [0, 4, 8, 12])


def test_a_map_of_an_unstable_loop_is_refused():
    parameters = ParameterSet()
    parameters.set(CONTROLLER, 'pwm_gain', 1.2)
    with pytest.raises(DesignError, match=r'^[^\n]*unstable[^\n]*$'):
        stability.grid(parameters, 10, 4)


def test_the_gain_is_relative_to_that_of_the_parameters():
    parameters = ParameterSet()
    (low, high) = stability.gain_limits(parameters, 0, LOWEST, HIGHEST)
    parameters.set(CONTROLLER, 'pwm_gain', 0.8)
    np.testing.assert_allclose(
        stability.gain_limits(parameters, 0, 0.5, 1.5), [low / 0.8, high / 0.8], rtol=1e-4
    )
    assert stability.is_stable(parameters, 1.2, 0)
    assert not stability.is_stable(parameters, 1.4, 0)


def test_rounding_keeps_a_stable_loop_moving(monkeypatch):
    monkeypatch.setattr(stability, 'RUN_S', 15.0)
    parameters = ParameterSet()
    nominal = stability.rounded_run(parameters, 1.0, 0)
    assert 2.0 < nominal.duty_rms < 10.0
    assert nominal.saturated == 0.0
    near_the_lower_limit = stability.rounded_run(parameters, 0.54, 0)
    assert near_the_lower_limit.duty_rms > 2.0 * nominal.duty_rms
    ringing = stability.rounded_run(parameters, 1.1, 0)
    assert ringing.saturated > 0.5
    assert stability.rounded_run(parameters, 0.4, 0).fell


def cell(gain, predicted, measured):
    return Cell(gain, 0, predicted, measured, math.nan, math.nan, math.nan, fell=True)


def test_a_difference_is_tolerable_only_close_to_a_limit():
    parameters = ParameterSet()
    for gain, predicted, tolerable in (
        (1.01, True, True),
        (1.09, False, True),
        (0.98, True, False),
        (1.12, False, False),
        (0.54, True, True),
        (0.49, False, False),
    ):
        found = stability.is_tolerable(parameters, cell(gain, predicted, not predicted))
        assert found == tolerable, gain


def test_the_distance_is_that_from_the_nearest_limit():
    limits = np.array([0.5, 1.0])
    for gain, is_stable, inside, is_upper in (
        (0.45, False, -0.1, False),
        (0.55, True, 0.1, False),
        (0.9, True, 0.1, True),
        (1.2, False, -0.2, True),
    ):
        found = stability.distance(cell(gain, is_stable, is_stable), limits)
        assert found == (pytest.approx(inside), is_upper)


def test_intervals_are_those_of_neighbours_that_are_stable():
    gains = [1.0, 2.0, 3.0, 4.0]
    assert stability.intervals(gains, [True, False, True, True]) == [(1.0, 1.0), (3.0, 4.0)]
    assert stability.intervals(gains, [False] * 4) == []


def test_the_experiment_prints_its_tables_and_writes_its_picture(monkeypatch, tmp_path):
    layout = Grid(np.array([0.45, 1.0, 1.2]), np.array([0, 4]))
    monkeypatch.setattr(maps, 'grid', lambda *_: layout)
    monkeypatch.setattr(stability, 'RUN_S', 10.0)
    result = CliRunner().invoke(tune.tune, ['stability', '--output', str(tmp_path)])
    assert result.exception is None, result.output
    assert '| 0 ms | 0.523 … 1.051 | 1 … 1 | 0 |' in result.output
    assert '0 of 6 cells differ' in result.output
    assert (tmp_path / 'stability.png').read_bytes().startswith(b'\x89PNG')
    assert len((tmp_path / 'stability.csv').read_text().splitlines()) == 1 + 6


def test_options_of_the_maps_are_refused_for_other_experiments():
    result = CliRunner().invoke(tune.tune, ['stand', '--fine'])
    assert result.exit_code == 2
    assert 'stability, basin, identification only' in result.output
    result = CliRunner().invoke(tune.tune, ['identification', '--output', 'x'])
    assert 'stability and basin only' in result.output
