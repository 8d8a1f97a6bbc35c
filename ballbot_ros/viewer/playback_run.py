"""A recorded run, accessible at any time."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

import numpy as np

from ballbot_ros.analysis.assessment import judge_recorded_properties
from ballbot_ros.analysis.run_data import RunData, Series, read_run
from ballbot_ros.analysis.signals import signals_of
from ballbot_ros.analysis.topic_samples import TopicSamples, read_topic, topics_with_signals
from ballbot_ros.errors import ViewerError
from ballbot_ros.parameters import ControllerParameters, Dimensions
from ballbot_ros.parameters.timing import TICK_NS, TICK_S
from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.messages.topics import BATTERY_STATE, PLANT_IMU, PLANT_ODOM, SONAR_RANGE
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.brick import Tone
from ballbot_ros.robot.brick.job_times import kernel_constants
from ballbot_ros.robot.world.floor_map import OccupancyGrid, floor_map_of
from ballbot_ros.viewer.overlay import Mark, MarkKind
from ballbot_ros.viewer.robot import TRAIL_STEP, wxyz
from ballbot_ros.viewer.snapshot import Snapshot, acting_force
from ballbot_ros.viewer.views import RolledBall

_MARKS_PER_LINE = 200
"""Marks of a kind that are distinguishable on a time line."""


def run_marks(run: RunData) -> tuple[Mark, ...]:
    """Return state changes, pushes, wall hits, tones and moments of properties, in this order.

    Events of a kind that would lie upon each other share a mark.
    """
    states = (
        Mark(state.start, MarkKind.STATE, state.name.replace('_', ' ')) for state in run.states
    )
    pushes = (
        Mark(push.start, MarkKind.PUSH, f'{push.interval.name} of {push.strength}')
        for push in run.pushes
    )
    hits = (Mark(hit.start, MarkKind.HIT, hit.name) for hit in run.wall_hits)
    tones = (
        Mark(time, MarkKind.TONE, f'tone of {tone.frequency_hz} Hz, {tone.duration_ms} ms')
        for time, tone in run.tones
    )
    decisions = (
        Mark(each.start, MarkKind.PROPERTY, each.detail)
        for judgement in judge_recorded_properties(run)
        for each in judgement.marks
    )
    kinds = states, pushes, hits, tones, sorted(decisions, key=lambda mark: mark.time)
    apart = run.end / _MARKS_PER_LINE
    return tuple(mark for kind in kinds for mark in _merged(kind, apart))


def _merged(marks: Iterable[Mark], apart: float) -> Iterator[Mark]:
    """Iterate over marks at least `apart` [s]; each also stands for those up to the next one."""
    groups: list[list[Mark]] = []
    for mark in marks:
        if groups and mark.time - groups[-1][0].time < apart:
            groups[-1].append(mark)
        else:
            groups.append([mark])
    for first, *others in groups:
        text = f'{first.text}, and {len(others)} more' if others else first.text
        yield Mark(first.time, first.kind, text)


class PlaybackRun:
    """A run of a recording.

    Attributes
    ----------
    name, number : str, int
        Its name, and its number in the file, from 1.
    end : float
        Time of its last tick [s].
    damage : str or None
        What is missing in the file, according to the reader; None if nothing is.
    start : tuple of float
        x and y of the first tick in ``map`` [m].
    jobs : Jobs or None
        Those of the brick, if they took time.
    interrupt_us : int
        Time of the brick's interrupt.

    Raises
    ------
    RecordingError
        If the file can't be read or is not a recording of this robot.
    ViewerError
        If the file has no poses of the robot.
    """

    def __init__(
        self,
        path: Path,
        progress: ProgressCallback = lambda done, total: None,
        number: int | None = None,
    ) -> None:
        run = self._run = read_run(path, number, progress)
        has_poses = run.is_real or {PLANT_IMU, PLANT_ODOM} <= run.series.keys()
        if not has_poses or not len(run.motion.time):
            raise ViewerError(f'{path}: nothing to show: it has no poses of the robot')
        self.name, self.number = run.name, run.number
        self.end, self._ahead = run.end, 0.0
        self.damage = run.damage
        self.dimensions = Dimensions.from_parameters(run.plant)
        floor = run.floor  # the published walls, if no map is attached
        self.floor_map = floor_map_of(floor) if isinstance(floor, OccupancyGrid) else floor
        position = run.motion.position
        x, y = position[0].tolist()
        self.start = (x, -y)
        self._ball = RolledBall(position, self.dimensions.ball_radius)
        starts = ((push.start, str(each), push.force) for each, push in enumerate(run.pushes))
        ends = ((push.end, str(each), (0.0, 0.0)) for each, push in enumerate(run.pushes))
        self._forces = [*starts, *ends]
        self.marks = run_marks(run)
        self.jobs = run.jobs
        controller = run.attached.parameters.of(ControllerParameters)
        self.interrupt_us = kernel_constants(controller).interrupt_us
        self._trail_ticks = _trail_ticks(position)
        self._trail = [(x, -y) for x, y in position[self._trail_ticks].tolist()]
        self._state_times = [interval.start for interval in run.states]
        self._page_times = [time for time, _ in run.pages]
        self._tone_times = [time for time, _ in run.tones]

    def align_with(self, other: PlaybackRun) -> None:
        """Take the time of another run: of a real and a simulated one, calibrations end together.

        From then on, times count from the start of the other one.
        """
        if self._run.is_real != other._run.is_real:
            self._ahead = self._run.calibrated - other._run.calibrated
            self.end = self._run.end - self._ahead

    def clock_us(self, time: float) -> int:
        """Return the sim time at a time [s] of the run [µs], as that of its jobs."""
        return self._run.recorded.start_ns // 1000 + round(time * 1e6)

    def snapshot(self, time: float, *, rolls: bool = True) -> Snapshot:
        """Return the robot at `time` [s], or at the nearer end of the run.

        Unless the ball `rolls`, which takes longest, its orientation is left out.
        """
        motion, tick = self._run.motion, self._tick(time)
        time += self._ahead
        state = bisect_right(self._state_times, time) - 1
        page = bisect_right(self._page_times, time) - 1
        x, y = motion.position[tick].tolist()
        psi_x, psi_y = motion.psi[tick].tolist()
        duty_x, duty_y = motion.duty[tick].tolist()
        sonar = self._run.series.get(SONAR_RANGE)
        ball = tuple(wxyz(self._ball.at(tick)).tolist()) if rolls else None
        return Snapshot(
            time=float(motion.time[tick]),
            position=(x, y),
            psi=(psi_x, psi_y),
            duty=(duty_x, duty_y),
            sonar=_newest(sonar, time),
            cone_angle=0.0 if sonar is None else float(sonar.values[0, 1]),  # it is constant
            battery=_newest(self._run.series.get(BATTERY_STATE), time),
            state=self._run.states[state].name if state >= 0 else '',
            lcd=self._run.pages[page][1] if page >= 0 else '',
            ball=ball,
            force=acting_force(self._forces, time),
        )

    def _tick(self, time: float) -> int:
        # Allow for 1 µs: the times of a slider are less exact than the stamps of ticks.
        newest = time + self._ahead + 1e-6
        return max(0, int(np.searchsorted(self._run.motion.time, newest, 'right')) - 1)

    def tone(self, start: float, end: float) -> Tone | None:
        """Return the last tone from `start` to before `end` [s]."""
        number = bisect_left(self._tone_times, end) - 1
        if number < 0 or self._tone_times[number] < start:
            return None
        return self._run.tones[number][1]

    @property
    def ticks(self) -> int:
        """Number of ticks from the start to the end."""
        return round(self.end / TICK_S) + 1

    @property
    def columns(self) -> frozenset[str]:
        """The names of its signals' columns, as in ``Run.frame``."""
        return frozenset(name for signal in signals_of(self._run) for name in signal.columns)

    def table(self, names: Collection[str], ticks: int) -> dict[str, Floats]:
        """Return those of the columns `names` that it has, at its first `ticks` ticks.

        After the end of the run they are NaN.
        """
        own = min(ticks, self.ticks)
        start_ns = self._run.start_ns + round(self._ahead / TICK_S) * TICK_NS
        stamps = start_ns + TICK_NS * np.arange(own)
        table: dict[str, Floats] = {}
        for signal in signals_of(self._run):
            if not set(signal.columns).isdisjoint(names):
                table |= signal.table(self._run, stamps)
        return {
            name: np.pad(values.astype(np.float64), (0, ticks - own), constant_values=np.nan)
            for name, values in table.items()
        }

    def topics(self) -> list[str]:
        """Return the recorded topics whose messages can have numbers."""
        return topics_with_signals(self._run.path)

    def read_topic(self, topic: str, progress: ProgressCallback) -> TopicSamples:
        """Read a topic as :func:`~ballbot_ros.analysis.topic_samples.read_topic` does."""
        return read_topic(self._run, topic, progress)

    def trail(self, time: float) -> list[tuple[float, float]]:
        """Return the trail from the start to `time`, x and y in ``map`` [m]."""
        return self._trail[: bisect_right(self._trail_ticks, self._tick(time))]


def _trail_ticks(position: Floats) -> list[int]:
    """Return the ticks at which the trail gets a point."""
    points = position.tolist()
    ticks = [0]
    for tick, point in enumerate(points):
        if math.dist(point, points[ticks[-1]]) > TRAIL_STEP:
            ticks.append(tick)
    return ticks


def _newest(series: Series | None, time: float) -> float:
    """Return the newest sample at a time [s]; NaN if there is none."""
    if series is None or (place := int(np.searchsorted(series.time, time + 1e-6, 'right'))) == 0:
        return math.nan
    return float(series.values[place - 1, 0])
