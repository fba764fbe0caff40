"""FFT of square tiles, for convolution: in place, planar, all columns side by side in vectors, without putting the result in order.

From "Anti-aliasing of triangle rasterisation, and its parallelisation" (2021), its section on SIMD: one-dimensional transforms of one
direction, a square transpose in place, and those of the other; planar storage, which it names as the cure for what held its SIMD back; two real
channels in one complex transform. What differs: the transforms run down the columns, so that vectors hold neighbours and need no
shuffles; the forward transform decimates in frequency and leaves its result in digit-reversed order, transposed, and the backward one
takes it from there (decimation in time), because a product of spectra does not mind the order; radix 4, and one step of radix 2 where the
size is no power of 4.

A tile is two flat arrays (real and imaginary part), stored strip by strip: the first 16 columns row by row (8 in float64: a cache line
each), then the next 16. So a column's transform works on one run of memory that the first cache holds, whatever the size. The last strip
is followed by nothing, each other by one spare line, lest the strips' rows fall on the same cache set.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.filter.vectors import LINE, SQUARE, backward2, backward4, forward2, forward4, transpose_pair

SIZES = (32, 64, 128, 256, 512, 1024, 2048)


def lanes(dtype: object) -> int:
    """Columns of a strip."""
    return LINE // np.dtype(dtype).itemsize  # type: ignore[call-overload]


def elements(size: int, dtype: object) -> int:
    """Numbers in each part of a tile, spare lines included."""
    return (size // lanes(dtype)) * (size + 1) * lanes(dtype)


@cache
def twiddles(size: int, dtype: object) -> Array:
    """The factors of all steps, in the order of the forward transform: exp(-2 pi i j k / span) for k = 1 .. radix - 1 at each j."""
    pieces = []
    span = size
    while span > 1:
        radix = 2 if span == size and (size.bit_length() - 1) % 2 else 4
        j, k = np.meshgrid(np.arange(span // radix), np.arange(1, radix), indexing="ij")
        angle = -2 * np.pi * ((j * k) % span) / span
        pieces.append(np.stack([np.cos(angle), np.sin(angle)], -1).reshape(-1))
        span //= radix
    table = np.concatenate(pieces).astype(dtype)  # type: ignore[call-overload]
    table.setflags(write=False)
    return table


@jit.inlined
def _odd(size):
    """1 where the size, a power of 2, is no power of 4."""
    bits = 0
    while 1 << bits < size:
        bits += 1
    return bits & 1


@jit.part
def _forward_columns(re, im, size, row, factors):
    for strip in range(0, (size // row) * (size + 1) * row, (size + 1) * row):
        place, span = 0, size
        if _odd(size):
            place, span = size, size >> 1
            for j in range(span):
                forward2(re, im, strip + j * row, span * row, factors, 2 * j)
        while span > 1:
            quarter = span >> 2
            for block in range(0, size, span):
                for j in range(quarter):
                    forward4(re, im, strip + (block + j) * row, quarter * row, factors, place + 6 * j)
            place += 6 * quarter
            span = quarter


@jit.part
def _backward_columns(re, im, size, row, factors):
    for strip in range(0, (size // row) * (size + 1) * row, (size + 1) * row):
        place, span = len(factors), 4
        while span <= size:
            quarter = span >> 2
            place -= 6 * quarter
            for block in range(0, size, span):
                for j in range(quarter):
                    backward4(re, im, strip + (block + j) * row, quarter * row, factors, place + 6 * j)
            span <<= 2
        if place > 0:
            half = size >> 1
            for j in range(half):
                backward2(re, im, strip + j * row, half * row, factors, 2 * j)


@jit.part
def transpose(array, size, row):
    """Transpose a square tile in place."""
    strip = (size + 1) * row
    for y in range(0, size, SQUARE):
        for x in range(0, y + 1, SQUARE):
            transpose_pair(array, (x // row) * strip + y * row + x % row, (y // row) * strip + x * row + y % row, row)


@jit.part
def forward(re, im, size, row, factors):
    """The two-dimensional transform, in an order of its own."""
    _forward_columns(re, im, size, row, factors)
    transpose(re, size, row)
    transpose(im, size, row)
    _forward_columns(re, im, size, row, factors)


@jit.part
def backward(re, im, size, row, factors):
    """The inverse of `forward`, times size^2."""
    _backward_columns(re, im, size, row, factors)
    transpose(re, size, row)
    transpose(im, size, row)
    _backward_columns(re, im, size, row, factors)
