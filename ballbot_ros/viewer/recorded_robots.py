"""The robots of recorded runs in a scene."""

from __future__ import annotations

from collections.abc import Sequence

from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.scene import Scene


class RecordedRobots:
    """The robot of a run and, if there is a second run, that of the other one as its ghost."""

    def __init__(self, scene: Scene, runs: Sequence[PlaybackRun]) -> None:
        self._runs = runs
        self._robots = [
            scene.add_robot(name, run.dimensions, ghost=name != 'robot')
            for name, run in zip(('robot', 'ghost'), runs, strict=False)
        ]

    def show(self, time: float) -> None:
        """Show the robots at `time` [s]."""
        for robot, run in zip(self._robots, self._runs, strict=True):
            robot.show(run.snapshot(time))

    def show_trails(self, time: float) -> None:
        """Show the paths until `time` [s]."""
        for robot, run in zip(self._robots, self._runs, strict=True):
            robot.show_trail(run.trail(time))
