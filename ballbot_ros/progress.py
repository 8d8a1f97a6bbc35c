"""Showing progress."""

from __future__ import annotations

from collections.abc import Callable

ProgressCallback = Callable[[int, int], None]
"""Called with the amount done and the total."""

PROGRESS_PERIOD_S = 0.2
"""Update interval of a progress display in wall time [s]."""
