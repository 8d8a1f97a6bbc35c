"""From PWM duty to motor voltage (section 6.2)."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.parameters import Subset


@dataclass(frozen=True)
class Actuator(Subset):
    """Dead zone of the driveline friction and the voltage law (6.1).

    `dead_zone` is the duty [%] lost to friction on either side of zero. At full duty the voltage is
    ``v_max = slope * battery [mV] + offset`` [V].
    """

    dead_zone: float
    voltage_slope: float
    voltage_offset: float

    def voltage(self, duty: int, battery_v: float) -> float:
        """Return the motor voltage [V] of an integer `duty` within -100 ... 100 %."""
        return motor_voltage(
            duty, battery_v, self.dead_zone, self.voltage_slope, self.voltage_offset
        )


def motor_voltage(
    duty: int, battery_v: float, dead_zone: float, slope: float, offset: float
) -> float:
    """Return the motor voltage [V] of an integer `duty` within -100 ... 100 %.

    The battery voltage is in V; the others are as in :class:`Actuator`.
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
