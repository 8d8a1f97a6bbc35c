"""Every shipped scenario runs and meets its expectations."""

import json

import pytest
from graph import call

from ballbot_ros.engine.scenario.reader import scenario_names


@pytest.mark.parametrize('name', scenario_names())
def test_it_meets_its_expectations(name):
    done = call('run', name, '--processes=none', '--no-record', '--json')
    assert done.returncode == 0, done.stderr + done.stdout
    assert json.loads(done.stdout)['expectations']
