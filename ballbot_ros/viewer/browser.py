"""A headless browser, for pictures and tests."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ballbot_ros.viewer.errors import ViewerError, importing

if TYPE_CHECKING:
    from playwright.sync_api import Page

PROGRAMS = ('chromium', 'chromium-browser', 'google-chrome')

# Software WebGL, because there may be no graphics card. The rest of the page is drawn without it,
# which is faster in software.
_FLAGS = (
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
    """Open a page of this size [px]; raise ViewerError without Chromium or Playwright."""
    program = browser_program()
    with importing():
        from playwright.sync_api import sync_playwright
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(_FLAGS))
        yield browser.new_page(viewport={'width': width, 'height': height})
        browser.close()
