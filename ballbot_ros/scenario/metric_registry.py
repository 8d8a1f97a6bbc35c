"""Metrics as functions: a decorator gives each its meaning, and its place in the order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

Measured = TypeVar('Measured')
Function = Callable[[Measured], float]


@dataclass(frozen=True)
class Metric(Generic[Measured]):
    """What a metric is, and the function that computes it; NaN where there is nothing to measure.

    Attributes
    ----------
    meaning : str
    compute : callable
    """

    meaning: str
    compute: Function[Measured]


class MetricRegistry(dict[str, Metric[Measured]]):
    """Metrics by name, in the order in which they are defined."""

    def metric(
        self, meaning: str, name: str = ''
    ) -> Callable[[Function[Measured]], Function[Measured]]:
        """Register the decorated function as a metric.

        Parameters
        ----------
        meaning : str
        name : str, optional
            The metric's name, ending in its unit; that of the function if it is not given.
        """

        def register(compute: Function[Measured]) -> Function[Measured]:
            self[name or compute.__name__] = Metric(meaning, compute)
            return compute

        return register

    def measure(self, measured: Measured) -> dict[str, float]:
        """Return the value of every metric."""
        return {name: float(metric.compute(measured)) for name, metric in self.items()}

    @property
    def meanings(self) -> Mapping[str, str]:
        """What each metric is, by its name."""
        return {name: metric.meaning for name, metric in self.items()}


UNITS: Mapping[str, str] = {
    'm_s': 'm/s',
    'deg_s': '°/s',
    'ms': 'ms',
    's': 's',
    'deg': '°',
    'm': 'm',
    'percent': '%',
    'j': 'J',
    'v': 'V',
    'hz': 'Hz',
}
"""The units with which the names of metrics end, the longer endings first."""


def label(name: str) -> tuple[str, str]:
    """Return a metric's name in words, and its unit; the unit of a pure number is empty."""
    for ending, unit in UNITS.items():
        if name.endswith(f'_{ending}'):
            return name.removesuffix(f'_{ending}').replace('_', ' '), unit
    return name.replace('_', ' '), ''
