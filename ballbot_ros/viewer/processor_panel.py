"""The brick's processor in the panel, while a run stands still."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from ballbot_ros.analysis.processor import ended, pieces
from ballbot_ros.parameters.timing import SLOW_PERIOD_NS
from ballbot_ros.recording.messages.jobs import Jobs

if TYPE_CHECKING:
    import viser

WINDOW_US = SLOW_PERIOD_NS // 1000
"""Time that is shown."""

_LABELS, _WIDTH, _ROW = 66.0, 210.0, 15.0
"""Width of the names and of the bars, and height of a row [px]."""


def timeline_svg(jobs: Jobs, until_us: int, until: float, interrupt_us: int) -> str:
    """Return who has had the processor in the last :data:`WINDOW_US` before a time, as SVG.

    The time is given as that of the jobs, and as that of the page [s]. Bars show who has the
    processor, thin lines the time from the release of a job to its end, and crosses lost alarms.
    """
    scale, first_us = _WIDTH / WINDOW_US, until_us - WINDOW_US

    def x(time_us: int) -> float:
        return _LABELS + scale * min(max(0, time_us - first_us), WINDOW_US)

    def middle(task: int) -> float:
        return _ROW * (task + 0.5)

    def bar(task: int, start_us: int, end_us: int, height: float, fill: str) -> str:
        return (
            f'<rect x="{x(start_us):.2f}" y="{middle(task) - height / 2:.1f}" '
            f'width="{max(0.5, x(end_us) - x(start_us)):.2f}" height="{height}" fill="{fill}"/>'
        )

    near = jobs.selected((jobs.end > first_us) & (jobs.release < until_us))
    done = ended(near)
    parts = [
        f'<text x="0" y="{middle(task) + 3.5}" font-size="10">{escape(name)}</text>'
        for task, name in enumerate(jobs.tasks)
    ]
    for task, release, end in np.stack([done.task, done.release, done.end]).T.tolist():
        parts.append(bar(task, release, end, 1.5, '#7ab'))
    for job, start, end in pieces(done, interrupt_us).T.tolist():
        parts.append(bar(done.task[job], start, end, 10.0, '#0072b2'))
    for task, at in np.stack([near.task, near.release])[:, near.is_lost].T.tolist():
        parts.append(f'<text x="{x(at):.2f}" y="{middle(task) + 3.5}" fill="#d55e00">×</text>')
    height = _ROW * (len(jobs.tasks) + 1)
    parts.append(
        f'<text x="{_LABELS}" y="{height - 3}" font-size="10">last {WINDOW_US // 1000} ms before '
        f'{until:.3f} s</text>'
    )
    return (
        f'<svg class="processor" width="{_LABELS + _WIDTH}" height="{height}" fill="currentColor" '
        f'style="margin:0 1em">{"".join(parts)}</svg>'
    )


class ProcessorPanel:
    """Shows the jobs before the time at which a run stands still."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._html = gui.add_html('', order=0.5)
        self._shown: tuple[int, int] | None = None

    def show(self, jobs: Jobs | None, until_us: int, until: float, interrupt_us: int = 0) -> None:
        """Show the jobs up to a time, see :func:`timeline_svg`; nothing without jobs."""
        shown = None if jobs is None else (until_us, len(jobs.task))
        if shown != self._shown:
            self._shown = shown
            content = '' if jobs is None else timeline_svg(jobs, until_us, until, interrupt_us)
            self._html.content = content
