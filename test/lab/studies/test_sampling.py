"""Samples of studies: the same for the same seed, whatever the parts; and well distributed."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given, settings
from scipy import stats
from scipy.stats import qmc

from ballbot_ros.lab.studies.reader import MAX_SEED, read_study
from ballbot_ros.lab.studies.sampling import Sampler, seeds_of_runs
from ballbot_ros.lab.studies.study import grid_shape

VARY = """
vary:
  plant_sim.body_mass: {uniform: [0.6, 0.8]}
  plant_sim.ball_friction: {log_uniform: [1.0e-4, 1.0e-2]}
  gyro_driver.noise: {normal: [0.7, 0.2], min: 0.0, max: 1.5}
  plant_sim.plant_model: {list: [linear, nonlinear]}
  plant_sim.actuator_delay: {uniform: [0, 7]}
  push.1.force: {uniform: [0.0, 20.0]}
  push.2.direction: {uniform: [-180.0, 180.0]}
"""
LAWS = {
    'plant_sim.body_mass': stats.uniform(0.6, 0.2),
    'plant_sim.ball_friction': stats.loguniform(1e-4, 1e-2),
    'gyro_driver.noise': stats.truncnorm(-3.5, 4.0, 0.7, 0.2),
    'push.1.force': stats.uniform(0.0, 20.0),
    'push.2.direction': stats.uniform(-180.0, 360.0),
}
DRAWN = ('random', 'latin_hypercube', 'sobol', 'halton')
GRID = """
sampling: grid
repeats: 3
vary:
  plant_sim.backlash: {grid: [0.0, 0.3, 4]}
  plant_sim.plant_model: {list: [linear, nonlinear]}
  plant_sim.actuator_delay: {grid: [0, 8, 3]}
