"""The time in which the controller balanced, without gaps, for analyses that need equal steps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.timing import TICK_S

_GAP_S = 1.5 * TICK_S


class Balancing(NamedTuple):
    """The ticks of a run's longest time of balancing; column 0 is plane x, 1 plane y.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time since the first tick of the run [s].
    duty : ndarray, shape (n, 2)
        Duty [%].
    psi : ndarray, shape (n, 2)
        True body pitch [rad].
    """

    time: NDArray[np.float64]
    duty: NDArray[Any]
    psi: NDArray[Any]

    @property
    def pitch(self) -> NDArray[np.float64]:
        """True body pitch [°], shape (n, 2)."""
        return np.asarray(np.degrees(self.psi))

    @classmethod
    def of(cls, run: RunData) -> Balancing:
        """Return the longest time without a missing tick in which the controller balanced."""
        trajectory = run.trajectory
        active = run.balancing(trajectory.time)
        begins, ends = active.copy(), active.copy()
        connected = active[1:] & active[:-1] & (np.diff(trajectory.time) < _GAP_S)
        begins[1:] &= ~connected
        ends[:-1] &= ~connected
        first, last = np.flatnonzero(begins), np.flatnonzero(ends)
        longest = slice(0, 0)
        if first.size:
            number = int(np.argmax(last - first))
            longest = slice(int(first[number]), int(last[number]) + 1)
        return cls(trajectory.time[longest], trajectory.duty[longest], trajectory.psi[longest])
