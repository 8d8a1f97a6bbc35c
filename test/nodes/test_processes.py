"""Information from the system about processes."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from graph import wait_for

from ballbot_ros.lockstep.participants import LocalNode
from ballbot_ros.nodes import processes
from ballbot_ros.nodes.processes import (
    LocalProcessObserver,
    ProcessSilence,
    started_nodes_variable,
    threads_by_process,
    threads_of,
)
from ballbot_ros.parameters import CONTROLLER, GYRO
from campaign.site import children

SPIN = [sys.executable, '-c', 'while True: pass']
WAIT = [sys.executable, '-c', 'input()']


@pytest.fixture
def start():
    with contextlib.ExitStack() as stack:

        def start(command):
            process = subprocess.Popen(command, stdin=subprocess.PIPE)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        yield start


def cpu_s(process):
    return sum(thread.cpu_s for thread in threads_of(process.pid).values())


def is_runnable(process):
    return any(thread.is_runnable for thread in threads_of(process.pid).values())


def test_a_process_that_computes_gets_time_and_one_that_waits_gets_none(start):
    spinning, waiting = start(SPIN), start(WAIT)
    wait_for(lambda: cpu_s(waiting) and not is_runnable(waiting), what='its wait')
    before, used_s = threads_of(waiting.pid), cpu_s(spinning)
    wait_for(lambda: cpu_s(spinning) > used_s + 0.05, what='some work')
    assert is_runnable(spinning)
    assert threads_of(waiting.pid) == before


def test_a_process_queues_while_others_have_its_processor(start):
    (cpu, *_) = os.sched_getaffinity(0)
    competitors = [start(SPIN) for _ in range(4)]
    for process in competitors:
        os.sched_setaffinity(process.pid, {cpu})

    def queued_s(process):
        return max(thread.queued_s for thread in threads_of(process.pid).values())

    wait_for(lambda: all(map(threads_of, (each.pid for each in competitors))))
    before = {process.pid: queued_s(process) for process in competitors}
    wait_for(
        lambda: all(queued_s(process) > before[process.pid] + 0.1 for process in competitors),
        what='their wait for the processor',
    )
    assert all(map(is_runnable, competitors))


@contextlib.contextmanager
def scheduled_when_idle(process):
    """Let a process run only when no other one wants its processor."""
    os.sched_setscheduler(process.pid, os.SCHED_IDLE, os.sched_param(0))
    yield


@contextlib.contextmanager
def limited_by_quota(process):
    """Let a process run for 1 ms of 100 ms."""
    group = Path(f'/sys/fs/cgroup/cpu/ballbot_test_{process.pid}')
    try:
        group.mkdir()
    except OSError as error:
        pytest.skip(f'no control group can be made here: {error}')
    try:
        (group / 'cpu.cfs_period_us').write_text('100000')
        (group / 'cpu.cfs_quota_us').write_text('1000')
        (group / 'cgroup.procs').write_text(str(process.pid))
        yield
    finally:
        process.kill()
        process.wait()
        group.rmdir()


@pytest.mark.parametrize('starve', [scheduled_when_idle, limited_by_quota])
def test_a_starved_process_is_not_silent(start, starve):
    (cpu, *_) = os.sched_getaffinity(0)
    starved, competitor, waiting = start(SPIN), start(SPIN), start(WAIT)
    for process in (starved, competitor):
        os.sched_setaffinity(process.pid, {cpu})
    with starve(starved):
        wait_for(lambda: cpu_s(waiting) and not is_runnable(waiting), what='its wait')
        silences = [ProcessSilence(process.pid) for process in (starved, waiting)]
        measured_s = [0.0, 0.0]

        def has_measured():
            measured_s[:] = [silence.measure_s() for silence in silences]
            return measured_s[1] > 1.5

        wait_for(has_measured, what='a silence of the other process')
        assert measured_s[0] < 0.5


def test_a_process_that_is_stopped_neither_runs_nor_queues(start):
    (cpu, *_) = os.sched_getaffinity(0)
    stopped, spinning = start(SPIN), start(SPIN)
    for process in (stopped, spinning):
        os.sched_setaffinity(process.pid, {cpu})
    stopped.send_signal(signal.SIGSTOP)
    wait_for(lambda: not is_runnable(stopped), what='its stop')

    def wait_for_work_of_the_other():
        used_s = cpu_s(spinning)
        wait_for(lambda: cpu_s(spinning) > used_s + 0.05, what='some work')

    # A process is called stopped before the scheduler has switched it out and closed its account.
    # When the other one has worked on the same processor, it has.
    wait_for_work_of_the_other()
    before = threads_of(stopped.pid)
    wait_for_work_of_the_other()
    assert threads_of(stopped.pid) == before


def test_a_process_that_has_ended_has_no_threads(start):
    process = start(WAIT)
    assert process.pid in children(os.getpid())
    wait_for(lambda: threads_of(process.pid), what='its account')
    process.kill()
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    assert threads_of(process.pid) == {}
    process.wait()
    assert threads_of(process.pid) == {}
    assert threads_by_process([process.pid]) == {}
    assert process.pid not in children(os.getpid())


def test_a_plant_knows_the_living_nodes_that_its_command_has_started(monkeypatch):
    observer = LocalProcessObserver()
    assert observer.started_nodes() == []
    ended = subprocess.Popen(['true'])
    ended.wait()
    variable = started_nodes_variable({GYRO: os.getpid(), CONTROLLER: ended.pid})
    for name, value in variable.items():
        monkeypatch.setenv(name, value)
    assert observer.started_nodes() == [LocalNode(GYRO, os.getpid())]


@pytest.mark.parametrize('account', [None, '0 0 0'], ids=['none', 'empty'])
def test_a_kernel_without_scheduler_statistics_gives_no_threads(tmp_path, monkeypatch, account):
    thread = tmp_path / '7' / 'task' / '7'
    thread.mkdir(parents=True)
    (thread / 'stat').write_text('7 (a (node)) R 1')
    if account:
        (thread / 'schedstat').write_text(account)
    monkeypatch.setattr(processes, '_PROC', tmp_path)
    assert threads_by_process([7]) == {}
    (thread / 'schedstat').write_text('2000000000 500000000 3')
    (only,) = threads_of(7).values()
    assert (only.cpu_s, only.queued_s, only.is_runnable) == (2.0, 0.5, True)
