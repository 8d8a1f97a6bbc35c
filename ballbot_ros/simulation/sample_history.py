"""Tells a sample that comes again from one that contradicts what was there."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from enum import Enum, auto

DEPTH = 16


class Sample(Enum):
    """What a sample is to those that came before on its topic."""

    NEW = auto()
    REPEATED = auto()
    CONTRADICTING = auto()
    OLD = auto()


class SampleHistory:
    """The last samples of a topic, of which each stamp has one.

    Parameters
    ----------
    is_same : callable
        Whether two serialised messages of one stamp say the same.
    """

    def __init__(self, is_same: Callable[[bytes, bytes], bool]) -> None:
        self._is_same = is_same
        self._samples: deque[tuple[int, bytes]] = deque(maxlen=DEPTH)

    def clear(self) -> None:
        """Forget the samples: another run begins."""
        self._samples.clear()

    def judge(self, stamp_ns: int, data: bytes) -> Sample:
        """Tell what a sample is, and keep one that is new.

        Returns
        -------
        Sample
            NEW if it is newer than all others; OLD if it is older and of a stamp that is not
            known, or no longer; otherwise whether it says what the known one says.
        """
        samples = self._samples
        if not samples or stamp_ns > samples[-1][0]:
            samples.append((stamp_ns, data))
            return Sample.NEW
        for known_ns, known in reversed(samples):
            if known_ns == stamp_ns:
                return Sample.REPEATED if self._is_same(known, data) else Sample.CONTRADICTING
        return Sample.OLD
