"""Convolution by sums: of the two passes of a separable kernel, or of all weights of any kernel that are not zero.

Bands of output rows are independent, so they are what threads take from the queue; within one, everything stays in the second cache. Rows
are summed as they lie, colours side by side: a tap one pixel further is `channels` numbers further.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.filter.vectors import LINE, SUMS, weighted_sums

_STRIP = 8  # blocks of sums loaded side by side in the first pass
_SHORT = 33  # taps of a column that are summed where the rows lie
_CHUNKS = 6  # pieces of work for each thread
_NARROW = 4  # blocks of sums whose columns are summed together
_SCRATCH = 1 << 20  # bytes of a band's rows that should stay in the second cache; a quarter where columns are short


def block(dtype: object) -> int:
    """How many sums `weighted_sums` makes."""
    return SUMS * LINE // np.dtype(dtype).itemsize  # type: ignore[call-overload]


def aligned(shape: tuple[int, ...], dtype: object) -> Array:
    """An uninitialised array that begins on a cache line."""
    size = int(np.prod(shape))
    raw = np.empty(size * np.dtype(dtype).itemsize + LINE, np.uint8)  # type: ignore[call-overload]
    skip = -raw.ctypes.data % LINE
    return raw[skip : skip + size * np.dtype(dtype).itemsize].view(dtype).reshape(shape)  # type: ignore[call-overload]


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
def _extend_row(row, at, before, pixels, channels, x_map, value):
    """Fill what a row of `pixels` at `at + before * channels` lacks on both sides."""
    for p in range(len(x_map)):
        if before <= p < before + pixels:
            continue
        for channel in range(channels):
            row[at + p * channels + channel] = value if x_map[p] < 0 else row[at + (before + x_map[p]) * channels + channel]


@jit.part
def _columns_in_place(sums, length, at, source, numbers, places, first, here, weights, columns, spare):
    """The first pass over `here` rows from the row `first` on, where the rows lie: a few columns of all of them at a time."""
    wide = min(_NARROW * columns, numbers)
    for left in range(0, numbers, wide):
        x = min(left, numbers - wide)
        for y in range(here):
            rows = places[first + y : first + y + len(weights)]
            sum_row(sums, y * length + at + x, wide, source, x, rows, weights, columns, spare)


@jit.part
def _columns_in_strips(sums, length, at, blocks, source, numbers, y_map, first, here, weights, offsets, value, columns):
    """The same by way of strips of blocks: for many taps, whose rows are far apart in memory, and for rows that are the constant."""
    loaded = here + len(weights) - 1
    for x in range(0, numbers, _STRIP * columns):
        count = min(_STRIP * columns, numbers - x)
        _load_strip(blocks, source, y_map, first, loaded, x, count, numbers, value, columns)
        for k in range(0, count, columns):
            for y in range(here):
                weighted_sums(sums, y * length + at + x + k, blocks, k * loaded + y * columns, offsets, weights)


@jit.parallel_kernel
def _separable(queue, workers, source, out, height, width, channels, y_map, y_weights, x_map, before, x_weights, value, beside, chunk, rows,
               columns, length, short, y_places, y_offsets, x_offsets, scratch, all_offsets, zeros, odd):  # fmt: skip
    own = scratch[jit.take(workers)]
    all_offsets, zeros, odd = jit.borrow(all_offsets), jit.borrow(zeros), jit.borrow(odd)
    sums, blocks, spare = jit.borrow(own[: rows * length]), jit.borrow(own[rows * length : len(own) - columns]), jit.borrow(own[len(own) - columns :])
    source, out, y_map, x_map = jit.borrow(source), jit.borrow(out), jit.borrow(y_map), jit.borrow(x_map)
    y_weights, x_weights, y_offsets, x_offsets = jit.borrow(y_weights), jit.borrow(x_weights), jit.borrow(y_offsets), jit.borrow(x_offsets)
    y_places = jit.borrow(y_places)
    numbers = width * channels
    start = jit.take(queue) * chunk
    while start < height:
        end = min(start + chunk, height)
        for first in range(start, end, rows):
            here = min(rows, end - first)
            if short and numbers >= columns and y_map[first] >= 0 and y_map[first + here + len(y_weights) - 2] >= 0:
                _columns_in_place(sums, length, before * channels, source, numbers, y_places, first, here, y_weights, columns, spare)
            else:
                _columns_in_strips(sums, length, before * channels, blocks, source, numbers, y_map, first, here, y_weights, y_offsets, value, columns)
            for y in range(here):
                _extend_row(sums, y * length, before, width, channels, x_map, beside)
                sum_row(out, (first + y) * numbers, numbers, sums, y * length, x_offsets, x_weights, columns, spare)
                if not all_finite(out, (first + y) * numbers, numbers, all_offsets, zeros, spare):
                    odd[0] = 1
        start = jit.take(queue) * chunk


@jit.part
def _sum_edge(out, at, first, last, channels, source, numbers, y_map, y, x_map, i, j, weights, value):
    """The pixels first .. last - 1 of the row at `at`, tap by tap through the maps."""
    for x in range(first, last):
        for channel in range(channels):
            total = np.float64(0.0)
            for t in range(len(weights)):
                column = x_map[x + j[t]]
                sample = value if column < 0 else source[y_map[y + i[t]] * numbers + column * channels + channel]
                total += np.float64(weights[t]) * np.float64(sample)
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
        _extend_row(lines, y * length, before, width, channels, x_map, value)


@jit.parallel_kernel
def _direct(queue, workers, source, out, height, width, channels, y_map, y_taps, x_map, before, value, rows, columns, length, i, j, offsets, weights,
            scratch, all_offsets, zeros, odd):  # fmt: skip
    own = scratch[jit.take(workers)]
    all_offsets, zeros, odd = jit.borrow(all_offsets), jit.borrow(zeros), jit.borrow(odd)
    lines, spare = jit.borrow(own[: len(own) - columns]), jit.borrow(own[len(own) - columns :])
    places_owner = np.empty(len(weights), np.int64)
    places = jit.borrow(places_owner)
    source, out, y_map, x_map = jit.borrow(source), jit.borrow(out), jit.borrow(y_map), jit.borrow(x_map)
    i, j, offsets, weights = jit.borrow(i), jit.borrow(j), jit.borrow(offsets), jit.borrow(weights)
    numbers, inside = width * channels, width - len(x_map) + width
    first = jit.take(queue) * rows
    while first < height:
        here = min(rows, height - first)
        if inside * channels >= columns and y_map[first] >= 0 and y_map[first + here + y_taps - 2] >= 0:
            for y in range(first, first + here):
                at = y * numbers
                for t in range(len(weights)):
                    places[t] = y_map[y + i[t]] * numbers + j[t] * channels
                _sum_edge(out, at, 0, before, channels, source, numbers, y_map, y, x_map, i, j, weights, value)
                sum_row(out, at + before * channels, inside * channels, source, 0, places, weights, columns, spare)
                _sum_edge(out, at, before + inside, width, channels, source, numbers, y_map, y, x_map, i, j, weights, value)
        else:
            _load_lines(lines, source, y_map, first, here + y_taps - 1, length, numbers, before, width, channels, x_map, value)
            for y in range(here):
                sum_row(out, (first + y) * numbers, numbers, lines, y * length, offsets, weights, columns, spare)
        for y in range(first, first + here):
            if not all_finite(out, y * numbers, numbers, all_offsets, zeros, spare):
                odd[0] = 1
        first = jit.take(queue) * rows
    places_owner[0] = 0  # it must live until here: borrowing does not keep it


def worker_scratch(threads: int, numbers: int, dtype: object) -> tuple[Array, Array]:
    """A counter of workers, and for each some numbers of its own (a whole number of cache lines)."""
    lane = LINE // np.dtype(dtype).itemsize  # type: ignore[call-overload]
    scratch = aligned((threads, -(-numbers // lane) * lane), dtype)
    scratch[:] = 0  # the last block of a row takes in what lies behind it, and what it makes of that is not kept
    return np.zeros(1, np.int64), scratch


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
    rows = int(np.clip((_SCRATCH >> 2 * short) // (length * dtype.itemsize), 8, 64))
    rows = max(1, min(rows, -(-height // threads)))
    chunk = rows * max(1, height // (rows * threads * _CHUNKS))  # neighbouring bands share rows: they go to one thread
    threads = max(1, min(threads, -(-height // chunk)))
    workers, scratch = worker_scratch(threads, rows * length + (rows + len(y_weights)) * _STRIP * columns + columns, dtype)
    odd = np.zeros(1, np.int64)
    beside = value * float(y_weights.sum())
    y_offsets, x_offsets = columns * np.arange(len(y_weights)), channels * np.arange(len(x_weights))
    jit.run(_separable, threads, workers, image.reshape(-1), out.reshape(-1), height, width, channels, y_map, y_weights, x_map, before, x_weights,
            dtype.type(value), dtype.type(beside), chunk, rows, columns, length, short, y_map * (width * channels), y_offsets, x_offsets, scratch,
            *whole_blocks(width * channels, dtype), odd)  # fmt: skip
    return not odd[0]


def direct(image: Array, out: Array, y_map: Array, x_map: Array, before: int, weights: Array, value: float, threads: int) -> bool:
    """Weigh pixels: out[y, x] = sum of weights[i, j] extended[y + i, x + j]. Arguments as of `separable`; `weights` is (kh, kw)."""
    height, width, channels = image.shape
    dtype, columns = image.dtype, block(image.dtype)
    taps = len(weights)
    length = -(-(len(x_map) * channels + 2 * columns) // columns) * columns
    rows = int(np.clip(_SCRATCH // (length * dtype.itemsize) - taps + 1, 8, 64))
    rows = max(1, min(rows, -(-height // threads)))
    threads = max(1, min(threads, -(-height // rows)))
    odd = np.zeros(1, np.int64)
    i, j = np.nonzero(weights)
    if not len(i):
        i, j = np.zeros(1, np.int64), np.zeros(1, np.int64)
    workers, scratch = worker_scratch(threads, (rows + taps - 1) * length + 2 * columns, dtype)
    jit.run(_direct, threads, workers, image.reshape(-1), out.reshape(-1), height, width, channels, y_map, taps, x_map, before, dtype.type(value),
            rows, columns, length, i, j, i * length + j * channels, np.ascontiguousarray(weights[i, j]), scratch,
            *whole_blocks(width * channels, dtype), odd)  # fmt: skip
    return not odd[0]
