"""The battery pack: constant, or sagging with current and falling with charge."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.parameters import Subset

FRESH_V = 9.5
LOW_V = 7.0


@dataclass(frozen=True)
class BatteryParameters(Subset):
    """Battery parameters, named as in `parameters.TABLE`."""

    battery_model: str
    battery_voltage: float
    battery_resistance: float
    battery_capacity: float
    idle_current: float


class Battery:
    """Terminal voltage of the pack.

    In the draining model, the open-circuit voltage falls in proportion to the charge drawn (from
    9.5 V fresh to 7 V low over the capacity), and the internal resistance drops a voltage in
    proportion to the current of the last step.

    Attributes
    ----------
    charge : float
        Charge drawn so far [A·s].
    voltage : float
        Terminal voltage [V].
    draining : bool
        Whether it is the draining model.
    """

    def __init__(self, parameters: BatteryParameters) -> None:
        self._parameters = parameters
        self._slope = (FRESH_V - LOW_V) / parameters.battery_capacity
        self.draining = parameters.battery_model == 'draining'
        self.charge = 0.0
        self.voltage = parameters.battery_voltage

    def draw(self, motor_current: float, dt: float) -> None:
        """Draw the motors' supply current [A] and the brick's own for `dt` seconds."""
        if not self.draining:
            return
        p = self._parameters
        current = max(0.0, motor_current) + p.idle_current
        self.charge += current * dt
        self.voltage = terminal_voltage(
            self.charge, current, p.battery_voltage, self._slope, p.battery_resistance
        )


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
