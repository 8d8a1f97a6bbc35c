"""README and docs name every command and option, every scenario and every node."""

import re
from pathlib import Path

import pytest

from ballbot_ros.cli.command import COMMANDS, load_command
from ballbot_ros.parameters import ALL_NODES
from ballbot_ros.scenario.library import scenario_names
from ballbot_ros.simulation.golden import load_golden

PROJECT = Path(__file__).parents[2]
README = (PROJECT / 'README.md').read_text(encoding='utf-8')
OPTION_PAGES = {'run': README, 'drive': (PROJECT / 'docs/drive.md').read_text(encoding='utf-8')}
ROS_PAGE = (PROJECT / 'docs/ros.md').read_text(encoding='utf-8')
OPTIONS = [
    (name, option)
    for name in OPTION_PAGES
    for parameter in load_command(name).params
    for option in parameter.opts
    if option.startswith('--')
]


@pytest.mark.parametrize('name', sorted(COMMANDS))
def test_every_command_is_in_the_readme(name):
    assert f'| `scripts/run {name}' in README


@pytest.mark.parametrize(('command', 'option'), OPTIONS)
def test_every_option_of_running_and_driving_is_documented(command, option):
    assert f'| `{option}' in OPTION_PAGES[command]


@pytest.mark.parametrize('name', [*scenario_names(), *ALL_NODES])
def test_every_scenario_and_node_is_in_the_readme(name):
    assert f'`{name}`' in README


@pytest.mark.parametrize('name', ALL_NODES)
def test_every_node_is_in_the_table_of_nodes(name):
    assert f'\n| `{name}` |' in ROS_PAGE


def test_the_program_in_the_readme_runs(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (program,) = re.findall(r'^```python\n(.*?)^```', README, re.DOTALL | re.MULTILINE)
    exec(compile(program, 'README.md', 'exec'), {})
    verdict, peak_pitch, duty_sha256 = capsys.readouterr().out.split()
    assert verdict == 'passed'
    assert 3.0 < float(peak_pitch) < 6.0
    # The program's run has device noise, unlike the scenario with the ideal profile.
    assert duty_sha256 != load_golden().scenarios['stationary']
