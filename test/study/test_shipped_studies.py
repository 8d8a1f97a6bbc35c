"""The shipped studies."""

import numpy as np
import pytest

from ballbot_ros.run.spec import RunSpec
from ballbot_ros.study.library import read_study, study_names
from ballbot_ros.study.runs import CompiledSimulator
from ballbot_ros.study.sampling import Sampler
from ballbot_ros.study.study import Sampling

RUNS = 24


def test_the_studies_are_shipped():
    assert study_names() == ['basin', 'delay_and_gain', 'robustness', 'sensitivity']


@pytest.mark.parametrize('name', study_names())
def test_a_shipped_study_has_cases_that_pass_and_cases_that_fail(name):
    study = read_study(name)
    assert study.name == name
    assert 5000 <= study.runs <= 20_000
    # Spread over the whole study, in order.
    whole = Sampler(study).part(0, study.runs)
    chosen = np.linspace(0, study.runs - 1, RUNS).astype(int)
    if study.sampling is Sampling.GRID:
        chosen = np.random.default_rng(1).permutation(study.runs)[:RUNS]
    columns = {each: column[chosen] for each, column in whole.values.items()}
    results = CompiledSimulator(study.spec, study.measures).simulate(study.samples(columns))
    passed = ~results.failed
    for each in study.expectations:
        values = results.measured[:, study.measures.index(each.measure)]
        passed &= [each.holds(value) for value in values]
    assert 0 < passed.sum() < RUNS
    assert len({each.tobytes() for each in results.duty_sha256}) == RUNS


def test_every_study_is_a_run_of_a_shipped_scenario():
    for name in study_names():
        study = read_study(name)
        assert RunSpec.of_scenario(study.scenario, study.options).parameters is not None
