"""Reading recorded runs in a command."""

import pytest

import ballbot_ros as bb
from ballbot_ros.cli.recordings import read_playback_runs


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp('recordings')
    for name in ('track', 'corridor', ''):
        parameters = {'plant_sim.map': name, 'plant_sim.duration': 0.1}
        path = folder / f'{name or "floor"}.mcap'
        bb.simulate('stationary', parameters=parameters).save(path)
    return folder


@pytest.mark.parametrize(
    ('name', 'ghost', 'is_noted'),
    [
        ('track', 'corridor', True),
        ('track', 'floor', True),
        ('track', 'track', False),
        ('floor', 'floor', False),
        ('track', None, False),
    ],
)
def test_a_ghost_on_another_map_is_noted(recordings, capsys, name, ghost, is_noted):
    path = recordings / f'{name}.mcap'
    other = recordings / f'{ghost}.mcap' if ghost else None
    assert len(read_playback_runs(path, other)) == 1 + bool(ghost)
    note = f'note: {other} is on another map; the map shown is that of {path}\n'
    assert capsys.readouterr().err == (note if is_noted else '')
