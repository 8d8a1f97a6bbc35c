"""README and docs are true: commands, nodes, outputs, tables of figures."""

import json
import re
from pathlib import Path
from textwrap import indent

from graph import call

import ballbot_ros as bb
from ballbot_ros.analysis.loop_summary import margin_rows
from ballbot_ros.cli.command import COMMANDS
from ballbot_ros.controllers.design.loop_analysis import analyse_ideal, analyse_sampled
from ballbot_ros.engine.golden import load_golden
from ballbot_ros.nodes.conformance.contract import CONTRACTS
from ballbot_ros.nodes.conformance.examination import REQUIREMENTS
from ballbot_ros.parameters import ALL_NODES, ParameterSet
from ballbot_ros.parameters.files import read_parameter_file

PROJECT = Path(__file__).parents[2]
README = (PROJECT / 'README.md').read_text(encoding='utf-8')
CONTROL_PAGE = (PROJECT / 'docs/control.md').read_text(encoding='utf-8')
ROS_PAGE = (PROJECT / 'docs/ros.md').read_text(encoding='utf-8')


def test_the_readme_is_short():
    assert len(README.splitlines()) <= 120
    assert len(README.split()) <= 900


def test_every_command_is_on_the_page_of_commands():
    page = (PROJECT / 'docs/commands.md').read_text(encoding='utf-8')
    assert [name for name in COMMANDS if f'`ballbot {name}' not in page] == []


def test_the_list_of_the_scenarios_is_what_the_command_prints():
    page = (PROJECT / 'docs/scenarios.md').read_text(encoding='utf-8')
    said = call('scenarios').stdout
    assert indent(f'$ scripts/run scenarios\n{said}', ' ' * 4) in page


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


def test_the_response_times_on_the_page_are_those_of_the_command():
    page = (PROJECT / 'docs/codegen.md').read_text(encoding='utf-8')
    for task in json.loads(call('schedule', '--json').stdout)['tasks']:
        times = ' | '.join(f'{task[key]} µs' for key in ('time_us', 'worst_us', 'simulated_us'))
        assert task['name'] == 'task_init' or f'| `{task["name"]}` | {times} |\n' in page


def test_the_margins_on_the_page_are_those_of_the_analysis():
    rows = margin_rows(analyse_ideal(ParameterSet()), analyse_sampled(ParameterSet()))
    for row in rows:
        cells = ' | '.join(row)
        assert f'| {cells} |'.replace('|  |', '| |') in CONTROL_PAGE, row.name


def test_the_runs_on_the_page_are_as_measured():
    rows = re.findall(r'^\| (nothing|`\S+=\S+`) \| .+? \| (.+?) \| (.*?) ?\| (.+) \|$',
                      CONTROL_PAGE, re.MULTILINE)  # fmt: skip
    assert len(rows) == 13
    for changed, duty, saturated, verdict in rows:
        name, _, value = changed.strip('`').partition('=')
        run = bb.simulate('stationary', parameters={name: float(value)} if value else None)
        assert (verdict == 'passed') == run.passed, changed
        if duty == 'falls':
            assert run.metrics['peak_pitch_deg'] > 30.0
            continue
        assert duty == f'{run.metrics["duty_rms_percent"]:.1f} %', changed
        assert saturated == f'{100.0 * run.metrics["duty_saturated_share"]:.1f} %', changed


def test_the_table_of_the_cure_is_as_computed_and_measured():
    gains = [PROJECT / f'config/gains/{name}.yaml' for name in ('document', 'quiet')]
    loops = [analyse_sampled(read_parameter_file(path)) for path in gains]
    ideal = analyse_ideal(ParameterSet())
    rows = [
        [row.name, row.sampled, other.sampled]
        for row, other in zip(*(margin_rows(ideal, loop) for loop in loops), strict=True)
    ]
    rounding = [f'{loop.samples.rounding_noise:.1f} %' for loop in loops]
    rows.append(['duty from rounding', *rounding])
    for scenario in ('stationary', 'hardware_standing'):
        runs = [bb.simulate(scenario, parameters=path) for path in gains]
        duties = [f'{run.metrics["duty_rms_percent"]:.1f} %' for run in runs]
        rows.append([f'duty RMS, `{scenario}`', *duties])
    missing = [row for row in rows if f'| {" | ".join(row)} |' not in CONTROL_PAGE]
    assert missing == []


def test_the_program_in_the_readme_runs(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (program,) = re.findall(r'^```python\n(.*?)^```', README, re.DOTALL | re.MULTILINE)
    exec(compile(program, 'README.md', 'exec'), {})
    verdict, peak_pitch, duty_sha256 = capsys.readouterr().out.split()
    assert verdict == 'passed'
    assert 3.0 < float(peak_pitch) < 6.0
    # The program's run has device noise, unlike the scenario with the ideal profile.
    assert duty_sha256 != load_golden().scenarios['stationary']
