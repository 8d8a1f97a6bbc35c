"""Random numbers that depend only on seed, device and sample time.

A device that restarts in mid-run, or samples twice at one time, has the same noise.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

from ballbot_ros.robot.numerics.random_numbers import bits_53, philox4x32

_WORD = 0xFFFFFFFF
_ZERO = np.uint64(0)

Key = tuple[np.uint64, np.uint64]
"""The key of the generator."""


def noise_bits(index_low: Any, index_high: Any, device: Any, key: Key) -> tuple[Any, Any]:
    """Return the 53 random bits of each of the two numbers of a sample.

    Parameters
    ----------
    index_low, index_high : uint64 or ndarray of uint64
        The lower and upper 32 bits of the sample's number.
    device : uint64
        Result of :func:`device_number`.
    key : tuple of uint64
        Result of :func:`noise_key`.
    """
    words = philox4x32(index_low, index_high, device, _ZERO, key[0], key[1])
    return bits_53(words.w0, words.w1), bits_53(words.w2, words.w3)


def noise_key(seed: int) -> Key:
    """Return the key of the generator for a seed, 0 ... 2^64 - 1."""
    return np.uint64(seed & _WORD), np.uint64(seed >> 32)


def device_number(device: str) -> np.uint64:
    """Return the part of the generator's counter that distinguishes the devices."""
    return np.uint64(zlib.crc32(device.encode()))
