"""The remains of a recording that was finished, cut off, or never begun."""

import pytest
from graph import record

from campaign.remains import Remains, read_remains
from campaign.run import undisturbed_duties, write_scenario
from campaign.site import Site

TICKS = 300


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp('recorded')
    scenario = write_scenario(folder)
    path, _ = record(folder, scenario, '--set', f'plant_sim.duration={TICKS * 0.004}')
    return path


def test_a_finished_recording_has_the_duties_of_an_undisturbed_run(recorded, tmp_path):
    remains = read_remains(recorded, tmp_path)
    expected = tuple(undisturbed_duties(Site(tmp_path, [1]), TICKS))
    assert remains == Remains(finished=True, truths=TICKS, duties=expected)
    assert expected[-1] != (0.0, 0.0)


def test_a_truncated_recording_is_repaired_and_has_the_first_duties(recorded, tmp_path):
    data = recorded.read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(data[: len(data) // 2])
    remains, whole = read_remains(cut, tmp_path), read_remains(recorded, tmp_path)
    assert not remains.finished
    assert not remains.problem
    assert remains.duties == whole.duties[: len(remains.duties)]
    assert len(remains.duties) < TICKS


def test_an_unreadable_recording_is_reported(tmp_path):
    empty = tmp_path / 'empty.mcap'
    empty.touch()
    assert 'empty' in read_remains(empty, tmp_path).problem
    assert read_remains(tmp_path / 'none.mcap', tmp_path) is None
