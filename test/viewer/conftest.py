"""A recorded run to show."""

import pytest

pytest.importorskip('viser', reason='the extra viewer is not installed')

from graph import BALLBOT


@pytest.fixture(scope='session')
def recording(tmp_path_factory):
    """Ten seconds of the scenario autonomous, which has a map with lines."""
    import subprocess

    folder = tmp_path_factory.mktemp('run')
    words = [
        'run', 'autonomous', '--processes=none', '--json', '--set=plant_sim.duration=10',
        '--output', folder,
    ]  # fmt: skip
    subprocess.run([*BALLBOT, *map(str, words)], capture_output=True, check=False)
    return folder / 'autonomous.mcap'
