"""Weighted sums of rows and of neighbours: what `separable`, `direct` and `antialias` are made of.

Rows are summed as they lie, colours side by side: a tap one pixel further is `channels` numbers further. What is summed down columns is made for
several rows at once, because neighbouring rows are made of the same numbers.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.filter.vectors import LINE, ROWS, SUMS, weighted_rows, weighted_sums

_NARROW = 4  # blocks of sums whose columns are summed together
SCRATCH = 1 << 20
"""Bytes of a band's rows that should stay in the second cache."""


def block(dtype: object) -> int:
    """How many sums `weighted_sums` makes."""
    return SUMS * LINE // np.dtype(dtype).itemsize  # type: ignore[call-overload]


def aligned(shape: tuple[int, ...], dtype: object) -> Array:
    """An uninitialised array that begins on a cache line."""
    size = int(np.prod(shape))
    raw = np.empty(size * np.dtype(dtype).itemsize + LINE, np.uint8)  # type: ignore[call-overload]
    skip = -raw.ctypes.data % LINE
    return raw[skip : skip + size * np.dtype(dtype).itemsize].view(dtype).reshape(shape)  # type: ignore[call-overload]


def staggered(weights: Array, step: int = 1) -> Array:
    """Weights (n, ...) for ROWS rows at once, each `step` places further than the one before: (n + (ROWS - 1) step, ..., ROWS)."""
    out = np.zeros((len(weights) + (ROWS - 1) * step, *weights.shape[1:], ROWS), weights.dtype)
    for row in range(ROWS):
        out[row * step : row * step + len(weights), ..., row] = weights
    return out


@jit.part
def all_finite(x, start, count, offsets, zeros, spare):
    """Whether `count` numbers are finite: times zero they sum to zero. `offsets` and `zeros` are from `whole_blocks` of as many."""
    odd = 0
    if len(offsets) == 0:
        for i in range(start, start + count):
            odd += x[i] * 0 != 0
    else:
        weighted_sums(spare, 0, x, start, offsets, zeros)
        for i in range(len(spare)):
            odd += spare[i] != 0
    return odd == 0


def whole_blocks(count: int, dtype: object) -> tuple[Array, Array]:
    """Offsets of blocks of sums that cover `count` numbers, the last overlapping the one before, and as many zeros; none where too few."""
    width = block(dtype)
    if count < width:
        return np.zeros(0, np.int64), np.zeros(0, dtype)  # type: ignore[call-overload]
    offsets = np.minimum(np.arange(0, count, width), count - width)
    return offsets, np.zeros(len(offsets), dtype)  # type: ignore[call-overload]


@jit.part
def sum_row(out, at, count, x, start, offsets, weights, width, spare):
    """`count` sums into out[at:], in blocks of `width`; the last block overlaps the one before, or, where there is none, goes through `spare`."""
    if count < width:
        weighted_sums(spare, 0, x, start, offsets, weights)
        for i in range(count):
            out[at + i] = spare[i]
        return
    i = 0
    while i < count:
        i = min(i, count - width)
        weighted_sums(out, at + i, x, start + i, offsets, weights)
        i += width


@jit.part
def sum_rows(out, at, apart, count, x, start, offsets, weights, width):
    """The same for ROWS rows, `apart` from each other in `out`; at least a block of sums in each."""
    i = 0
    while i < count:
        i = min(i, count - width)
        weighted_rows(out, at + i, apart, x, start + i, offsets, weights)
        i += width


@jit.part
def extend_row(row, at, before, pixels, channels, x_map, value):
    """Fill what a row of `pixels` at `at + before * channels` lacks on both sides."""
    for p in range(len(x_map)):
        if before <= p < before + pixels:
            continue
        for channel in range(channels):
            row[at + p * channels + channel] = value if x_map[p] < 0 else row[at + (before + x_map[p]) * channels + channel]


@jit.part
def sum_columns(sums, at, length, source, numbers, places, step, first, here, weights, together, columns, spare):
    """The first pass over `here` rows from the row `first` on, where the rows lie: a few columns of all of them at a time. Row y is the sum of
    those at places[y * step], places[y * step + 1], ..., and goes to sums[at + (y - first) * length]."""
    wide, taps = min(_NARROW * columns, numbers), len(together) // ROWS
    for left in range(0, numbers, wide):
        x, y = min(left, numbers - wide), 0
        while y < here:
            start, to = (first + y) * step, at + y * length + x
            if y + ROWS <= here and wide >= columns:
                sum_rows(sums, to, length, wide, source, x, places[start : start + taps], together, columns)
                y += ROWS
            else:
                sum_row(sums, to, wide, source, x, places[start : start + len(weights)], weights, columns, spare)
                y += 1


def worker_scratch(threads: int, numbers: int, dtype: object) -> tuple[Array, Array]:
    """A counter of workers, and for each some numbers of its own (a whole number of cache lines)."""
    lane = LINE // np.dtype(dtype).itemsize  # type: ignore[call-overload]
    scratch = aligned((threads, -(-numbers // lane) * lane), dtype)
    scratch[:] = 0  # the last block of a row takes in what lies behind it, and what it makes of that is not kept
    return np.zeros(1, np.int64), scratch
