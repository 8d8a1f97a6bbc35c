"""From PWM duty to motor voltage (section 6.2), and the battery.

In the draining model, the open-circuit voltage falls in proportion to the charge drawn (from 9.5 V
fresh to 7 V low over the capacity), and the internal resistance drops a voltage in proportion to
the current of the last step.
"""

from __future__ import annotations


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


def supply_current(duty_x: int, duty_y: int, current_x: float, current_y: float) -> float:
    """Return the current [A] that both motors draw from the battery.

    A duty [%] is the share of the time in which the motor's current [A] flows through the battery.
    """
    return duty_x / 100.0 * current_x + duty_y / 100.0 * current_y


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
    """Return the charge drawn [A·s] and the terminal voltage [V] `dt` seconds later.

    The motors' supply current and the brick's own are in A; for the other arguments see
    :func:`terminal_voltage`.
    """
    current = max(0.0, motor_current) + idle_current
    charge += current * dt
    return charge, terminal_voltage(charge, current, full, slope, resistance)


def terminal_voltage(
    charge: float, current: float, full: float, slope: float, resistance: float
) -> float:
    """Return the terminal voltage [V], never negative.

    Parameters
    ----------
    charge, current : float
        The charge drawn so far [A·s], and the current [A].
    full : float
        Open-circuit voltage before any charge is drawn [V].
    slope : float
        Fall of the open-circuit voltage with the charge [V/(A·s)].
    resistance : float
        Internal resistance [Ohm].
    """
    return max(0.0, full - slope * charge - resistance * current)
