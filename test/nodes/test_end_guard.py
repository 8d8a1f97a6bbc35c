"""Processes that no signal can end, because a call does not return."""

import signal
import subprocess
import sys

import pytest
from graph import LAST_RESORT_S

PROGRAM = """
import ctypes, time
from ballbot_ros.nodes.end_guard import guarded_end
from ballbot_ros.stop_request import StopRequest

mutex = ctypes.create_string_buffer(64)

def block():
    while True:  # calls of the middleware may keep Python's lock, too
        ctypes.PyDLL(None).pthread_mutex_lock(mutex)

with guarded_end(), StopRequest() as stop:
    print('ready', flush=True)
    {body}
print('ended', stop.signal)
"""


@pytest.mark.parametrize(
    ('body', 'status', 'output'),
    [
        pytest.param('block()', -signal.SIGKILL, '', id='blocked'),
        pytest.param(
            'while not stop.signal: time.sleep(0.01)\n    block()',
            -signal.SIGKILL,
            '',
            id='blocked at its end',
        ),
        pytest.param(
            'while not stop.signal: time.sleep(0.01)\n    for _ in range(30): time.sleep(0.1)',
            0,
            f'ended {signal.SIGTERM:d}\n',
            id='slow',
        ),
    ],
)
def test_a_signal_ends_a_blocked_process(body, status, output):
    process = subprocess.Popen(
        [sys.executable, '-c', PROGRAM.format(body=body)], stdout=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdout.readline() == 'ready\n'
        process.send_signal(signal.SIGTERM)
        assert process.communicate(timeout=LAST_RESORT_S)[0] == output
    assert process.returncode == status
