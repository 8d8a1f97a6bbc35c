"""Progress bar with sim time and real-time factor."""

from __future__ import annotations

import time

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from ballbot_ros.progress import PROGRESS_PERIOD_S


def stderr_console() -> Console:
    """Return a console that prints plain lines."""
    return Console(stderr=True, highlight=False, markup=False)


class Progress:
    """A bar on a terminal; on a pipe or file, or without `bar`, only the notices.

    Parameters
    ----------
    duration : float
        In sim time [s]; 0 for an endless run.
    console : Console or None
        Shared with others that print while the bar is shown; their lines appear above it.
    """

    def __init__(
        self, name: str, duration: float, *, bar: bool = True, console: Console | None = None
    ) -> None:
        self._console = console or stderr_console()
        self._bar = Bar(
            TextColumn('{task.description}', markup=False),
            BarColumn(bar_width=40),
            TextColumn('{task.fields[text]}'),
            console=self._console,
            transient=True,
            disable=not (bar and self._console.is_terminal),
        )
        self._duration = duration
        self._task = self._bar.add_task(name, total=duration or None, text='starting')
        self._last = (time.monotonic(), 0.0)

    def __enter__(self) -> Progress:
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.stop()

    def update(self, elapsed_s: float) -> None:
        """Show the sim time since the start [s]; cheap enough to be called at every tick."""
        now = time.monotonic()
        if not elapsed_s:
            self._last = (now, 0.0)  # a run that waits for its start has no factor
            return
        then, before = self._last
        if now - then < PROGRESS_PERIOD_S:
            return
        factor = (elapsed_s - before) / (now - then)
        self._last = (now, elapsed_s)
        of = f' / {self._duration:g}' if self._duration else ''
        self._bar.update(
            self._task,
            completed=elapsed_s,
            text=f'{elapsed_s:.1f}{of} s   {factor:.1f} × real time',
        )

    def notice(self, text: str) -> None:
        """Print a line above the bar."""
        self._console.print(text, soft_wrap=True)
