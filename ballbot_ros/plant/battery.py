"""The battery pack: constant, or sagging with current and falling with charge.

In the draining model, the open-circuit voltage falls in proportion to the charge drawn (from 9.5 V
fresh to 7 V low over the capacity), and the internal resistance drops a voltage in proportion to
the current of the last step.
"""

from __future__ import annotations

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
