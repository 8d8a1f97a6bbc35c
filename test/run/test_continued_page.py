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
from ballbot_ros.run.requirements import Processes  # noqa: E402
from ballbot_ros.run.spec import RunOptions, RunSpec  # noqa: E402


def press(browser, name):
    browser.page.get_by_role('button', name=name, exact=True).click()


def is_at_the_first_tick(browser):
    """Go there, and return whether the page shows it; one that is very busy may miss it once."""
    page = browser.page
    page.keyboard.press(' ')
    page.wait_for_timeout(300)  # the time that is shown changes
    page.keyboard.press('Home')
    page.keyboard.press('.')
    page.wait_for_timeout(1000)
    return browser.shown_time() == pytest.approx(0.004, abs=0.01)


@pytest.mark.timeout(600)
def test_a_recorded_run_becomes_live_and_is_kept(tmp_path, monkeypatch, domain):
    monkeypatch.chdir(tmp_path)
    recording = recorded(tmp_path, EVENTFUL)
    with serving(domain, 'view', recording, '--port', 0) as (address, process):
        with browsing(address) as browser:
            page = browser.page
            page.get_by_role('button', name='Live').wait_for()
            wait_until(lambda: is_at_the_first_tick(browser), browser)
            press(browser, 'Live')
            browser.wait_for_text('live since 0.00 s')
            wait_until(lambda: 'ghost x' in browser.text(), browser)
            page.get_by_text('Fault', exact=True).click()
            press(browser, 'Begin')
            wait_until(lambda: browser.shown_time() > 2.0, browser)
            page.keyboard.down('w')
            wait_until(lambda: browser.shown_time() > 3.0, browser)
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
