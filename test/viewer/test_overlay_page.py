"""The overlay in a browser: what it shows, and what it sends."""

import contextlib

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('needs_browser')]

from browsing import browsing, wait_until  # noqa: E402
from graph import wait_for  # noqa: E402
from parts import DIMENSIONS  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from ballbot_ros.viewer.overlay import (  # noqa: E402
    Banner,
    BannerKind,
    Button,
    ChooseRate,
    Hold,
    Mark,
    MarkKind,
    OverlayState,
    Press,
    Seek,
    Timeline,
)
from ballbot_ros.viewer.page import Page  # noqa: E402
from ballbot_ros.viewer.scene import ScenePanel  # noqa: E402
from ballbot_ros.viewer.snapshot import Snapshot  # noqa: E402

STATE = OverlayState(
    banner=Banner('paused', BannerKind.BUSY, ('peak pitch 1.2°',), '/report', 'Report'),
    buttons=(
        Button('pause', 'Pause', ' ', 'Pause or run', is_pressed=True),
        Button('step', 'Step'),
    ),
    rates=('0.5×', '1×'),
    rate='1×',
    timeline=Timeline(8.0, (Mark(2.0, MarkKind.PUSH, 'push 1 N'),)),
    can_drive=True,
)

GAMEPAD = """() => {
  const gamepad = { connected: true, axes: [0.02, -0.75, 0.5, 0.0] };
  navigator.getGamepads = () => [null, window.isPlugged ? gamepad : null];
}"""


@contextlib.contextmanager
def served():
    """Serve a page."""
    page = Page(DIMENSIONS, 'NXT Ballbot', '127.0.0.1', 0)
    ScenePanel(page.server.gui).show(Snapshot(0.0, (0.0, 0.0), (0.0, 0.0)))
    page.overlay.show(STATE)
    yield page
    page.stop()


@pytest.fixture(scope='module')
def lasting(needs_browser):
    """A page that is served and open during all tests that do it no harm."""
    with served() as page, browsing(page.address) as browser:
        yield page, browser


@pytest.fixture
def opened(lasting):
    """The page, the browser that shows it, and what it requests from now on."""
    page, browser = lasting
    page.overlay.show(STATE)
    for selector in ('.transport', '.stick'):
        browser.page.locator(selector).wait_for()
    page.overlay.take()
    yield page, browser, Requests(page, browser)
    assert browser.errors == []


class Requests:
    """The requests of a page so far."""

    def __init__(self, page, browser):
        self.page, self.browser = page, browser

    def take_some(self):
        """Wait for requests, and return them."""
        taken = []
        wait_until(lambda: taken.extend(self.page.overlay.take()) or taken, self.browser)
        return taken

    def wait_for(self, *expected):
        """Wait until exactly these requests have come."""
        taken = []
        wait_until(lambda: taken.extend(self.page.overlay.take()) or len(taken) >= len(expected),
                   self.browser)  # fmt: skip
        assert taken == list(expected)

    def newest_hold(self):
        """Return the newest report of the stick, forward and rightward, if there is a new one."""
        holds = [each for each in self.page.overlay.take() if isinstance(each, Hold)]
        return (holds[-1].forward, holds[-1].rightward) if holds else None

    def wait_for_hold(self, forward, rightward):
        expected = pytest.approx((forward, rightward), abs=0.02)
        wait_until(lambda: self.newest_hold() == expected, self.browser)


def test_buttons_keys_and_the_time_line_send_requests(opened):
    page, browser, requests = opened
    assert browser.page.title() == 'NXT Ballbot'
    for name, pressed in (('Pause', 'true'), ('Step', 'false'), ('1×', 'true')):
        button = browser.page.get_by_role('button', name=name, exact=True)
        assert button.get_attribute('aria-pressed') == pressed
    browser.press('Step')
    requests.wait_for(Press('step'))
    browser.press('0.5×')
    requests.wait_for(ChooseRate('0.5×'))
    browser.press('Pause')
    browser.page.keyboard.press(' ')  # once, though the button was clicked before
    requests.wait_for(Press('pause'), Press('pause'))
    browser.page.locator('.mark').click()
    requests.wait_for(Seek(2.0))
    page.overlay.move_playhead(4.0)
    browser.page.get_by_text('4.00 / 8.00 s').wait_for()
    assert browser.page.locator('.mark').get_attribute('title') == '2.00 s: push 1 N'
    slider = browser.page.get_by_label('Time', exact=True)
    box = slider.bounding_box()
    browser.page.mouse.click(box['x'] + box['width'] / 4, box['y'] + box['height'] / 2)
    (seek, *_) = requests.take_some()
    assert seek.time == pytest.approx(2.0, abs=0.2)


