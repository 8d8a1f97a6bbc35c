"""Arithmetic that gives the same bits on every machine.

A motor duty must not depend on the processor, on the C library, or on the release of numpy. Code
that affects a duty therefore avoids BLAS, LAPACK, the C library's elementary functions, ``**`` on
floats and numpy's distributions. The replacements are here. They use additions, multiplications,
divisions and square roots of IEEE double precision, which every machine rounds alike, in a fixed
order.

The functions take and return plain numbers, so that numba can compile them unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

_F = TypeVar('_F', bound=Callable[..., Any])

ALTERNATIVES: dict[Callable[..., Any], Callable[..., Any]] = {}
"""Functions that compiled code calls instead of others."""

INLINED: set[Callable[..., Any]] = set()
"""Functions that compiled code contains instead of calling them."""


def compiled_as(alternative: _F) -> Callable[[_F], _F]:
    """Let compiled code call `alternative` instead of the decorated function, which equals it."""

    def register(function: _F) -> _F:
        ALTERNATIVES[function] = alternative
        return function

    return register


def inlined(function: _F) -> _F:
    """Let compiled code contain a function that it calls once.

    Its named tuples of many numbers are then no arguments, which would be copied.
    """
    INLINED.add(function)
    return function


def with_globals(function: Callable[..., Any], others: Mapping[str, object]) -> FunctionType:
    """Return a copy of a function for which other objects replace some of its module.

    So one function calls another without having it as an argument, which compiled code that is kept
    can't have.
    """
    assert isinstance(function, FunctionType)
    names = {**function.__globals__, **others}
    fresh = FunctionType(function.__code__, names, function.__name__, function.__defaults__)
    fresh.__qualname__ = function.__qualname__
    return inlined(fresh) if function in INLINED else fresh


TWO_PI = 2.0 * math.pi

_QUARTER_PI = math.pi / 4.0
_TWO_OVER_PI = 2.0 / math.pi
# Half of pi in three parts. The first two have 33 bits each, so that their products with integers
# up to 2^20 are exact.
_HALF_PI_1 = float.fromhex('0x1.921fb54400000p+0')
_HALF_PI_2 = float.fromhex('0x1.0b4611a600000p-34')
_HALF_PI_3 = float.fromhex('0x1.3198a2e037073p-69')
_MAX_ANGLE = float(2**20)

# Sine: x + x z (S3 + S5 z + ...) with z = x^2. The coefficients interpolate it at the Chebyshev
# nodes of 0 ... (pi/4)^2; the error is below 2^-55.
_S3 = -0.16666666666666666
_S5 = 0.008333333333330948
_S7 = -0.00019841269836758574
_S9 = 2.755731610255244e-06
_S11 = -2.5051131845003624e-08
_S13 = 1.5918129294866608e-10

_SQRT_HALF = math.sqrt(0.5)
# The logarithm of 2 in two parts; the product of the first part with any exponent is exact.
_LN2_1 = float.fromhex('0x1.62e42fee00000p-1')
_LN2_2 = float.fromhex('0x1.a39ef35793c76p-33')


def sine_cosine(angle: float) -> tuple[float, float]:
    """Return sine and cosine of an angle [rad], to about one unit in the last place.

    Angles are reduced by quarters of a turn (Cody and Waite) to at most an eighth of a turn. There,
    a polynomial gives the sine, and the cosine follows from it without loss. Angles beyond
    2^20 rad, which a double resolves coarsely, are first reduced by the double nearest to 2 pi.
    Infinite angles give NaN.
    """
    if -_QUARTER_PI <= angle <= _QUARTER_PI:
        quarters, x = 0, angle
    else:
        size = abs(angle)
        if not size < _MAX_ANGLE:
            if size - size != 0.0:
                return math.nan, math.nan
            size %= TWO_PI
        quarters = math.floor(size * _TWO_OVER_PI + 0.5)
        x = ((size - quarters * _HALF_PI_1) - quarters * _HALF_PI_2) - quarters * _HALF_PI_3
        if angle < 0.0:
            quarters, x = -quarters, -x
    z = x * x
    sine = x + x * (z * (_S3 + z * (_S5 + z * (_S7 + z * (_S9 + z * (_S11 + z * _S13))))))
    cosine = math.sqrt(1.0 - sine * sine)
    if quarters == 0:
        return sine, cosine
    quadrant = quarters % 4
    if quadrant == 0:
        return sine, cosine
    if quadrant == 1:
        return cosine, -sine
    if quadrant == 2:
        return -sine, -cosine
    return -cosine, sine


def sines_cosines(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return :func:`sine_cosine` of each angle; shape (2, n)."""
    return np.array([sine_cosine(each) for each in angles.tolist()]).reshape(-1, 2).T


def natural_log(x: float) -> float:
    """Return the natural logarithm of a finite x > 0 to about one unit in the last place.

    With x = m·2^e and m within sqrt(1/2) ... sqrt(2): e·ln 2 + 2 artanh((m - 1)/(m + 1)).
    """
    mantissa, exponent = math.frexp(x)
    if mantissa < _SQRT_HALF:
        mantissa *= 2.0
        exponent -= 1
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    # The terms z^n / (2n + 1), the smallest first.
    series = 0.0
    for n in range(11, 0, -1):
        series = (series + 1.0 / (2 * n + 1)) * z
    return exponent * _LN2_1 + (exponent * _LN2_2 + 2.0 * s * series + 2.0 * s)


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
