"""Pictures and films of recorded runs, rendered in a headless browser."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import re
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from queue import Queue
from threading import Thread

import imageio_ffmpeg
import numpy as np
import PIL.Image
import PIL.ImageDraw
import PIL.ImageFont

from ballbot_ros.errors import ViewerError
from ballbot_ros.files import replacing
from ballbot_ros.parameters import Dimensions, PlantParameters
from ballbot_ros.process import ProgressCallback
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.robot.world.floor_map import load_map
from ballbot_ros.viewer.markers import Area
from ballbot_ros.viewer.offscreen import Image, offscreen_scene
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.recording_page import RecordedRobots
from ballbot_ros.viewer.robot import BLACK, WHITE
from ballbot_ros.viewer.snapshot import Snapshot
from ballbot_ros.viewer.views import CHASER_1, View, camera


@dataclass(frozen=True)
class FilmFormat:
    """How FFmpeg encodes a film.

    Attributes
    ----------
    max_fps : int
        Highest number of frames per second that players show.
    needs_even_size : bool
        Whether two by two pixels have one colour value.
    quality : float or None
        Of a codec with variable bit rate, 0 to 10.
    """

    codec: str
    pixels: str
    max_fps: int
    needs_even_size: bool = False
    quality: float | None = None
    options: tuple[str, ...] = ()


# A palette for each frame, so that no frame waits for the last one.
_PALETTE = (
    'split[image][sample];[sample]palettegen=stats_mode=single[palette];'
    '[image][palette]paletteuse=new=1:dither=none:diff_mode=rectangle'
)

FORMATS = {
    '.mp4': FilmFormat('libx264', 'yuv420p', 60, needs_even_size=True, quality=7),
    '.webp': FilmFormat(
        'libwebp_anim', 'yuv420p', 60, options=('-quality', '80', '-loop', '0')
    ),
    '.gif': FilmFormat('gif', 'pal8', 50, options=('-filter_complex', _PALETTE, '-loop', '0')),
}  # fmt: skip
"""Formats of films by their suffix."""


def write_film(output: Path, images: Iterator[Image], fps: int) -> None:
    """Write a film in the format of its suffix, with `fps` frames per second."""
    first = next(images)
    height, width, _ = first.shape
    film_format = FORMATS[output.suffix]
    encoder = imageio_ffmpeg.write_frames(
        os.fspath(output),
        (width, height),
        fps=fps,
        codec=film_format.codec,
        quality=film_format.quality,
        pix_fmt_out=film_format.pixels,
        output_params=list(film_format.options),
        macro_block_size=1,  # keep the size
        ffmpeg_log_level='error',
    )
    encoder.send(None)  # starts it
    with contextlib.closing(encoder):
        for image in itertools.chain([first], images):
            encoder.send(np.ascontiguousarray(image))


_HEIGHT = 0.045
"""Height of the letters, as a part of the shorter side of the picture."""

_MIN_LETTERS = 10
_OPACITY = 170


def with_time_stamp(image: Image, time: float) -> Image:
    """Return the picture with the time [s] in its lower left corner."""
    picture = PIL.Image.fromarray(image)
    size = max(_MIN_LETTERS, round(_HEIGHT * min(picture.size)))
    font = PIL.ImageFont.load_default(size)
    draw = PIL.ImageDraw.Draw(picture, 'RGBA')
    text = f'{time:.2f} s'
    margin = size // 2
    # The digits differ in width; the box shall not change from frame to frame.
    width = draw.textlength(re.sub(r'\d', '0', text), font)
    left, bottom = margin, picture.height - margin
    box = (left, bottom - 2 * size, left + width + size, bottom)
    draw.rounded_rectangle(box, size // 3, (*BLACK, _OPACITY))
    draw.text((box[2] - size // 2, bottom - size), text, WHITE, font, anchor='rm')
    return np.asarray(picture)


SIZE = (960, 528)
"""Default width and height of a picture [px]."""


def frames(
    run: PlaybackRun,
    shots: Sequence[tuple[View, float]],
    *,
    ghost: PlaybackRun | None = None,
    size: tuple[int, int] = SIZE,
) -> Generator[Image]:
    """Yield a picture of the run for each view and time [s]; raise ViewerError if that fails."""
    width, height = size
    area = Area.of(run.floor_map, run.start)
    with offscreen_scene(width, height) as offscreen:
        offscreen.scene.show_floor(run.floor_map)
        robots = RecordedRobots(offscreen.scene, [run] if ghost is None else [run, ghost])
        for view, time in shots:
            robots.show(time)
            robots.show_trails(time)
            seen = camera(view, run.snapshot(time), run.dimensions, area, width / height)
            yield offscreen.picture(seen)


def present_frames(
    plant: PlantParameters, pose: Callable[[], tuple[Pair, Pair]]
) -> Generator[Image]:
    """Yield pictures of a plant's robot as it then is; a browser is open until the end."""
    dimensions = Dimensions.from_parameters(plant)
    floor = load_map(plant.map) if plant.map else None
    area = Area.of(floor, (plant.start_position_x, plant.start_position_y))
    with offscreen_scene(*SIZE) as offscreen:
        offscreen.scene.show_floor(floor)
        robot = offscreen.scene.add_robot('robot', dimensions)
        while True:
            now = Snapshot(0.0, *pose())
            robot.show(now)
            yield offscreen.picture(camera(CHASER_1, now, dimensions, area, SIZE[0] / SIZE[1]))


