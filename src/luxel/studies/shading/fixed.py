"""Attributes of a triangle exactly, as ratios of integers, and as the numbers of the fixed-point registers that interpolate them."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.raster.constants import SUBPIXEL

VALUE_BITS = 16
"""Fraction bits in which the values at the corners are given, whatever the interpolators have."""


class Format(NamedTuple):
    """A register: a sign, `integer` bits and `fraction` bits, in two's complement, wrapping around.

    The sign is there so that a value that rounding carries below 0 is a little less than nothing, and not white.
    """

    integer: int = 8
    fraction: int = 16

    @property
    def bits(self) -> int:
        """Of the whole register."""
        return 1 + self.integer + self.fraction

    @property
    def ulp(self) -> float:
        """The unit in the last place."""
        return 2.0**-self.fraction

    def __str__(self) -> str:
        return f"{self.integer}.{self.fraction}"

    def checked(self) -> Format:
        """Itself.

        Raises:
            InputError: It has no integer bit, or more bits than the model's 64 leave room for.
        """
        if not (1 <= self.integer <= 16 and 0 <= self.fraction <= 28):
            raise InputError(f"format: expected 1 to 16 integer and 0 to 28 fraction bits, got {self}")
        return self


def wrap(value: int, bits: int) -> int:
    """What a two's complement register of so many bits holds of a whole number."""
    half = 1 << (bits - 1)
    return ((value + half) & ((1 << bits) - 1)) - half


def wrap_all(values: Array, bits: int) -> Array:
    """`wrap` of an array of int64."""
    spare = np.int64(64 - bits)
    return (values << spare) >> spare


def nearest(numerator: int, denominator: int) -> int:
    """The whole number nearest to a ratio with a positive denominator; halves go up."""
    return (2 * numerator + denominator) // (2 * denominator)


class Plane(NamedTuple):
    """One attribute over a triangle: (p x + q y + r) / d at the centre of pixel (x, y), exact; d is positive."""

    p: int
    q: int
    r: int
    d: int

    def at(self, x: int, y: int) -> Fraction:
        """The value at a pixel's centre."""
        return Fraction(self.p * x + self.q * y + self.r, self.d)

    def rounded(self, x: int, y: int, form: Format) -> int:
        """The value at a pixel's centre to the nearest that a register holds, in units of the last place."""
        return wrap(nearest((self.p * x + self.q * y + self.r) << form.fraction, self.d), form.bits)

    def all_rounded(self, x: Array, y: Array, form: Format) -> Array:
        """`rounded` at many pixels, (n,) int64."""
        p, q, r = (number << (form.fraction + 1) for number in self[:3])
        whole = [(p * column + q * row + r + self.d) // (2 * self.d) for column, row in zip(x.tolist(), y.tolist(), strict=True)]
        return wrap_all(np.array(whole, np.int64), form.bits)

    def gradient(self, form: Format) -> tuple[int, int]:
        """The change from pixel to pixel along x and y, rounded to the register; steep ones wrap, which sums that fit undo."""
        return wrap(nearest(self.p << form.fraction, self.d), form.bits), wrap(nearest(self.q << form.fraction, self.d), form.bits)


def planes(corners: Array, values: Array) -> list[Plane]:
    """The attributes of a triangle.

    Args:
        corners: (3, 2) integers, 1/256 pixel.
        values: (3, channels) integers, 2^-VALUE_BITS.

    Raises:
        InputError: The corners lie on a line.
    """
    (x0, y0), (x1, y1), (x2, y2) = ((int(x), int(y)) for x, y in corners)
    area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    if area == 0:
        raise InputError(f"corners: expected three that do not lie on a line, got {np.asarray(corners).tolist()}")
    sign = 1 if area > 0 else -1
    found = []
    for channel in range(values.shape[1]):
        v0, v1, v2 = (int(v) for v in values[:, channel])
        along = sign * ((v1 - v0) * (y2 - y0) - (v2 - v0) * (y1 - y0))  # times 1 / |area|, a 1/256 pixel
        down = sign * ((v2 - v0) * (x1 - x0) - (v1 - v0) * (x2 - x0))
        centre = v0 * sign * area + along * (SUBPIXEL // 2 - x0) + down * (SUBPIXEL // 2 - y0)
        found.append(Plane(along * SUBPIXEL, down * SUBPIXEL, centre, sign * area << VALUE_BITS))
    return found


def errors(exact: Sequence[Plane], x: Array, y: Array, values: Array, form: Format) -> Array:
    """What registers hold, less what is exact.

    The products are taken modulo 2^64, and so is their difference: which is exact, because the difference itself is far below 2^63.

    Args:
        exact: The attributes, `channels` of them.
        x, y: (n,) pixels.
        values: (channels, n) int64, what the registers hold there.

    Returns:
        (channels, n) float64, in the attributes' own unit.
    """
    x, y = x.astype(np.int64), y.astype(np.int64)
    found = np.empty(values.shape)
    for channel, plane in enumerate(exact):
        p, q, r = (np.int64(wrap(number << form.fraction, 64)) for number in plane[:3])
        held = values[channel] * np.full(1, wrap(plane.d, 64), np.int64)
        found[channel] = (held - (p * x + q * y + r)) / (float(plane.d) * 2.0**form.fraction)
    return found
