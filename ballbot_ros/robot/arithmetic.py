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
from typing import Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.robot.compiler_hints import inlined

Floats = NDArray[np.float64]


_Number = TypeVar('_Number', int, float)


class Numbers(Protocol[_Number]):
    """Numbers in a buffer, a list or an array, shape (n,)."""

    def __len__(self) -> int: ...
    def __getitem__(self, at: int, /) -> _Number: ...
    def __setitem__(self, at: int, value: _Number, /) -> None: ...


Ints: TypeAlias = Numbers[int]
Reals: TypeAlias = Numbers[float]


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


@inlined
def sine_cosine(angle: float) -> tuple[float, float]:
    """Return sine and cosine of an angle [rad], to about one unit in the last place.

    Angles are reduced by quarters of a turn (Cody and Waite) to at most an eighth of a turn. There,
    a polynomial gives the sine, and the cosine follows from it without loss. Angles beyond
    2^20 rad, which a double resolves coarsely, are first reduced by the double nearest to 2 pi.
    Infinite angles give NaN.
    """
    quarters, x = 0, angle
    if not -_QUARTER_PI <= angle <= _QUARTER_PI:
        quarters, x = _reduced(angle)
    z = x * x
    sine = x + x * (z * (_S3 + z * (_S5 + z * (_S7 + z * (_S9 + z * (_S11 + z * _S13))))))
    cosine = math.sqrt(1.0 - sine * sine)
    if quarters == 0:
        return sine, cosine
    return _turned(sine, cosine, quarters)


def _reduced(angle: float) -> tuple[int, float]:
    """Return the quarters of a turn that are nearest to an angle [rad], and the rest."""
    size = abs(angle)
    if not size < _MAX_ANGLE:
        if size - size != 0.0:
            return 0, math.nan
        size %= TWO_PI
    quarters = math.floor(size * _TWO_OVER_PI + 0.5)
    x = ((size - quarters * _HALF_PI_1) - quarters * _HALF_PI_2) - quarters * _HALF_PI_3
    return (-quarters, -x) if angle < 0.0 else (quarters, x)


def _turned(sine: float, cosine: float, quarters: int) -> tuple[float, float]:
    """Return sine and cosine of an angle that is larger by quarters of a turn."""
    quadrant = quarters % 4
    if quadrant == 0:
        return sine, cosine
    if quadrant == 1:
        return cosine, -sine
    if quadrant == 2:
        return -sine, -cosine
    return -cosine, sine


def sines_cosines(angles: Floats) -> Floats:
    """Return :func:`sine_cosine` of each angle, with the same bits; shape (2, ...)."""
    is_small = np.abs(angles) <= _QUARTER_PI
    are_small = is_small.all()
    x = angles if are_small else np.where(is_small, angles, 0.0)
    z = x * x
    sines = x + x * (z * (_S3 + z * (_S5 + z * (_S7 + z * (_S9 + z * (_S11 + z * _S13))))))
    both = np.array([sines, np.sqrt(1.0 - sines * sines)])
    if not are_small:
        # They are few, or those of robots that have fallen, which are all the same.
        others, places = np.unique(angles[~is_small], return_inverse=True)
        both[:, ~is_small] = np.transpose([*map(sine_cosine, others.tolist())])[:, places]
    return both


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
