"""Anti-aliasing by frequency: a picture drawn at a higher rate loses, in its spectrum, what pixels cannot show, and is then decimated.

The second remedy of "Anti-aliasing of triangle rasterisation, and its parallelisation" (2021): remove the high frequencies, then sample. The
filter is given by what it does to frequencies, a Butterworth filter along each axis (what a square of pixels can show is a square of
frequencies), and applied as the sums that this comes to, because only every `rate`-th of them is wanted: a polyphase filter (Crochiere and
Rabiner, "Multirate Digital Signal Processing", 1983). Columns are summed first, whole rows at a time; then each row is dealt into
`rate` rows of every `rate`-th pixel, so that sums of neighbours are neighbours again. Every number of the fine picture is used where it lies, and
nothing of its size is made.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.filter.borders import border_map
from luxel.filter.filters import checked_picture, refuse_odd
from luxel.filter.sums import all_finite, block, staggered, sum_columns, sum_row, whole_blocks, worker_scratch
from luxel.filter.transfer import butterworth

CUTOFF, ORDER = 0.4, 4.0
"""The default Butterworth filter: cut-off in cycles per pixel, and order. See docs/decisions/0009-filters.md for how they were chosen."""

_LEFT_OUT = 1e-3  # of the largest weight, by the poles; in truth it is less than a tenth of that
_FARTHEST = 64  # pixels
_HIGHEST = 16.0  # cycles per pixel: the default filter lets 4e-7 through
_ROWS = 16  # of the result, made at once


def decimate(picture: object, rate: int, cutoff: float = CUTOFF, order: float = ORDER, threads: int | None = None) -> Array:
    """Low-pass a picture drawn at `rate` times the rate, and take every `rate`-th sample of it at the pixels' centres.

    Args:
        picture: (rate h, rate w, c) or (rate h, rate w) float16 to float64, linear light, premultiplied by alpha; mirrored at its border.
        rate: Samples a pixel along each axis, 1 or more.
        cutoff, order: Of the Butterworth filter along each axis, in cycles per pixel of the result.
        threads: None: all cores.

    Returns:
        (h, w, c) or (h, w), of the picture's dtype. Values stay between the least and the largest of each channel, which the filter would
        overshoot at sharp edges; so colours stay no larger than where alpha is 1, and alpha stays in 0..1.

    Raises:
        InputError: A size that is no multiple of the rate, integers, a cut-off or order that there is not, numbers that are not finite.
    """
    array, shape = checked_picture(picture)
    if not isinstance(rate, (int, np.integer)) or rate < 1:
        raise InputError(f"rate: expected a whole number of at least 1, got {rate!r}")
    if array.dtype.kind != "f":
        raise InputError(f"picture: expected linear light in floats, got {array.dtype}")
    height, width, channels = array.shape
    if height % rate or width % rate:
        raise InputError(f"picture: expected a size that is a multiple of {rate}, got {width} x {height}")
    source = np.ascontiguousarray(array, np.float64 if array.dtype == np.float64 else np.float32)
    out = np.empty((height // rate, width // rate, channels), source.dtype)
    if not _run(source, out, rate, weights(rate, cutoff, order), jit.checked_threads(threads)):
        refuse_odd(array)
    return out.astype(array.dtype, copy=False).reshape(out.shape if len(shape) == 3 else out.shape[:2])


def weights(rate: int, cutoff: float = CUTOFF, order: float = ORDER) -> Array:
    """((2 r + 1) rate,) float64: the filter's impulse response at the fine samples around a pixel's centre, r pixels to each side, summing to 1.

    It falls by exp(-2 pi cutoff sin(pi / (2 order))) a pixel, as the poles of the transfer function lie.
    """
    butterworth(0.0, 0.0, cutoff, order)  # it checks its arguments
    falls = 2 * math.pi * cutoff * math.sin(math.pi / (2 * max(order, 1.0)))
    reach = min(_FARTHEST, math.ceil(-math.log(_LEFT_OUT) / falls))
    count = (2 * reach + 1) * rate
    x = (np.arange(count) - (count - 1) / 2) / rate
    f = (np.arange(64 * math.ceil(_HIGHEST * reach)) + 0.5) / (64 * reach)  # 64 steps a ripple of the farthest weight, by midpoints
    passes = butterworth(f, 0.0, cutoff, order)
    taps = np.array([(passes * np.cos(2 * np.pi * f * place)).sum() for place in x])
    return taps / taps.sum()


def _run(source: Array, out: Array, rate: int, taps: Array, threads: int) -> bool:
    """Fill `out`; whether all of it is finite."""
    height, width, channels = source.shape
    dtype, columns = source.dtype, block(source.dtype)
    before = (len(taps) - rate) // 2
    y_map, x_map = border_map(height, before, before, "mirror"), border_map(width, before, before, "mirror")
    steps = 2 * (before // rate) + 1  # of each phase
    length = -(-len(x_map) * channels // rate // columns) * columns + 2 * columns  # of a phase's row
    k, phase = np.divmod(np.arange(len(taps)), rate)
    assert len(taps) == steps * rate
    threads = max(1, min(threads, -(-len(out) // _ROWS)))
    numbers = width * channels
    workers, own = worker_scratch(threads, (_ROWS + 2) * (numbers + columns) + rate * length + columns, dtype)
    odd = np.zeros(1, np.int64)
    ranges = np.empty((threads, 2, channels), dtype)
    ranges[:, 0], ranges[:, 1] = np.inf, -np.inf
    flat = source.reshape(-1)
    if numbers < columns:  # a block of sums is wider than the picture, and reads on
        flat = np.append(flat, np.zeros(columns, dtype))
    jit.run(_decimate, threads, workers, flat, out.reshape(-1), len(out), width, channels, rate, y_map * numbers, x_map,
            taps.astype(dtype), staggered(taps.astype(dtype), rate).reshape(-1), phase * length + k * channels, length, columns, own, ranges,
            *whole_blocks(out.shape[1] * channels, dtype), odd)  # fmt: skip
    if odd[0]:
        return False
    jit.run(_clamp, threads, out.reshape(len(out), -1), ranges[:, 0].min(0), ranges[:, 1].max(0))
    return True


@jit.part
def _range_of(low, high, row):
    """Take a row into the least and the largest of each place."""
    for i in range(len(row)):
        value = row[i]
        low[i] = value if value < low[i] else low[i]
        high[i] = value if value > high[i] else high[i]


@jit.part
def _deal(phases, length, row, at, x_map, channels, rate):
    """Every `rate`-th pixel of a row, mirrored beyond its ends, to a row of its own. Unsigned places are not looked at for being below 0."""
    for phase in range(rate):
        start = phase * length
        for k in range(len(x_map) // rate):
            pixel = at + x_map[k * rate + phase] * channels
            for channel in range(channels):
                phases[np.uint64(start + k * channels + channel)] = row[np.uint64(pixel + channel)]


@jit.parallel_kernel
def _decimate(queue, workers, source, out, height, width, channels, rate, places, x_map, weights, together, offsets, length, columns, scratch, ranges,
              all_offsets, zeros, odd):  # fmt: skip
    me = jit.take(workers)
    own = scratch[me]
    all_offsets, zeros, odd = jit.borrow(all_offsets), jit.borrow(zeros), jit.borrow(odd)
    numbers, pitch = width * channels, width * channels + columns
    sums, low = jit.borrow(own[: _ROWS * pitch]), jit.borrow(own[_ROWS * pitch : _ROWS * pitch + numbers])
    high = jit.borrow(own[(_ROWS + 1) * pitch : (_ROWS + 1) * pitch + numbers])
    phases = jit.borrow(own[(_ROWS + 2) * pitch : len(own) - columns])
    spare = jit.borrow(own[len(own) - columns :])
    source, out, places, x_map = jit.borrow(source), jit.borrow(out), jit.borrow(places), jit.borrow(x_map)
    weights, together, offsets = jit.borrow(weights), jit.borrow(together), jit.borrow(offsets)
    for i in range(numbers):
        low[i], high[i] = np.inf, -np.inf
    across, before = width // rate * channels, (len(weights) - rate) // 2
    first = jit.take(queue) * _ROWS
    while first < height:
        here = min(_ROWS, height - first)
        for y in range(before + first * rate, before + (first + here) * rate):
            _range_of(low, high, source[places[y] : places[y] + numbers])
        sum_columns(sums, 0, pitch, source, numbers, places, rate, first, here, weights, together, columns, spare)
        for y in range(here):
            _deal(phases, length, sums, y * pitch, x_map, channels, rate)
            sum_row(out, (first + y) * across, across, phases, 0, offsets, weights, columns, spare)
            if not all_finite(out, (first + y) * across, across, all_offsets, zeros, spare):
                odd[0] = 1
        first = jit.take(queue) * _ROWS
    for i in range(numbers):
        channel = i % channels
        ranges[me, 0, channel] = min(ranges[me, 0, channel], low[i])
        ranges[me, 1, channel] = max(ranges[me, 1, channel], high[i])


@jit.parallel_kernel
def _clamp(queue, out, low, high):
    """Rows of channels side by side, to the range of each channel."""
    y = jit.take(queue)
    while y < len(out):
        for i in range(out.shape[1]):
            channel = i % len(low)
            out[y, i] = min(high[channel], max(low[channel], out[y, i]))
        y = jit.take(queue)
