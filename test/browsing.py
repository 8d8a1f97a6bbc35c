"""Using a page as a user does."""

import asyncio
import contextlib
import functools
import io
import re
import subprocess
import time

import numpy as np
from graph import BALLBOT, LAST_RESORT_S, environment
from PIL import Image

from ballbot_ros.viewer.browser import FLAGS, browser_program

SIZE = (760, 520)
"""Size of a page [px]."""

FOREIGN = 'evil.example'
"""A foreign name that points to this machine."""

# Without a graphics card a moving scene takes all processors. The page does everything for each
# frame except the drawing itself, which waits until a test looks at a picture.
DRAW_ON_DEMAND = """
window.isDrawing = false;
window.drawnFrames = 0;
let isFrameCounted = false;
for (const name of [
  'clear', 'drawArrays', 'drawElements', 'drawArraysInstanced', 'drawElementsInstanced',
  'drawRangeElements',
]) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...values) {
    if (!window.isDrawing) return;
    draw.apply(this, values);
    if (isFrameCounted || name === 'clear') return;
    isFrameCounted = true;
    requestAnimationFrame(() => { // this frame is complete
      isFrameCounted = false;
      window.drawnFrames += 1;
    });
  };
}
"""


@contextlib.contextmanager
def running(domain, *arguments):
    """Run a command; yield its process."""
    process = subprocess.Popen(
        [*BALLBOT, *map(str, arguments)],
        env=environment(domain),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=LAST_RESORT_S)


@contextlib.contextmanager
def serving(domain, *arguments):
    """Run a command that serves a page; yield its address and its process."""
    with running(domain, *arguments) as process:
        said = []
        for line in process.stdout:
            said.append(line)
            if found := re.search(r'http://\S+', line):
                yield found[0], process
                return
        raise RuntimeError(''.join(said))


class Browser:
    """A browser at that address, which draws the scene only for pictures; its errors are kept."""

    def __init__(self, page, address):
        self.page = page
        page.add_init_script(DRAW_ON_DEMAND)
        width, height = page.viewport_size.values()
        # The part of the page without the panel and the notice about missing graphics hardware.
        self.scene = {'x': 0, 'y': 160, 'width': width - 360, 'height': height - 160}
        self.errors = []
        page.context.set_default_timeout(LAST_RESORT_S * 1e3)  # also for pages that it opens
        page.on('console', lambda m: m.type == 'error' and self.errors.append(m.text))
        page.on('pageerror', lambda error: self.errors.append(str(error)))
        page.goto(address)
        self.wait_for_text('state')

    def wait_for_text(self, text):
        self.page.get_by_text(text).first.wait_for()

    def press(self, name):
        self.page.get_by_role('button', name=name, exact=True).click()

    def pause(self, *, is_paused=True):
        """Pause or resume by the button, which shows what is in effect."""
        wait_until(lambda: self.pressed('Pause') is not None, self)
        if self.pressed('Pause') != is_paused:
            self.press('Pause')
            wait_until(lambda: self.pressed('Pause') == is_paused, self)

    def pressed(self, name):
        """Return whether a button of the overlay is shown as pressed; None if there is none."""
        buttons = self.page.locator('.transport').get_by_role('button', name=name, exact=True)
        states = buttons.evaluate_all('all => all.map(each => each.ariaPressed)')
        return states[0] == 'true' if states else None

    def banner(self):
        """Return the text of the banner, '' if there is none."""
        banner = self.page.locator('.banner')
        return banner.inner_text() if banner.is_visible() else ''

    def choose(self, view):
        """Choose a view by its key, repeatedly: the page ignores keys until it is ready."""

        def is_chosen():
            self.page.keyboard.press(view[0])
            return view in self.inputs()

        wait_until(is_chosen, self)

    def open(self, folder):
        self.page.get_by_text(folder, exact=True).click(force=True)

    def hold_stick(self, forward, rightward):
        """Hold the stick with the mouse."""
        stick = self.page.locator('.stick')
        stick.hover()
        self.page.mouse.down()
        box = stick.bounding_box()
        self.page.mouse.move(
            box['x'] + box['width'] * (1.0 + rightward) / 2.0,
            box['y'] + box['height'] * (1.0 - forward) / 2.0,
        )

    def let_go(self):
        """Release the mouse."""
        self.page.mouse.up()

    def picture(self):
        """Return the gray values of a part of the scene, without the overlay.

        The picture shows a frame that was drawn after the call.
        """
        with self.drawing():
            data = self.page.screenshot(clip=self.scene, style='#overlay { visibility: hidden }')
        return np.asarray(Image.open(io.BytesIO(data)).convert('L'), float)

    @contextlib.contextmanager
    def drawing(self):
        """Draw all frames, the first one before anything else."""
        self.page.evaluate('window.drawnFrames = 0; window.isDrawing = true')
        self.page.wait_for_function('window.drawnFrames > 0')  # a scene at rest: within a second
        yield
        self.page.evaluate('window.isDrawing = false')

    def canvas_size(self):
        """Return width and height of the whole scene [px]."""
        box = self.page.locator('canvas').first.bounding_box()
        return box['width'], box['height']

    def tones(self):
        """Return the number of tones that the page was told to play."""
        tones = self.page.locator('audio').evaluate_all('all => all.map(a => a.dataset.number)')
        return int(tones[0]) if tones else 0

    def has_moved(self, seconds=1.0):
        """Return whether two successive pictures differ in more than single pixels."""
        before = self.picture()
        self.page.wait_for_timeout(seconds * 1e3)
        return bool((np.abs(self.picture() - before) > 30.0).sum() > 40)

    def text(self):
        """Return all text on the page."""
        return self.page.inner_text('body')

    def inputs(self):
        """Return the values of the inputs on the page."""
        return [each.input_value() for each in self.page.locator('input').all()]

    def shown_time(self):
        """Return the sim time next to the scene; None while there is none."""
        found = re.search(r'sim time\s*([\d.]+) s', self.text())
        return float(found[1]) if found else None


