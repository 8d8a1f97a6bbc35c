"""`ballbot run --viewer` in a terminal: the browser, the wait, and its end."""

import os
import re
import signal
import termios

import pytest
from graph import BALLBOT, LAST_RESORT_S, children, environment, wait_for
from terminal import Terminal

pytest.importorskip('rclpy')
pytest.importorskip('viser', reason='the extra viewer is not installed')
pytestmark = pytest.mark.graph

RUN = ('run', 'stationary', '--viewer', '--no-record', '--set=viewer.port=0',
       '--set=plant_sim.duration=1', '--real-time-factor=0')  # fmt: skip
WAITS = b'the run begins when'


@pytest.fixture
def terminal():
    return Terminal()


@pytest.fixture
def start(domain, terminal, tmp_path):
    """Start the command in the terminal, with a browser that writes what it is told to open."""
    browser = tmp_path / 'browser'
    opened, part = tmp_path / 'opened', tmp_path / 'part'
    browser.write_text(f'#!/bin/sh\necho "$1" > {part}\nmv {part} {opened}\n')
    browser.chmod(0o755)
    started = []

    def start(*arguments):
        variables = environment(domain) | {'BROWSER': f'{browser} %s'}
        started.append(terminal.start([*BALLBOT, *RUN, *arguments], **variables))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait(LAST_RESORT_S)


def test_the_browser_opens_and_a_key_begins_the_run(start, terminal, tmp_path):
    """The address comes first, on its own line; nothing is left of the bar below it."""
    settings = termios.tcgetattr(terminal.side)
    process = start()
    terminal.wait_for_text(WAITS)
    address = re.match(rb'viewer  (\S+)\r\n', terminal.screen)[1].decode()
    opened = tmp_path / 'opened'
    wait_for(opened.exists, what='the browser')
    assert opened.read_text().strip() == address
    terminal.press(b'x')
    terminal.wait_for_text(b'the page stays open')
    assert termios.tcgetattr(terminal.side) == settings
    assert b'passed' in terminal.screen or b'expectations' in terminal.screen
    terminal.press(b'\x03')
    process.wait(LAST_RESORT_S)
    assert b'Traceback' not in terminal.screen


def test_ctrl_c_ends_the_wait(start, terminal, tmp_path):
    settings = termios.tcgetattr(terminal.side)
    process = start('--no-browser')
    terminal.wait_for_text(WAITS)
    terminal.wait_for_text(b'starting')
    terminal.press(b'\x03')
    assert process.wait(LAST_RESORT_S) == 128 + signal.SIGINT
    assert termios.tcgetattr(terminal.side) == settings
    assert b'Traceback' not in terminal.screen
    assert not (tmp_path / 'opened').exists()


def test_a_run_does_not_wait_for_a_page_that_can_not_be_opened_any_more(start, terminal):
    process = start('--no-browser')
    terminal.wait_for_text(WAITS)
    viewer = wait_for(lambda: children(process.pid).get('viewer'), what='the viewer')
    os.kill(viewer, signal.SIGKILL)
    process.wait(LAST_RESORT_S)
    terminal.wait_for_text(b'viewer was killed by SIGKILL')
    terminal.wait_for_text(b'ticks')
    assert b'Traceback' not in terminal.screen
