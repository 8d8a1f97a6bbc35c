"""The state of the robot at one instant, and its recent history."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ballbot_ros.analysis.figure_parts import plane_columns
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.recording.messages.conversions import NO_CONTROLLER_STATE, ControllerState
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.viewer.robot import TRAIL_STEP

ForceEvent = tuple[float, str, Pair]
"""Time [s], name of a push, and its force in plane signs from then on [N]."""


def acting_force(events: Iterable[ForceEvent], time: float) -> Pair:
    """Return the force in plane signs [N] at `time` [s], given the starts and ends of the pushes.

    Times are allowed 1 µs, as a time of a slider is less exact than a stamp.
    """
    forces = {name: force for start, name, force in sorted(events) if start <= time + 1e-6}
    return sum(x for x, _ in forces.values()), sum(y for _, y in forces.values())


class ShownRun:
    """Decides by the announcements of runs, and by the stamps of samples.

    Times of publication are on the wall clock [ns]; only those of one machine are compared. `name`
    is that of the announcement; '' before the first, or while another is awaited.
    """

    def __init__(self) -> None:
        self.name = ''
        self._start_ns = 0
        self._announced_ns = self._replaced_ns = 0
        self._awaits_truth = False

    def announce(self, name: str, start_ns: int, published_ns: int) -> bool:
        """Note a run that starts at the stamp `start_ns`; return whether it is shown from now on.

        It is not if another run has been requested since.
        """
        self._announced_ns = max(self._announced_ns, published_ns)
        if self.is_awaited:
            return False
        self.name, self._start_ns = name, start_ns
        self._awaits_truth = True
        return True

    def replace(self, published_ns: int) -> None:
        """Note the request of another run, published at this time."""
        self._replaced_ns = published_ns
        if self.is_awaited:
            self.name = ''

    @property
    def is_awaited(self) -> bool:
        """Whether a requested run is still to be announced."""
        return self._replaced_ns > self._announced_ns

    def includes(self, stamp_ns: int, *, is_truth: bool) -> bool:
        """Return whether a sample belongs to the run; `is_truth` marks those of the plant.

        Participants may still answer the last tick of the run before, until the plant has published
        the first truth of the new one. Later stamps may be earlier: a player has jumped back.
        """
        if self._awaits_truth and stamp_ns < self._start_ns:
            return False
        self._awaits_truth = self._awaits_truth and not is_truth
        return True


Columns = Mapping[str, Floats]

WINDOW_S = 10.0
"""Length of the plots of a live run in time."""

DEGREES = math.degrees(1.0)
UNKNOWN: Pair = (math.nan, math.nan)

TRAIL_POINTS = 2000
"""Number of points that the trail of a long run has at least."""

TRAIL_PIECE = 500
"""Number of points of a piece of the trail, which is sent again only if it changes."""


class Snapshot(NamedTuple):
    """The robot at one instant; pairs are (plane x, plane y), as in docs/frames.md.

    Attributes
    ----------
    time : float
        Sim time, or time since the start of a recorded run [s].
    position, psi, duty : tuple of float
        Ball centre [m], body pitch [rad] and motor duty [%].
    speed, pitch_rate : tuple of float
        Of the ball [m/s], of the body [rad/s]; NaN if unknown.
    estimates : ControllerState
        What the controller estimates and follows; NaN if unknown.
    sticks : tuple of float
        Forward and rightward, each -1 ... 1; NaN if unknown.
    sonar, cone_angle : float
        Distance [m], inf without an echo, NaN without data; opening of the sonar's cone [rad].
    battery : float
        Voltage [V]; NaN if unknown.
    state : str
        Operating state; empty if unknown.
    lcd : str
        The display's lines.
    ball : tuple of float or None
        Orientation of the ball as a quaternion w, x, y, z; None if only the shown positions
        determine it.
    force : tuple of float
        The force of the pushes that act [N].
    """

    time: float
    position: Pair
    psi: Pair
    duty: Pair = UNKNOWN
    speed: Pair = UNKNOWN
    pitch_rate: Pair = UNKNOWN
    estimates: ControllerState = NO_CONTROLLER_STATE
    sticks: Pair = UNKNOWN
    sonar: float = math.nan
    cone_angle: float = 0.0
    battery: float = math.nan
    state: str = ''
    lcd: str = ''
    ball: tuple[float, float, float, float] | None = None
    force: Pair = (0.0, 0.0)

    @property
    def is_out_of_control(self) -> bool:
        """Whether the controller has given up, as after a fall."""
        return self.state == OperatingState.OUT_OF_CONTROL


class History:
    """The samples of the last :data:`WINDOW_S` of sim time, and the trail of the ball."""

    def __init__(self) -> None:
        self._samples: deque[Snapshot] = deque()
        self._trail: list[tuple[float, float, float]] = []  # time, x and y

    def clear(self) -> None:
        """Start over with a new run."""
        self._samples.clear()
        self._trail.clear()

    def add(self, snapshot: Snapshot) -> None:
        """Add a sample, unless there is one with the same time.

        A sample with an earlier time restarts the history: a player has jumped back.
        """
        if self._samples and snapshot.time == self._samples[-1].time:
            return
        if self._samples and snapshot.time < self._samples[-1].time:
            self.clear()
        self._samples.append(snapshot)
        while self._samples[0].time < snapshot.time - WINDOW_S:
            self._samples.popleft()
        point = snapshot.position[0], -snapshot.position[1]
        if not self._trail or math.dist(point, self._trail[-1][1:]) > TRAIL_STEP:
            self._trail.append((snapshot.time, *point))
        if len(self._trail) > TRAIL_POINTS + TRAIL_PIECE:
            del self._trail[:TRAIL_PIECE]

    def forget(self, time: float) -> None:
        """Forget what was from a time on [s]."""
        while self._samples and self._samples[-1].time >= time:
            self._samples.pop()
        while self._trail and self._trail[-1][0] >= time:
            self._trail.pop()

    def trail(self) -> list[tuple[float, float]]:
        """Return the trail, x and y in ``map`` [m]."""
        return [(x, y) for _, x, y in self._trail]

    def columns(self, ball_radius: float, start: Pair | None) -> tuple[Floats, Columns]:
        """Return the times [s] of the samples and their columns, named as in ``Run.frame``.

        The first row has only a time: it makes plots of the samples as long as the window.

        Parameters
        ----------
        ball_radius : float
            Of the ball that the controller rolls [m].
        start : tuple of float or None
            The robot's position at the start of the run [m], from which the controller counts; None
            if it is unknown.
        """
        samples = list(self._samples)
        times = [sample.time for sample in samples]
        first = max(0.0, times[-1] - WINDOW_S) if times else 0.0
        columns: dict[str, Floats] = {}
        for name, unit, of, scale in _SIGNALS:
            columns |= plane_columns(name, unit, _pairs(samples, of) * scale)
        origin = UNKNOWN if start is None else start
        for name, unit, of, offset in (
            ('estimated_position', 'm', lambda sample: sample.estimates.theta, origin),
            ('reference_position', 'm', lambda sample: sample.estimates.theta_ref, origin),
            ('reference_speed', 'm_per_s', lambda sample: sample.estimates.theta_ref_dot, 0.0),
        ):
            columns |= plane_columns(name, unit, _pairs(samples, of) * ball_radius + offset)
        columns['distance_m'] = np.array([math.nan, *(sample.sonar for sample in samples)])
        columns['battery_v'] = np.array([math.nan, *(sample.battery for sample in samples)])
        return np.array([first, *times]), columns


_Of = Callable[[Snapshot], Pair]

_SIGNALS: tuple[tuple[str, str, _Of, float], ...] = (
    ('position', 'm', lambda sample: sample.position, 1.0),
    ('speed', 'm_per_s', lambda sample: sample.speed, 1.0),
    ('pitch', 'deg', lambda sample: sample.psi, DEGREES),
    ('pitch_rate', 'deg_per_s', lambda sample: sample.pitch_rate, DEGREES),
    ('duty', 'percent', lambda sample: sample.duty, 1.0),
    ('stick', 'percent', lambda sample: sample.sticks, 100.0),
    ('estimated_pitch', 'deg', lambda sample: sample.estimates.psi, DEGREES),
)
"""Name, unit, value and its factor of the signals that need nothing but a sample."""


def _pairs(samples: Sequence[Snapshot], of: _Of) -> Floats:
    """Return a pair of each sample, after a row without values."""
    return np.array([UNKNOWN, *map(of, samples)], np.float64)


LIVE_SIGNALS = frozenset(History().columns(0.0, None)[1])
"""The columns of :meth:`History.columns`."""
