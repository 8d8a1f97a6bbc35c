"""Pictures and films of recorded runs, rendered in a headless browser."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from queue import Queue
from threading import Thread

from ballbot_ros.parameters import Dimensions, PlantParameters
from ballbot_ros.plant.ground_truth import GroundTruth
from ballbot_ros.progress import ProgressCallback
from ballbot_ros.viewer.film_files import replacing, write_film, write_picture
from ballbot_ros.viewer.floor import Area
from ballbot_ros.viewer.offscreen import Image, offscreen_scene
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.recorded_robots import RecordedRobots
from ballbot_ros.viewer.snapshot import Snapshot
from ballbot_ros.viewer.time_stamp import with_time_stamp
from ballbot_ros.viewer.views import CHASER_1, View, camera
from ballbot_ros.world.library import load_map

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


def present_frames(plant: PlantParameters, truth: Callable[[], GroundTruth]) -> Generator[Image]:
    """Yield pictures of a plant's robot as it then is; a browser is open until the end."""
    dimensions = Dimensions.from_parameters(plant)
    floor = load_map(plant.map) if plant.map else None
    area = Area.of(floor, (plant.start_position_x, plant.start_position_y))
    with offscreen_scene(*SIZE) as offscreen:
        offscreen.scene.show_floor(floor)
        robot = offscreen.scene.add_robot('robot', dimensions)
        while True:
            now = Snapshot(0.0, truth().position, truth().psi)
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


@dataclass(frozen=True)
class Excerpt:
    """The part of a run that a film shows.

    Attributes
    ----------
    start, end : float
        First and last time [s].
    fps : int
        Frames per second of the film.
    rate : float
        Seconds of the run per second of the film.
    """

    start: float
    end: float
    fps: int
    rate: float = 1.0

    def times(self) -> list[float]:
        """Return the time of each frame [s]; there is at least one."""
        step = self.rate / self.fps
        number = math.floor((self.end - self.start) / step + 1e-6)
        return [self.start + step * frame for frame in range(max(1, number))]


@dataclass(frozen=True)
class Rendering:
    """What a picture or a film shows.

    Attributes
    ----------
    run, ghost : PlaybackRun
        The run, and one to compare it with.
    view : View
        The camera.
    size : tuple of int
        Width and height [px].
    time_stamp : bool
        Whether the time is written into the picture.
    """

    run: PlaybackRun
    view: View = CHASER_1
    ghost: PlaybackRun | None = None
    size: tuple[int, int] = SIZE
    time_stamp: bool = False

    def write_picture(self, output: Path, time: float) -> None:
        """Write a picture at `time` [s]; errors as in :meth:`write_film`."""
        with replacing(output) as unfinished:
            write_picture(unfinished, next(self._images([time], lambda done, total: None)))

    def write_film(
        self,
        output: Path,
        excerpt: Excerpt,
        progress: ProgressCallback = lambda done, total: None,
    ) -> None:
        """Write a film; report its progress in frames.

        The file appears only when it is complete; an existing one stays unchanged until then.

        Raises
        ------
        ViewerError
            If rendering fails, or the file can't be written.
        """
        with replacing(output) as unfinished:
            write_film(unfinished, self._images(excerpt.times(), progress), excerpt.fps)

    def _images(self, times: Sequence[float], progress: ProgressCallback) -> Iterator[Image]:
        shots = [(self.view, time) for time in times]
        images = frames(self.run, shots, ghost=self.ghost, size=self.size)
        progress(0, len(times))
        with contextlib.closing(images):
            for number, (time, image) in enumerate(zip(times, images, strict=True), 1):
                yield with_time_stamp(image, time) if self.time_stamp else image
                progress(number, len(times))
