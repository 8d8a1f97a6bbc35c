"""Monitoring the processes of a run, and the verdict on it."""

import os
import queue
from contextlib import nullcontext
from pathlib import Path
from signal import SIGKILL, SIGTERM
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from graph import LAST_RESORT_S
from stubs import bare

from ballbot_ros.errors import BallbotError
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.nodes.middleware import DISCOVERY_RANGE, DomainLock
from ballbot_ros.parameters import GYRO, NODES, PLANT, RECORDER, VIEWER, ParameterSet
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_NS
from ballbot_ros.run import node_process, one_process, separate_processes
from ballbot_ros.run.node_process import (
    GRACE_S,
    LAST_GRACE_S,
    STOPPED_GRACE_S,
    ForkClient,
    NodeProcess,
    stop_all,
)
from ballbot_ros.run.one_process import RCLError, ros
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.separate_processes import merge_process_failures, run_nodes, watch

SILENT = 'plant_sim does not answer'


FULL = 'No space left on device'


def process(name, exit_status=0):
    return SimpleNamespace(name=name, exit_status=exit_status, failure=f'{name}: {FULL}')


def test_a_completed_run_is_completed():
    for outcome, failure, ends, signal, expected in (
        ('completed', '', {}, 0, ('completed', '', 0)),
        ('completed', SILENT, {'plant_sim': -9}, 0, ('completed', '', 0)),
        ('completed', 'gyro_driver was killed by SIGKILL', {'gyro_driver': -9}, 0,
         ('completed', '', 0)),
        ('completed', '', {'recorder': 1}, 0, ('failed', f'recorder: {FULL}', 1)),
        ('completed', '', {'recorder': 2}, 0, ('failed', f'recorder: {FULL}', 2)),
        ('failed', '', {'recorder': 2}, 0, ('failed', f'recorder: {FULL}', 2)),
        ('failed', '', {'plant_sim': 1, 'sonar_driver': 1}, 0, ('failed', f'plant_sim: {FULL}', 1)),
        ('failed', SILENT, {'plant_sim': -9}, 0, ('failed', SILENT, 1)),
        ('failed', 'sonar_driver ended with status 2', {'sonar_driver': 2}, 0,
         ('failed', 'sonar_driver ended with status 2', 2)),
        ('completed', SILENT, {}, 2, ('stopped', '', 130)),
        ('stopped', SILENT, {}, 15, ('stopped', '', 143)),
        ('stopped', '', {}, 0, ('failed', 'plant_sim was stopped', 1)),
        ('failed', '', {}, 0, ('failed', f'plant_sim: {FULL}', 1)),
    ):  # fmt: skip
        assert ended(outcome, failure, ends, signal) == expected, (outcome, failure, ends, signal)


def test_a_run_whose_recorder_was_killed_before_it_finished_the_file_has_failed():
    killed = {'recorder': -9}
    assert ended('completed', '', killed, 0) == ('completed', '', 0)
    found = ended('completed', '', killed, 0, is_recorded=False)
    assert found == ('failed', f'recorder: {FULL}', 1)
    assert ended('completed', '', {}, 0, is_recorded=False) == (
        'completed',
        '',
        0,
    )  # an external one
    assert ended('stopped', '', killed, 15, is_recorded=False) == ('stopped', '', 143)


def test_a_run_replaced_by_another_has_not_failed():
    for outcome, failure, signal, expected in (
        ('stopped', '', 0, ('stopped', '', 0)),
        ('failed', SILENT, 0, ('stopped', '', 0)),
        ('completed', '', 0, ('completed', '', 0)),
        ('completed', SILENT, 0, ('completed', '', 0)),
        ('stopped', '', 2, ('stopped', '', 130)),
    ):
        found = ended(outcome, failure, {}, signal, is_replaced=True)
        assert found == expected, (outcome, failure, signal)


