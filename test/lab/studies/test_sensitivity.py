"""Sensitivity indices are those of functions with known ones."""

import sys

import numpy as np
import pytest
from laws import refusal

pytest.importorskip('SALib')

from scipy.stats import qmc

from ballbot_ros.errors import MissingExtraError
from ballbot_ros.lab.studies import sensitivity
from ballbot_ros.lab.studies.sensitivity import MIN_SAMPLE, analyse

RUNS = 4096


def cube(dimensions, runs=RUNS, seed=1):
    return qmc.Sobol(dimensions, rng=np.random.default_rng(seed)).random(runs).T


def test_the_ishigami_function():
    """The third variable explains nothing on its own, but PAWN sees what it does."""
    a, b = 7.0, 0.1
    x = (2.0 * cube(4) - 1.0) * np.pi
    result = np.sin(x[0]) + a * np.sin(x[1]) ** 2 + b * x[2] ** 4 * np.sin(x[0])
    total = a**2 / 8 + b * np.pi**4 / 5 + b**2 * np.pi**8 / 18 + 0.5
    expected = [0.5 * (1 + b * np.pi**4 / 5) ** 2 / total, a**2 / 8 / total, 0.0, 0.0]
    found = analyse(dict(zip('abcd', x, strict=True)), {'result': result}, 1)
    np.testing.assert_allclose(found.first_order[:, 0], expected, atol=0.02)
    assert (np.abs(found.first_order[:, 0] - expected) < 2.0 * found.half_width[:, 0]).all()
    pawn, floor = found.pawn[:, 0], found.floor[0]
    assert pawn[:3].min() > 2.0 * floor
    assert pawn[3] < 1.5 * floor


def test_a_linear_function_of_words_whole_numbers_and_switches():
    """With noise; its indices are the shares of the variance."""
    x = cube(3)
    words = np.array(['low', 'mid', 'top'])[(3 * x[0]).astype(int)]
    whole = (5 * x[1]).astype(int)
    switch = np.where(x[2] < 0.5, 'false', 'true')
    noise = np.random.default_rng(2).normal(0.0, 1.0, RUNS)
    # The order of the words is not that of their effects.
    effect = {'low': 0.0, 'mid': 3.0, 'top': 1.0}
    result = np.array([effect[each] for each in words]) + whole + 2.0 * (switch == 'true') + noise
    parts = np.array([14.0 / 9.0, 2.0, 1.0])
    found = analyse({'words': words, 'whole': whole, 'switch': switch}, {'result': result}, 1)
    np.testing.assert_allclose(found.first_order[:, 0], parts / (parts.sum() + 1.0), atol=0.03)


def test_levels_of_a_grid_do_not_take_effects_from_each_other():
    """The rows of a grid are in the order of all its variables."""
    a, b = (each.ravel() for each in np.meshgrid(np.arange(3), np.arange(200), indexing='ij'))
    found = analyse({'a': a, 'b': b}, {'result': b.astype(float)}, 1)
    np.testing.assert_allclose(found.first_order[:, 0], [0.0, 1.0], atol=0.05)


def test_passing_ranks_the_variables():
    x = cube(3)
    passed = x[2] + 0.3 * x[0] < 0.7
    found = analyse(dict(zip('abc', x, strict=True)), {'noise': cube(1)[0], 'passed': passed}, 1)
    assert list(np.argsort(-found.influence())) == [2, 0, 1]
    always = analyse(dict(zip('abc', x, strict=True)), {'x': x[1], 'passed': passed | True}, 1)
    assert np.argmax(always.influence()) == 1
    assert np.isnan(always.first_order[:, 1]).all()


def test_runs_without_a_value_are_left_out_and_counted():
    x = cube(2)
    result = x[0].copy()
    result[::2] = np.nan
    result[1] = np.inf
    few = np.where(np.arange(RUNS) < MIN_SAMPLE - 1, x[0], np.nan)
    found = analyse({'a': x[0], 'b': x[1]}, {'result': result, 'few': few}, 1)
    assert found.counts.tolist() == [RUNS // 2 - 1, MIN_SAMPLE - 1]
    assert found.first_order[0, 0] > 0.98
    assert np.isnan(found.first_order[:, 1]).all()
    assert np.isnan(found.pawn[:, 1]).all()


def test_the_same_seed_gives_the_same_indices():
    x = cube(2)
    first, second = (analyse({'a': x[0]}, {'r': x[0] + x[1]}, 2**62) for _ in range(2))
    np.testing.assert_array_equal(first.half_width, second.half_width)
    np.testing.assert_array_equal(first.pawn, second.pawn)


def test_without_salib_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'SALib.analyze', None)
    text = refusal(MissingExtraError, sensitivity.analyse, {}, {}, 1)
    assert text.endswith('install it with `pip install "ballbot_ros[study]"`')