class SharedBrowser:
    """One browser for all tests of this process, each of which opens pages of its own.

    To start a browser, and to start a renderer in it, takes longer than most tests. So all pages
    share one renderer, which lives as long as a page is open: an empty one stays open.
    """

    def __init__(self):
        from playwright.sync_api import sync_playwright

        names = f'--host-resolver-rules=MAP {FOREIGN} 127.0.0.1'
        self._playwright = sync_playwright().start()
        self._loop = asyncio.get_running_loop()
        browser = self._playwright.chromium.launch(
            executable_path=browser_program(),
            args=[*FLAGS, '--renderer-process-limit=1', names],
        )
        self._context = browser.new_context()
        kept = self._context.new_page()
        # Only pages of the same host share a renderer.
        kept.route('**', lambda route: route.fulfill(body=''))
        kept.goto('http://127.0.0.1/')
        self._kept = kept
        asyncio._set_running_loop(None)

    @contextlib.contextmanager
    def _in_use(self):
        """Let Playwright's event loop count as running.

        Else it would do so as long as the browser lives, which forbids any other in this thread.
        """
        before = asyncio._get_running_loop()
        asyncio._set_running_loop(self._loop)
        try:
            yield
        finally:
            asyncio._set_running_loop(before)

    @contextlib.contextmanager
    def browser(self):
        """Yield Playwright's browser, for contexts of one's own."""
        with self._in_use():
            yield self._context.browser

    @contextlib.contextmanager
    def page(self, width, height):
        """Open a page of this size [px], which closes at the end with those opened meanwhile."""
        with self._in_use():
            known = self._context.pages
            try:
                page = self._context.new_page()
                page.set_viewport_size({'width': width, 'height': height})
                yield page
            finally:
                for each in self._context.pages:
                    if each not in known:
                        each.close()

    def close(self):
        with self._in_use():
            self._context.browser.close()
            self._playwright.stop()
        asyncio._set_running_loop(None)


@functools.cache
def _shared_browser():
    return SharedBrowser()


def shared_page(width, height):
    """As :func:`ballbot_ros.viewer.browser.browser_page`, in the browser that all tests share."""
    return _shared_browser().page(width, height)


def shared_browser():
    """Yield Playwright's browser, for contexts that the caller makes and closes."""
    return _shared_browser().browser()


def open_document(browser, document, width=1200, scheme='light'):
    """Return the page of a report; errors and requests to hosts are kept in `faults`."""
    context = browser.new_context(viewport={'width': width, 'height': 900}, color_scheme=scheme)
    page = context.new_page()
    page.context.set_default_timeout(LAST_RESORT_S * 1e3)  # also for pages that it opens
    page.faults = []
    page.on('console', lambda m: m.type == 'error' and page.faults.append(m.text))
    page.on('pageerror', lambda error: page.faults.append(str(error)))
    page.on(
        'request',
        lambda r: r.url.startswith(('file:', 'data:', 'blob:')) or page.faults.append(r.url),
    )
    page.goto(document.as_uri())
    page.wait_for_function("!document.getElementById('figures-notice')")
    return page


def close_shared_browser():
    if _shared_browser.cache_info().currsize:
        _shared_browser().close()
        _shared_browser.cache_clear()


@contextlib.contextmanager
def browsing(address):
    with shared_page(*SIZE) as page:
        yield Browser(page, address)


class StubRobot:
    """Records the page's requests."""

    def __init__(self):
        self.asked = []

    def __getattr__(self, name):
        return lambda *arguments: self.asked.append((name, *arguments))


def receive(server, *inputs):
    """Handle messages of a made-up browser, each an input and its value, one after the other."""
    from viser._messages import GuiUpdateMessage

    server.gui._resolve_client = lambda client_id: client_id

    async def handle():
        for handle, value in inputs:
            message = GuiUpdateMessage(handle._impl.uuid, {'value': value})
            await server.gui._handle_gui_updates(1, message)

    asyncio.run_coroutine_threadsafe(handle(), server.get_event_loop()).result()


def another(browser, address):
    """Open another page, which closes with the first."""
    page = browser.page
    other = page.context.new_page()
    other.set_viewport_size(page.viewport_size)
    return Browser(other, address)


def wait_until(condition, browser):
    deadline = time.monotonic() + LAST_RESORT_S
    while not condition():
        assert time.monotonic() < deadline, f'it did not happen: {browser.text()[:2000]}'
        browser.page.wait_for_timeout(50)
