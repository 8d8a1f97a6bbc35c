"""Random numbers that depend only on seed, device and sample time.

A device that restarts in mid-run, or samples twice at one time, has the same noise.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np

from ballbot_ros.numerics.random_numbers import bits_53, philox4x32

_BLOCK = 256
_WORD = 0xFFFFFFFF


class DeviceNoise:
    """Two random numbers for each sample, generated in blocks.

    The key of the generator is the seed, 0 ... 2^64 - 1; its counter is the sample number and the
    device. `draw` converts 53 random bits to a number: ``uniform`` or ``normal``.
    """

    def __init__(self, seed: int, device: str, draw: Callable[[int], float]) -> None:
        self._key = np.uint64(seed & _WORD), np.uint64(seed >> 32)
        self._device = np.uint64(zlib.crc32(device.encode()))
        self._draw = draw
        self._block = -1
        self._pairs: list[tuple[float, float]] = []

    def pair(self, index: int) -> tuple[float, float]:
        """Return the numbers of sample `index`, a non-negative integer."""
        block, offset = divmod(index, _BLOCK)
        if block != self._block:
            self._pairs = self._make(block * _BLOCK)
            self._block = block
        return self._pairs[offset]

    def _make(self, first: int) -> list[tuple[float, float]]:
        low = np.arange(first & _WORD, (first & _WORD) + _BLOCK, dtype=np.uint64)
        high = np.uint64(first >> 32)
        words = philox4x32(low, high, self._device, np.uint64(0), *self._key)
        one = bits_53(words.w0, words.w1).tolist()
        other = bits_53(words.w2, words.w3).tolist()
        draw = self._draw
        return [(draw(a), draw(b)) for a, b in zip(one, other, strict=True)]
