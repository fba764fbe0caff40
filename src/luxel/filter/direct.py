"""Convolution with any kernel by the sum of all its weights that are not zero.

Bands of output rows are what threads take from the queue. Rows are summed where they lie, several of the result at once; the few pixels whose
neighbours lie beyond the left or right border are summed one by one, and rows that reach beyond the constant's border from a copy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.filter.sums import SCRATCH, all_finite, block, extend_row, staggered, sum_row, sum_rows, whole_blocks, worker_scratch
from luxel.filter.vectors import ROWS


class Taps(NamedTuple):
    """Rows and columns (n,) of a kernel's weights, and the weights (n,), or (n ROWS,) for ROWS rows of the result."""

    i: Array
    j: Array
    weights: Array

    @classmethod
    def of(cls, kernel: Array) -> Taps:
        """Those of (kh, kw) or (kh, kw, ROWS) that are not zero, but one at least."""
        used = np.any(kernel.reshape(*kernel.shape[:2], -1) != 0, axis=-1)
        used[0, 0] |= not used.any()
        i, j = np.nonzero(used)
        return cls(i, j, np.ascontiguousarray(kernel[i, j]).reshape(-1))


@jit.part
def _sum_edge(out, at, first, last, channels, source, numbers, y_map, y, x_map, taps, value):
    """The pixels first .. last - 1 of the row at `at`, tap by tap through the maps."""
    for x in range(first, last):
        for channel in range(channels):
            total = np.float64(0.0)
            for t in range(len(taps.weights)):
                column = x_map[x + taps.j[t]]
                sample = value if column < 0 else source[y_map[y + taps.i[t]] * numbers + column * channels + channel]
                total += np.float64(taps.weights[t]) * np.float64(sample)
            out[at + x * channels + channel] = total


@jit.part
def _load_lines(lines, source, y_map, first, count, length, numbers, before, width, channels, x_map, value):
    """Copy the rows y_map[first : first + count], extended on both sides."""
    for y in range(count):
        at, place = y * length + before * channels, y_map[first + y]
        if place < 0:
            for n in range(numbers):
                lines[at + n] = value
        else:
            for n in range(numbers):
                lines[at + n] = source[place * numbers + n]
        extend_row(lines, y * length, before, width, channels, x_map, value)


@jit.part
def _sum_in_place(out, source, width, channels, y_map, x_map, before, taps, together, value, first, here, columns, places):
    """At least ROWS rows; the last of them are made again where their number is no multiple."""
    numbers, inside = width * channels, width - len(x_map) + width
    for k in range(0, here, ROWS):
        y = first + min(k, here - ROWS)
        for t in range(len(places)):
            places[t] = y_map[y + together.i[t]] * numbers + together.j[t] * channels
        sum_rows(out, y * numbers + before * channels, numbers, inside * channels, source, 0, places, together.weights, columns)
        for row in range(y, y + ROWS):
            _sum_edge(out, row * numbers, 0, before, channels, source, numbers, y_map, row, x_map, taps, value)
            _sum_edge(out, row * numbers, before + inside, width, channels, source, numbers, y_map, row, x_map, taps, value)


@jit.parallel_kernel
def _direct(queue, workers, source, out, height, width, channels, y_map, y_taps, x_map, before, value, rows, columns, length, taps, together, offsets,
            scratch, all_offsets, zeros, odd):  # fmt: skip
    own = scratch[jit.take(workers)]
    all_offsets, zeros, odd, offsets = jit.borrow(all_offsets), jit.borrow(zeros), jit.borrow(odd), jit.borrow(offsets)
    lines, spare = jit.borrow(own[: len(own) - columns]), jit.borrow(own[len(own) - columns :])
    places_owner = np.empty(len(together.i), np.int64)
    places = jit.borrow(places_owner)
    source, out, y_map, x_map = jit.borrow(source), jit.borrow(out), jit.borrow(y_map), jit.borrow(x_map)
    taps, together = jit.borrow(taps), jit.borrow(together)
    numbers, inside = width * channels, width - len(x_map) + width
    first = jit.take(queue) * rows
    while first < height:
        here = min(rows, height - first)
        if here >= ROWS and inside * channels >= columns and y_map[first] >= 0 and y_map[first + here + y_taps - 2] >= 0:
            _sum_in_place(out, source, width, channels, y_map, x_map, before, taps, together, value, first, here, columns, places)
        else:
            _load_lines(lines, source, y_map, first, here + y_taps - 1, length, numbers, before, width, channels, x_map, value)
            for y in range(here):
                sum_row(out, (first + y) * numbers, numbers, lines, y * length, offsets, taps.weights, columns, spare)
        for y in range(first, first + here):
            if not all_finite(out, y * numbers, numbers, all_offsets, zeros, spare):
                odd[0] = 1
        first = jit.take(queue) * rows
    places_owner[0] = 0  # it must live until here: borrowing does not keep it


def direct(image: Array, out: Array, y_map: Array, x_map: Array, before: int, weights: Array, value: float, threads: int) -> bool:
    """Weigh pixels: out[y, x] = sum of weights[i, j] extended[y + i, x + j]. Arguments as of `separable`; `weights` is (kh, kw)."""
    height, width, channels = image.shape
    dtype, columns = image.dtype, block(image.dtype)
    tall = len(weights)
    length = -(-(len(x_map) * channels + 2 * columns) // columns) * columns
    rows = int(np.clip(SCRATCH // (length * dtype.itemsize) - tall + 1, 8, 64))
    rows = max(1, min(rows, -(-height // threads)))
    threads = max(1, min(threads, -(-height // rows)))
    odd = np.zeros(1, np.int64)
    taps, together = Taps.of(weights), Taps.of(staggered(weights))
    workers, scratch = worker_scratch(threads, (rows + tall - 1) * length + 2 * columns, dtype)
    jit.run(_direct, threads, workers, image.reshape(-1), out.reshape(-1), height, width, channels, y_map, tall, x_map, before, dtype.type(value),
            rows, columns, length, taps, together, taps.i * length + taps.j * channels, scratch, *whole_blocks(width * channels, dtype),
            odd)  # fmt: skip
    return not odd[0]
