"""How the page of a run is announced and opened."""

import pytest

from ballbot_ros.cli import web_page
from ballbot_ros.cli.web_page import PageObserver, PageOpening, PageOptions
from ballbot_ros.viewer.address import address_in, address_line

ADDRESS = 'http://127.0.0.1:8080/?token=a'


@pytest.fixture
def opened(monkeypatch):
    addresses = []
    monkeypatch.setattr(web_page, 'open_browser', addresses.append)
    return addresses


@pytest.mark.parametrize(
    ('opens_browser', 'waits', 'can_press_key', 'hint'),
    [
        (True, True, True, 'press a key'),
        (False, True, False, '--no-wait'),
        (True, False, True, None),
    ],
)
def test_the_page_is_opened_and_the_wait_announced(
    opened, opens_browser, waits, can_press_key, hint
):
    shown = []
    options = PageOptions(opens_browser=opens_browser, waits=waits)
    opening = PageOpening(options, shown.append, can_press_key=can_press_key)
    opening.on_line('viewer: a warning')
    assert (shown, opened, opening.address) == (['viewer: a warning'], [], '')
    opening.on_line(address_line(ADDRESS))
    assert opened == [ADDRESS] * opens_browser
    assert opening.address == ADDRESS
    assert shown[1] == address_line(ADDRESS)
    assert [hint in line for line in shown[2:]] == ([True] if waits else [])


def test_an_observer_with_a_page_still_shows_the_progress(opened):
    shown, elapsed = [], []

    class Observer:
        update, notice = elapsed.append, shown.append

    opening = PageOpening(PageOptions(waits=False), shown.append, can_press_key=True)
    observer = PageObserver(Observer, opening)
    observer.update(1.0)
    observer.notice(address_line(ADDRESS))
    assert (elapsed, shown, opened) == ([1.0], [address_line(ADDRESS)], [ADDRESS])


def test_only_a_line_of_the_viewer_has_its_address():
    assert address_in(address_line(ADDRESS)) == ADDRESS
    for line in ('', 'viewer  ', f'x {address_line(ADDRESS)}', ADDRESS):
        assert address_in(line) == '', line


@pytest.mark.parametrize('name', ['run', 'drive'])
@pytest.mark.parametrize('option', ['--no-wait', '--no-browser'])
def test_options_of_the_page_need_a_page(command, name, option):
    words = ['stationary'] if name == 'run' else []
    status, _, stderr = command(name, *words, option)
    assert (status, stderr) == (2, f'error: {option}: requires --viewer\n')
