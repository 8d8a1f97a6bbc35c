"""The laws of a step that are no equations of motion: motor, battery, gear play, falls, walls.

In the draining model, the open-circuit voltage falls in proportion to the charge drawn (from 9.5 V
fresh to 7 V low over the capacity), and the internal resistance drops a voltage in proportion to
the current of the last step.
"""

from __future__ import annotations

from typing import NamedTuple

from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.robot.plant.integration import PlaneState
from ballbot_ros.robot.plant.model import MassMatrix, impulse_ratio


def motor_voltage(
    duty: int, battery_v: float, dead_zone: float, slope: float, offset: float
) -> float:
    """Return the motor voltage [V] of an integer `duty` within -100 ... 100 %.

    Parameters
    ----------
    battery_v : float
        Battery voltage [V].
    dead_zone : float
        Duty [%] that the friction of the driveline takes on either side of zero.
    slope, offset : float
        Voltage law (6.1): the voltage at full duty is ``slope * battery [mV] + offset`` [V].
    """
    return effective_duty(duty, dead_zone) / 100.0 * max_voltage(battery_v, slope, offset)


def max_voltage(battery_v: float, slope: float, offset: float) -> float:
    """Return the motor voltage [V] at full duty for the battery voltage [V], (6.1)."""
    return max(0.0, slope * (battery_v * 1000.0) + offset)


def effective_duty(duty: int, dead_zone: float) -> float:
    """Return the duty [%] that remains after the dead zone."""
    if duty > dead_zone:
        return duty - dead_zone
    if duty < -dead_zone:
        return duty + dead_zone
    return 0.0


def motor_current(
    voltage: float, theta_dot: float, psi_dot: float, back_emf: float, ohms: float
) -> float:
    """Return the motor current [A], (3.16).

    Parameters
    ----------
    voltage : float
        Motor voltage [V].
    theta_dot, psi_dot : float
        Rates of the ball angle and the body pitch [rad/s].
    back_emf : float
        k Kb [V·s/rad]: the motor's constant, seen from the ball.
    ohms : float
        Resistance of the motor Rm [Ohm].
    """
    return (voltage - back_emf * (theta_dot - psi_dot)) / ohms


FRESH_V = 9.5
LOW_V = 7.0


def capacity_slope(capacity: float) -> float:
    """Return the fall of the open-circuit voltage with the charge [V/(A·s)]."""
    return (FRESH_V - LOW_V) / capacity


def discharge(
    charge: float,
    motor_current: float,
    dt: float,
    idle_current: float,
    full: float,
    slope: float,
    resistance: float,
) -> tuple[float, float]:
    """Return the charge drawn [A·s] and the terminal voltage [V], never negative, `dt` s later.

    Parameters
    ----------
    charge : float
        The charge drawn so far [A·s].
    motor_current, idle_current : float
        The motors' supply current, and that of the brick [A].
    full : float
        Open-circuit voltage before any charge is drawn [V].
    slope : float
        Fall of the open-circuit voltage with the charge [V/(A·s)].
    resistance : float
        Internal resistance [Ohm].
    """
    current = max(0.0, motor_current) + idle_current
    charge += current * dt
    return charge, max(0.0, full - slope * charge - resistance * current)


def state_after_fall(state: PlaneState, fall_angle: float) -> PlaneState:
    """Return the state of a fallen plane at rest, at a pitch of at most `fall_angle` [rad]."""
    return state[0], max(-fall_angle, min(fall_angle, state[1])), 0.0, 0.0


def wheel_angle(ratio: float, theta: float, psi: float, start_psi: float) -> float:
    """Return the angle [rad] of a wheel since the start, from ball angle and pitch [rad]."""
    return ratio * (theta - (psi - start_psi))


def shaft_angle(shaft: float, wheel: float, half_play: float) -> float:
    """Return the angle of the motor shaft, which the wheel drags along within the gear play.

    The previous angle of the shaft, the wheel's angle and half of the play are in rad.
    """
    return min(wheel + half_play, max(wheel - half_play, shaft))


class WallHit(NamedTuple):
    """The start of a contact with a wall, at a sim time [ns].

    The ball's centre was stopped at `position` [m] in plane signs; `parts` of the body would have
    been in the wall.
    """

    time_ns: int
    position: Pair
    parts: tuple[str, ...]

    def __str__(self) -> str:
        """Return one line for the log, in the axes of ``map``."""
        x, y = round(self.position[0], 2) + 0.0, round(-self.position[1], 2) + 0.0
        return (
            f'wall hit at sim time {self.time_ns * 1e-9:.3f} s: ball at x {x:.2f} m, y {y:.2f} m '
            f'(map), {", ".join(self.parts)}'
        )


def state_after_impact(
    before: PlaneState, after: PlaneState, mass: MassMatrix, linear: bool
) -> PlaneState:
    """Return the state of a plane stopped by an inelastic impulse at the ball's centre.

    The impulse acts on theta alone, so the second row of M Δ(theta', psi') = (impulse, 0) couples
    the jump of psi' to that of theta'. A wall can't pull: a plane that has reversed within the step
    keeps its velocity. The states are `before` the step, and `after` it if there were no wall.
    """
    theta, psi, theta_dot, psi_dot = after
    if (theta > before[0]) == (theta_dot > 0.0):
        psi_dot += theta_dot * impulse_ratio(mass, 0.0 if linear else psi)
        theta_dot = 0.0
    return before[0], psi, theta_dot, psi_dot


def ball_position(start: Pair, radius: float, theta_x: float, theta_y: float) -> Pair:
    """Return the position of the ball [m] for its angles [rad] from `start` [m]."""
    return start[0] + radius * theta_x, start[1] + radius * theta_y
