"""Makes docs/images/viewer_*.png, the pictures of docs/viewer.md, from a run of autonomous.

    .venv/bin/python docs/figures/viewer.py

Needs Chromium, as `ballbot render` does.
"""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from ballbot_ros.viewer.browser import browser_page
from ballbot_ros.viewer.page import Page
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.recording_page import RecordingPage
from ballbot_ros.viewer.render import frames
from ballbot_ros.viewer.views import CHASER_1, VIEWS

IMAGES = Path(__file__).resolve().parents[1] / 'images'
TIME = 9.5
PAGE_SIZE = (1280, 800)
SETTLED_MS = 5000
"""Wall time after which the page has drawn everything [ms]."""


def record(folder: Path) -> PlaybackRun:
    """Run the scenario."""
    command = [sys.executable, '-m', 'ballbot_ros.cli.main', 'run', 'autonomous']
    subprocess.run([*command, '--processes=none', '--output', folder], check=True)
    return PlaybackRun(folder / 'autonomous.mcap')


def page_picture(run: PlaybackRun) -> Image.Image:
    """Return the page, with the recording paused."""
    page = Page(run.dimensions, run.name, '127.0.0.1', 0)
    try:
        recording_page = RecordingPage(page, [run])
        recording_page.clock.is_playing = False
        recording_page.clock.seek(TIME)
        with browser_page(*PAGE_SIZE) as browser:
            browser.goto(page.address)
            while not page.has_clients:
                browser.wait_for_timeout(50)
            # The notice says that there is no graphics card.
            browser.add_style_tag(content='.mantine-Notifications-root { display: none }')
            browser.keyboard.press(str(VIEWS.index(CHASER_1) + 1))
            for _ in range(SETTLED_MS // 100):
                recording_page.update(0.0)
                browser.wait_for_timeout(100)
            return Image.open(io.BytesIO(browser.screenshot()))
    finally:
        page.stop()


def save(picture: Image.Image, name: str) -> None:
    """Write a picture with 256 colours."""
    path = IMAGES / f'viewer_{name}.png'
    picture.convert('RGB').quantize(256).save(path, optimize=True)


def main() -> None:
    """Write the pictures."""
    with TemporaryDirectory() as folder:
        run = record(Path(folder))
        for view, frame in zip(VIEWS, frames(run, [(view, TIME) for view in VIEWS]), strict=True):
            save(Image.fromarray(frame), view)
        save(page_picture(run), 'page')


if __name__ == '__main__':
    main()
