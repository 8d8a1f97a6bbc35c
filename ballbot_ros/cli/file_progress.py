"""The progress bar of work on a file."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import Progress

UPDATE_S = 0.2


class FileProgress:
    """A bar on the terminal; nothing on a pipe or file.

    Parameters
    ----------
    name : str
        What is done.
    """

    def __init__(self, name: str) -> None:
        console = Console(stderr=True)
        self._bar = Progress(console=console, transient=True, disable=not console.is_terminal)
        self._task = self._bar.add_task(name, total=None)
        self._next = 0.0

    def __enter__(self) -> FileProgress:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def update(self, done: int, total: int) -> None:
        """Show how much of how much is done; cheap enough to be called at every message."""
        if self._bar.disable:
            return
        now = time.monotonic()
        if now >= self._next:
            self._next = now + UPDATE_S
            self._bar.update(self._task, completed=done, total=total)
