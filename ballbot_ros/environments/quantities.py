"""The components of observations and states, with their bounds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ballbot_ros.controllers.policy import DRIVING_NAMES
from ballbot_ros.plant.ground_truth import GroundTruth

Floats = NDArray[np.float64]

RATE_DEG_PER_S = 1023.0
"""The gyro reads 0 ... 1023 deg/s, and so its offset is."""

ENCODER_DEG_PER_S = 5000.0
SPEED_M_PER_S = 2.0
"""More than motors of any battery can reach; times the duration they bound angles and distances."""


class Quantity(NamedTuple):
    """A component of a vector: its name, which has the unit, and the largest and least value."""

    name: str
    low: float
    high: float


def pair(name: str, bound: float) -> tuple[Quantity, Quantity]:
    """Return the quantity of planes x and y; the name has a place for the plane."""
    return Quantity(name.format('x'), -bound, bound), Quantity(name.format('y'), -bound, bound)


def device_quantities(duration: float, full_rate: float, *, drives: bool) -> tuple[Quantity, ...]:
    """Return the components of the observation of the devices."""
    all_of_them = (
        *pair('rate_{}_deg_per_s', RATE_DEG_PER_S),
        *pair('encoder_{}_deg', ENCODER_DEG_PER_S * duration),
        Quantity('battery_v', 0.0, 15.0),
        Quantity('distance_cm', 0.0, 255.0),
        *pair('commanded_rate_{}_deg_per_s', full_rate),
    )
    assert tuple(each.name for each in all_of_them) == DRIVING_NAMES
    return all_of_them if drives else all_of_them[:5]


def state_quantities(duration: float) -> tuple[Quantity, ...]:
    """Return the components of :func:`state_of`."""
    return (
        *pair('position_{}_m', SPEED_M_PER_S * duration),
        *pair('velocity_{}_m_per_s', 10.0),
        *pair('pitch_{}_rad', 1.5),
        *pair('pitch_rate_{}_rad_per_s', 100.0),
        Quantity('battery_v', 0.0, 15.0),
    )


def state_of(truth: GroundTruth, start: tuple[float, float]) -> tuple[float, ...]:
    """Return the true state; the position is the one from the start [m]."""
    return (
        truth.position[0] - start[0],
        truth.position[1] - start[1],
        *truth.velocity,
        *truth.psi,
        *truth.psi_rate,
        truth.battery_voltage,
    )


def box(quantities: tuple[Quantity, ...]) -> spaces.Box[np.float64]:
    """Return the space of a vector."""
    low, high = (np.array([getattr(each, end) for each in quantities]) for end in ('low', 'high'))
    return spaces.Box(low, high, dtype=np.float64)
