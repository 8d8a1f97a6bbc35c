"""The force of the pushes that act at a time."""

from __future__ import annotations

from collections.abc import Iterable

from ballbot_ros.plant.ground_truth import Pair

ForceEvent = tuple[float, str, Pair]
"""Time [s], name of a push, and its force in plane signs from then on [N]."""


def acting_force(events: Iterable[ForceEvent], time: float) -> Pair:
    """Return the force in plane signs [N] at `time` [s], given the starts and ends of the pushes.

    Times are allowed 1 µs, as a time of a slider is less exact than a stamp.
    """
    forces = {name: force for start, name, force in sorted(events) if start <= time + 1e-6}
    return sum(x for x, _ in forces.values()), sum(y for _, y in forces.values())
