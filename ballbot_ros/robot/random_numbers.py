"""Random numbers as a function of key and counter: Philox4x32-10, numbers derived from it, noise.

A device that restarts in mid-run, or samples twice at one time, has the same noise.
"""

from __future__ import annotations

import math
import zlib
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.robot.arithmetic import natural_log

# Salmon, Moraes, Dror and Shaw, Parallel random numbers: as easy as 1, 2, 3 (2011).
_ROUNDS = 10
_MULTIPLIER_0, _MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_WORD = np.uint64(0xFFFFFFFF)
_BITS = np.uint64(32)


class Words(NamedTuple):
    """The four 32-bit words that Philox computes from a counter."""

    w0: Any
    w1: Any
    w2: Any
    w3: Any


def philox4x32(c0: Any, c1: Any, c2: Any, c3: Any, k0: Any, k1: Any) -> Words:
    """Return Philox4x32-10 of the counter c0 ... c3 with the key k0, k1, all of 32 bits as uint64.

    It uses only integer operations, so numbers and arrays give the same results.
    """
    for _ in range(_ROUNDS):
        product_0 = _MULTIPLIER_0 * c0
        product_1 = _MULTIPLIER_1 * c2
        c0, c2 = (product_1 >> _BITS) ^ c1 ^ k0, (product_0 >> _BITS) ^ c3 ^ k1
        c1, c3 = product_1 & _WORD, product_0 & _WORD
        k0 = (k0 + _WEYL_0) & _WORD
        k1 = (k1 + _WEYL_1) & _WORD
    return Words(c0, c1, c2, c3)


_PER_2_53 = float.fromhex('0x1p-53')
_MEDIAN = float(2**52) - 0.5
_HIGH_SHIFT, _LOW_SHIFT = np.uint64(21), np.uint64(11)


def bits_53(high: Any, low: Any) -> Any:
    """Return a whole number of 53 bits from two words of 32."""
    return (high << _HIGH_SHIFT) | (low >> _LOW_SHIFT)


def uniform(bits: int) -> float:
    """Return a number within [0, 1) from 53 random bits."""
    return float(bits) * _PER_2_53


def normal(bits: int) -> float:
    """Return a standard normal number from 53 random bits.

    It is the quantile of (bits + 1/2) / 2^53, by the rational functions of algorithm AS 241, PPND16
    (Wichura 1988), accurate to about 1 part in 10^16. Complementary bits give opposite numbers.
    """
    # Exact: 53 bits hold every half of a whole number up to 2^52.
    q = (float(bits) - _MEDIAN) * _PER_2_53
    if -0.425 <= q <= 0.425:
        r = 0.180625 - q * q
        return (
            q
            * (((((((2.5090809287301226727e3 * r + 3.3430575583588128105e4) * r
                    + 6.7265770927008700853e4) * r + 4.5921953931549871457e4) * r
                  + 1.3731693765509461125e4) * r + 1.9715909503065514427e3) * r
                + 1.3314166789178437745e2) * r + 3.3871328727963666080e0)
            / (((((((5.2264952788528545610e3 * r + 2.8729085735721942674e4) * r
                    + 3.9307895800092710610e4) * r + 2.1213794301586595867e4) * r
                  + 5.3941960214247511077e3) * r + 6.8718700749205790830e2) * r
                + 4.2313330701600911252e1) * r + 1.0)
        )  # fmt: skip
    r = math.sqrt(-natural_log(0.5 - abs(q)))
    if r <= 5.0:
        r -= 1.6
        z = (
            (((((((7.74545014278341407640e-4 * r + 2.27238449892691845833e-2) * r
                  + 2.41780725177450611770e-1) * r + 1.27045825245236838258e0) * r
                + 3.64784832476320460504e0) * r + 5.76949722146069140550e0) * r
              + 4.63033784615654529590e0) * r + 1.42343711074968357734e0)
            / (((((((1.05075007164441684324e-9 * r + 5.47593808499534494600e-4) * r
                    + 1.51986665636164571966e-2) * r + 1.48103976427480074590e-1) * r
                  + 6.89767334985100004550e-1) * r + 1.67638483018380384940e0) * r
                + 2.05319162663775882187e0) * r + 1.0)
        )  # fmt: skip
    else:
        r -= 5.0
        z = (
            (((((((2.01033439929228813265e-7 * r + 2.71155556874348757815e-5) * r
                  + 1.24266094738807843860e-3) * r + 2.65321895265761230930e-2) * r
                + 2.96560571828504891230e-1) * r + 1.78482653991729133580e0) * r
              + 5.46378491116411436990e0) * r + 6.65790464350110377720e0)
            / (((((((2.04426310338993978564e-15 * r + 1.42151175831644588870e-7) * r
                    + 1.84631831751005468180e-5) * r + 7.86869131145613259100e-4) * r
                  + 1.48753612908506148525e-2) * r + 1.36929880922735805310e-1) * r
                + 5.99832206555887937690e-1) * r + 1.0)
        )  # fmt: skip
    return -z if q < 0.0 else z


_LOW_WORD = 0xFFFFFFFF
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
    return np.uint64(seed & _LOW_WORD), np.uint64(seed >> 32)


def device_number(device: str) -> np.uint64:
    """Return the part of the generator's counter that distinguishes the devices."""
    return np.uint64(zlib.crc32(device.encode()))
