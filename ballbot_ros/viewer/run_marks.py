"""The events of a recorded run as marks on the time line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.viewer.overlay import Mark, MarkKind

_MARKS_PER_LINE = 200
"""Marks of a kind that are distinguishable on a time line."""


def run_marks(run: RunData) -> tuple[Mark, ...]:
    """Return state changes, pushes, wall hits and tones, in this order.

    Events of a kind that would lie upon each other share a mark.
    """
    states = (
        Mark(state.start, MarkKind.STATE, state.name.replace('_', ' ')) for state in run.states
    )
    pushes = (
        Mark(push.start, MarkKind.PUSH, f'{push.interval.name} of {push.strength}')
        for push in run.pushes
    )
    hits = (Mark(hit.start, MarkKind.HIT, hit.name) for hit in run.wall_hits)
    tones = (
        Mark(time, MarkKind.TONE, f'tone of {tone.frequency_hz} Hz, {tone.duration_ms} ms')
        for time, tone in run.tones
    )
    apart = run.end / _MARKS_PER_LINE
    return tuple(mark for kind in (states, pushes, hits, tones) for mark in _merged(kind, apart))


def _merged(marks: Iterable[Mark], apart: float) -> Iterator[Mark]:
    """Iterate over marks at least `apart` [s]; each also stands for those up to the next one."""
    groups: list[list[Mark]] = []
    for mark in marks:
        if groups and mark.time - groups[-1][0].time < apart:
            groups[-1].append(mark)
        else:
            groups.append([mark])
    for first, *others in groups:
        text = f'{first.text}, and {len(others)} more' if others else first.text
        yield Mark(first.time, first.kind, text)
