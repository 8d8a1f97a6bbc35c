"""Waiting for a key in a terminal, as a process in its foreground."""

import signal
import subprocess
import sys
import termios

import pytest
from graph import LAST_RESORT_S, wait_for
from terminal import Terminal, take_terminal

PROGRAM = """
import time
from ballbot_ros.nodes.teleop.terminal import KeyPress
key_press = KeyPress(lambda: print('pressed', flush=True))
try:
    print('ready', flush=True)
    time.sleep(600)
except KeyboardInterrupt:
    key_press.close()
    print('closed', flush=True)
"""


@pytest.fixture
def start():
    started = []

    def start(program, stdin, **options):
        process = subprocess.Popen(
            [sys.executable, '-c', program],
            stdin=stdin,
            stdout=subprocess.PIPE,
            text=True,
            **options,
        )
        started.append(process)
        assert process.stdout.readline() == 'ready\n'
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_the_first_key_is_reported_and_the_terminal_restored(start):
    terminal = Terminal()
    settings = termios.tcgetattr(terminal.side)
    process = start(PROGRAM, terminal.side, preexec_fn=take_terminal)
    assert termios.tcgetattr(terminal.side) != settings
    terminal.press(b'x')
    assert process.stdout.readline() == 'pressed\n'
    wait_for(lambda: termios.tcgetattr(terminal.side) == settings, what='the settings from before')
    assert b'x' not in terminal.screen
    terminal.press(b'\x03')
    assert process.stdout.readline() == 'closed\n'
    assert process.wait(LAST_RESORT_S) == 0


def test_a_key_that_was_pressed_a_moment_before_is_not_lost(start):
    program = """
import time
from ballbot_ros.nodes.teleop.terminal import KeyPress
print('ready', flush=True)
key_press = KeyPress(lambda: print('pressed', flush=True))
time.sleep(600)
"""
    terminal = Terminal()
    terminal.press(b'x')
    process = start(program, terminal.side, preexec_fn=take_terminal)
    assert process.stdout.readline() == 'pressed\n'


def test_ctrl_c_still_interrupts_and_the_terminal_is_restored(start):
    terminal = Terminal()
    settings = termios.tcgetattr(terminal.side)
    process = start(PROGRAM, terminal.side, preexec_fn=take_terminal)
    terminal.press(b'\x03')
    assert process.stdout.readline() == 'closed\n'
    assert process.wait(LAST_RESORT_S) == 0
    assert termios.tcgetattr(terminal.side) == settings


def test_without_a_terminal_or_in_the_background_no_key_is_awaited(start):
    """A process in the background must not change the terminal, which would stop it."""
    terminal = Terminal()
    for stdin in (subprocess.DEVNULL, terminal.side):
        process = start(PROGRAM, stdin)
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == 'closed\n'
        assert process.wait(LAST_RESORT_S) == 0