def test_a_page_tells_when_it_has_drawn_the_robot():
    with served() as page:
        with connect(page.address.replace('http', 'ws').replace('/?', '/link?')):
            assert not page.overlay.is_drawn  # a connection alone draws nothing
        with browsing(page.address) as browser:
            wait_until(lambda: page.overlay.is_drawn, browser)
        wait_for(lambda: not page.overlay.is_drawn, what='the end of the page')


def test_the_banner_shows_its_details(opened):
    page, browser, _ = opened
    banner = browser.page.get_by_role('status').filter(has_text='paused')
    banner.wait_for()
    assert banner.inner_text().split('\n') == ['paused', 'peak pitch 1.2°', 'Report']
    assert banner.get_by_role('link').get_attribute('href') == '/report'
    page.overlay.show(OverlayState())
    banner.wait_for(state='hidden')
    browser.page.locator('.transport').wait_for(state='hidden')


def test_a_lost_connection_is_shown():
    with served() as page, browsing(page.address) as browser:
        browser.page.locator('.transport').wait_for()
        assert browser.errors == []
        page.stop()
        browser.wait_for_text('connection lost')


def test_keys_stick_and_gamepad_drive(opened):
    page, browser, requests = opened
    keyboard = browser.page.keyboard
    keyboard.down('w')
    requests.wait_for_hold(0.5, 0.0)
    keyboard.down('ArrowLeft')
    requests.wait_for_hold(0.5, -0.5)
    keyboard.press('+')
    requests.wait_for_hold(0.6, -0.6)
    browser.page.evaluate('dispatchEvent(new Event("blur"))')  # another window has the keys
    requests.wait_for_hold(0.0, 0.0)
    keyboard.up('w')
    keyboard.up('ArrowLeft')

    browser.hold_stick(-1.0, 1.0)
    requests.wait_for_hold(-(0.5**0.5), 0.5**0.5)
    browser.let_go()
    requests.wait_for_hold(0.0, 0.0)

    browser.page.evaluate(GAMEPAD)
    browser.page.evaluate('window.isPlugged = true')
    requests.wait_for_hold(0.75, 0.5)
    browser.page.evaluate('window.isPlugged = false')
    requests.wait_for_hold(0.0, 0.0)

    page.overlay.show(OverlayState())
    browser.page.locator('.stick').wait_for(state='hidden')
    keyboard.down('w')
    browser.page.wait_for_timeout(300)
    assert page.overlay.take() == []
    keyboard.up('w')

    page.overlay.show(STATE)
    browser.page.locator('.stick').wait_for()
    keyboard.press('-')  # as before


def test_the_page_follows_the_browser_s_colour_scheme_and_keeps_its_token(opened):
    _, browser, requests = opened
    _has_bright_text(browser, is_bright=False)
    for scheme in ('dark', 'light'):
        # Each change reloads the page, without which viser would keep its scheme. A browser that
        # tells the new page of the scheme after it has started makes it reload once more, so that
        # waiting for one navigation is not enough.
        browser.page.evaluate('window.isOld = true')
        browser.page.emulate_media(color_scheme=scheme)
        _has_bright_text(browser, is_bright=scheme == 'dark')
        browser.press('Step')
        requests.wait_for(Press('step'))
        if scheme == 'dark':
            browser.page.reload()  # as the user does
            _has_bright_text(browser, is_bright=True)
            browser.press('Step')
            requests.wait_for(Press('step'))


def _has_bright_text(browser, *, is_bright):
    """Wait until the texts of overlay and panel of a new page are bright, or dark."""
    browser.page.wait_for_function(
        """isBright => !window.isOld && ['.transport', 'table'].every(selector => {
          const node = document.querySelector(selector);
          const levels = node && getComputedStyle(node).color.match(/[0-9]+/g).slice(0, 3);
          return levels && (levels.reduce((sum, each) => sum + Number(each), 0) > 384) === isBright;
        })""",
        arg=is_bright,
    )


def test_on_a_phone_nothing_is_beyond_the_edge(opened):
    _, browser, _ = opened
    size = browser.page.viewport_size
    browser.page.set_viewport_size({'width': 390, 'height': 780})
    for selector in ('.banner', '.transport', '.driving', '.stick'):
        node = browser.page.locator(selector)
        wait_until(lambda node=node: _is_inside(node.bounding_box(), 390), browser)
    width = browser.page.evaluate('document.documentElement.scrollWidth')
    assert width <= 390
    browser.page.set_viewport_size(size)


def _is_inside(box, width):
    return box is not None and box['x'] >= 0 and box['x'] + box['width'] <= width
