"""A recorded run as a data frame: one row per tick, with units in the names of the columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.run_data import RunData, Series
from ballbot_ros.analysis.signals import signals_of
from ballbot_ros.errors import BallbotError
from ballbot_ros.messages.topics import PLANT_IMU, PLANT_ODOM
from ballbot_ros.timing import SECOND_NS

if TYPE_CHECKING:
    import pandas


def frame_of(run: RunData) -> pandas.DataFrame:
    """Return the signals of a run, one row per tick; the index is the time since the start [s].

    Position, speed, body pitch, motor rate and torque are the true ones; `gyro` includes its
    offset. A signal without a sample at a tick is NaN. Signals that are sampled less often than the
    plant (distance, battery voltage, sticks, and in free-running mode the duty) keep their newest
    value.

    Raises
    ------
    BallbotError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise BallbotError(
            'pandas not found: install it with `pip install "ballbot_ros[pandas]"`'
        ) from None
    ticks = next(run.series[t] for t in (PLANT_IMU, PLANT_ODOM, *run.series) if t in run.series)
    columns: dict[str, NDArray[Any]] = {}
    for signal in signals_of(run):
        columns |= signal.table(run, ticks.stamps)
    time = pandas.Index((ticks.stamps - run.start_ns) / SECOND_NS, name='time_s')
    frame = pandas.DataFrame(columns, index=time, dtype=float)
    frame['operating_state'] = pandas.Categorical(_states(run, ticks))
    return frame


def _states(run: RunData, ticks: Series) -> NDArray[Any]:
    """Return the operating state at each tick; None if it is unknown."""
    names = np.full(len(ticks.time), None, dtype=object)
    for each in run.states:
        names[(ticks.time >= each.start - 1e-9) & (ticks.time < each.end - 1e-9)] = each.name
    return names
