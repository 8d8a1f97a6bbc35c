"""The status of a robot that is driven by hand, as lines of text."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.viewer.snapshot import Snapshot

_UNKNOWN = '–'


def drive_status(snapshot: Snapshot | None, factor: float) -> Mapping[str, str]:
    """Return names and texts; None before the robot's first pose.

    Forward and rightward are positive. `factor` is sim time per wall time.
    """
    if snapshot is None:
        names = ('sim time', 'state', 'position', 'pitch', 'speed', 'sonar')
        return dict.fromkeys(names, _UNKNOWN)
    return {
        'sim time': f'{snapshot.time:.1f} s   {factor:.2f} × real time',
        'state': snapshot.state + '   press r to restart' * snapshot.is_out_of_control,
        'position': _pair(snapshot.position, 100.0, 'cm'),
        'pitch': _pair(snapshot.psi, math.degrees(1.0), '°'),
        'speed': _pair(snapshot.speed, 100.0, 'cm/s'),
        'sonar': _distance(snapshot.sonar),
    }


def _pair(values: Pair, scale: float, unit: str) -> str:
    forward, rightward = (f'{value * scale:+7.1f} {unit:<4}' for value in values)
    return f'forward {forward}   rightward {rightward}'.rstrip()


def _distance(metres: float) -> str:
    if math.isnan(metres):
        return _UNKNOWN
    return f'{metres * 100.0:.0f} cm' if math.isfinite(metres) else 'no echo'
