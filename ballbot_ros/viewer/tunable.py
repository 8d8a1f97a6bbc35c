"""A parameter that a controller takes over during a run, as a live page shows it."""

from __future__ import annotations

from dataclasses import dataclass

_STEPS = 200
"""Steps of a slider for real numbers."""

_NARROW = 10.0
"""A slider covers the bounds if they are at most this many times as far apart as its value."""

_WHOLE_SPAN = 1000.0
"""A slider for whole numbers covers bounds that are at most this far apart."""

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Tunable:
    """A parameter that can be tuned.

    Attributes
    ----------
    description : str
        Its meaning and unit.
    low, high : float
        Its bounds, the same for each number.
    start, value : tuple of float
        Its numbers at the start of the run, and now; a single one unless it is an array.
    is_whole, is_array : bool
        Whether its numbers are integers, and whether it is an array.
    """

    name: str
    description: str
    low: float
    high: float
    start: Numbers
    value: Numbers
    is_whole: bool = False
    is_array: bool = False

    def range_of(self, value: float) -> tuple[float, float]:
        """Return the range of a slider for a value: the bounds, or part of them around it."""
        narrow = _WHOLE_SPAN if self.is_whole else _NARROW * max(abs(value), 1.0)
        if self.high - self.low <= narrow:
            return self.low, self.high
        reach = 2.0 * value or 1.0
        low, high = min(0.0, reach), max(0.0, reach)
        return max(self.low, low), min(self.high, high)

    def ros_value(self, numbers: Numbers) -> float | int | list[float]:
        """Return numbers as the value of a ROS parameter."""
        if self.is_array:
            return list(numbers)
        return round(numbers[0]) if self.is_whole else numbers[0]

    def step_of(self, low: float, high: float) -> float:
        """Return the step of a slider."""
        return 1.0 if self.is_whole or low == high else (high - low) / _STEPS
