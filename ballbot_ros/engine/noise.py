"""The random numbers of a sample: in blocks for the interpreter, one by one in compiled code."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ballbot_ros.brick.noise import Key, noise_bits
from ballbot_ros.numerics.compiler_hints import compiled_as
from ballbot_ros.numerics.random_numbers import normal, uniform

_BLOCK = 256
_KEPT_BLOCKS = 64
_WORD = 0xFFFFFFFF
_HALF = 32

Numbers = tuple[float, float]


def one_uniform_pair(key: Key, device: Any, index: int) -> Numbers:
    """Return what :func:`uniform_pair` does, without a block."""
    one, other = _bits(key, device, index)
    return uniform(one), uniform(other)


def one_normal_pair(key: Key, device: Any, index: int) -> Numbers:
    """Return what :func:`normal_pair` does, without a block."""
    one, other = _bits(key, device, index)
    return normal(one), normal(other)


@compiled_as(one_uniform_pair)
def uniform_pair(key: Key, device: Any, index: int) -> Numbers:
    """Return the two uniform numbers of sample `index` of a device, within [0, 1)."""
    return _uniform_block(key, device, index // _BLOCK)[index % _BLOCK]


@compiled_as(one_normal_pair)
def normal_pair(key: Key, device: Any, index: int) -> Numbers:
    """Return the two standard normal numbers of sample `index` of a device."""
    return _normal_block(key, device, index // _BLOCK)[index % _BLOCK]


def _bits(key: Key, device: Any, index: int) -> tuple[Any, Any]:
    low, high = noise_bits(np.uint64(index & _WORD), np.uint64(index >> _HALF), device, key)
    return np.int64(low), np.int64(high)


@lru_cache(_KEPT_BLOCKS)
def _uniform_block(key: Key, device: Any, block: int) -> list[Numbers]:
    return [(uniform(one), uniform(other)) for one, other in _bits_of_block(key, device, block)]


@lru_cache(_KEPT_BLOCKS)
def _normal_block(key: Key, device: Any, block: int) -> list[Numbers]:
    return [(normal(one), normal(other)) for one, other in _bits_of_block(key, device, block)]


def _bits_of_block(key: Key, device: Any, block: int) -> list[tuple[int, int]]:
    first = block * _BLOCK
    low = np.arange(first & _WORD, (first & _WORD) + _BLOCK, dtype=np.uint64)
    one, other = noise_bits(low, np.uint64(first >> _HALF), device, key)
    return list(zip(one.tolist(), other.tolist(), strict=True))
