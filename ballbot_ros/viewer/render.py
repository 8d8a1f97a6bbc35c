"""Pictures and films of a recorded run, rendered in a headless browser."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import imageio
import numpy as np
import viser
from numpy.typing import NDArray

from ballbot_ros.progress import ProgressCallback
from ballbot_ros.viewer.browser import browser_page
from ballbot_ros.viewer.errors import ViewerError
from ballbot_ros.viewer.page import Page
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.recording_page import RecordingPage

WIDTH, HEIGHT = 960, 528
"""Size of a picture [px]; film codecs need multiples of 16."""

FRAMES_PER_SECOND = {'.mp4': 20, '.gif': 10}

_CONNECT_S = 60.0
_FRAME_S = 60.0
_SETTLE_S = 1.0

Image = NDArray[np.uint8]
"""Shape (:data:`HEIGHT`, :data:`WIDTH`, 3)."""


def frames(run: PlaybackRun, shots: Sequence[tuple[str, float]]) -> Iterator[Image]:
    """Yield a picture of the run for each view and time [s]; raise ViewerError if that fails."""
    with browser_page(WIDTH, HEIGHT) as browser:
        page = Page(run.dimensions, run.name, '127.0.0.1', 0)
        try:
            recording_page = RecordingPage(page, [run])
            browser.goto(page.address)
            client = _client(page)
            recording_page.show(shots[0][1], panel=True)
            _render_image(client)  # makes the browser load the meshes first
            time.sleep(_SETTLE_S)
            for view, moment in shots:
                page.set_view(client.client_id, view)
                recording_page.show(moment, panel=True)
                yield _render_image(client)
        finally:
            page.stop()


def _client(page: Page) -> viser.ClientHandle:
    deadline = time.monotonic() + _CONNECT_S
    while time.monotonic() < deadline:
        for client in page.server.get_clients().values():
            return client
        time.sleep(0.05)
    raise ViewerError(f'the browser did not show the page within {_CONNECT_S:g} s')


def _render_image(client: viser.ClientHandle) -> Image:
    try:
        image = client.get_render(HEIGHT, WIDTH, timeout=_FRAME_S)
    except (RuntimeError, TimeoutError) as error:
        raise ViewerError(f'the browser failed to render: {error}') from None
    return np.asarray(image[..., :3], np.uint8)


def render_to_file(
    run: PlaybackRun,
    view: str,
    output: Path,
    moment: float,
    progress: ProgressCallback = lambda done, total: None,
) -> None:
    """Render a picture (.png) of the run at `moment` [s], or a film (.mp4, .gif) of the whole run.

    The file appears only when it is complete; an existing one stays unchanged until then.

    Raises
    ------
    ViewerError
        If rendering fails, or the file can't be written.
    """
    rate = FRAMES_PER_SECOND.get(output.suffix)
    times = [moment] if rate is None else np.arange(0.0, run.end, 1.0 / rate).tolist()
    shots = [(view, time) for time in times]
    try:
        with TemporaryDirectory(prefix='.ballbot_', dir=output.parent) as folder:
            unfinished = Path(folder) / output.name
            with _writer(unfinished, rate) as writer:
                for number, frame in enumerate(frames(run, shots), 1):
                    writer.append_data(frame)
                    progress(number, len(shots))
            unfinished.replace(output)
    except (OSError, ImportError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or ' '.join(str(error).split())
        raise ViewerError(f'{output}: {reason}') from None


def _writer(output: Path, rate: int | None) -> Any:
    if rate is None:
        return imageio.get_writer(output)
    if output.suffix == '.gif':
        return imageio.get_writer(output, duration=1000.0 / rate, loop=0)
    return imageio.get_writer(output, fps=rate)
