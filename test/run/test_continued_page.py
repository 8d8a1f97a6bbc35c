"""The page of a recorded run that becomes live, in a browser."""

import re

import pytest

pytest.importorskip('rclpy')
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('needs_browser')]

from branching import EVENTFUL, recorded, run  # noqa: E402
from browsing import browsing, serving, wait_until  # noqa: E402
from graph import LAST_RESORT_S  # noqa: E402
from own_controllers import BALANCE  # noqa: E402

from ballbot_ros.analysis.parent import Parent  # noqa: E402
from ballbot_ros.recording.reader import RecordingReader  # noqa: E402
from ballbot_ros.run.branch import read_past  # noqa: E402
from ballbot_ros.run.continued_page import LIVE, ContinuedPage  # noqa: E402
from ballbot_ros.run.continued_run import ContinuedRun  # noqa: E402
from ballbot_ros.run.requirements import Processes  # noqa: E402
from ballbot_ros.run.spec import RunOptions, RunSpec  # noqa: E402
from ballbot_ros.viewer.overlay import Press  # noqa: E402
from ballbot_ros.viewer.page import Page  # noqa: E402
from ballbot_ros.viewer.playback_run import PlaybackRun  # noqa: E402


def press(browser, name):
    browser.page.get_by_role('button', name=name, exact=True).click()


@pytest.mark.timeout(600)
def test_a_recorded_run_becomes_live_and_is_kept(tmp_path, monkeypatch, domain):
    monkeypatch.chdir(tmp_path)
    recording = recorded(tmp_path, EVENTFUL)
    with serving(domain, 'view', recording, '--port', 0) as (address, process):
        with browsing(address) as browser:
            page = browser.page
            page.get_by_role('button', name='Live').wait_for()
            for key in '.', 'Home', '.':  # not Space, which plays again if the end was reached
                page.keyboard.press(key)
            wait_until(lambda: browser.shown_time() == pytest.approx(0.004, abs=0.01), browser)
            press(browser, 'Live')
            browser.wait_for_text('live since 0.00 s')
            wait_until(lambda: 'ghost x' in browser.text(), browser)
            page.get_by_text('Fault', exact=True).click()
            press(browser, 'Begin')
            wait_until(lambda: browser.shown_time() > 2.0, browser)
            page.keyboard.down('w')
            begun = browser.shown_time()
            wait_until(lambda: browser.shown_time() > begun + 1.0, browser)
            page.keyboard.up('w')
            press(browser, 'Pause')
            press(browser, 'Keep')
            browser.wait_for_text('kept')
            kept = re.search(r'runs/\S+?\.mcap', browser.text())[0]
            with RecordingReader(tmp_path / kept) as reader:
                told = Parent.decode(reader.attachments()).changes
            assert told[0].startswith('fault gyro_x off time=')
            assert told[1:] == ('driven by hand',)
            press(browser, 'Again')
            wait_until(lambda: browser.shown_time() < 1.5, browser)
            # A click on the time line goes back, or on to any other moment of the recorded run.
            page.locator('.mark[data-kind="push"]').first.click()
            browser.wait_for_text('live since 2.00 s')
            press(browser, 'Recorded')
            page.get_by_role('button', name='Live').wait_for()
            wait_until(lambda: 'ghost x' not in browser.text(), browser)
            assert browser.errors == []
        process.terminate()
        assert process.wait(LAST_RESORT_S) == 0


@pytest.mark.timeout(600)
def test_a_click_counts_although_the_bar_changes_while_the_button_is_down(tmp_path, domain):
    recording = recorded(tmp_path, EVENTFUL)
    with (
        serving(domain, 'view', recording, '--port', 0) as (address, _),
        browsing(address) as browser,
    ):
        page = browser.page
        mark = page.locator('.mark[data-kind="push"]').first
        mark.hover()
        page.mouse.down()
        for key in '.', 'Home':  # the first changes a button
            page.keyboard.press(key)
        wait_until(lambda: browser.shown_time() == 0.0, browser)
        page.mouse.up()
        wait_until(lambda: browser.shown_time() == pytest.approx(2.0, abs=0.01), browser)


@pytest.mark.timeout(600)
def test_a_run_that_can_not_go_on_says_why(tmp_path, domain):
    own = tmp_path / 'own.py'
    own.write_text(BALANCE)
    options = RunOptions(processes=Processes.NONE, controller=f'{own}:Balance')
    recording = tmp_path / 'own.mcap'
    run(RunSpec.of_scenario('stationary', options), recording)
    own.unlink()
    with (
        serving(domain, 'view', recording, '--port', 0) as (address, _),
        browsing(address) as browser,
    ):
        press(browser, 'Live')
        browser.wait_for_text('give your copy of that code as')
        assert browser.page.get_by_role('button', name='Live').count() == 1


def test_what_was_asked_before_live_is_done_before(tmp_path, monkeypatch):
    """As when a busy page takes several requests at once."""
    recording = recorded(tmp_path, EVENTFUL)
    run = PlaybackRun(recording)
    page = Page(run.dimensions, run.name, '127.0.0.1', 0)
    states, requests = [], [Press('start'), Press('pause'), Press(LIVE.name)]
    monkeypatch.setattr(page.overlay, 'take', lambda: requests)
    monkeypatch.setattr(page.overlay, 'show', states.append)
    with RecordingReader(recording) as reader:

        def make():
            past = read_past(reader, run.number, tmp_path, None, trust_attached_code=False)
            return ContinuedRun(past, tmp_path)

        shown = ContinuedPage(page, [run], make, print)
        shown.clock.seek(2.0)
        shown.update(0.0)
        shown.close()
    page.stop()
    pause = next(button for button in states[-1].buttons if button.name == 'pause')
    assert states[-1].banner.text == 'live since 0.00 s'
    assert not pause.is_pressed
