"""What chooses the points of a search: laws of both methods, and what CMA-ES is better at."""

import math
import sys

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given, settings

from ballbot_ros.errors import MissingExtraError
from ballbot_ros.lab.search.optimiser import Method, RandomSearch, optimiser_of

POPULATION, STEP = 8, 0.3


def searched(method, cost, start, generations, *, seed=(1,), population=POPULATION, steps=None):
    """Return the points of a search, (generations, n, d)."""
    start = np.array(start)
    steps = np.zeros(len(start)) if steps is None else np.array(steps)
    optimiser = optimiser_of(method, start, population, seed, steps, STEP)
    points = []
    for _ in range(generations):
        points.append(optimiser.ask())
        optimiser.tell(cost(points[-1]))
    return np.array(points)


def distance(points):
    """The squared distance from a point, which is the least at 0.3, with a valley."""
    scaled = (points - 0.3) * np.logspace(0.0, 1.0, points.shape[1])
    return (scaled**2).sum(axis=1)


COSTS = {
    'distance': distance,
    'constant': lambda points: np.ones(len(points)),
    'steps': lambda points: np.floor(points * 4.0).sum(axis=1),
    'beyond a wall': lambda points: np.where(points[:, 0] > 0.5, 1e100, distance(points)),
    'only walls': lambda points: 1e100 * (1.0 + distance(points)),
    'infinite': lambda points: np.full(len(points), math.inf),
}


@pytest.mark.parametrize('method', Method)
@pytest.mark.parametrize('cost', COSTS.values(), ids=COSTS)
@pytest.mark.filterwarnings('error')
def test_points_are_within_the_unit_cube_and_begin_with_the_start(method, cost):
    for start in ([0.9], [0.0, 1.0 - 2.0**-53], [0.2, 0.5, 0.7]):
        points = searched(method, cost, start, 12)
        assert points.shape == (12, POPULATION, len(start))
        assert (points >= 0.0).all()
        assert (points < 1.0).all()
        assert points[0, 0].tolist() == start


@given(
    st.sampled_from(list(Method)),
    st.integers(0, 2**63),
    st.integers(1, 4),
    st.integers(2, 20),
)
@settings(max_examples=8)
def test_the_same_costs_lead_to_the_same_points(method, seed, count, population):
    start, options = [0.5] * count, {'seed': (seed, count), 'population': population}
    np.random.seed(seed % 2**32)  # noqa: NPY002
    one = searched(method, distance, start, 5, **options)
    global_numbers = np.random.get_state()[1].tolist()  # noqa: NPY002
    np.random.seed(3)  # noqa: NPY002
    assert (searched(method, distance, start, 5, **options) == one).all()
    other = searched(method, distance, start, 5, **{**options, 'seed': (seed + 1, count)})
    assert (other[0, 1:] != one[0, 1:]).any()
    np.random.seed(seed % 2**32)  # noqa: NPY002
    assert np.random.get_state()[1].tolist() == global_numbers  # noqa: NPY002


@pytest.mark.parametrize('count', [1, 2, 5])
def test_cma_is_better_than_chance(count):
    best = {
        method: distance(searched(method, distance, [0.9] * count, 60).reshape(-1, count)).min()
        for method in Method
    }
    assert best[Method.CMA] < 1e-2 * best[Method.RANDOM]


def test_random_points_do_not_depend_on_costs():
    one, other = (
        searched(Method.RANDOM, cost, [0.5, 0.5], 5) for cost in (distance, COSTS['constant'])
    )
    assert (one == other).all()
    random = optimiser_of(Method.RANDOM, np.zeros(2), 4, (1,), np.zeros(2), STEP)
    assert isinstance(random, RandomSearch)


def test_a_search_that_has_converged_begins_elsewhere():
    points = searched(Method.CMA, distance, [0.9, 0.9], 150)
    spread = points.std(axis=1).max(axis=1)
    converged = int(np.argmax(spread < 1e-4))
    assert converged
    assert spread[converged:].max() > 0.05


def test_discrete_values_do_not_freeze():
    steps = [0.3 / 4.0, 0.3 / 4.0]
    points = searched(Method.CMA, COSTS['constant'], [0.5, 0.5], 60, steps=steps)
    assert len(np.unique(np.floor(points[-10:] * 4.0))) > 1


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, 'cma', None)
    with pytest.raises(MissingExtraError, match='cma'):
        searched(Method.CMA, distance, [0.5], 1)
    searched(Method.RANDOM, distance, [0.5], 1)
