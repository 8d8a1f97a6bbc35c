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
        self._slope = capacity_slope(parameters.battery_capacity)
        self.draining = parameters.battery_model == 'draining'
        self.charge = 0.0
        self.voltage = parameters.battery_voltage

    def draw(self, motor_current: float, dt: float) -> None:
        """Draw the motors' supply current [A] and the brick's own for `dt` seconds."""
        if not self.draining:
            return
        p = self._parameters
        self.charge, self.voltage = discharge(
            self.charge, motor_current, dt,
            p.idle_current, p.battery_voltage, self._slope, p.battery_resistance,
        )  # fmt: skip


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
