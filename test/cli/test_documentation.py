"""README and docs name every command and option, every scenario and every node."""

import re
from pathlib import Path

from ballbot_ros.cli.command import COMMANDS, load_command
from ballbot_ros.conformance.contract import CONTRACTS
from ballbot_ros.conformance.examination import REQUIREMENTS
from ballbot_ros.parameters import ALL_NODES
from ballbot_ros.scenario.library import scenario_names
from ballbot_ros.simulation.golden import load_golden

PROJECT = Path(__file__).parents[2]
README = (PROJECT / 'README.md').read_text(encoding='utf-8')
OPTION_PAGES = {'run': README, 'drive': (PROJECT / 'docs/drive.md').read_text(encoding='utf-8')}
ROS_PAGE = (PROJECT / 'docs/ros.md').read_text(encoding='utf-8')


def test_every_command_is_in_the_readme():
    assert [name for name in COMMANDS if f'| `scripts/run {name}' not in README] == []


def test_every_option_of_running_and_driving_is_documented():
    missing = {
        (name, option)
        for name, page in OPTION_PAGES.items()
        for parameter in load_command(name).params
        for option in parameter.opts
        if option.startswith('--') and f'| `{option}' not in page
    }
    assert missing == set()


def test_every_scenario_and_node_is_in_the_readme():
    assert [name for name in (*scenario_names(), *ALL_NODES) if f'`{name}`' not in README] == []


def test_every_node_is_in_the_table_of_nodes():
    assert [name for name in ALL_NODES if f'\n| `{name}` |' not in ROS_PAGE] == []


def test_every_role_and_requirement_is_on_the_page_of_the_contracts():
    page = (PROJECT / 'docs/contract.md').read_text(encoding='utf-8')
    _, _, tested = page.partition('## What `ballbot conform` tests')
    rows = re.findall(r'^\| `(.+?)` \| (.+) \|$', tested, re.MULTILINE)
    assert [name for name, _ in rows] == [each.name for each in REQUIREMENTS]
    for (name, text), each in zip(rows, REQUIREMENTS, strict=True):
        assert text.startswith(each.text), name
    for role, contract in CONTRACTS.items():
        row = re.search(rf'^\| `{role}` \|.*$', page, re.MULTILINE)[0]
        answer, period_ms = contract.answer, contract.period_ns // 1_000_000
        assert f'`{answer.name}` {answer.type_name.replace("/msg/", "/")}' in row, role
        assert f'| {period_ms} ms |' in row, role


def test_the_program_in_the_readme_runs(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (program,) = re.findall(r'^```python\n(.*?)^```', README, re.DOTALL | re.MULTILINE)
    exec(compile(program, 'README.md', 'exec'), {})
    verdict, peak_pitch, duty_sha256 = capsys.readouterr().out.split()
    assert verdict == 'passed'
    assert 3.0 < float(peak_pitch) < 6.0
    # The program's run has device noise, unlike the scenario with the ideal profile.
    assert duty_sha256 != load_golden().scenarios['stationary']
