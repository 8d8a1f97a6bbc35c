"""Progress bars of runs and of files; lines in place of a bar without a terminal."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ballbot_ros.parameters import CONTROLLER, PLANT
from ballbot_ros.process import PROGRESS_PERIOD_S, ProgressCallback

LINE_PERIOD_S = 10.0

HOLD_S = 5.0
"""Time for which a line is held back that may be the reason of a result that follows [s]."""


def stderr_console() -> Console:
    """Return a console that prints plain lines."""
    return Console(stderr=True, highlight=False, markup=False)


class ProgressLines:
    """Prints a line every 10 s where there is no terminal to show a bar; `text`: how far it is.

    `wait` waits so many seconds, and returns whether the work has ended; None for the clock.
    """

    def __init__(
        self, name: str, console: Console, wait: Callable[[float], bool] | None = None
    ) -> None:
        self.text = ''
        self._name, self._console, self._ended = name, console, threading.Event()
        self._wait = wait or self._ended.wait
        self._thread = threading.Thread(target=self._print, daemon=True)

    def __enter__(self) -> ProgressLines:
        if not self._console.is_terminal:
            self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        if self._thread.ident:
            self._thread.join()

    def _print(self) -> None:
        for count in itertools.count(1):
            if self._wait(LINE_PERIOD_S):
                return
            words = f'{self._name}: {self.text}'.removesuffix(': ')
            self._console.print(f'{words}, {count * LINE_PERIOD_S:.0f} s so far', soft_wrap=True)


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
        self._held: list[str] = []
        self._held_since_s = 0.0

    def __enter__(self) -> Progress:
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.release()
        self._bar.stop()

    def update(self, elapsed_s: float) -> None:
        """Show the sim time since the start [s]; cheap enough to be called at every tick."""
        now = time.monotonic()
        if self._held and now - self._held_since_s > HOLD_S:  # the run goes on: they did not end it
            self.release()
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
        """Print a line above the bar; hold back one that may be the reason of the result."""
        if text.removeprefix(f'{PLANT}: ').startswith(f'{CONTROLLER}: '):
            self._held.append(text)
            self._held_since_s = time.monotonic()
        else:
            self._console.print(text, soft_wrap=True)

    def release(self, reason: str = '') -> None:
        """Print the lines held back, without those that only repeat the reason of the result."""
        for text in self._held:
            if not (reason and text.endswith(reason)):
                self._console.print(text, soft_wrap=True)
        self._held.clear()


@contextmanager
def file_progress(name: str, unit: str = '') -> Iterator[ProgressCallback]:
    """Show the progress: on a terminal as a bar, with a number if there is a unit, else as lines.

    It yields a function of the amount done and the total, cheap enough to be called at every
    message.
    """
    console = stderr_console()
    with (
        ProgressLines(name, console) as lines,
        Bar(
            TextColumn('{task.description}', markup=False),
            BarColumn(bar_width=40),
            TextColumn(f'{{task.completed}}/{{task.total}} {unit}')
            if unit
            else TaskProgressColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        ) as bar,
    ):
        task = bar.add_task(name, total=None)
        due = 0.0

        def update(done: int, total: int) -> None:
            nonlocal due
            if (now := time.monotonic()) < due:
                return
            due = now + PROGRESS_PERIOD_S
            # A file may have more than it says.
            lines.text = f'{min(done / max(total, 1), 1.0):.0%}'
            bar.update(task, completed=done, total=total)

        yield update
