"""Processes that no signal can end, because a call does not return."""

import signal
import subprocess
import sys

import pytest
from graph import LAST_RESORT_S

PROGRAM = """
import ctypes, signal, time
from ballbot_ros.nodes.end_guard import guarded_end
from ballbot_ros.process import StopRequest

mutex = ctypes.create_string_buffer(64)

def block():
    while True:  # calls of the middleware may keep Python's lock, too
        ctypes.PyDLL(None).pthread_mutex_lock(mutex)

def await_signal():
    print('ready', flush=True)
    while not stop.signal:
        time.sleep(0.01)

with guarded_end(), StopRequest() as stop:
    {body}
print('ended', stop.signal)
"""
ENDED = f'ended {signal.SIGTERM:d}\n'


@pytest.mark.parametrize(
    ('body', 'status', 'output'),
    [
        pytest.param('print("ready", flush=True); block()', -signal.SIGKILL, '', id='blocked'),
        pytest.param('await_signal(); block()', -signal.SIGKILL, '', id='blocked at its end'),
        pytest.param('await_signal(); [time.sleep(0.1) for _ in range(30)]', 0, ENDED, id='slow'),
        pytest.param(
            'signal.signal(signal.SIGALRM, lambda *_: None); signal.setitimer(0, 0.1); '
            'time.sleep(2.5); await_signal()', 0, ENDED, id='another signal',
        ),
    ],
)  # fmt: skip
def test_a_signal_ends_a_blocked_process(body, status, output):
    process = subprocess.Popen(
        [sys.executable, '-c', PROGRAM.format(body=body)], stdout=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdout.readline() == 'ready\n'
        process.send_signal(signal.SIGTERM)
        assert process.communicate(timeout=LAST_RESORT_S)[0] == output
    assert process.returncode == status
