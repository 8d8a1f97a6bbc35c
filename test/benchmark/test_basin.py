"""The basin of attraction, next to what saturation allows."""

from click.testing import CliRunner

from ballbot_ros.design.recoverable import recoverable_states
from ballbot_ros.parameters import ParameterSet
from benchmark import basin, maps, tune
from benchmark.basin import Estimate


def test_a_program_that_knows_the_pitch_recovers_from_more(monkeypatch):
    monkeypatch.setattr(basin, 'RECOVERY_S', 3.0)
    parameters = ParameterSet()
    for pitch, rate, from_zero, from_true in (
        (7.0, 0.0, True, True),
        (10.0, 0.0, False, True),
        (-10.0, 0.0, False, True),
        (0.0, 60.0, True, True),
        (-12.0, 60.0, False, True),
        (12.0, 20.0, False, False),
    ):
        found = [basin.recovers(parameters, pitch, rate, estimate) for estimate in Estimate]
        assert found == [from_zero, from_true], (pitch, rate)


def test_nothing_recovers_beyond_what_the_motors_allow(monkeypatch):
    monkeypatch.setattr(basin, 'RECOVERY_S', 3.0)
    parameters = ParameterSet()
    found = list(basin.starts(parameters, recoverable_states(parameters), 5, 3))
    assert len(found) == 15
    outside = [start for start in found if start.share > 1.02]
    assert outside
    assert not any(start.from_zero or start.from_true for start in outside)
    assert any(start.from_true for start in found)


def test_the_experiment_prints_its_table_and_writes_its_picture(monkeypatch, tmp_path):
    monkeypatch.setattr(maps, 'BASIN_COARSE', (5, 3))
    monkeypatch.setattr(basin, 'RECOVERY_S', 2.0)
    result = CliRunner().invoke(tune.tune, ['basin', '--output', str(tmp_path)])
    assert result.exception is None, result.output
    assert 'The motors allow 12.4 deg at rest, or 84.3 deg/s upright.' in result.output
    assert (tmp_path / 'basin.png').read_bytes().startswith(b'\x89PNG')
    assert len((tmp_path / 'basin.csv').read_text().splitlines()) == 1 + 15
    assert result.output.count('%)') == len(Estimate)
