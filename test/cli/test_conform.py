"""`ballbot conform`: real nodes, right and wrong, against the contracts of their roles."""

import contextlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
from graph import BALLBOT, LAST_RESORT_S, call, environment

from ballbot_ros.cli import conform as conform_module
from ballbot_ros.nodes.conformance.examination import RequirementResult, RequirementVerdict
from ballbot_ros.nodes.middleware import DomainLock
from ballbot_ros.parameters import GYRO, ROLES

pytest.importorskip('rclpy')


pytestmark = pytest.mark.graph

WRONG = Path(__file__).parents[1] / 'wrong_gyro_driver.py'


@pytest.fixture
def conform(domain, tmp_path):
    """Run `ballbot conform`; return status, output and errors."""

    def run(*words):
        done = subprocess.run(
            [*BALLBOT, 'conform', *map(str, words)],
            env=environment(domain), cwd=tmp_path, capture_output=True, text=True, check=False,
            stdin=subprocess.DEVNULL, timeout=LAST_RESORT_S,
        )  # fmt: skip
        return done.returncode, done.stdout, done.stderr

    return run


def own(role):
    return [sys.executable, '-m', 'ballbot_ros.nodes', role]


def wrong(*faults):
    return [sys.executable, WRONG, ','.join(faults)]


def verdicts(output):
    return {row['name']: row['verdict'] for row in json.loads(output)['requirements']}


def test_the_table_has_a_line_for_each_requirement(command, monkeypatch):
    rows = [
        RequirementResult('late start', 'joins', RequirementVerdict.NOT_TESTED, 'give the COMMAND'),
        RequirementResult('values', 'sends values', RequirementVerdict.MET),
        RequirementResult(
            'restart', 'takes part', RequirementVerdict.FAILED, 'no answer to 1.140 s'
        ),
    ]
    monkeypatch.setattr(
        conform_module,
        'examine_node',
        lambda role, words: iter(rows[not words : 3 if words else 2]),
    )
    status, output, errors = command('conform', GYRO, '--', 'mine', '--option')
    assert (status, errors) == (1, '')
    assert output.splitlines() == [
        'not tested  late start    joins: give the COMMAND',
        'met         values        sends values',
        'failed      restart       takes part: no answer to 1.140 s',
        '1 met, 1 failed, 1 not tested',
    ]
    status, output, errors = command('conform', GYRO)
    assert (status, output.splitlines()[-1]) == (0, '1 met')
    assert errors.startswith(f'waiting for {GYRO}: start within 30 s')


def test_a_wrong_node_fails_what_it_breaks_and_nothing_else(conform):
    status, output, errors = conform(GYRO, '--json', '--', *wrong('mute', 'twin'))
    assert status == 1, output + errors
    failed = [name for name, verdict in verdicts(output).items() if verdict == 'failed']
    assert failed == ['asked again', 'restart']


def test_a_node_that_the_user_has_started_is_not_restarted(conform, start_node):
    """Its dead time is that of its announcement."""
    start_node(GYRO, delay=6, delay_jitter=9)
    status, output, errors = conform(GYRO, '--json')
    assert status == 0, output
    untested = [name for name, verdict in verdicts(output).items() if verdict == 'not tested']
    assert untested == ['late start', 'restart']
    assert errors.startswith(f'waiting for {GYRO}: start within 30 s, with ROS_DOMAIN_ID=')


def test_a_node_that_runs_already_is_not_taken_for_the_one_under_test(conform, start_node):
    start_node(GYRO)
    status, output, errors = conform(GYRO, '--', *own(GYRO))
    assert (status, output) == (2, '')
    assert errors == (
        "error: a node that publishes on 'gyro' is running already: end it, or omit COMMAND to "
        'test it\n'
    )


def test_what_the_node_prints_is_no_part_of_the_output(conform):
    status, output, errors = conform(GYRO, '--json', '--', 'sh', '-c', 'echo hello; kill -40 $$')
    assert status == 1
    assert verdicts(output)['late start'] == 'failed'
    assert 'it was killed by signal 40' in output
    assert errors == 'hello\n'


def test_two_nodes_in_a_role_are_named(conform, start_node):
    for _ in range(2):
        start_node(GYRO)
    status, output, _ = conform(GYRO, '--json')
    assert status == 1
    reasons = [row['reason'] for row in json.loads(output)['requirements']]
    assert any(reason.count('/gyro_driver (process ') == 2 for reason in reasons)


def test_a_node_that_ends_is_failed_at_once(conform):
    status, output, _ = conform(GYRO, '--', sys.executable, '-c', 'raise SystemExit(3)')
    assert status == 1
    lines = output.splitlines()
    assert lines[0].endswith('it does not join the run; it ended with status 3')
    assert lines[-1] == f'1 failed, {len(lines) - 2} not tested'


def test_a_mistake_is_one_line_and_exit_status_2(domain, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    for words, told in (
        (['gyro'], f"'gyro' is not one of {', '.join(map(repr, ROLES))}"),
        ([], "Missing argument 'ROLE'"),
        ([GYRO, '--', '/no/such/node'], "'/no/such/node': No such file or directory"),
        ([GYRO, '--', ''], "'': "),
        ([GYRO, '--', '/dev/null'], "'/dev/null': Permission denied"),
    ):
        done = call('conform', *words)
        errors = done.stderr
        assert (done.returncode, done.stdout) == (2, ''), errors
        assert errors.startswith('error: '), errors
        assert told in errors
        assert len(errors.splitlines()) == 1, errors
    with contextlib.closing(_Locked(domain)):
        done = call('conform', GYRO, '--', *own(GYRO))
    assert done.returncode == 2
    assert f'another plant, player or brick_link is running in ROS domain {domain}' in done.stderr


class _Locked:
    def __init__(self, domain):
        self._lock = DomainLock(domain)

    def close(self):
        self._lock.release()
