"""Inputs and outputs of the plant: plain values, quick to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

FORCE_LIMIT = 1000.0
"""Largest component of a push [N], [N·m]."""

MAX_PUSH_LEAD_NS = 3600 * 10**9
"""How far in the future a push may start [ns]."""

Pair = tuple[float, float]
"""A value of plane x and one of plane y, in plane signs (docs/frames.md)."""


STEP_VALUES = 6
"""Numbers of a kept step: motor angles [rad], pitch rates [rad/s] and positions [m] of x and y."""


class MeasuredState(NamedTuple):
    """What the devices measure of the true state of one physics step, as in `GroundTruth`."""

    motor_angle: Pair
    psi_rate: Pair
    position: Pair


def state_before(steps: tuple[float, ...], age: int) -> MeasuredState:
    """Return the state at an age [steps], of steps as in :class:`GroundTruth`."""
    at = len(steps) - STEP_VALUES * (age + 1)
    x, y, rate_x, rate_y, *position = steps[at : at + STEP_VALUES]
    return MeasuredState((x, y), (rate_x, rate_y), (position[0], position[1]))


class GroundTruth(NamedTuple):
    """The true state of the robot at one instant; every pair is (plane x, plane y).

    Attributes
    ----------
    stamp_ns : int
        Sim time [ns].
    motor_angle, motor_rate, motor_torque : tuple of float
        Motor shafts: rad from the start pose, rad/s, N·m.
    psi, psi_rate : tuple of float
        Body pitch [rad] and its rate [rad/s].
    position, velocity : tuple of float
        Ball centre, the start position plus Rs theta [m], and its rate [m/s].
    battery_voltage : float
        Terminal voltage [V] in single precision, as in its message.
    steps : tuple of float
        The latest physics steps, :data:`STEP_VALUES` each, this instant last; empty unless a
        device's samples are delayed.
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
    steps: tuple[float, ...] = ()


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

    def __str__(self) -> str:
        """Return a description for the log, in sim time."""
        acts = [
            f'{name} ({x + 0.0:g}, {y + 0.0:g}) {unit}'
            for name, (x, y), unit in (('force', self.force, 'N'), ('torque', self.torque, 'N·m'))
            if x or y
        ]
        span = f'{self.start_ns * 1e-9:.3f} s to {self.end_ns * 1e-9:.3f} s'
        return f'push from {span}: {", ".join(acts) or "nothing"}'

    def problem(self, now_ns: int) -> str:
        """Return the problem with an external push at `now_ns` [ns]; '' if there is none."""
        # Written so that NaN is out of bounds.
        if not all(abs(value) <= FORCE_LIMIT for value in (*self.force, *self.torque)):
            return f'not within ±{FORCE_LIMIT:g} N and N·m'
        if self.start_ns > now_ns + MAX_PUSH_LEAD_NS:
            ahead_s = (self.start_ns - now_ns) * 1e-9
            return f'{ahead_s:.3g} s ahead of sim time; {MAX_PUSH_LEAD_NS * 1e-9:g} s at most'
        return ''
