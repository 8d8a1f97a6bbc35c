"""Robots drawn at random are identified from what their bricks measured."""

import pytest
from click.testing import CliRunner

from benchmark import identification, tune


@pytest.mark.slow
def test_a_robot_drawn_at_random_is_identified_within_the_intervals(monkeypatch):
    monkeypatch.setattr(tune, 'FEW_ROBOTS', 1)
    result = CliRunner().invoke(tune.tune, ['identification'])
    assert result.exception is None, result.output
    for name in identification.NAMES:
        assert f'| recording | `{name}` | 1 of 1 | 1 of 1 |' in result.output
    assert '| data log | `body_height` | 1 of 1 | 1 of 1 |' in result.output
    assert '0 of 1 robots fell.' in result.output
