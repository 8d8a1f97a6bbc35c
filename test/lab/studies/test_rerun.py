"""What the files of a study may select."""

from types import SimpleNamespace

import pytest

from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.rerun import study_parameters

MODULE = 'mine:Mine'
SETS = f'controller: {{ros__parameters: {{implementation: {MODULE}}}}}\n'
SCENARIO = 'purpose: a test\nduration: 2\n'


@pytest.mark.parametrize(
    ('scenario', 'parameters'),
    [
        (SCENARIO, SETS),
        (f'{SCENARIO}parameters: {{controller: {{implementation: {MODULE}}}}}\n', '{}'),
    ],
)
def test_a_study_selects_only_installed_controllers(tmp_path, monkeypatch, scenario, parameters):
    monkeypatch.syspath_prepend(str(tmp_path))
    executed = tmp_path / 'executed'
    (tmp_path / 'mine.py').write_text(f'open({str(executed)!r}, "w")\n')
    study = SimpleNamespace(name='tried', scenario=scenario, parameters=parameters)
    with pytest.raises(StudyError, match='mine:Mine, which is not installed as a controller'):
        study_parameters(study, tmp_path / 'tried.yaml')
    assert not executed.exists()
    assert study_parameters(study, tmp_path / 'tried.yaml', 'pid').is_set(
        'controller', 'implementation'
    )