"""


@pytest.fixture(scope='module')
def study_of(tmp_path_factory):
    folder = tmp_path_factory.mktemp('studies')

    def study(text, **options):
        path = folder / 'mine.yaml'
        path.write_text(f'purpose: x\nscenario: push\n{text}')
        return read_study(str(path), **options)

    return study


@pytest.fixture(scope='module')
def studies(study_of):
    """A study of 500 runs for each sampling, and a grid."""
    drawn = {each: study_of(f'runs: 500\nsampling: {each}{VARY}') for each in DRAWN}
    return {**drawn, 'grid': study_of(GRID)}


def columns(samples):
    return {**samples.values, **samples.events}


def assert_equal(one, other):
    assert one.keys() == other.keys()
    for name, column in one.items():
        np.testing.assert_array_equal(column, other[name], err_msg=name)


@settings(max_examples=25)
@given(
    st.sampled_from((*DRAWN, 'grid')),
    st.lists(st.integers(0, 72), min_size=2, max_size=6),
)
def test_parts_are_equal_to_the_whole_in_any_order(studies, sampling, places):
    study = studies[sampling]
    whole = columns(Sampler(study).part(0, 72))
    sampler = Sampler(study)
    for one, other in pairwise(places):
        first, last = sorted((one, other))
        part = sampler.part(first, last)
        assert part.count == last - first
        assert_equal(columns(part), {name: each[first:last] for name, each in whole.items()})


@pytest.mark.parametrize('sampling', DRAWN)
def test_the_seed_decides(study_of, sampling):
    text = f'runs: 100\nsampling: {sampling}{VARY}'
    one, same, other = (
        columns(Sampler(study_of(text, seed=seed)).part(0, 100)) for seed in (5, 5, 6)
    )
    assert_equal(one, same)
    for name in (*LAWS, 'plant_sim.seed'):
        assert (one[name] != other[name]).all(), name


@pytest.mark.parametrize('sampling', ['random', 'sobol', 'halton'])
def test_a_run_is_the_same_whatever_the_number_of_runs(studies, study_of, sampling):
    more = study_of(f'runs: 1000000\nsampling: {sampling}{VARY}')
    few = columns(Sampler(studies[sampling]).part(100, 110))
    assert_equal(columns(Sampler(more).part(100, 110)), few)


@pytest.mark.parametrize('sampling', ['random', 'sobol', 'halton'])
def test_late_parts_need_none_before(study_of, sampling):
    study = study_of(f'runs: 1000000\nsampling: {sampling}{VARY}')
    first, last = 999_900, 1_000_000
    late = columns(Sampler(study).part(first, last))
    sampler = Sampler(study)
    sampler.part(0, 10)
    assert_equal(late, columns(sampler.part(first, last)))


@pytest.mark.parametrize('sampling', DRAWN)
def test_each_variable_has_its_distribution(studies, sampling):
    drawn = columns(Sampler(studies[sampling]).part(0, 500))
    for name, law in LAWS.items():
        assert stats.kstest(drawn[name], law.cdf).pvalue > 0.01, name
    counts = np.bincount(drawn['plant_sim.actuator_delay'], minlength=8)
    assert stats.chisquare(counts).pvalue > 0.01
    words = np.unique(drawn['plant_sim.plant_model'], return_counts=True)
    assert words[0].tolist() == ['linear', 'nonlinear']
    assert stats.chisquare(words[1]).pvalue > 0.01


@pytest.mark.parametrize('sampling', DRAWN)
def test_the_variables_are_independent(studies, sampling):
    drawn = columns(Sampler(studies[sampling]).part(0, 500))
    table = np.array([drawn[name] for name in LAWS])
    off_diagonal = np.corrcoef(table) - np.eye(len(LAWS))
    # Three standard errors of the correlation of independent numbers.
    assert np.abs(off_diagonal).max() < 3.0 / np.sqrt(500)


def test_the_sequences_fill_space_better_than_random_numbers(studies):
    discrepancy = {}
    for sampling in DRAWN:
        drawn = columns(Sampler(studies[sampling]).part(0, 256))
        shares = np.array([law.cdf(drawn[name]) for name, law in LAWS.items()]).T
        discrepancy[sampling] = qmc.discrepancy(np.clip(shares, 0.0, 1.0))
    for sampling in ('sobol', 'halton'):
        assert discrepancy[sampling] < 0.5 * discrepancy['random'], sampling


def test_a_latin_hypercube_has_a_value_in_each_stratum(studies):
    drawn = columns(Sampler(studies['latin_hypercube']).part(0, 500))
    for name, law in LAWS.items():
        strata = np.floor(law.cdf(drawn[name]) * 500).astype(int)
        # A value at the very edge of its stratum may be counted in the next one.
        assert len(np.unique(strata)) >= 495, name


def test_a_grid_has_all_combinations_and_repeats_them_with_other_seeds(studies):
    study = studies['grid']
    assert (math.prod(grid_shape(study.variables)), study.runs) == (24, 72)
    drawn = columns(Sampler(study).part(0, 72))
    names = ('plant_sim.backlash', 'plant_sim.plant_model', 'plant_sim.actuator_delay')
    rows = list(zip(*(drawn[name].tolist() for name in names), strict=True))
    assert len(set(rows)) == 24
    assert rows[:24] == rows[24:48] == rows[48:]
    assert [row[2] for row in rows[:4]] == [0, 4, 8, 0]
    np.testing.assert_allclose(np.unique(drawn['plant_sim.backlash']), [0.0, 0.1, 0.2, 0.3])
    assert len(set(drawn['plant_sim.seed'].tolist())) == 72


@pytest.mark.parametrize('sampling', [*DRAWN, 'grid'])
def test_only_the_seed_may_vary(study_of, sampling):
    runs = 'repeats: 50' if sampling == 'grid' else 'runs: 50'
    samples = Sampler(study_of(f'{runs}\nsampling: {sampling}\n')).part(10, 50)
    assert samples.count == 40
    assert list(samples.values) == ['plant_sim.seed']
    np.testing.assert_array_equal(samples.values['plant_sim.seed'], seeds_of_runs(1, 10, 50))


@given(st.integers(0, MAX_SEED), st.integers(0, 10**9))
def test_seeds_are_whole_numbers_of_53_bits(seed, run):
    seeds = seeds_of_runs(seed, run, run + 3)
    assert seeds.dtype == np.int64
    assert ((seeds >= 0) & (seeds < 2**53)).all()
    assert len(set(seeds.tolist())) == 3


def test_seeds_are_drawn_unless_given(study_of):
    vary = 'runs: 5\nvary: {gyro_driver.seed: {uniform: [1, 9]}}\n'
    assert list(Sampler(study_of(vary)).part(0, 5).values) == ['gyro_driver.seed']
    fixed = 'parameters: {plant_sim: {seed: 5}}\nvary: {plant_sim.backlash: {uniform: [0, 0.1]}}\n'
    assert list(Sampler(study_of(f'runs: 5\n{fixed}')).part(0, 5).values) == ['plant_sim.backlash']
