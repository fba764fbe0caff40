"""Low-pass filters as what they do to each frequency, and as weights of pixels.

Frequencies are in cycles per pixel: 0.5 is the highest that pixels can show (Nyquist). Each function takes the frequency along rows and
along columns, arrays that broadcast, and gives the factor, 1 at frequency 0. Gonzalez and Woods, "Digital Image Processing", chapter 4.
"""

from __future__ import annotations

import math

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError

TRUNCATE = 4.0
"""A Gaussian's weights end at so many standard deviations, as in SciPy and OpenCV: what is left out is 6e-5 of the whole in each direction."""


def ideal(fy: object, fx: object, cutoff: float) -> Array:
    """1 up to the cut-off, 0 beyond, by distance from frequency 0: rings at edges (Gibbs)."""
    return (_squared(fy, fx) <= _cutoff(cutoff) ** 2).astype(np.float64)


def butterworth(fy: object, fx: object, cutoff: float, order: float) -> Array:
    """1 / sqrt(1 + (f / cutoff)^(2 order)): half the energy at the cut-off, and the steeper the higher the order."""
    _cutoff(cutoff)
    if not (_is_number(order) and 0 < order <= 100):
        raise InputError(f"order: expected a number above 0 and up to 100, got {order!r}")
    with np.errstate(over="ignore"):
        return 1 / np.sqrt(1 + _power(_squared(fy, fx) / cutoff**2, order))


def gaussian(fy: object, fx: object, sigma: float) -> Array:
    """exp(-2 pi^2 sigma^2 f^2), the transform of a Gaussian of standard deviation `sigma` pixels."""
    return np.exp(-2 * np.pi**2 * checked_sigma(sigma) ** 2 * _squared(fy, fx))


def sigma_of(cutoff: float) -> float:
    """Standard deviation, in pixels, of the Gaussian that lets half the energy through at `cutoff`, like a Butterworth filter."""
    return math.sqrt(math.log(2)) / (2 * math.pi * _cutoff(cutoff))


def gaussian_taps(sigma: float) -> Array:
    """(2 r + 1,) float64: the weights of a Gaussian at whole pixels up to r = round(4 sigma), summing to 1."""
    radius = int(TRUNCATE * checked_sigma(sigma) + 0.5)
    x = np.arange(-radius, radius + 1)
    taps = np.exp(-0.5 * (x / sigma) ** 2)
    return taps / taps.sum()


def response(taps: Array, frequencies: Array) -> Array:
    """The factors of a symmetric row of weights at `frequencies` (n,), real float64."""
    radius = len(taps) // 2
    total = np.full(frequencies.shape, float(taps[radius]))
    turn = np.exp(2j * np.pi * frequencies)
    power = np.ones_like(turn)
    for k in range(1, radius + 1):
        power = power * turn
        total += 2 * taps[radius + k] * power.real
    return total


def checked_sigma(sigma: object) -> float:
    """`sigma`, if it is a standard deviation in pixels."""
    if not (_is_number(sigma) and 0 < float(sigma) <= 1e5):  # type: ignore[arg-type]
        raise InputError(f"gaussian: expected a standard deviation above 0 and up to 100000 pixels, got {sigma!r}")
    return float(sigma)  # type: ignore[arg-type]


def _power(base: Array, order: float) -> Array:
    """`base ** order`; by multiplications where the order is whole, which takes a tenth of the time."""
    if order != int(order):
        return base**order
    result, square, left = np.ones_like(base), base, int(order)
    while left:
        if left & 1:
            result = result * square
        left >>= 1
        square = square * square if left else square
    return result


def _squared(fy: object, fx: object) -> Array:
    return np.square(np.asarray(fy, np.float64)) + np.square(np.asarray(fx, np.float64))


def _cutoff(cutoff: object) -> float:
    if not (_is_number(cutoff) and 0 < float(cutoff) <= 1):  # type: ignore[arg-type]
        raise InputError(f"cutoff: expected cycles per pixel above 0 and up to 1 (0.5 is the finest that pixels show), got {cutoff!r}")
    return float(cutoff)  # type: ignore[arg-type]


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool) and math.isfinite(float(value))
