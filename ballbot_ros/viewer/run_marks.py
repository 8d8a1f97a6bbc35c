"""The events of a recorded run as marks on the time line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.plant.ground_truth import Pair
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
    pushes = (Mark(time, MarkKind.PUSH, _push_text(*push)) for time, push in run.pushes)
    hits = (Mark(time, MarkKind.HIT, 'wall hit') for time in run.wall_hits)
    tones = (
        Mark(time, MarkKind.TONE, f'tone of {tone.frequency_hz} Hz, {tone.duration_ms} ms')
        for time, tone in run.tones
    )
    apart = run.end / _MARKS_PER_LINE
    return tuple(mark for kind in (states, pushes, hits, tones) for mark in _merged(kind, apart))


def _push_text(force: Pair, torque: Pair) -> str:
    parts = [
        f'{value + 0.0:g} {unit} {direction}'
        for pair, unit in ((force, 'N'), (torque, 'N·m'))
        for value, direction in zip(pair, ('forward', 'rightward'), strict=True)
        if value
    ]
    return f'push of {", ".join(parts)}'


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
