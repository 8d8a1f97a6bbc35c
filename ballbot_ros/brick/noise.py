"""Random numbers that depend on seed, device and sample time alone.

A device that is restarted in mid-run, or asked twice for one sample, gives the same noise.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np

_BLOCK = 256

Draw = Callable[[np.random.Generator, tuple[int, int]], np.ndarray]


class DeviceNoise:
    """Rows of random numbers by sample index, drawn in blocks from a counter-based generator.

    Parameters
    ----------
    seed : int
        The run's seed.
    device : str
        Name of the device: its stream.
    width : int
        Numbers a row.
    draw : callable
        ``draw(generator, (rows, width))`` gives the block, standard normal or uniform.
    """

    def __init__(self, seed: int, device: str, width: int, draw: Draw) -> None:
        self._key = np.array([seed, zlib.crc32(device.encode())], dtype=np.uint64)
        self._width = width
        self._draw = draw
        self._block = -1
        self._rows: list[list[float]] = []

    def row(self, index: int) -> list[float]:
        """Return the row of sample `index`, a non-negative integer."""
        block, offset = divmod(index, _BLOCK)
        if block != self._block:
            bits = np.random.Philox(key=self._key, counter=[0, block, 0, 0])
            generator = np.random.Generator(bits)
            self._rows = self._draw(generator, (_BLOCK, self._width)).tolist()
            self._block = block
        return self._rows[offset]


def normal(generator: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw standard normal numbers."""
    return generator.standard_normal(shape)


def uniform(generator: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw numbers uniform in [0, 1)."""
    return generator.random(shape)
