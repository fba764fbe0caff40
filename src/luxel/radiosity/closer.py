"""Closer: for the last bounce elements look once more where one look around is not enough.

Each ray of the look around (`gather`) stands for a cell of the hemisphere. Something small and bright (a window's frame in the sun, the wall beside a
lamp) is met by some rays of some elements and missed by others, which shows as stripes. Where the light of a cell and of those about it, as
neighbouring elements see it, is so unlike that it matters, four rays go through the cell in place of one. All neighbours look closer at the same
cells, and at those about what is bright too: an element that looked only where it has seen much would find less there, on the average, and have too
little.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity import packet
from luxel.radiosity.directions import on_hemisphere
from luxel.radiosity.element import FREE, free_sample
from luxel.radiosity.gather import LOST, View, met_by, padded, sample_of, start_ray
from luxel.radiosity.packet import WIDTH
from luxel.radiosity.sky import TOGETHER, cells

_F = np.float32
_SIDE = 2  # parts along a side of a cell
_PARTS = _SIDE * _SIDE
_AT_ONCE = 1 << 14  # elements; a few seconds where all look closer and see nothing alike: who interrupts waits so long
_FEW = _F(1 / 16)  # of the cells: who sees by fewer, behind a skirting board, say, is dark, and not as bright as what a stray ray meets


@jit.part
def find_unlike(hits, light, cell, first, last, unlike, least, most, again):
    """again[a, b]: whether neighbouring elements have to look closer at each cell. `least` and `most` (wide, high) float32 are scratch."""
    wide, high = again.shape
    total = _F(0.0)
    for k in range(len(cell)):
        low, up = _F(np.inf), _F(0.0)
        for i in range(first, last):
            if hits[i, k] != LOST:
                e = np.uint64(hits[i, k] + 3)
                seen = light[e, 0] + light[e, 1] + light[e, 2]
                total += seen
                low, up = min(low, seen), max(up, seen)
        least[cell[k, 0], cell[k, 1]], most[cell[k, 0], cell[k, 1]] = low, up
    limit = unlike * total / _F(len(cell) * (last - first))
    for a in range(wide):
        for b in range(high):
            low, up = _F(np.inf), _F(0.0)
            for r in range(max(a - 1, 0), min(a + 2, wide)):
                for s in range(max(b - 1, 0), min(b + 2, high)):
                    low, up = min(low, least[r, s]), max(up, most[r, s])
            again[a, b] = up - low > limit


@jit.part
def look_closer(first, last, hits, cell, again, scene, numbers, frames, reach, lookup, light, local, sums, c, stack, result):
    """result[:, i]: the mean light (red, green, blue) W/m2 over all cells, of neighbouring elements first .. last - 1, at most a packet.

    `local` (3,) and `sums` (WIDTH, 8) float32 are scratch: cells seen by one ray (red, green, blue, rays that tell) are summed apart from what closer
    rays bring.
    """
    wide, high = again.shape
    count, parts = last - first, 0
    for r in range(count):
        for channel in range(8):
            sums[r, channel] = _F(0.0)
    for k in range(len(cell)):
        a, b = cell[k, 0], cell[k, 1]
        if again[a, b]:
            for part in range(_PARTS):
                local[0], local[1], local[2] = on_hemisphere(
                    (a + (part % _SIDE + 0.5) / _SIDE) / wide, (b + (part // _SIDE + 0.5) / _SIDE) / high
                )
                for r in range(np.uint64(WIDTH)):
                    i = first + min(np.int64(r), count - 1)  # the last packet is filled up with its last element's rays
                    start_ray(numbers, frames[i], local, i, free_sample(np.int64(numbers[FREE, i]), sample_of(parts)), reach, r, c)
                packet.meet_all(scene, c, stack)
                for r in range(np.uint64(count)):
                    _add(sums, r, 4, met_by(r, first + np.int64(r), scene, numbers, lookup, c), light)
                parts += 1
        else:
            for r in range(np.uint64(count)):
                _add(sums, r, 0, hits[first + np.int64(r), k], light)
    one, least = _F(1.0 / _PARTS), _FEW * _F(len(cell))  # of a cell: so much does one of its rays count beside a cell that is not looked at closer
    for r in range(count):
        share = _F(1.0) / max(sums[r, 3] + sums[r, 7] * one, least)
        for channel in range(3):
            result[channel, first + r] = (sums[r, channel] + sums[r, 4 + channel] * one) * share


@jit.inlined
def _add(sums, r, column, e, light):
    """Add what a ray brings that has met `e` to sums[r, column .. column + 3]."""
    if e != LOST:
        k = np.uint64(e + 3)
        sums[r, column] += light[k, 0]
        sums[r, column + 1] += light[k, 1]
        sums[r, column + 2] += light[k, 2]
        sums[r, column + 3] += _F(1.0)


@jit.parallel_kernel
def _look_closer(queue, scene, numbers, frames, reach, lookup, hits, light, cell, wide, high, unlike, begin, end, result):
    own_c, own_stack, own_local = np.zeros(packet.SCRATCH, np.float32), np.zeros(packet.STACK, np.int32), np.zeros(3, np.float32)
    own_least, own_most, own_again = np.zeros((wide, high), np.float32), np.zeros((wide, high), np.float32), np.zeros((wide, high), np.bool_)
    own_sums = np.zeros((WIDTH, 8), np.float32)
    c, stack, local, least, most = jit.borrow(own_c), jit.borrow(own_stack), jit.borrow(own_local), jit.borrow(own_least), jit.borrow(own_most)
    again, scene, numbers, frames, lookup = jit.borrow(own_again), jit.borrow(scene), jit.borrow(numbers), jit.borrow(frames), jit.borrow(lookup)
    hits, light, cell, result, sums = jit.borrow(hits), jit.borrow(light), jit.borrow(cell), jit.borrow(result), jit.borrow(own_sums)
    chunk = jit.take(queue)
    while begin + chunk * TOGETHER < end:
        first = begin + chunk * TOGETHER
        last = min(end, first + TOGETHER)
        find_unlike(hits, light, cell, first, last, unlike, least, most, again)
        look_closer(first, last, hits, cell, again, scene, numbers, frames, reach, lookup, light, local, sums, c, stack, result)
        chunk = jit.take(queue)
    own_c[0] = own_stack[0] + own_local[0] + own_least[0, 0] + own_most[0, 0] + own_again[0, 0] + own_sums[0, 0]  # they live until here


def gather_closer(view: View, hits: Array, light: Array, unlike: float, threads: int, told: Callable[[float], None]) -> Array:
    """(3, k) float32 W/m2: the irradiance of the k elements of `view` by other surfaces.

    Args:
        hits: (k, rays) int32: what they have met; rays a power of two.
        light: (n, 3) float32 radiosity of all elements, W/m2.
        unlike: They look closer at cells whose light and that of cells about them differ by more than so many times the mean light of all.
        told: Hears which share of the elements has looked.
    """
    cell, wide, high = cells(hits.shape[1])
    result = np.empty((3, len(hits)), np.float32)
    frames, what = view.frames(), padded(light)
    for begin in range(0, len(hits), _AT_ONCE):
        end = min(len(hits), begin + _AT_ONCE)
        jit.run(_look_closer, threads, view.scene, view.numbers, frames, np.float32(view.reach), view.lookup, hits, what, cell, wide, high,
                np.float32(unlike), begin, end, result)  # fmt: skip
        told(end / len(hits))
    return result
