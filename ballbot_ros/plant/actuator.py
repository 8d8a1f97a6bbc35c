"""From PWM duty to motor voltage (section 6.2)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Actuator:
    """Dead zone of the driveline friction and the voltage law (6.1).

    Attributes
    ----------
    dead_zone : float
        Duty [%] that friction swallows on either side of zero.
    voltage_slope, voltage_offset : float
        ``v_max = slope * battery [mV] + offset`` [V].
    """

    dead_zone: float
    voltage_slope: float
    voltage_offset: float

    def max_voltage(self, battery_v: float) -> float:
        """Return the motor voltage [V] at full duty for the battery voltage [V]."""
        return max(0.0, self.voltage_slope * (battery_v * 1000.0) + self.voltage_offset)

    def effective_duty(self, duty: int) -> float:
        """Return the duty [%] that is left behind the dead zone."""
        if duty > self.dead_zone:
            return duty - self.dead_zone
        if duty < -self.dead_zone:
            return duty + self.dead_zone
        return 0.0

    def voltage(self, duty: int, battery_v: float) -> float:
        """Return the motor voltage [V] of an integer `duty` within -100 ... 100 %."""
        return self.effective_duty(duty) / 100.0 * self.max_voltage(battery_v)
