"""From PWM duty to motor voltage (section 6.2)."""

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
