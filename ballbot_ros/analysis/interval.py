"""Intervals of time."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.parameters.text_enum import TextEnum


class IntervalKind(TextEnum):
    """What an interval is about."""

    STATE = 'state'
    STICKS = 'sticks'
    PUSH = 'push'
    WALL_HIT = 'wall hit'


@dataclass(frozen=True)
class Interval:
    """A named interval of time [s]; `detail` is a description, or ''."""

    start: float
    end: float
    name: str
    kind: IntervalKind = IntervalKind.STATE
    detail: str = ''
