"""From pictures as they are stored to what may be filtered, and back: linear light, colours multiplied by their alpha.

8 and 16 bit pictures are sRGB-encoded with straight alpha (channels 2: grey and alpha, 4: RGB and alpha). An average of encoded values is too
dark, and an average of straight colours takes in the colour of what is transparent.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.encode import linear_to_srgb, srgb_code, srgb_to_linear

_CHUNK = 1 << 14  # pixels
_F = np.float32


@cache
def _levels(dtype: object, encoded: bool) -> Array:
    """What each code stands for, float32."""
    top = np.iinfo(np.dtype(dtype)).max  # type: ignore[call-overload]
    codes = np.arange(top + 1) / top
    table = (srgb_to_linear(codes) if encoded else codes).astype(_F)
    table.setflags(write=False)
    return table


@cache
def _codes16() -> Array:
    """(65537,) float32: codes 0..65535 of sRGB at the squares of evenly spaced roots of light, between which a line is true to 0.01 codes."""
    table = (65535 * linear_to_srgb(np.linspace(0, 1, 65537) ** 2)).astype(_F)
    table.setflags(write=False)
    return table


@jit.parallel_kernel
def _decode(queue, source, out, colors, alphas, channels, alpha):
    pixels = len(source) // channels
    first = jit.take(queue) * _CHUNK
    while first < pixels:
        last = min(pixels, first + _CHUNK)
        if alpha:
            for pixel in range(first, last):
                at = pixel * channels + channels - 1
                a = alphas[source[at]]
                out[at] = a
                for i in range(pixel * channels, at):
                    out[i] = colors[source[i]] * a
        else:
            for i in range(first * channels, last * channels):
                out[i] = colors[source[i]]
        first = jit.take(queue) * _CHUNK


@jit.inlined
def _code(value, top, encoded, table):
    """The nearest code of a value; those outside 0..1 are clamped."""
    value = min(_F(1.0), max(_F(0.0), value))
    if not encoded:
        return np.int64(value * top + _F(0.5))
    if top < _F(256.0):
        return np.int64(srgb_code(value))
    place = np.sqrt(value) * _F(65536.0)
    k = min(np.int64(place), 65535)
    return np.int64(table[k] + (table[k + 1] - table[k]) * (place - _F(k)) + _F(0.5))


@jit.parallel_kernel
def _encode(queue, source, out, top, channels, alpha, encoded, table):
    pixels = len(source) // channels
    first = jit.take(queue) * _CHUNK
    while first < pixels:
        for pixel in range(first, min(pixels, first + _CHUNK)):
            at, end, scale = pixel * channels, (pixel + 1) * channels - alpha, _F(1.0)
            if alpha:
                a = min(_F(1.0), max(_F(0.0), source[end]))
                out[end] = np.int64(a * top + _F(0.5))
                scale = _F(1.0) / a if out[end] > 0 else _F(0.0)  # what cannot be seen has no colour, rather than that of rounding errors
            for i in range(at, end):
                out[i] = _code(source[i] * scale, top, encoded, table)
        first = jit.take(queue) * _CHUNK


def decode(image: Array, encoded: bool, threads: int) -> Array:
    """(h, w, c) uint8 or uint16 to float32: linear light times alpha where `encoded`, else codes over the largest one."""
    source = np.ascontiguousarray(image)
    out = np.empty(image.shape, _F)
    alpha = encoded and image.shape[2] in (2, 4)
    tables = _levels(image.dtype, encoded), _levels(image.dtype, False)
    jit.run(_decode, threads, source.reshape(-1), out.reshape(-1), *tables, image.shape[2], alpha)
    return out


def encode(light: Array, dtype: object, encoded: bool, threads: int) -> Array:
    """The inverse of `decode`, rounded to the nearest code and clamped."""
    kind = np.dtype(dtype)  # type: ignore[call-overload]
    out = np.empty(light.shape, kind)
    alpha = int(encoded and light.shape[2] in (2, 4))
    top = _F(np.iinfo(kind).max)
    jit.run(_encode, threads, light.reshape(-1), out.reshape(-1), top, light.shape[2], alpha, encoded, _codes16())
    return out