def ended(outcome, failure, ends, signal, *, is_replaced=False, is_recorded=True):
    processes = {name: process(name, ends.get(name, 0)) for name in ('plant_sim', *ends)}
    by_the_plant = RunResult(Outcome(outcome))
    stop = SimpleNamespace(signal=signal)
    result = merge_process_failures(
        processes, by_the_plant, failure, stop, is_replaced=is_replaced, is_recorded=is_recorded
    )
    return result.outcome, result.reason, result.exit_status


def watched(victim, now_ns, *, plant_hangs=False, exit_status=-9):
    """Return the watch's result for a graph in which one node has died, after a few looks."""
    running = SimpleNamespace(
        running=True, was_killed=False, exit_status=None, pid=1, kill=lambda: None
    )
    end = 'was killed by SIGKILL'
    dead = SimpleNamespace(
        running=False, pid=2, was_killed=True, exit_status=exit_status, exit_description=end,
        failure=f'{victim} {end}', forward_remaining_output=lambda: None,
    )  # fmt: skip
    processes = dict.fromkeys((*NODES, VIEWER), running) | {victim: dead}
    monitor = SimpleNamespace(now_ns=now_ns, poll=lambda: None, plant_hangs=lambda pid: plant_hangs)
    notices, times_s = [], []
    progress = SimpleNamespace(notice=notices.append, update=times_s.append)
    looks = iter([False, False, True])
    client = SimpleNamespace(failure=lambda: '')
    reason = watch(client, processes, monitor, progress, lambda: next(looks))
    assert notices[0] == f'{victim} was killed by SIGKILL'
    assert len(notices) == 1 + plant_hangs
    assert set(times_s) == ({(now_ns - FIRST_TICK_NS) * 1e-9} if now_ns else set())
    return reason


OTHERS = [name for name in NODES if name != PLANT]


def test_a_node_that_dies_before_the_first_tick_ends_the_run_at_once():
    for victim in OTHERS:
        for now_ns in (0, FIRST_TICK_NS):
            assert watched(victim, now_ns) == f'{victim} was killed by SIGKILL'


def test_a_node_that_dies_in_mid_run_may_be_restarted():
    for victim in OTHERS:
        assert watched(victim, FIRST_TICK_NS + TICK_NS) == ''


def test_a_hanging_plant_is_named():
    expected = 'plant_sim does not answer'
    assert watched('gyro_driver', FIRST_TICK_NS + TICK_NS, plant_hangs=True) == expected


def test_a_viewer_is_no_part_of_the_run():
    assert watched(VIEWER, 0) == ''


@pytest.mark.parametrize('now_ns', [0, FIRST_TICK_NS + TICK_NS])
def test_without_the_plant_there_is_no_run(now_ns):
    assert watched(PLANT, now_ns) == 'plant_sim was killed by SIGKILL'


@pytest.mark.graph
def test_a_node_that_refuses_to_start_gives_the_reason(domain, monkeypatch, tmp_path):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    file = tmp_path / 'parameters.yaml'
    file.write_text(f'recorder: {{ros__parameters: {{output: {tmp_path}/parameters.yaml/x.mcap}}}}')
    lines = []
    with ForkClient() as client:
        node = NodeProcess(client, 'recorder', file, lines.append)
        node.wait(60.0)
        node.forward_remaining_output()
        assert node.exit_status == 2
        # Check the last line only: the middleware may print something before it.
        assert lines[-1] == f'error: {file}/x.mcap: File exists'
        assert node.failure == f'recorder: {file}/x.mcap: File exists'