class Painter:
    """Draws frames in a thread of its own: Playwright refuses that of a notebook."""

    def __init__(self, frames: Generator[Image]) -> None:
        self._requests: Queue[Future[Image] | None] = Queue()
        self._thread = Thread(target=self._paint, args=(frames,), daemon=True)
        self._thread.start()

    def _paint(self, frames: Generator[Image]) -> None:
        with contextlib.closing(frames):
            while request := self._requests.get():
                try:
                    request.set_result(next(frames))
                except Exception as error:
                    request.set_exception(error)

    def picture(self) -> Image:
        """Return the next frame."""
        self._requests.put(request := Future[Image]())
        return request.result()

    def close(self) -> None:
        """Close the browser."""
        self._requests.put(None)
        self._thread.join()


def frame_times(start: float, end: float, fps: int, rate: float = 1.0) -> list[float]:
    """Return the times of the frames of a film [s]; there is at least one.

    It shows a run from `start` to `end` [s], `rate` seconds of it per second of the film.
    """
    step = rate / fps
    number = math.floor((end - start) / step + 1e-6)
    return [start + step * frame for frame in range(max(1, number))]


@dataclass(frozen=True)
class Rendering:
    """What a picture or a film shows: a run from a camera, and a ghost to compare it with.

    `size` is width and height [px]; with `time_stamp`, the time is written into the picture.
    """

    run: PlaybackRun
    view: View = CHASER_1
    ghost: PlaybackRun | None = None
    size: tuple[int, int] = SIZE
    time_stamp: bool = False

    def write_picture(self, output: Path, time: float) -> None:
        """Write a picture at `time` [s]; errors as in :meth:`write_film`."""
        with replacing(output, ViewerError) as unfinished:
            image = next(self._images([time], lambda done, total: None))
            PIL.Image.fromarray(image).save(unfinished, optimize=True)

    def write_film(
        self,
        output: Path,
        times: Sequence[float],
        fps: int,
        progress: ProgressCallback = lambda done, total: None,
    ) -> None:
        """Write a film of these times [s]; report its progress in frames.

        The file appears only when it is complete; an existing one stays unchanged until then.
        It raises ViewerError if rendering fails, or the file can't be written.
        """
        with replacing(output, ViewerError) as unfinished:
            write_film(unfinished, self._images(times, progress), fps)

    def _images(self, times: Sequence[float], progress: ProgressCallback) -> Iterator[Image]:
        shots = [(self.view, time) for time in times]
        images = frames(self.run, shots, ghost=self.ghost, size=self.size)
        progress(0, len(times))
        with contextlib.closing(images):
            for number, (time, image) in enumerate(zip(times, images, strict=True), 1):
                yield with_time_stamp(image, time) if self.time_stamp else image
                progress(number, len(times))
