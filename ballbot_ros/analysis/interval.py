"""Intervals of time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Interval:
    """A named interval of time [s]."""

    start: float
    end: float
    name: str
