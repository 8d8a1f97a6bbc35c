"""The newest lines of a program's log, for a panel with little room."""

from __future__ import annotations

import re
from collections import deque

_INFO = re.compile(r'\[INFO\] \[[^]]*\] \[([^]]*)\]: (.*)')


class PassingMessages:
    """Keeps the newest lines of level INFO; all others should stay on the terminal."""

    def __init__(self, count: int) -> None:
        self._lines: deque[str] = deque(maxlen=count)

    def take(self, text: str) -> bool:
        """Keep a line; return whether it was one to keep."""
        found = _INFO.fullmatch(text.strip())
        if found:
            self.add(f'{found[1]}: {found[2]}')
        return found is not None

    def add(self, line: str) -> None:
        """Keep a line."""
        self._lines.append(line)

    @property
    def lines(self) -> list[str]:
        """The newest lines, oldest first."""
        return list(self._lines)
