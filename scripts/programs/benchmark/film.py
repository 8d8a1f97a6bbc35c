"""How fast films are rendered, compared with the page in the same browser."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console

from ballbot_ros.viewer.browser import browser_page
from ballbot_ros.viewer.page import PANEL_WIDTH, UPDATE_S, Page
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.recording_page import RecordingPage
from ballbot_ros.viewer.render import SIZE, frame_times, frames
from ballbot_ros.viewer.views import CHASER_1
from benchmark.figures import RATIO, Figure

FROM_S, TO_S = 5.0, 10.0
"""Excerpt of the scenario in which the robot moves [s]."""

WARM_UP_S = 5.0
"""Wall time after which a page draws at its own pace [s]."""


def measure_films(repeat: int, progress: Console) -> list[Figure]:
    """Return the rates of a film and of a page whose scene has the same size, and their ratio.

    A slow page lowers its resolution to three quarters; a film does not.
    """
    with tempfile.TemporaryDirectory(prefix='ballbot_bench_') as scratch:
        run = PlaybackRun(_record(Path(scratch)))
        pages, films = [], []
        for number in range(1, repeat + 1):
            pages.append(page_rate(run))
            films.append(film_rate(run))
            progress.print(
                f'{number}/{repeat} page {pages[-1]:.1f} frames/s, film {films[-1]:.1f} frames/s'
            )
    ratios = [film / page for film, page in zip(films, pages, strict=True)]
    return [
        Figure('page_rate', 'frames a second of the page', RATIO, pages),
        Figure('film_rate', 'frames a second of a film', RATIO, films),
        Figure('film_to_page', 'film / page', RATIO, ratios, 0.5, 1.0),
    ]


def _record(folder: Path) -> Path:
    command = [
        sys.executable, '-m', 'ballbot_ros.cli.main', 'run', 'autonomous', '--json',
        '--processes=none', f'--set=plant_sim.duration={TO_S}', f'--output={folder}',
    ]  # fmt: skip
    # The status is 1, because a short run misses the scenario's expectations.
    subprocess.run(command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return folder / 'autonomous.mcap'


def film_rate(run: PlaybackRun) -> float:
    """Return the frames that a film gets per second, after its first one."""
    film = frames(run, [(CHASER_1, moment) for moment in frame_times(FROM_S, TO_S, 10)])
    next(film)
    begun = time.perf_counter()
    return sum(1 for _ in film) / (time.perf_counter() - begun)


def page_rate(run: PlaybackRun) -> float:
    """Return the frames per second that the browser draws of the page of a moving robot."""
    width, height = SIZE
    with browser_page(width + PANEL_WIDTH, height) as browser:
        page = Page(run.dimensions, run.name, '127.0.0.1', 0)
        try:
            recording_page = RecordingPage(page, [run])
            browser.goto(page.address)
            while not page.has_clients:
                browser.wait_for_timeout(50)
            for client_id in page.server.get_clients():
                page.set_view(client_id, CHASER_1)
            browser.evaluate(
                '() => { window.drawn = 0;'
                ' const count = () => { window.drawn++; requestAnimationFrame(count); }; count(); }'
            )
            _play(recording_page, WARM_UP_S)
            before, begun = browser.evaluate('drawn'), time.perf_counter()
            _play(recording_page, TO_S - FROM_S)
            drawn = browser.evaluate('drawn') - before
            return float(drawn / (time.perf_counter() - begun))
        finally:
            page.stop()


def _play(page: RecordingPage, seconds: float) -> None:
    page.clock.seek(FROM_S)
    page.clock.is_playing = True
    begun = last = time.perf_counter()
    while (now := time.perf_counter()) - begun < seconds:
        page.update(now - last)
        last = now
        time.sleep(UPDATE_S)
