"""A headless browser, for pictures and tests."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ballbot_ros.errors import ViewerError, importing, one_line

if TYPE_CHECKING:
    from playwright.sync_api import Page

PROGRAMS = ('chromium', 'chromium-browser', 'google-chrome')

# Software WebGL, because there may be no graphics card. The rest of the page is drawn without it,
# which is faster in software.
FLAGS = (
    '--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
    '--disable-gpu-compositing',
)  # fmt: skip


def browser_program() -> str:
    """Return the path of Chromium; raise ViewerError if it is not installed."""
    for name in PROGRAMS:
        if path := shutil.which(name):
            return path
    raise ViewerError('Chromium not found: install it with `sudo apt install chromium`')


@contextmanager
def browser_page(width: int, height: int) -> Iterator[Page]:
    """Open a page of this size [px]; BallbotError without Playwright or a browser that starts."""
    program = browser_program()
    with importing('film'):
        from playwright.sync_api import Error, sync_playwright
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
            page = browser.new_page(viewport={'width': width, 'height': height})
        except Error as error:
            # The browser's first line on its standard error, or that of Playwright's message.
            said = re.search(r'\[err\] (.+)', str(error))
            reason = one_line(said[1] if said else str(error).partition('\n')[0])
            raise ViewerError(f'{program} does not start: {reason}') from None
        yield page
        browser.close()
