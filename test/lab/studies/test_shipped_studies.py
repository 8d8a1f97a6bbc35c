"""The shipped studies."""

from dataclasses import replace

import numpy as np
import pytest
from study_reruns import rerun_of

from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.engine.scenario.writer import scenario_data
from ballbot_ros.lab.studies.events import fault_values
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.reader import read_studies, read_study, study_names
from ballbot_ros.lab.studies.runs import scenarios_of_runs, simulator_for
from ballbot_ros.lab.studies.sampling import Sampler
from ballbot_ros.lab.studies.study import Sampling
from ballbot_ros.parameters import ROBOT_CLASSES
from ballbot_ros.parameters.yaml_document import yaml_text

RUNS = 24


def test_the_studies_are_shipped():
    assert study_names() == [
        'basin', 'clock', 'delay_and_gain', 'failsafe', 'link_phase', 'mechanism', 'robustness',
        'sensitivity', 'task_costs',
    ]  # fmt: skip


@pytest.mark.parametrize('name', study_names())
def test_a_shipped_study_has_cases_that_pass_and_cases_that_fail(name):
    study, *others = read_studies(name)
    assert study.name.startswith(name)
    assert 4000 <= sum(each.runs for each in (study, *others)) <= 20_000
    # Spread over the whole study, in order.
    whole = Sampler(replace(study, redesign=None)).part(0, study.runs)
    chosen = np.linspace(0, study.runs - 1, RUNS).astype(int)
    if study.sampling is Sampling.GRID:
        chosen = np.random.default_rng(1).permutation(study.runs)[:RUNS]
    columns = {each: column[chosen] for each, column in {**whole.values, **whole.events}.items()}
    results = simulator_for(study.spec, study.measures).simulate(study.samples(columns))
    passed = ~results.failed
    for each in study.expectations:
        values = results.measured[:, study.measures.index(each.measure)]
        passed &= [each.holds(value) for value in values]
    assert 0 < passed.sum() < RUNS
    # Bricks that are off have the same duties.
    assert len({each.tobytes() for each in results.duty_sha256}) >= RUNS - 1


@pytest.mark.parametrize('name', study_names())
def test_a_run_of_a_shipped_study_can_be_a_scenario(name, tmp_path):
    study = read_study(name)
    samples = Sampler(study).part(5, 6)
    row = {each: column[0] for each, column in samples.values.items()}
    for scenario in scenarios_of_runs(study.spec, samples):
        row |= fault_values(scenario, study.spec.scenario)
    again = rerun_of(study, samples, 0, tmp_path)
    expected = with_values(study.spec.parameters, row)
    # The name of the scenario is that of the new file.
    expected.set('plant_sim', 'scenario', again.plant.scenario)
    path = tmp_path / 'base.yaml'
    for cls in ROBOT_CLASSES:
        assert again.parameters.of(cls) == expected.of(cls)
    path.write_text(yaml_text(scenario_data(*study.common_scenario)))
    assert load_scenario(str(path)).expectations == study.expectations
