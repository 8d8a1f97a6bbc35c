"""Opening a page in the browser of the user."""

import os
import sys
from pathlib import Path

import pytest
from graph import wait_for

from ballbot_ros.cli import web_page
from ballbot_ros.cli.web_page import has_browser, open_browser

ADDRESS = 'http://127.0.0.1:1/?token=a-b_c'


@pytest.mark.parametrize(
    ('environment', 'platform', 'expected'),
    [
        ({}, 'linux', False),
        ({'DISPLAY': ''}, 'linux', False),
        ({'DISPLAY': ':0'}, 'linux', True),
        ({'WAYLAND_DISPLAY': 'wayland-0'}, 'linux', True),
        ({'BROWSER': 'firefox'}, 'linux', True),
        ({}, 'darwin', True),
    ],
)
def test_a_desktop_or_the_users_choice_is_a_browser(environment, platform, expected):
    assert has_browser(environment, platform) == expected


@pytest.fixture
def browser(tmp_path, monkeypatch):
    """A browser that writes its arguments, and complains."""
    program, opened = tmp_path / 'browser', tmp_path / 'opened'
    program.write_text(
        '#!/bin/sh\necho noise; echo noise >&2\n'
        f'echo "$@" "term=$TERM" "tty=$(tty)" > {opened}.part\n'
        f'mv {opened}.part {opened}\nexit 3\n'
    )
    program.chmod(0o755)
    monkeypatch.setenv('BROWSER', f'{program} %s')
    return opened


def test_the_users_browser_opens_the_page_without_terminal_and_noise(browser, capfd):
    open_browser(ADDRESS)
    wait_for(browser.exists, what='the browser')
    assert browser.read_text().split() == [ADDRESS, 'term=', 'tty=not', 'a', 'tty']
    assert capfd.readouterr() == ('', '')


def test_without_a_desktop_nothing_is_started(monkeypatch):
    for name in ('BROWSER', 'DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, 'platform', 'linux')
    monkeypatch.setattr(web_page, 'Thread', None)
    open_browser(ADDRESS)


def test_a_browser_that_can_not_be_started_is_no_error(monkeypatch, capfd):
    monkeypatch.setenv('BROWSER', str(Path(os.devnull) / 'none'))
    monkeypatch.setattr(sys, 'executable', '/nonexistent/python')
    web_page._open(ADDRESS)
    assert capfd.readouterr() == ('', '')
