"""Encode: linear light to 8-bit sRGB, correctly rounded for every float32.

The table: a float32 between 2^-13 and 1 is looked up by its exponent and its 7 highest fraction bits. Each such bucket is so narrow that
at most one of the 255 thresholds between neighbouring codes lies in it. An entry keeps the code at the bucket's low end in its high half
and, in its low half, what must be added to the remaining 16 fraction bits to carry over at the threshold. So a code is one
gather, one addition and one shift, and exact (sRGB: IEC 61966-2-1).
"""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.jit import float_bits, inlined, part
from luxel.raster.channels import OA, OB, OG, OR

_LOW_BITS = 16
_FIRST = np.int32(np.float32(2.0**-13).view(np.int32) >> _LOW_BITS)
_LAST = np.int32(np.float32(1.0).view(np.int32) >> _LOW_BITS)
_MASK = np.int32((1 << _LOW_BITS) - 1)
_BASE = np.int32(_FIRST << _LOW_BITS)
_SHIFT, _UNSIGNED_SHIFT = np.int32(_LOW_BITS), np.uint32(_LOW_BITS)
_DARK, _ZERO, _HALF, _ONE, _FULL = (np.float32(value) for value in (2.0**-13, 0.0, 0.5, 1.0, 255.0))
_OPAQUE = np.uint32(0xFF000000)
_GREEN, _BLUE, _ALPHA = np.int32(8), np.int32(16), np.int32(24)


def srgb_to_linear(code: Array) -> Array:
    """Linear light 0..1, float64, of sRGB values 0..1 of any shape."""
    code = np.asarray(code, np.float64)
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: Array) -> Array:
    """sRGB values 0..1, float64, of linear light 0..1 of any shape."""
    light = np.asarray(light, np.float64)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)


def _thresholds() -> Array:
    """(255,) float32: the least value whose code is k + 1; linear_to_srgb(t) * 255 >= k + 0.5."""
    return _least_float32(srgb_to_linear((np.arange(255) + 0.5) / 255))


def _least_float32(value: Array) -> Array:
    near = value.astype(np.float32)
    return np.where(near.astype(np.float64) < value, np.nextafter(near, np.float32(np.inf)), near)


def _table() -> Array:
    bits = _thresholds().view(np.int32)
    low = np.arange(_FIRST, _LAST + 1, dtype=np.int64) << _LOW_BITS
    code = np.searchsorted(bits, low, "right")  # thresholds at or below the bucket's low end
    inside = np.searchsorted(bits, low + _MASK, "right") - code
    if inside.max() > 1:
        raise AssertionError("two thresholds in one bucket")
    carry = np.where(inside == 1, (1 << _LOW_BITS) - (bits[np.minimum(code, 254)] - low), 0)
    return ((code << _LOW_BITS) + carry).astype(np.int32)


SRGB_TABLE = _table()
LINEAR_LUT = srgb_to_linear(np.arange(256) / 255).astype(np.float32)


@inlined
def srgb_code(value: np.float32) -> np.int32:
    """The sRGB code 0..255 of linear light; below 0 and NaN give 0, above 1 gives 255."""
    value = min(_ONE, max(_DARK, value))  # in this order NaN gives the bound
    offset = np.int32(float_bits(value) - _BASE)
    bucket = np.uint32(np.uint32(offset) >> _UNSIGNED_SHIFT)  # seen to fit int32, so that looking it up takes half as long
    return np.int32(np.int32(SRGB_TABLE[bucket] + np.int32(offset & _MASK)) >> _SHIFT)


@inlined
def unit_code(value: np.float32) -> np.int32:
    """The nearest of 0..255 to 255 * value; below 0 and NaN give 0, above 1 gives 255."""
    value = min(_ONE, max(_ZERO, value))
    return np.int32(value * _FULL + _HALF)


@inlined
def pack(red: np.int32, green: np.int32, blue: np.int32, alpha: np.int32) -> np.uint32:
    """A pixel of four codes: the bytes R G B A in memory on a little-endian machine."""
    return np.uint32(np.int32(red | np.int32(green << _GREEN)) | np.int32(np.int32(blue << _BLUE) | np.int32(alpha << _ALPHA)))


@part
def encode(g: Array, n: int, exposure: np.float32, out: Array) -> None:
    """Write the first `n` fragments of a batch as pixels.

    Args:
        g: The batch; OR OG OB OA are read: linear radiance, not premultiplied, and alpha.
        n: Fragments.
        exposure: float32; multiplies the radiance.
        out: (>= n,) uint32; gets sRGB and straight alpha, the bytes R G B A in memory on a little-endian machine.
    """
    for i in range(n):
        red = srgb_code(g[OR + i] * exposure)
        green = srgb_code(g[OG + i] * exposure)
        blue = srgb_code(g[OB + i] * exposure)
        out[i] = pack(red, green, blue, unit_code(g[OA + i]))
