"""The README names every command and option, every scenario and every node."""

from pathlib import Path

import pytest

from ballbot_ros.cli.command import COMMANDS, load_command
from ballbot_ros.parameters import ALL_NODES
from ballbot_ros.scenario.library import scenario_names

README = (Path(__file__).parents[2] / 'README.md').read_text(encoding='utf-8')
OPTIONS = [
    (name, option)
    for name in ('run', 'drive')
    for parameter in load_command(name).params
    for option in parameter.opts
    if option.startswith('--')
]


@pytest.mark.parametrize('name', sorted(COMMANDS))
def test_every_command_is_in_the_readme(name):
    assert f'| `scripts/run {name}' in README


@pytest.mark.parametrize(('command', 'option'), OPTIONS)
def test_every_option_of_running_and_driving_is_in_the_readme(command, option):
    assert option in README, command


@pytest.mark.parametrize('name', [*scenario_names(), *ALL_NODES])
def test_every_scenario_and_node_is_in_the_readme(name):
    assert f'`{name}`' in README
