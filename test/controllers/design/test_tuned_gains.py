"""The gains of config/gains/tuned.yaml: what their search promises."""

from dataclasses import replace
from pathlib import Path

import pytest

import ballbot_ros as bb
from ballbot_ros.engine.scenario.reader import scenario_names
from ballbot_ros.lab.search.tuning import read_tuning
from ballbot_ros.lab.studies.execution import StudyObserver, run_study
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.study_data import StudyData

TUNED = Path(__file__).parents[3] / 'config/gains/tuned.yaml'


@pytest.mark.parametrize('name', scenario_names())
def test_every_scenario_passes(name):
    run = bb.simulate(name, parameters=TUNED)
    assert run.passed, run.reason


def test_others_are_much_better(tmp_path):
    pytest.importorskip('numba')
    pitch, objective = [], []
    for name, parameter_file in (('quiet', None), ('tuned', TUNED)):
        tuning = read_tuning('quiet', parameter_file=parameter_file)
        study = replace(tuning.studies[0], runs=512, seed=99)
        run_study(job_of(study, tmp_path / name), StudyObserver())
        rows = StudyData.open(tmp_path / name).frame()
        assert not rows['fallen'].any()
        pitch.append(rows['steady_pitch_rms_deg'].max())
        weights = tuning.objective.weights
        objective.append(sum(weight * rows[each] for each, weight in weights.items()).max())
    assert pitch[1] < 0.6 * pitch[0]
    assert objective[1] < 0.85 * objective[0]
