"""Short pieces of an experiment, from which its parameters are identified.

The robot is unstable: what a simulation does after a second depends on its start more than on the
parameters. So it starts again every 0.8 s, from a state that is estimated together with the
parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.analysis.identification.experiment import ENCODER, Channel, Experiment
from ballbot_ros.parameters.timing import STEP_NS, STEPS_PER_TICK, TICK_NS
from ballbot_ros.robot.arithmetic import Floats

SEGMENT_TICKS = 200
"""Length of a segment: in longer ones, too much depends on its start. In shorter ones, the noise
that the controller answers with its duties would bias the parameters more."""

UNDRIVEN_SEGMENT_S = 2.0
"""Length of a segment whose duties are not known [s]. The unknown voltages keep it upright; of each
segment, four readings say nothing of the parameters."""

MAX_SEGMENTS = 150
"""Most segments of an experiment, two minutes, which bounds work and memory."""

TURNING_READINGS = 3
"""Number of readings in which an encoder has turned one way, so that the gears are in contact."""

_MIN_READINGS = 8

_STEP_US = STEP_NS // 1000


@dataclass(frozen=True)
class Segments:
    """Segments of an experiment, all of the same length of `n` readings.

    Attributes
    ----------
    starts : ndarray, shape (s,)
        Index of the first reading of each segment.
    duty : ndarray, shape (s, 4 n, 2), or None
        The duty [%] that acts at the beginning of each physics step; None if it is not known.
    duty_before : ndarray, shape (s, 2), or None
        The one in the step before the segment.
    changes : ndarray, shape (s, 4 n), or None
        After which share of each step the duty of the next one acts.
    readings : mapping of Channel to ndarray, shape (s, n, 2)
        NaN where one shows a time before its segment.
    shown : mapping of Channel to ndarray, shape (s, n)
        The time that each reading shows [steps from the start of its segment].
    battery : ndarray, shape (s, n)
    contact : ndarray, shape (s, 2)
        At the start, -1 or 1 for the side on which the gears are in contact.
    """

    experiment: Experiment
    starts: NDArray[np.intp]
    duty: NDArray[Any] | None
    duty_before: NDArray[Any] | None
    changes: Floats | None
    readings: Mapping[Channel, Floats]
    shown: Mapping[Channel, Floats]
    battery: Floats
    contact: Floats

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.starts)

    @property
    def length(self) -> int:
        """Number of readings of a segment."""
        return int(self.battery.shape[1])

    @property
    def seconds(self) -> float:
        """Total length [s]."""
        return self.count * self.length * self.experiment.reading_s

    def beginnings(self, length: int) -> Segments:
        """Return the first readings of each segment."""
        steps = slice(length * STEPS_PER_TICK)
        return replace(
            self,
            duty=None if self.duty is None else self.duty[:, steps],
            changes=None if self.changes is None else self.changes[:, steps],
            readings={channel: values[:, :length] for channel, values in self.readings.items()},
            shown={channel: values[:, :length] for channel, values in self.shown.items()},
            battery=self.battery[:, :length],
        )

    def without(self, dropped: NDArray[np.bool_]) -> Segments:
        """Return the segments without those in a mask, shape (s,)."""
        arrays = ('starts', 'duty', 'duty_before', 'changes', 'battery', 'contact')
        given = {name: getattr(self, name) for name in arrays}
        return replace(
            self,
            readings={channel: values[~dropped] for channel, values in self.readings.items()},
            shown={channel: values[~dropped] for channel, values in self.shown.items()},
            **{name: each[~dropped] for name, each in given.items() if each is not None},
        )


def segment_length(experiment: Experiment) -> int:
    """Return the number of readings of a segment."""
    if experiment.duty is None:
        return max(_MIN_READINGS, round(UNDRIVEN_SEGMENT_S / experiment.reading_s))
    return SEGMENT_TICKS


def cut(experiment: Experiment) -> Segments:
    """Return the segments of an experiment: in its usable time, without gaps, one after another.

    With gear play, a segment begins where both encoders turn: only then it is known on which side
    the gears are in contact. Of a long experiment, the segments are spread evenly.
    """
    length = segment_length(experiment)
    may_start, contact = _starts(experiment)
    lead = 0
    if experiment.duty is not None:
        lead = -(-int(max(_delays_us(experiment), default=0)) // (TICK_NS // 1000)) + 1
    ends_of_gaps = np.flatnonzero(~experiment.usable)
    starts: list[int] = []
    index, count = lead, len(experiment.usable)
    while index + length <= count:
        # The duties of the dead time before it, and all readings of the segment, are needed.
        unusable = ends_of_gaps[np.searchsorted(ends_of_gaps, index - lead) :]
        if unusable.size and unusable[0] < index + length:
            index = int(unusable[0]) + 1 + lead
        elif may_start[index]:
            starts.append(index)
            index += length
        else:
            index += 1
    if len(starts) > MAX_SEGMENTS:
        chosen = np.linspace(0, len(starts) - 1, MAX_SEGMENTS).round().astype(int)
        starts = [starts[each] for each in chosen]
    first = np.array(starts, np.intp)
    window = first[:, np.newaxis] + np.arange(length)
    duty = before = changes = None
    if experiment.duty is not None:
        acting, shares = _acting_duties(experiment.duty, _delays_us(experiment))
        steps = first[:, np.newaxis] * STEPS_PER_TICK + np.arange(length * STEPS_PER_TICK)
        duty, before, changes = acting[steps], acting[steps[:, 0] - 1], shares[steps]
    ticks = experiment.steps_per_reading * np.arange(length)
    readings, shown = {}, {}
    for channel, values in experiment.readings.items():
        ages = np.broadcast_to(experiment.ages.get(channel, 0), count)
        shown[channel] = ticks - ages[window]
        is_before = (shown[channel] < 0)[:, :, np.newaxis]
        readings[channel] = np.where(is_before, np.nan, values[window])
    return Segments(
        experiment=experiment,
        starts=first,
        duty=duty,
        duty_before=before,
        changes=changes,
        readings=readings,
        shown=shown,
        battery=np.where(ticks < experiment.battery_age, np.nan, experiment.battery[window]),
        contact=contact[first],
    )


def _starts(experiment: Experiment) -> tuple[NDArray[np.bool_], Floats]:
    """Return where a segment may start, shape (n,), and the sides of the gears, shape (n, 2)."""
    count = len(experiment.usable)
    encoder = experiment.readings.get(ENCODER)
    if not experiment.plant.backlash or encoder is None:
        return np.ones(count, np.bool_), np.zeros((count, 2))
    read = np.flatnonzero(~np.isnan(encoder).any(axis=1))
    steps, turning = np.zeros((count, 2)), np.zeros((count, 2), np.bool_)
    steps[read[1:]] = np.sign(np.diff(encoder[read], axis=0))
    if len(read) >= TURNING_READINGS:
        recent = np.lib.stride_tricks.sliding_window_view(steps[read], TURNING_READINGS, axis=0)
        turning[read[TURNING_READINGS - 1 :]] = np.abs(recent.sum(-1)) == TURNING_READINGS
    # The readings of a later tick show the start.
    late = -(-int(experiment.ages.get(ENCODER, 0)) // STEPS_PER_TICK)
    begins = np.roll(turning.all(axis=1), -late)
    begins[count - late :] = False
    return begins, -np.roll(steps, -late, axis=0)  # the shaft lags behind the wheel


def _delays_us(experiment: Experiment) -> NDArray[np.int64]:
    """Return the time after which each duty acts [µs]."""
    own = 0 if experiment.delays_us is None else experiment.delays_us
    dead_us = experiment.plant.actuator_delay * _STEP_US
    return np.broadcast_to(own + dead_us, len(experiment.usable))


def _acting_duties(duty: NDArray[Any], delays_us: NDArray[np.int64]) -> tuple[NDArray[Any], Floats]:
    """Return the duty that acts at the beginning of each step, and when that of the next one does.

    Shapes (4 n, 2) and (4 n,); the latter as a share of the step. Of duties that begin to act in
    the same step, it is the newest.
    """
    ticks = np.arange(len(duty))
    effects_us = ticks * (TICK_NS // 1000) + delays_us
    steps = len(duty) * STEPS_PER_TICK
    first = -(-effects_us // _STEP_US)
    is_inside = first < steps
    newest = np.full(steps, -1)
    np.maximum.at(newest, first[is_inside], ticks[is_inside])
    newest = np.maximum.accumulate(newest)
    shares = np.ones(steps)
    acts = is_inside & (effects_us % _STEP_US > 0) & (newest[np.minimum(first, steps - 1)] == ticks)
    shares[first[acts] - 1] = effects_us[acts] % _STEP_US / _STEP_US
    acting = np.where(newest[:, np.newaxis] >= 0, duty[newest], 0).astype(np.int64)
    return acting, shares
