"""Errors of the inputs, kept until they have been reported."""

from __future__ import annotations


class InputErrors:
    """The current error of each input.

    An error stays until its input works again and the error has been reported at least once. A
    single bad message among many good ones is therefore visible, and an input has one error at a
    time.
    """

    def __init__(self) -> None:
        self._texts: dict[str, str] = {}
        self._cleared: set[str] = set()

    def add(self, source: str, text: str) -> bool:
        """Store the newest error of a source; return whether the source had none before."""
        self._cleared.discard(source)
        is_first = source not in self._texts
        self._texts[source] = f'{source}: {text}'
        return is_first

    def clear(self, source: str) -> None:
        """Note that the source works again."""
        if source in self._texts:
            self._cleared.add(source)

    def remove_cleared(self) -> None:
        """Drop the errors of working sources, which have now been reported."""
        while self._cleared:
            self._texts.pop(self._cleared.pop(), None)

    def __str__(self) -> str:
        """Return all errors on one line."""
        return '; '.join(list(self._texts.values()))
