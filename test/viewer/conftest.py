"""A recorded run to show."""

import pytest

pytest.importorskip('viser', reason='the extra viewer is not installed')

from graph import record


@pytest.fixture(scope='session')
def recording(tmp_path_factory):
    """Ten seconds of the scenario autonomous, which has a map with lines."""
    path, _ = record(tmp_path_factory.mktemp('run'), 'autonomous', '--set=plant_sim.duration=10')
    return path
