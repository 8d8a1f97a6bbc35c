"""Robots drawn at random are identified from what their bricks measured."""

import pytest
import yaml
from click.testing import CliRunner

from ballbot_ros.files import share_directory
from benchmark import identification, tune

DURATION_S = 24.0
"""Little more than what the data log of an identification must have."""


@pytest.fixture
def short_scenario(tmp_path):
    content = yaml.safe_load(
        (share_directory() / f'config/scenarios/{identification.SCENARIO}.yaml').read_text(
            encoding='utf-8'
        )
    )
    del content['expectations']
    content['duration'] = DURATION_S
    for stick, parts in content['sticks'].items():
        content['sticks'][stick] = [part for part in parts if part['to'] <= DURATION_S]
    path = tmp_path / 'short.yaml'
    path.write_text(yaml.safe_dump(content), encoding='utf-8')
    return path


@pytest.mark.slow
def test_a_robot_drawn_at_random_is_identified_within_the_intervals(monkeypatch, short_scenario):
    monkeypatch.setattr(tune, 'FEW_ROBOTS', 1)
    monkeypatch.setattr(identification, 'SCENARIO', str(short_scenario))
    # Nothing is promised of a log without the gear play, whose fit costs as much as the others.
    monkeypatch.delitem(identification.SOURCES, 'data log, gear play not known')
    result = CliRunner().invoke(tune.tune, ['identification'])
    assert result.exception is None, result.output
    for name in identification.NAMES:
        assert f'| recording | `{name}` | 1 of 1 | 1 of 1 |' in result.output
    assert '| data log | `body_height` | 1 of 1 | 1 of 1 |' in result.output
    assert '0 of 1 robots fell.' in result.output
