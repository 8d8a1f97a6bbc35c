"""The page of `ballbot run --viewer`: waiting, pausing, the verdict, and another scenario."""

import json
import signal

import pytest

pytest.importorskip('rclpy')
pytestmark = [
    pytest.mark.graph,
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.usefixtures('needs_browser'),
]

from browsing import browsing, wait_until  # noqa: E402
from graph import record  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from ros_client import Client  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402
from terminal import Terminal  # noqa: E402

from ballbot_ros.analysis.parent import Parent  # noqa: E402
from ballbot_ros.nodes.viewer_requests import parameter_setting  # noqa: E402
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS  # noqa: E402
from ballbot_ros.recording.messages.topics import PLANT_IMU  # noqa: E402
from ballbot_ros.recording.reader import RecordingReader  # noqa: E402

DURATION_S = 4
SLOW = '0.1'
"""Real-time factor at which no scenario ends before the test looks, not even on a slow machine."""

OPTIONS = (
    '--set', f'plant_sim.duration={DURATION_S}', '--set', 'plant_sim.kernel=true',
    '--set', 'plant_sim.link=true',
)  # fmt: skip
END_S = FIRST_TICK_NS / SECOND_NS + DURATION_S

# Notes each change of banner, state and sim time.
WATCH = """() => {
  window.seen = [];
  const look = () => {
    const banner = document.querySelector('.banner');
    const text = document.body.innerText;
    const [, state, time] = text.match(/state\\s+(.*)\\s+sim time\\s+(\\S*)/) ?? [];
    const now = [banner.hidden ? '' : banner.innerText, state, time];
    if (String(now) !== String(window.seen.at(-1))) window.seen.push(now);
  };
  setInterval(look, 10);
}"""


@pytest.fixture
def client(domain):
    client = Client(domain)
    client.watch(PLANT_IMU)
    yield client
    client.close()


def pause(client, *, is_paused):
    client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=is_paused))


def test_the_page_of_a_run_says_what_it_is_doing(start_run, client, tmp_path):
    terminal = Terminal()
    run = start_run(
        'stationary', '--viewer', '--json', '--set', 'viewer.port=0', *OPTIONS,
        '--real-time-factor', SLOW,
        '--output', tmp_path / 'runs', stderr=terminal.side,
    )  # fmt: skip
    terminal.wait_for_match(r'viewer  http\S+\r\nthe run begins when')
    address = terminal.screen.split(b'viewer  ')[1].split()[0].decode()
    client.spin_until(lambda: PLANT_IMU.name in client.newest)
    assert client.newest[PLANT_IMU.name].header.stamp.sec == 1, 'it waits at its first tick'
    with browsing(address) as browser:
        client.spin_until(lambda: client.newest[PLANT_IMU.name].header.stamp.nanosec > 0)
        it_is_paused_from_anywhere(browser, client)
        it_shows_the_processor_after_some_steps(browser)
        outcome = it_ends_with_a_verdict(browser, client, run)
        another_scenario_shows_nothing_of_it(browser)
        it_goes_back(browser, tmp_path / 'runs')
        assert browser.errors == [], browser.errors
    run.process.send_signal(signal.SIGINT)
    assert run.finish() == 128 + signal.SIGINT
    result, _ = json.JSONDecoder().raw_decode(run.stdout)
    _, offline = record(tmp_path / 'offline', 'stationary', *OPTIONS)
    assert result['outcome'] == outcome == offline['outcome']
    assert result['duty_sha256'] == offline['duty_sha256']


def it_goes_back(browser, folder):
    """The run so far happens again up to then, and is driven from then on."""
    wait_until(lambda: (browser.shown_time() or 0.0) > FIRST_TICK_NS / SECOND_NS, browser)
    browser.page.get_by_label('Time', exact=True).fill(str(FIRST_TICK_NS / SECOND_NS))
    wait_until(lambda: browser.banner().startswith('starting @0.000'), browser)
    wait_until(lambda: (browser.shown_time() or 0.0) > END_S, browser)
    with RecordingReader(folder / '3' / 'square_branch.mcap') as reader:
        parent = Parent.decode(reader.attachments())
    assert (parent.at, parent.changes) == (0.0, ('driven by hand',))


def it_is_paused_from_anywhere(browser, client):
    """By the key, by the button, and by another program."""
    wait_until(lambda: browser.pressed('Pause') is False, browser)
    for act, is_paused in (
        (lambda: browser.page.keyboard.press(' '), True),
        (lambda: browser.press('Pause'), False),
        (lambda: pause(client, is_paused=True), True),
        (lambda: browser.page.keyboard.press(' '), False),
        (lambda: browser.page.keyboard.press(' '), True),
    ):
        act()
        wait_until(lambda is_paused=is_paused: browser.pressed('Pause') == is_paused, browser)
        wait_until(
            lambda is_paused=is_paused: browser.banner().startswith('paused') == is_paused, browser
        )
    assert browser.pressed(f'{SLOW}×')
    client.call(
        SetParameters, 'plant_sim/set_parameters', parameter_setting('real_time_factor', 0.0)
    )
    wait_until(lambda: browser.pressed('max') and not browser.pressed(f'{SLOW}×'), browser)


def it_shows_the_processor_after_some_steps(browser):
    panel = browser.page.locator('svg.processor')
    wait_until(lambda: browser.page.keyboard.press('.') or panel.count() == 1, browser)
    assert 'task_ts1' in panel.text_content()


def it_ends_with_a_verdict(browser, client, run):
    """Return the outcome on the page."""
    pause(client, is_paused=False)
    wait_until(lambda: 'report' in browser.banner(), browser)
    assert browser.pressed('Pause') is None
    with browser.page.context.expect_page() as opened:
        # The notice about missing graphics hardware may cover it.
        browser.page.locator('.banner a').dispatch_event('click')
    report = opened.value
    report.wait_for_load_state()
    assert 'stationary' in report.title()
    report.close()
    return browser.banner().splitlines()[0].removeprefix('stationary: ')


def another_scenario_shows_nothing_of_it(browser):
    assert browser.shown_time() == pytest.approx(END_S)
    browser.page.evaluate(WATCH)
    browser.page.get_by_label('Next').click()
    browser.page.get_by_role('option', name='square').click()
    browser.press('Start')
    wait_until(lambda: (browser.shown_time() or END_S) < END_S, browser)
    seen = browser.page.evaluate('window.seen')
    starting = next(n for n, (banner, *_) in enumerate(seen) if banner == 'starting square …')
    # Banner and panel arrive over two connections.
    cleared = next(n for n, (_, _, time) in enumerate(seen) if n >= starting - 1 and time == '–')
    assert cleared - starting <= 1
    assert all(time == '–' or float(time) < END_S for _, _, time in seen[cleared:])
    assert {state for _, state, _ in seen[cleared:]} <= {'–', 'initialization', 'calibration'}
