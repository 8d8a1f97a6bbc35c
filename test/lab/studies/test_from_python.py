"""`bb.study`: the same frame as the command's results."""

import numpy as np
import pandas as pd
import pytest
from instance_controllers import Hanging
from laws import refusal
from notebook_cells import IMPORT, controller_class, notebook

import ballbot_ros as bb
from ballbot_ros.lab.studies.study_data import StudyData

__all__ = ['notebook']

CONTENT = {
    'scenario': 'push',
    'parameters': {'plant_sim': {'duration': np.float64(3.0)}},
    'runs': 30,
    'vary': {'plant_sim.body_mass': {'uniform': np.array([0.6, 0.75])}},
    'expectations': {'peak_pitch_deg': {'max': 10.0}},
}


def test_the_content_of_a_study_gives_a_frame(tmp_path):
    frame = bb.study(CONTENT, output=tmp_path / 'results')
    assert frame['number'].tolist() == list(range(30))
    assert frame['plant_sim.body_mass'].between(0.6, 0.75).all()
    assert (frame['passed'] == (frame['peak_pitch_deg'] <= 10.0)).all()
    assert frame['duty_sha256'].str.fullmatch('[0-9a-f]{64}').all()
    pd.testing.assert_frame_equal(frame, StudyData.open(tmp_path / 'results').frame())
    pd.testing.assert_frame_equal(frame, bb.study(CONTENT))
    assert len(bb.study(CONTENT, runs=4, seed=2)) == 4


def test_a_row_is_a_run_of_simulate():
    row = bb.study(CONTENT, runs=3).iloc[2]
    values = {'plant_sim.duration': 3.0, 'plant_sim.body_mass': row['plant_sim.body_mass']}
    run = bb.simulate('push', parameters=values, seed=int(row['seed']))
    assert run.duty_sha256 == row['duty_sha256']
    assert run.metrics['peak_pitch_deg'] == pytest.approx(row['peak_pitch_deg'], rel=1e-9)


def test_a_tick_that_hangs_fails_its_run():
    plant = {'duration': 1.0, 'timeout': 0.3}
    content = {**CONTENT, 'controller': Hanging, 'runs': 2, 'parameters': {'plant_sim': plant}}
    assert bb.study(content)['outcome'].tolist() == ['failed', 'failed']


def test_a_controller_of_a_notebook_is_refused(notebook):
    """The processes of a study do not have it."""
    notebook.run(IMPORT, controller_class('0'))
    content = {**CONTENT, 'controller': notebook.Mine}
    assert 'Mine is defined in the notebook' in refusal(bb.BallbotError, bb.study, content)


@pytest.mark.parametrize(
    ('study', 'message'),
    [
        (3, 'study: 3 is neither a name, a path nor a mapping'),
        ({'runs': 3}, 'scenario is missing'),
        ({'scenario': 'push', 'vary': {'plant_sim.mass': {'uniform': [0, 1]}}}, "'mass'"),
        ({'scenario': 'push', 'vary': object}, 'a value is neither a number'),
        ('unheard_of', "unknown study 'unheard_of'"),
    ],
)
def test_mistakes(study, message):
    assert message in refusal(bb.BallbotError, bb.study, study)
