"""Looking at a page as a user does."""

import contextlib
import io
import re
import subprocess
import time

import numpy as np
from graph import BALLBOT, environment
from PIL import Image

from ballbot_ros.viewer.browser import browser_page

SCENE = {'x': 0, 'y': 160, 'width': 600, 'height': 480}
"""What the panel and the notice about missing graphics hardware leave free of the page."""


@contextlib.contextmanager
def serving(domain, *arguments):
    """Run a command that serves a page; yield its address and its process."""
    process = subprocess.Popen(
        [*BALLBOT, *map(str, arguments)],
        env=environment(domain),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        said = []
        for line in process.stdout:
            said.append(line)
            if found := re.search(r'http://\S+', line):
                yield found[0], process
                break
        else:
            raise RuntimeError(''.join(said))
    finally:
        process.terminate()
        process.communicate(timeout=20.0)


class Browser:
    """A browser at that address; what it complains of is kept."""

    def __init__(self, page, address):
        self.page = page
        self.errors = []
        page.on('console', lambda m: m.type == 'error' and self.errors.append(m.text))
        page.on('pageerror', lambda error: self.errors.append(str(error)))
        page.goto(address)
        self.wait_for_text('state')

    def wait_for_text(self, text, timeout=30.0):
        self.page.get_by_text(text).first.wait_for(timeout=timeout * 1e3)

    def press(self, name):
        self.page.get_by_role('button', name=name, exact=True).click()

    def open(self, folder):
        self.page.get_by_text(folder, exact=True).click(force=True)

    def hold(self, name, seconds):
        button = self.page.get_by_role('button', name=name, exact=True)
        button.scroll_into_view_if_needed()
        button.hover(force=True)
        self.page.mouse.down()
        self.page.wait_for_timeout(seconds * 1e3)
        self.page.mouse.up()

    def picture(self):
        data = self.page.screenshot(clip=SCENE)
        return np.asarray(Image.open(io.BytesIO(data)).convert('L'), float)

    def has_moved(self, seconds=1.0):
        """Tell whether pictures a while apart differ in more than single pixels."""
        before = self.picture()
        self.page.wait_for_timeout(seconds * 1e3)
        return bool((np.abs(self.picture() - before) > 30.0).sum() > 40)

    def inputs(self):
        """Return what is chosen and typed on the page."""
        return [each.input_value() for each in self.page.locator('input').all()]

    def shown_time(self):
        """Return the sim time beside the scene."""
        return float(re.search(r'sim time\s*([\d.]+) s', self.page.inner_text('body'))[1])


@contextlib.contextmanager
def browsing(address):
    with browser_page(960, 640) as page:
        yield Browser(page, address)


def wait_until(condition, browser, timeout=20.0):
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, 'timeout'
        browser.page.wait_for_timeout(50)
