"""What the system tells of processes."""

import contextlib
import os
import signal
import subprocess
import sys

import pytest
from graph import wait_for

from ballbot_ros.processes import activities, activity, children

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


def test_a_process_that_computes_gets_time_and_one_that_waits_gets_none(start):
    spinning, waiting = start(SPIN), start(WAIT)
    wait_for(lambda: not activity(waiting.pid).is_due, what='its wait')
    before = activities([spinning.pid, waiting.pid])
    wait_for(lambda: activity(spinning.pid).cpu_s > before[spinning.pid].cpu_s + 0.05)
    assert activity(spinning.pid).is_due
    assert activity(waiting.pid) == before[waiting.pid]


def test_a_process_is_due_while_others_have_its_processor(start):
    (cpu, *_) = os.sched_getaffinity(0)
    processes = [start(SPIN) for _ in range(4)]
    for process in processes:
        os.sched_setaffinity(process.pid, {cpu})
    before = activities([process.pid for process in processes])
    wait_for(
        lambda: all(
            activity(process.pid).queued_s > before[process.pid].queued_s + 0.1
            for process in processes
        ),
        what='their wait for the processor',
    )


def test_a_process_that_is_stopped_is_not_due(start):
    process = start(SPIN)
    process.send_signal(signal.SIGSTOP)
    wait_for(lambda: not activity(process.pid).is_due, what='its stop')
    stopped = activity(process.pid)
    wait_for(lambda: activity(os.getpid()).cpu_s, what='anything')
    assert activity(process.pid) == stopped


def test_of_a_process_that_is_gone_nothing_is_told(start):
    process = start(WAIT)
    assert process.pid in children(os.getpid())
    process.kill()
    process.wait()
    assert activity(process.pid) is None
    assert activities([process.pid]) == {}
    assert process.pid not in children(os.getpid())
