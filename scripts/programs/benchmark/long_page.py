"""Whether the page of a long recorded run is as fast as that of a short one."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console

from ballbot_ros.viewer.browser import browser_page
from ballbot_ros.viewer.page import UPDATE_S, Page
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.recording_page import RecordingPage
from benchmark.figures import RATIO, Figure

SCENARIO = 'square'
SHORT_S, LONG_S = 20.0, 1200.0
WARM_UP_S, MEASURED_S = 5.0, 10.0
SIZE = (1280, 900)

# The 3D scene is the same for both, and without a graphics card it alone would decide the rate.
_WITHOUT_DRAWING = """for (const name of ['clear', 'drawArrays', 'drawElements',
    'drawArraysInstanced', 'drawElementsInstanced'])
  WebGL2RenderingContext.prototype[name] = () => {};"""
_COUNT = """() => { window.frameCount = 0;
  const count = () => { window.frameCount++; requestAnimationFrame(count); }; count(); }"""


def measure_long_pages(repeat: int, progress: Console) -> list[Figure]:
    """Return the frame rates of the pages of both runs, and their ratio."""
    with tempfile.TemporaryDirectory(prefix='ballbot_bench_') as scratch:
        runs = [_recorded(Path(scratch) / f'{length:g}', length) for length in (SHORT_S, LONG_S)]
        rates: list[tuple[float, float]] = []
        for number in range(1, repeat + 1):
            short, long = (page_rate(run) for run in runs)
            rates.append((short, long))
            progress.print(f'{number}/{repeat} short run {short:.1f}, long run {long:.1f} frames/s')
    short_rates, long_rates = zip(*rates, strict=True)
    ratios = [long / short for short, long in rates]
    short_run, long_run = f'{SHORT_S:g} s', f'{LONG_S / 60.0:g} min'
    rate = 'frames a second of the page of'
    return [
        Figure('short_page_rate', f'{rate} {short_run}', RATIO, short_rates),
        Figure('long_page_rate', f'{rate} {long_run}', RATIO, long_rates),
        Figure('long_to_short_page', f'{long_run} / {short_run}', RATIO, ratios, 0.9, 1.0),
    ]


def _recorded(folder: Path, length: float) -> PlaybackRun:
    command = [
        sys.executable, '-m', 'ballbot_ros.cli.main', 'run', SCENARIO, '--json',
        '--processes=none', f'--set=plant_sim.duration={length}', f'--output={folder}',
    ]  # fmt: skip
    # The status is 1 if the length misses the scenario's expectations.
    subprocess.run(command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return PlaybackRun(folder / f'{SCENARIO}.mcap')


def page_rate(run: PlaybackRun) -> float:
    """Return the frames per second that the browser offers to the page while the run plays."""
    with browser_page(*SIZE) as browser:
        browser.add_init_script(_WITHOUT_DRAWING)
        page = Page(run.dimensions, run.name, '127.0.0.1', 0)
        try:
            recording_page = RecordingPage(page, [run])
            recording_page.clock.seek(run.end / 2.0)
            recording_page.clock.is_looping = True
            recording_page.update(0.0)
            browser.goto(page.address)
            browser.locator('.uplot').nth(3).wait_for()
            browser.evaluate(_COUNT)
            _play(recording_page, WARM_UP_S)
            before, begun = browser.evaluate('frameCount'), time.perf_counter()
            _play(recording_page, MEASURED_S)
            offered = browser.evaluate('frameCount') - before
            return float(offered / (time.perf_counter() - begun))
        finally:
            page.stop()


def _play(page: RecordingPage, seconds: float) -> None:
    begun = last = time.perf_counter()
    while (now := time.perf_counter()) - begun < seconds:
        page.update(now - last)
        last = now
        time.sleep(UPDATE_S)
