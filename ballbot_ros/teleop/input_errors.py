"""What is wrong with the inputs, kept until it has been reported."""

from __future__ import annotations


class InputErrors:
    """The present complaint of each input.

    A complaint stays until its input is healthy again and it was reported at least once, so that a
    single bad message among many good ones is seen, and one input complains once at a time.
    """

    def __init__(self) -> None:
        self._texts: dict[str, str] = {}
        self._healed: set[str] = set()

    def add(self, source: str, text: str) -> bool:
        """Note a complaint, the newest of its source; return whether the source had none."""
        self._healed.discard(source)
        is_first = source not in self._texts
        self._texts[source] = f'{source}: {text}'
        return is_first

    def clear(self, source: str) -> None:
        """Note that the source is healthy."""
        if source in self._texts:
            self._healed.add(source)

    def reported(self) -> None:
        """Drop the complaints of healthy sources, which have been reported now."""
        while self._healed:
            self._texts.pop(self._healed.pop(), None)

    def __str__(self) -> str:
        """Return all complaints on one line."""
        return '; '.join(list(self._texts.values()))
