"""What a tuning is for: costs of candidates, limits, and runs without a value."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.lab.search.objective import DEAD_TIME_MARGIN, INFEASIBLE, Limit, Objective
from ballbot_ros.lab.studies.columns import FALLEN, OUTCOME, MeasureColumn

PITCH, DUTY, UPRIGHT = 'peak_pitch_deg', 'duty_rms_percent', 'upright'
MEASURES = (
    MeasureColumn(PITCH),
    MeasureColumn(DUTY),
    MeasureColumn(UPRIGHT, minimum=0.0),  # the robustness of a property
)


def judged(objective, margins=None, fallen=None, failed=None, **values):
    """Judge candidates, given the values of measures, a row for each candidate."""
    columns = {name: np.array(each, float) for name, each in values.items()}
    shape = next(iter(columns.values())).shape
    for name in {PITCH, DUTY, UPRIGHT} - set(columns):
        columns[name] = np.zeros(shape)
    for name, given_ in ((FALLEN.name, fallen), (OUTCOME.name, failed)):
        columns[name] = np.zeros(shape, bool) if given_ is None else np.array(given_, bool)
    return objective.judge(MEASURES, columns, margins)


def objective(weights=None, share=None, *limits):
    return Objective(weights or {PITCH: 1.0}, share, limits)


def test_mean_quantile_and_worst_case():
    runs = [[*range(1, 101)]]
    for share, over, value in (
        (None, 'mean', 50.5),
        (0.95, '95 % quantile', 96.0),
        (1.0, 'worst', 100.0),
    ):
        of = objective(share=share)
        verdict = judged(of, peak_pitch_deg=runs)
        assert (of.over, verdict.value.tolist(), verdict.cost.tolist()) == (over, [value], [value])
        assert verdict.is_feasible.all()
        assert verdict.limits.shape == (1, 0)


def test_weights_add_measures_and_a_robustness_counts_with_the_other_sign():
    of = objective({PITCH: 2.0, UPRIGHT: 0.5}, 1.0)
    verdict = judged(of, peak_pitch_deg=[[1.0, 2.0]], upright=[[4.0, 4.0]])
    assert verdict.value.tolist() == [2.0 * 2.0 - 0.5 * 4.0]


def test_a_run_without_a_value_breaks_what_the_objective_tolerates():
    """The mean and the worst case tolerate none, a quantile the rest of the runs."""
    values = np.ones((1, 20))
    for lost in range(20):
        gone = np.arange(20)[None] < lost
        for share, tolerated in ((None, 0), (1.0, 0), (0.9, 2)):
            verdict = judged(objective(share=share), fallen=gone, peak_pitch_deg=values)
            assert verdict.lost.tolist() == [lost / 20]
            assert verdict.is_feasible.tolist() == [lost <= tolerated], (lost, share)
    for which in ({'fallen': [[1, 0]]}, {'failed': [[1, 0]]}, {'peak_pitch_deg': [[math.nan, 1]]}):
        given_ = {'peak_pitch_deg': [[1.0, 1.0]], **which}
        assert judged(objective(), **given_).lost.tolist() == [0.5]


def test_a_quantile_gains_nothing_by_runs_without_a_value():
    runs = np.arange(1.0, 101.0)[None]
    falls = runs > 97.0
    kept, lost = (
        judged(objective(share=0.95), fallen=fallen, peak_pitch_deg=runs)
        for fallen in (None, falls)
    )
    assert lost.value.tolist() == kept.value.tolist() == [96.0]
    assert lost.is_feasible.all()


def test_candidates_that_break_a_limit_are_the_worse_the_farther_they_do():
    of = objective(None, 1.0, Limit(DUTY, maximum=50.0), Limit(UPRIGHT, minimum=0.0))
    verdict = judged(
        of,
        peak_pitch_deg=[[9.0], [1.0], [1.0], [1.0], [1.0]],
        duty_rms_percent=[[50.0], [51.0], [99.0], [10.0], [math.nan]],
        upright=[[0.0], [1.0], [1.0], [-1.0], [1.0]],
    )
    assert verdict.is_feasible.tolist() == [True, False, False, False, False]
    assert np.argsort(verdict.cost, kind='stable').tolist() == [0, 1, 2, 3, 4]
    assert verdict.value.tolist() == [9.0, 1.0, 1.0, 1.0, 1.0]
    assert verdict.limits[:, 0].tolist()[:4] == [50.0, 51.0, 99.0, 10.0]


def test_a_limit_is_over_the_runs_as_the_objective_is():
    """Of a minimum the worst are the smallest values."""
    duty = [[10.0, 20.0, 60.0]]
    for share, limit, value in (
        (None, Limit(DUTY, maximum=50.0), 30.0),
        (1.0, Limit(DUTY, maximum=50.0), 60.0),
        (1.0, Limit(DUTY, minimum=15.0), 10.0),
        (0.5, Limit(DUTY, minimum=15.0), 20.0),
    ):
        verdict = judged(objective(None, share, limit), peak_pitch_deg=[[1, 1, 1]], **{DUTY: duty})
        assert verdict.limits.tolist() == [[value]]
        assert verdict.is_feasible.tolist() == [value <= 50.0 if limit.maximum else value >= 15.0]


def test_the_dead_time_margin_is_that_of_the_candidate():
    of = objective(None, None, Limit(DEAD_TIME_MARGIN, minimum=5.0))
    margins = np.array([4.9, 5.0, math.nan, math.inf])
    verdict = judged(of, margins, peak_pitch_deg=np.ones((4, 2)))
    assert verdict.is_feasible.tolist() == [False, True, False, True]
    assert np.array_equal(verdict.limits[:, 0], margins, equal_nan=True)


@pytest.mark.filterwarnings('error')
def test_large_values_break_no_limit_unless_they_are_no_numbers():
    verdict = judged(objective({PITCH: 1e9}), peak_pitch_deg=[[1e6], [1e300], [math.inf]])
    assert verdict.is_feasible.tolist() == [True, False, False]
    assert verdict.value[0] == 1e15
    assert verdict.lost.tolist() == [0.0, 1.0, 1.0]


numbers = st.floats(-1e6, 1e6) | st.just(math.nan)
rows = st.integers(1, 6).flatmap(
    lambda runs: st.lists(
        st.lists(st.tuples(numbers, numbers, st.booleans()), min_size=runs, max_size=runs),
        min_size=1,
        max_size=4,
    )
)


@pytest.mark.filterwarnings('error')
@given(rows, st.sampled_from([None, 0.5, 0.9, 1.0]), st.floats(-1e3, 1e3))
def test_laws_of_verdicts(candidates, share, bound):
    table = np.array(candidates, float)
    pitch, duty, fallen = np.moveaxis(table, 2, 0)
    columns = {'fallen': fallen, PITCH: pitch, DUTY: duty}
    of = objective({PITCH: 1.0, DUTY: 0.5}, share, Limit(DUTY, maximum=bound))
    verdict = judged(of, **columns)
    assert not np.isnan(verdict.cost).any()
    feasible = verdict.is_feasible
    assert (verdict.cost[feasible] == verdict.value[feasible]).all()
    assert (verdict.cost[~feasible] >= INFEASIBLE).all()
    assert (verdict.limits[feasible, 0] <= bound).all()
    assert (np.isnan(verdict.value) == (verdict.lost == 1.0)).all()
    # Neither the order of the runs nor the other candidates matter.
    order = np.random.default_rng(1).permutation(pitch.shape[1])
    alone = judged(of, **{name: each[:1, order] for name, each in columns.items()})
    np.testing.assert_allclose(alone.cost[0], verdict.cost[0], rtol=1e-9)
    # A robot that is worse does not make a candidate better.
    worse = judged(of, **{**columns, PITCH: pitch + 1.0})
    assert (worse.cost >= verdict.cost - 1e-6 * np.abs(verdict.cost)).all()


def test_the_measures_are_metrics():
    assert {PITCH, DUTY} <= set(METRICS)
