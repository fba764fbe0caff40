"""Convolution with the product of a column and a row: columns first, then rows.

Bands of output rows are independent, so they are what threads take from the queue; within one, everything stays in the second cache.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.filter.sums import SCRATCH, all_finite, block, extend_row, staggered, sum_columns, sum_row, whole_blocks, worker_scratch
from luxel.filter.vectors import ROWS, weighted_rows, weighted_sums

_STRIP = 8  # blocks of sums loaded side by side
_SHORT = 33  # taps of a column that are summed where the rows lie
_CHUNKS = 6  # pieces of work for each thread


@jit.part
def _load_strip(blocks, source, y_map, first, rows, x, count, length, value, width):
    """Copy `count` numbers from column `x` of the rows y_map[first : first + rows] into blocks of `width` columns, row below row."""
    for y in range(rows):
        place = y_map[first + y]
        for k in range(0, count, width):
            at, some = (k * rows) + y * width, min(width, count - k)
            if place < 0:
                for i in range(some):
                    blocks[at + i] = value
            else:
                start = place * length + x + k
                for i in range(some):
                    blocks[at + i] = source[start + i]


@jit.part
def _columns_in_strips(sums, length, at, blocks, source, numbers, y_map, first, here, weights, offsets, together, value, columns):
    """`sum_columns` by way of strips of blocks: for many taps, whose rows are far apart in memory, and for rows that are the constant."""
    loaded = here + len(weights) - 1
    for x in range(0, numbers, _STRIP * columns):
        count = min(_STRIP * columns, numbers - x)
        _load_strip(blocks, source, y_map, first, loaded, x, count, numbers, value, columns)
        for k in range(0, count, columns):
            y = 0
            while y < here:
                to, start = y * length + at + x + k, k * loaded + y * columns
                if y + ROWS <= here:
                    weighted_rows(sums, to, length, blocks, start, offsets, together)
                    y += ROWS
                else:
                    weighted_sums(sums, to, blocks, start, offsets[: len(weights)], weights)
                    y += 1


@jit.parallel_kernel
def _separable(queue, workers, source, out, height, width, channels, y_map, y_weights, y_together, x_map, before, x_weights, value, beside, chunk,
               rows, columns, length, short, y_places, y_offsets, x_offsets, scratch, all_offsets, zeros, odd):  # fmt: skip
    own = scratch[jit.take(workers)]
    all_offsets, zeros, odd = jit.borrow(all_offsets), jit.borrow(zeros), jit.borrow(odd)
    sums, blocks, spare = jit.borrow(own[: rows * length]), jit.borrow(own[rows * length : len(own) - columns]), jit.borrow(own[len(own) - columns :])
    source, out, y_map, x_map = jit.borrow(source), jit.borrow(out), jit.borrow(y_map), jit.borrow(x_map)
    y_weights, x_weights, y_offsets, x_offsets = jit.borrow(y_weights), jit.borrow(x_weights), jit.borrow(y_offsets), jit.borrow(x_offsets)
    y_places, y_together = jit.borrow(y_places), jit.borrow(y_together)
    numbers = width * channels
    start = jit.take(queue) * chunk
    while start < height:
        end = min(start + chunk, height)
        for first in range(start, end, rows):
            here = min(rows, end - first)
            if short and numbers >= columns and y_map[first] >= 0 and y_map[first + here + len(y_weights) - 2] >= 0:
                sum_columns(sums, before * channels, length, source, numbers, y_places, 1, first, here, y_weights, y_together, columns, spare)
            else:
                _columns_in_strips(sums, length, before * channels, blocks, source, numbers, y_map, first, here, y_weights, y_offsets, y_together,
                                   value, columns)  # fmt: skip
            for y in range(here):
                extend_row(sums, y * length, before, width, channels, x_map, beside)
                sum_row(out, (first + y) * numbers, numbers, sums, y * length, x_offsets, x_weights, columns, spare)
                if not all_finite(out, (first + y) * numbers, numbers, all_offsets, zeros, spare):
                    odd[0] = 1
        start = jit.take(queue) * chunk


def separable(image: Array, out: Array, y_map: Array, y_weights: Array, x_map: Array, before: int, x_weights: Array, value: float,
              threads: int) -> bool:  # fmt: skip
    """Weigh columns by `y_weights` and rows by `x_weights`: out[y, x] = sum of y_weights[i] x_weights[j] extended[y + i, x + j].

    Args:
        image, out: (h, w, c), of one dtype, float32 or float64.
        y_map, x_map: From `border_map`: h + len(y_weights) - 1 and w + len(x_weights) - 1 places.
        before: How many of the places of `x_map` lie left of the picture.
        value: What stands where the maps say -1.
        threads: At most so many.

    Returns:
        Whether all that came out is finite.
    """
    height, width, channels = image.shape
    dtype, columns = image.dtype, block(image.dtype)
    length = -(-(len(x_map) * channels + 2 * columns) // columns) * columns
    short = len(y_weights) <= _SHORT
    rows = int(np.clip((SCRATCH >> 2 * short) // (length * dtype.itemsize), 8, 64))
    rows = max(1, min(rows, -(-height // threads)))
    chunk = rows * max(1, height // (rows * threads * _CHUNKS))  # neighbouring bands share rows: they go to one thread
    threads = max(1, min(threads, -(-height // chunk)))
    workers, scratch = worker_scratch(threads, rows * length + (rows + len(y_weights)) * _STRIP * columns + columns, dtype)
    odd = np.zeros(1, np.int64)
    beside = value * float(y_weights.sum())
    y_offsets, x_offsets = columns * np.arange(len(y_weights) + ROWS - 1), channels * np.arange(len(x_weights))
    jit.run(_separable, threads, workers, image.reshape(-1), out.reshape(-1), height, width, channels, y_map, y_weights,
            staggered(y_weights).reshape(-1), x_map, before, x_weights, dtype.type(value), dtype.type(beside), chunk, rows, columns, length, short,
            y_map * (width * channels), y_offsets, x_offsets, scratch, *whole_blocks(width * channels, dtype), odd)  # fmt: skip
    return not odd[0]
