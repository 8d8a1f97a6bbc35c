"""Registry of metrics: a decorator registers a function with its meaning."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

Measured = TypeVar('Measured')
"""What a metric is computed from."""

Function = Callable[[Measured], float]


@dataclass(frozen=True)
class Metric(Generic[Measured]):
    """A metric: its meaning, and the function that computes it, with NaN for missing data."""

    meaning: str
    compute: Function[Measured]


class MetricRegistry(dict[str, Metric[Measured]]):
    """Metrics by name, in order of definition."""

    def metric(
        self, meaning: str, name: str = ''
    ) -> Callable[[Function[Measured]], Function[Measured]]:
        """Register the decorated function as a metric.

        The `name`, by default the function's, ends in the metric's unit.
        """

        def register(compute: Function[Measured]) -> Function[Measured]:
            self[name or compute.__name__] = Metric(meaning, compute)
            return compute

        return register

    def measure(self, measured: Measured) -> dict[str, float]:
        """Return the values of all metrics."""
        return {name: float(metric.compute(measured)) for name, metric in self.items()}

    @property
    def meanings(self) -> Mapping[str, str]:
        """Meaning of each metric, by name."""
        return {name: metric.meaning for name, metric in self.items()}


UNITS: Mapping[str, str] = {
    'm_per_s': 'm/s',
    'deg_per_s': '°/s',
    'ms': 'ms',
    's': 's',
    'deg': '°',
    'm': 'm',
    'percent': '%',
    'j': 'J',
    'v': 'V',
    'hz': 'Hz',
}
"""Units by the endings of metric names, longer endings first."""


_FROM_THE_START: Mapping[str, str] = {
    'position_rms': 'distance from start rms',
    'peak_position': 'peak distance from start',
    'final_position_x': 'final x from start',
    'final_position_y': 'final y from start',
}
"""Labels of metrics that count from the start: a position counts from the origin of ``map``."""


def label(name: str) -> tuple[str, str]:
    """Return a metric's name as text, and its unit; a pure number has no unit."""
    for ending, unit in UNITS.items():
        if name.endswith(f'_{ending}'):
            words = name.removesuffix(f'_{ending}')
            return _FROM_THE_START.get(words, words.replace('_', ' ')), unit
    return name.replace('_', ' '), ''
