"""Studies whose robots have gains designed for them."""

from dataclasses import replace

import numpy as np
import pytest
from graph import call
from html_pages import Page
from laws import refusal
from simulated_runs import assert_same, compiled_simulator, spec_of
from study_reruns import rerun_of

pytest.importorskip('pyarrow')
pytest.importorskip('SALib')

from ballbot_ros.controllers.design.redesign import Redesign
from ballbot_ros.engine.scenario.scenario import Measure
from ballbot_ros.errors import BallbotError
from ballbot_ros.lab.search.tuning import read_tuning
from ballbot_ros.lab.studies.execution import StudyObserver, run_study
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.report import study_report
from ballbot_ros.lab.studies.runs import OrdinarySimulator, Samples
from ballbot_ros.lab.studies.sampling import Sampler
from ballbot_ros.lab.studies.study import GAINS
from ballbot_ros.lab.studies.study_data import StudyData
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.run.execution import execute

MEASURES = [Measure('peak_pitch_deg'), Measure('duty_rms_percent')]
HEAD = (
    'purpose: x\nscenario: stationary\nruns: 3\nsampling: sobol\n'
    'parameters: {plant_sim: {duration: 3.0}}\nexpectations: {peak_pitch_deg: {max: 20.0}}\n'
)
BODIES = 'vary:\n  plant_sim.body_mass: {uniform: [0.4, 1.0]}\n'
DLQR = 'redesign: {method: dlqr, q: [1, 6.0e+5, 1, 1, 1.0e+3], r: 5000, delay: 2}\n'


@pytest.fixture
def study_of(tmp_path):
    def read(text, head=HEAD):
        path = tmp_path / 'mine.yaml'
        path.write_text(head + text)
        return read_study(str(path))

    return read


def gains_of(samples, run):
    return [float(samples.values[name][run]) for name in GAINS]


@pytest.mark.parametrize(
    ('text', 'options'),
    [
        ('redesign: lqr\n', ['--method', 'lqr']),
        (DLQR, ['--method', 'dlqr', '--q', '1,6e5,1,1,1e3', '--r', '5000', '--delay', '2']),
    ],
)
def test_the_gains_are_those_that_the_command_designs_for_the_robot(
    study_of, tmp_path, text, options
):
    study = study_of(text + BODIES)
    samples = Sampler(study).part(0, study.runs)
    assert len({tuple(gains_of(samples, run)) for run in range(3)}) == 3
    for run in range(3):
        file = tmp_path / f'{run}.yaml'
        mass = float(samples.values['plant_sim.body_mass'][run])
        done = call('design', '--set', f'plant_sim.body_mass={mass}', *options, '--output', file)
        assert done.returncode == 0, done.stderr
        designed = read_parameter_file(file).of(ControllerParameters)
        assert gains_of(samples, run) == [*designed.k_f, designed.k_i]


def test_a_run_is_the_single_run_with_these_gains(study_of):
    study = study_of('redesign: lqr\n' + BODIES)
    samples = Sampler(study).part(0, study.runs)
    results = compiled_simulator(study.spec, MEASURES).simulate(samples)
    assert_same(results, OrdinarySimulator(study.spec, MEASURES).simulate(samples))
    for run in range(3):
        *k_f, k_i = gains_of(samples, run)
        values = {name: column[run].item() for name, column in samples.values.items()}
        own = (
            f'plant_sim.body_mass={values["plant_sim.body_mass"]}',
            f'plant_sim.seed={values["plant_sim.seed"]}',
            f'controller.k_f={k_f}',
            f'controller.k_i={k_i}',
        )
        alone = OrdinarySimulator(spec_of('stationary', *own), MEASURES).simulate(Samples(1, {}))
        np.testing.assert_array_equal(results.duty_sha256[run], alone.duty_sha256[0])


def test_results_and_runs_once_more_have_the_gains(study_of, tmp_path):
    study = study_of('redesign: lqr\n' + BODIES + '  plant_sim.backlash: {uniform: [0, 0.1]}\n')
    folder = tmp_path / 'results'
    run_study(job_of(study, folder), StudyObserver())
    data = StudyData.open(folder)
    samples = Sampler(study).part(0, study.runs)
    for run in range(3):
        row = data.row(run)
        assert [row.varied[name] for name in GAINS] == gains_of(samples, run)
        spec = rerun_of(study, samples, run, tmp_path / str(run))
        assert execute(spec).duty_sha256 == row.duty_sha256
        written = spec.parameters.of(ControllerParameters)
        assert [*written.k_f, written.k_i] == gains_of(samples, run)
    # What is designed does not vary by itself.
    page = Page(study_report(data).page)
    assert 'designed for each robot: method lqr' in page.text
    assert 'No limits are predicted, since the gains are designed for each robot' in page.text
    assert 'plant_sim.body_mass' in page.text.partition('Measures')[2]
    assert 'share__controller' not in ' '.join(page.ids)


def test_a_robot_without_a_design_fails_and_the_others_do_not(study_of, tmp_path):
    study = study_of('redesign: lqr\nvary: {plant_sim.torque_constant: {list: [0.0, 0.317]}}\n')
    study = replace(study, runs=4)
    run_study(job_of(study, tmp_path / 'results'), StudyObserver())
    frame = StudyData.open(tmp_path / 'results').frame()
    weak = frame['plant_sim.torque_constant'] == 0.0
    assert weak.sum() == 2
    assert (frame[weak]['outcome'] == 'failed').all()
    assert (frame[weak][list(GAINS)] == 0.0).all(axis=None)
    assert frame[~weak]['passed'].all()


def test_equal_robots_are_designed_once(study_of, monkeypatch):
    designed = []
    of_class = Redesign.apply

    def apply(redesign, parameters):
        designed.append(parameters)
        of_class(redesign, parameters)

    monkeypatch.setattr(Redesign, 'apply', apply)
    study = study_of('redesign: lqr\nvary: {plant_sim.body_mass: {list: [0.5, 0.6, 0.7]}}\n')
    whole = Sampler(replace(study, runs=64)).part(0, 64)
    assert len(designed) == 3
    alone = study.samples({name: whole.values[name][40:41] for name in study.columns}, 40)
    assert gains_of(alone, 0) == gains_of(whole, 40)


def test_tunings_do_not_design(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text(HEAD + 'redesign: lqr\ntune: {python: {controller.k_i: {uniform: [-1, 0]}}}\n')
    assert "unknown key 'redesign'" in refusal(BallbotError, read_tuning, str(path))
