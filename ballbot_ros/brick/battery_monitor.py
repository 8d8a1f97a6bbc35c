"""The brick's battery voltage measurement."""

from __future__ import annotations

from ballbot_ros.brick.units import quantise

ADC_BITS = 10
FULL_SCALE_MV = 14180
"""Voltage of count 1024, one above the largest."""


COUNT_V = FULL_SCALE_MV / (1 << ADC_BITS) / 1000.0
"""Voltage of one count [V]."""


def count_of(reading_mv: int) -> int:
    """Return the count that a reading of :func:`battery_mv` stands for."""
    return -(-(reading_mv << ADC_BITS) // FULL_SCALE_MV)


def battery_mv(voltage: float) -> int:
    """Return what ``ecrobot_get_battery_voltage`` reads [mV] at a voltage [V].

    The converter has 10 bits and rounds to the nearest count; nxtOSEK scales the count in
    integers and truncates.
    """
    counts = quantise(voltage * 1000.0 * (1 << ADC_BITS) / FULL_SCALE_MV)
    counts = max(0, min((1 << ADC_BITS) - 1, counts))
    return (counts * FULL_SCALE_MV) >> ADC_BITS