def test_only_the_plant_keeps_the_lock_of_the_domain(monkeypatch, tmp_path):
    events = []
    lock = bare(DomainLock, file=7, release=lambda: events.append('release'))
    monitor = SimpleNamespace(pipe=SimpleNamespace(theirs=8))
    for name, stub in (
        ('DomainLock', lambda domain: lock),
        ('require_discovery', lambda: None),
        ('PlantMonitor', lambda: nullcontext(monitor)),
        ('watch', lambda *_: events.append('watch')),
    ):
        monkeypatch.setattr(separate_processes, name, stub)
    client = SimpleNamespace(
        ros_error='',
        await_ready=lambda should_stop: None,
        start=lambda request, output, inherited, should_stop: (
            events.append((request.name, inherited)) or len(events)
        ),
        status_of=lambda process: 0,
    )
    observer = SimpleNamespace(notice=None)
    run_nodes(client, [GYRO, PLANT, RECORDER], ParameterSet(), tmp_path, observer, lambda: False)
    assert events == [(GYRO, ()), (RECORDER, ()), (PLANT, (7, 8)), 'release', 'watch']


def test_a_signal_ends_the_wait_for_a_fork(monkeypatch, tmp_path):
    def start(request, output, inherited, should_stop):
        stops.append(True)
        assert should_stop()
        raise BallbotError('the run is stopped')

    stops = []
    monitor = SimpleNamespace(pipe=SimpleNamespace(theirs=8))
    lock = bare(DomainLock, file=7, release=lambda: None)
    monkeypatch.setattr(separate_processes, 'DomainLock', lambda domain: lock)
    monkeypatch.setattr(separate_processes, 'PlantMonitor', lambda: nullcontext(monitor))
    client = SimpleNamespace(ros_error='', await_ready=lambda should_stop: None, start=start)
    observer = SimpleNamespace(notice=None)
    nodes = [GYRO, PLANT, RECORDER]
    ended = run_nodes(client, nodes, ParameterSet(), tmp_path, observer, lambda: bool(stops))
    assert ended == ({}, '')


def test_a_node_that_dies_gives_no_reason():
    process = SimpleNamespace(
        name='recorder', _last_error_line='waits', was_killed=True, exit_description='died'
    )
    assert NodeProcess.failure.fget(process) == 'recorder died'


def test_how_a_node_has_ended_is_described():
    for status, running, was_killed, description in (
        (None, True, False, 'is still running'),
        (0, False, False, 'ended with status 0'),
        (2, False, False, 'ended with status 2'),
        (-SIGKILL, False, True, 'was killed by SIGKILL'),
        (-40, False, True, 'was killed by signal 40'),
    ):
        client = SimpleNamespace(status_of=lambda pid, status=status: status)
        node = bare(NodeProcess, name=GYRO, pid=1234, _last_error_line='', _client=client)
        assert (node.running, node.was_killed) == (running, was_killed), status
        assert node.failure == f'{GYRO} {description}'


def test_a_node_that_can_not_be_started_leaves_no_pipe(tmp_path):
    def fail(request, output, inherited, should_stop):
        raise BallbotError('the process that forks it has ended')

    before = set(Path('/proc/self/fd').iterdir())
    with pytest.raises(BallbotError, match='that forks it'):
        NodeProcess(SimpleNamespace(start=fail), GYRO, tmp_path, print)
    assert set(Path('/proc/self/fd').iterdir()) <= before


def test_only_a_running_process_is_signalled(monkeypatch):
    """The number of one that has ended may be that of another process by now."""
    signalled = []
    monkeypatch.setattr(node_process.os, 'kill', lambda *arguments: signalled.append(arguments))
    for status in (None, 0, -9):
        client = SimpleNamespace(
            status_of=lambda pid, status=status: status, await_end=lambda pid, timeout_s: None
        )
        node = bare(NodeProcess, pid=1234, _client=client)
        node.request_stop()
        node.kill()
    assert signalled == [(1234, SIGTERM), (1234, SIGKILL)]


