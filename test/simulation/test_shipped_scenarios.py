"""Every shipped scenario runs and meets its expectations."""

import pytest

from ballbot_ros.scenario.library import scenario_names


@pytest.mark.parametrize('name', scenario_names())
def test_it_meets_its_expectations(start_run, name):
    run = start_run(name, '--processes=none', '--no-record', '--json')
    assert run.finish() == 0, run.stderr + run.stdout
    assert run.result['expectations']
