import pytest
from generated import Built, need
from parts import values_of

from ballbot_ros.parameters import CONTROLLER


@pytest.fixture
def built(tmp_path):
    """Build the application for a target, with some parameters changed."""

    def make(target, *, flags=(), values=None, name='', **changes):
        need(target)
        values = values or values_of(CONTROLLER, **changes)
        return Built(values, target, tmp_path / f'{target}{name}', flags)

    return make