def test_the_recorder_is_stopped_when_the_others_have_ended():
    stopped = []

    def running(name):
        return SimpleNamespace(
            name=name,
            running=False,
            request_stop=lambda: stopped.append(name),
            forward_remaining_output=lambda: stopped.append(f'{name} has ended'),
        )

    stop_all([running(name) for name in (RECORDER, PLANT, VIEWER)], last=RECORDER)
    assert stopped[-2:] == [RECORDER, f'{RECORDER} has ended']
    assert set(stopped[2:4]) == {f'{PLANT} has ended', f'{VIEWER} has ended'}


class Client:
    """A fork server's client whose only node is a pipe."""

    def start(self, request, output, inherited, should_stop):
        self.output = os.fdopen(os.dup(output), 'w')
        return 1

    def status_of(self, process):
        return None

    def await_end(self, process, timeout_s):
        self.awaited = process, timeout_s


def test_the_output_of_a_node_is_passed_on_line_by_line_and_its_end_awaited_for_a_time(tmp_path):
    client, lines = Client(), queue.Queue()
    node = NodeProcess(client, PLANT, tmp_path, lines.put)
    with client.output as output:
        print('it has begun', file=output, flush=True)
        assert lines.get(timeout=LAST_RESORT_S) == 'it has begun'
    node.wait(0.25)
    assert client.awaited == (1, 0.25)


def test_a_node_that_does_not_end_is_killed_after_a_while_the_recorder_later(monkeypatch):
    """Only a wait takes time here."""
    now_s, killed = [100.0], {}

    class Hanging:
        forward_remaining_output = request_stop = staticmethod(lambda: None)

        def __init__(self, name, pid):
            self.name, self.pid, self.running = name, pid, True

        def wait(self, timeout_s):
            now_s[0] += timeout_s

        def kill(self):
            self.running = False
            killed[self.name] = now_s[0]

    monkeypatch.setattr(node_process, 'time', SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(node_process, 'threads_by_process', lambda pids: {pid: {} for pid in pids})
    monkeypatch.setattr(node_process, 'is_stopped', lambda pid: pid == 3)
    stop_all([Hanging(RECORDER, 1), Hanging(PLANT, 2), Hanging(GYRO, 3)], last=RECORDER)
    for name, expected in (
        (GYRO, 100.0 + STOPPED_GRACE_S),
        (PLANT, 100.0 + GRACE_S),
        (RECORDER, killed[PLANT] + LAST_GRACE_S),
    ):
        assert killed[name] == pytest.approx(expected, abs=0.11), name


@pytest.mark.parametrize(('chosen', 'used'), [('', 'LOCALHOST'), ('SUBNET', 'SUBNET')])
def test_nodes_discover_only_this_machine_unless_the_user_chooses_otherwise(
    monkeypatch, chosen, used
):
    monkeypatch.setattr('rclpy.ok', lambda: True)
    monkeypatch.setenv(DISCOVERY_RANGE, chosen)
    if not chosen:
        monkeypatch.delenv(DISCOVERY_RANGE)
    with ros():
        assert os.environ[DISCOVERY_RANGE] == used


@pytest.mark.parametrize('raised', [None, RCLError('unknown peer')])
def test_ros_ends_with_its_block(monkeypatch, raised):
    events = []
    monkeypatch.setattr('rclpy.ok', lambda: False)
    monkeypatch.setattr('rclpy.init', lambda **options: events.append('init'))
    monkeypatch.setattr('rclpy.try_shutdown', lambda: events.append('shutdown'))
    monkeypatch.setattr(one_process, 'prepare_middleware', lambda: events.append('prepare'))
    with pytest.raises(BallbotError, match='peer') if raised else nullcontext(), ros():
        events.append('block')
        if raised:
            raise raised
    assert events == ['prepare', 'init', 'block', 'shutdown']


@pytest.mark.parametrize('victim', [VIEWER, 'gyro_driver'])
def test_a_node_that_refuses_its_parameters_ends_the_run_at_any_time(victim):
    assert watched(victim, FIRST_TICK_NS + TICK_NS, exit_status=2).startswith(victim)
