"""The link between the brick's two processors: how old its readings are, and when it sends duties.

Every millisecond the link either starts to read a frame of sensor values, or takes the duties,
sends them, and then unpacks the frame that was read. So a frame is 1 or 2 ms old when task_ts1
begins; which one depends on the phase of the link. The frame has the newest values of a converter
that runs freely, with a period of about 3.1 ms.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.parameters.timing import MILLISECOND_NS
from ballbot_ros.robot.random_numbers import Key, device_number, noise_bits, noise_key, uniform

FRAME_NS = 2 * MILLISECOND_NS
"""Period of the frames in each direction."""

BATTERY_POLL_NS = 10 * MILLISECOND_NS
"""Period at which the other processor measures the battery voltage."""


class Link(NamedTuple):
    """The link of a run.

    Attributes
    ----------
    is_on : bool
        Whether readings and duties pass the link; otherwise it delays nothing.
    phase : int
        0 if it sends at even milliseconds, 1 if at odd ones.
    converter_ns, converter_at_ns : int
        Period of the converter, and when it ends a conversion.
    battery_age_ns : int
        Age of the battery voltage, whole milliseconds.
    """

    is_on: bool
    phase: int
    converter_ns: int
    converter_at_ns: int
    battery_age_ns: int


LINK = device_number('link')

NO_LINK = Link(False, 0, MILLISECOND_NS, 0, 0)


def is_sending(link: Link, time_ns: int) -> bool:
    """Return whether the link sends at a whole millisecond."""
    return (time_ns // MILLISECOND_NS + link.phase) % 2 == 0


def analog_age(link: Link, stamp_ns: int) -> int:
    """Return the age [ns] of the analog values that the brick has at a whole millisecond."""
    frame = MILLISECOND_NS if is_sending(link, stamp_ns) else FRAME_NS
    return frame + (stamp_ns - frame - link.converter_at_ns) % link.converter_ns


def longest_analog_steps(is_on: bool, converter_period_ms: float) -> int:
    """Return the greatest age of analog values, rounded up to whole milliseconds."""
    return math.ceil(FRAME_NS / MILLISECOND_NS + converter_period_ms) if is_on else 0


def drawn_link(
    phase: int, converter_period_ms: float, of_link: float, of_converter: float, of_battery: float
) -> Link:
    """Return the link of a run.

    Parameters
    ----------
    phase : int
        0, 1, or -1 for one of them at random.
    of_link, of_converter, of_battery : float
        Uniform numbers, for the phases of the link, the converter and the battery's measurement.
    """
    period_ns = round(converter_period_ms * 1e3) * 1000
    polled = int(of_battery * BATTERY_POLL_NS) // MILLISECOND_NS * MILLISECOND_NS
    return Link(
        True,
        int(2.0 * of_link) if phase < 0 else phase,
        period_ns,
        int(of_converter * period_ns) // 1000 * 1000,
        FRAME_NS + polled,
    )


def link_of(p: Any) -> Link:
    """Return the link of a run for parameters of a node that has those of the link."""
    if not p.link:
        return NO_LINK
    key = noise_key(p.seed)
    of_link, of_converter = _chances(key, 0)
    of_battery, _ = _chances(key, 1)
    return drawn_link(p.link_phase, p.converter_period, of_link, of_converter, of_battery)


def _chances(key: Key, number: int) -> tuple[float, float]:
    one, other = noise_bits(np.uint64(number), np.uint64(0), LINK, key)
    bits: tuple[Any, Any] = np.int64(one), np.int64(other)
    return uniform(bits[0]), uniform(bits[1])


def mean_analog_age(link: Link) -> float:
    """Return the mean age [ns] of the analog values at the ticks of task_ts1; 0 without a link."""
    if not link.is_on:
        return 0.0
    return (MILLISECOND_NS if is_sending(link, 0) else FRAME_NS) + link.converter_ns / 2.0
