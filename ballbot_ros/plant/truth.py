"""What the plant shows of itself and takes from outside: plain values, quick to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

STEP_NS = 1_000_000
STEPS_PER_TICK = 4
TICK_NS = STEPS_PER_TICK * STEP_NS

Pair = tuple[float, float]
"""A value of plane x and one of plane y, in plane signs (docs/frames.md)."""


class Truth(NamedTuple):
    """What is true of the robot at one instant; every pair is (plane x, plane y).

    Attributes
    ----------
    stamp_ns : int
        Sim time [ns].
    motor_angle, motor_rate, motor_torque : tuple of float
        Motor shafts: rad from the start pose, rad/s, N·m.
    psi, psi_rate : tuple of float
        Body pitch [rad] and its rate [rad/s].
    position, velocity : tuple of float
        Ball centre [m] and [m/s]: Rs theta from the start position.
    battery_voltage : float
        Terminal voltage [V], a single-precision number, as its message carries it.
    """

    stamp_ns: int
    motor_angle: Pair
    motor_rate: Pair
    motor_torque: Pair
    psi: Pair
    psi_rate: Pair
    position: Pair
    velocity: Pair
    battery_voltage: float


@dataclass(frozen=True)
class Push:
    """A disturbance at the body's centre, in plane signs.

    Attributes
    ----------
    start_ns, end_ns : int
        Sim time [ns]; it acts in the steps that begin in [start, end).
    force : tuple of float
        Horizontal force [N] on plane x, y.
    torque : tuple of float
        Torque [N·m] that tips plane x, y.
    """

    start_ns: int
    end_ns: int
    force: Pair
    torque: Pair = (0.0, 0.0)
