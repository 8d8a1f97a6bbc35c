"""Distinguishes repeated samples from conflicting ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from enum import Enum, auto

DEPTH = 16


class SampleStatus(Enum):
    """Relation of a sample to earlier ones on its topic."""

    NEW = auto()
    DUPLICATE = auto()
    CONFLICTING = auto()
    OLD = auto()


class SampleHistory:
    """The latest samples of a topic that has one sample per stamp.

    `is_same` compares the content of two serialised messages with one stamp.
    """

    def __init__(self, is_same: Callable[[bytes, bytes], bool]) -> None:
        self._is_same = is_same
        self._samples: deque[tuple[int, bytes]] = deque(maxlen=DEPTH)

    def clear(self) -> None:
        """Forget the samples: another run begins."""
        self._samples.clear()

    def classify(self, stamp_ns: int, data: bytes) -> SampleStatus:
        """Classify a sample, and store it if it is new.

        It is NEW if its stamp is newer than all others. If a sample with its stamp is stored, it is
        a DUPLICATE if the content is the same, or else CONFLICTING. Otherwise it is OLD.
        """
        samples = self._samples
        if not samples or stamp_ns > samples[-1][0]:
            samples.append((stamp_ns, data))
            return SampleStatus.NEW
        for known_ns, known in reversed(samples):
            if known_ns == stamp_ns:
                return (
                    SampleStatus.DUPLICATE
                    if self._is_same(known, data)
                    else SampleStatus.CONFLICTING
                )
        return SampleStatus.OLD
