"""Runs: what is visible in a tile, as runs of fragments of one triangle along a row of pixels.

A fragment is what a triangle covers of a pixel, however many samples (or what it covers of one sample, when supersampling). It lies at the
pixel's centre if the triangle has all its samples, else at the mean of those it has, which is inside the triangle. A triangle is set up
once for all its runs in a tile, wherever they end: `Runs.setup` says where.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import count_bits, lowest_bit
from luxel.raster.channels import FRAGMENTS
from luxel.raster.lanes import LANES, prefetch
from luxel.raster.rows import WORD, same_of_four, same_samples, where_four_same, where_same

_F = np.float32

MOST_SAMPLES = 16
"""That are shaded together."""

SETUPS = 1024
"""Triangles that stay set up; more than a batch can hold."""

# Where in the table a triangle is: the golden ratio spreads neighbours, and neighbouring rows of a mesh, which differ by round numbers.
_SPREAD, _LOW, _SHIFT = np.uint64(0x9E3779B1), np.uint64(0xFFFFFFFF), np.uint64(32 - (2 * SETUPS - 1).bit_length())


class Runs(NamedTuple):
    """The runs of a batch; (FRAGMENTS,) each, but `head`, which is one longer.

    Attributes:
        head: int32, its first fragment; the run after the last has the number of fragments.
        pixel: int32, the tile's pixel of its first fragment; the others follow to the right.
        setup: int32, where its triangle is set up.
        mask: uint64, the samples that its fragments have.
        x, y: float32, place of its first fragment in pixels from the tile's corner; the others lie 1 apart.
    """

    head: Array
    pixel: Array
    setup: Array
    mask: Array
    x: Array
    y: Array


class Shared(NamedTuple):
    """The pixels of a batch that several triangles share; their fragments, one a triangle, follow those of whole pixels.

    Attributes:
        pixel, setup, mask, x, y: (FRAGMENTS,) each, of each fragment, as in `Runs`.
        share: (FRAGMENTS,) float32, of each fragment: of the samples of its pixel.
        edge: (FRAGMENTS,) int32, of each pixel: its number in the tile.
        first: (FRAGMENTS + 1,) int32, of each pixel: its first fragment; the pixel after the last has the number of fragments.
    """

    pixel: Array
    setup: Array
    mask: Array
    x: Array
    y: Array
    share: Array
    edge: Array
    first: Array


class Batch(NamedTuple):
    """How much a batch holds: fragments, runs; of those, the ones of whole pixels; and pixels that triangles share."""

    fragments: int
    runs: int
    whole_fragments: int
    whole_runs: int
    edges: int


class Setups(NamedTuple):
    """Triangles that are set up.

    Attributes:
        triangle: (SETUPS,) int32, drawn triangle.
        material: (SETUPS,) int32, row of the material table.
        stored: (SETUPS, STORED) float32, what `fragments` stores of it.
        table: (2 * SETUPS,) int32, where a triangle may be set up, by a hash of its number.
        sources: (FRAGMENTS, 4) int32, scratch: source triangle and vertices.
        same: (MOST_SAMPLES * WORD,) int32, scratch: for each sample and pixel, the bits of the samples that have the same triangle.
        mean: (256, 2) float32, mean place in the pixel, in pixels, of the samples in a mask; of up to 8 samples.
    """

    triangle: Array
    material: Array
    stored: Array
    table: Array
    sources: Array
    same: Array
    mean: Array


class Cursor(NamedTuple):
    """How far a tile has been gathered: triangles that are set up, sample plane, pixel of it."""

    setups: int
    plane: int
    pixel: int


class Samples(NamedTuple):
    """Where samples lie, and which are shaded.

    Attributes:
        pattern: (s, 2) int32, 1/256 pixel.
        every: Supersampling: sample planes are pictures of their own; else all planes make one.
    """

    pattern: Array
    every: bool


@jit.kernel
def scratch(mean, stored):
    """Runs, Shared and Setups for a thread that shades; `stored` numbers are kept of a triangle."""
    runs = Runs(
        head=np.empty(FRAGMENTS + 1, np.int32), pixel=np.empty(FRAGMENTS, np.int32), setup=np.empty(FRAGMENTS, np.int32),
        mask=np.empty(FRAGMENTS, np.uint64), x=np.empty(FRAGMENTS, np.float32), y=np.empty(FRAGMENTS, np.float32),
    )  # fmt: skip
    shared = Shared(
        pixel=np.empty(FRAGMENTS, np.int32), setup=np.empty(FRAGMENTS, np.int32), mask=np.empty(FRAGMENTS, np.uint64),
        x=np.empty(FRAGMENTS, np.float32), y=np.empty(FRAGMENTS, np.float32), share=np.empty(FRAGMENTS, np.float32),
        edge=np.empty(FRAGMENTS + 1, np.int32), first=np.empty(FRAGMENTS + 1, np.int32),
    )  # fmt: skip
    setups = Setups(
        triangle=np.empty(SETUPS, np.int32), material=np.empty(SETUPS, np.int32), stored=np.empty((SETUPS, stored), np.float32),
        table=np.zeros(2 * SETUPS, np.int32), sources=np.empty((FRAGMENTS, 4), np.int32), same=np.empty(MOST_SAMPLES * WORD, np.int32), mean=mean,
    )  # fmt: skip
    return runs, shared, setups


@jit.inlined
def find(t, setups, count, triangles):
    """Where triangle `t` is set up, and the number of set-ups with it; a new one's indices are asked for ahead of their use."""
    slot = (np.uint64(t) * _SPREAD & _LOW) >> _SHIFT
    known = np.int64(setups.table[slot])
    if known < count and setups.triangle[np.uint64(known)] == t:
        return known, count
    setups.table[slot] = count
    setups.triangle[np.uint64(count)] = t
    if t < len(triangles):
        prefetch(triangles, np.int64(t) * 3)
    return count, count + 1


@jit.inlined
def add_run(r, runs, n, setup, pixel, mask, x, y):
    """Write run `runs`, whose first fragment is `n`."""
    k = np.uint64(runs)
    r.head[k], r.pixel[k], r.setup[k], r.mask[k], r.x[k], r.y[k] = n, pixel, setup, mask, x, y


def mean_places(pattern: Array) -> Array:
    """(256, 2) float32 for `Setups.mean`; what has no samples is 0. Not to be written to: it is made once."""
    return _mean_places(pattern.tobytes(), pattern.dtype.str)


@lru_cache(maxsize=32)
def _mean_places(pattern_bytes: bytes, kind: str) -> Array:
    pattern = np.frombuffer(pattern_bytes, kind).reshape(-1, 2)
    has = np.arange(256)[:, None] >> np.arange(min(len(pattern), 8)) & 1
    total = has @ pattern[:8]
    return (total / np.maximum(has.sum(1, keepdims=True), 1) / 256).astype(np.float32)


@jit.part
def compare_samples(ids, first, width, samples, pixels, same):
    """In which of `width` pixels from element `first` on the samples differ; where any do, `same` says which are equal to which."""
    equal = ~np.uint64(0) >> np.uint64(WORD - width)
    differ = np.uint64(0)
    if samples == 4:
        differ = equal & ~where_four_same(ids, first, pixels, width)
    else:
        for s in range(1, samples):
            differ |= equal & ~where_same(ids, first, first + s * pixels, width)
    group = 0
    while differ >> np.uint64(group) != np.uint64(0):
        if differ >> np.uint64(group) & np.uint64((1 << LANES) - 1) != np.uint64(0):
            if samples == 4:
                same_of_four(ids, first + group, pixels, same, group, WORD)
            else:
                for s in range(samples):
                    same_samples(ids, first + group, pixels, samples, s, same, s * WORD + group)
        group += LANES
        if group == WORD:
            break
    return differ


@jit.inlined
def mean_place(bits, mean, pattern):
    """The mean of the places in a pixel of the samples in `bits`, in pixels."""
    if bits < np.uint64(256):
        return mean[bits, 0], mean[bits, 1]
    sum_x, sum_y, rest = 0, 0, bits
    while rest != np.uint64(0):
        s = lowest_bit(rest)
        sum_x, sum_y = sum_x + np.int64(pattern[s, 0]), sum_y + np.int64(pattern[s, 1])
        rest &= rest - np.uint64(1)
    share = _F(1 / 256) / _F(count_bits(bits))
    return _F(sum_x) * share, _F(sum_y) * share


@jit.part
def append(r, shared, batch):
    """Append the fragments of shared pixels to the runs of whole ones, as runs of one, for those who make no difference."""
    for j in range(np.uint64(0), np.uint64(batch.fragments - batch.whole_fragments)):
        k = np.uint64(batch.whole_runs) + j
        r.head[k] = np.uint64(batch.whole_fragments) + j
        r.pixel[k], r.setup[k], r.mask[k], r.x[k], r.y[k] = shared.pixel[j], shared.setup[j], shared.mask[j], shared.x[j], shared.y[j]


@jit.part
def gather(r, shared, setups, at, ids, samples_at, tile, wide, high, triangles):
    """The runs of a tile's whole pixels, and the pixels that triangles share, from `at`, a Cursor, on, until a batch is full.

    Args:
        ids: The tile's ids.
        samples_at: Samples.
        tile, wide, high: Its side, and how much of it is in the picture.

    Returns:
        (Batch, Cursor); the tile is done when the plane is the last one's successor.
    """
    (count, plane, cursor), (pattern, every_sample) = at, samples_at
    n, runs, many, edges, samples, pixels = 0, 0, 0, 0, len(pattern), tile * tile
    joint = samples > 1 and not every_sample
    most = samples if joint else 1  # fragments of a pixel
    everything, one = ~np.uint64(0) >> np.uint64(WORD - samples), _F(1.0) / _F(samples)
    planes = samples if every_sample else 1
    while plane < planes:
        x, y = cursor % tile, cursor // tile
        width = min(min(WORD, wide - x), (FRAGMENTS - n - many) // most)
        if width < min(LANES, wide - x):
            break
        first = plane * pixels + cursor
        all_pixels = ~np.uint64(0) >> np.uint64(WORD - width)
        ends = ~where_same(ids, first, first + 1, width) & all_pixels | np.uint64(1) << np.uint64(width - 1)
        partial = compare_samples(ids, first, width, samples, pixels, setups.same) if joint else np.uint64(0)
        ends |= partial | partial >> np.uint64(1)
        at_x, at_y, mask = _F(0.5), _F(y) + _F(0.5), everything
        if every_sample:
            at_x, at_y = _F(pattern[plane, 0]) * _F(1 / 256), _F(y) + _F(pattern[plane, 1]) * _F(1 / 256)
            mask = np.uint64(1) << np.uint64(plane)
        # First the runs of whole pixels, then the pixels that several triangles share: fewer branches that nobody can predict.
        begins = (ends << np.uint64(1) | np.uint64(1)) & all_pixels & ~partial
        while begins != np.uint64(0):
            begin = lowest_bit(begins)
            begins &= begins - np.uint64(1)
            t = ids[np.uint64(first + begin)]
            if t >= 0:
                setup, count = find(t, setups, count, triangles)
                add_run(r, runs, n, setup, cursor + begin, mask, _F(x + begin) + at_x, at_y)
                runs += 1
                n += lowest_bit(ends >> np.uint64(begin)) + 1
        while partial != np.uint64(0):
            begin = lowest_bit(partial)
            partial &= partial - np.uint64(1)
            left, before = everything, many
            while left != np.uint64(0):
                s = lowest_bit(left)
                bits = np.uint64(setups.same[np.uint64(s * WORD + begin)])
                left &= ~bits
                t = ids[np.uint64(s * pixels + first + begin)]
                if t >= 0:
                    dx, dy = mean_place(bits, setups.mean, pattern)
                    setup, count = find(t, setups, count, triangles)
                    k = np.uint64(many)
                    shared.pixel[k], shared.setup[k], shared.mask[k] = cursor + begin, setup, bits
                    shared.x[k], shared.y[k], shared.share[k] = _F(x + begin) + dx, _F(y) + dy, _F(count_bits(bits)) * one
                    many += 1
            shared.edge[np.uint64(edges)], shared.first[np.uint64(edges)] = cursor + begin, before
            edges += many > before
        cursor += width
        if x + width >= wide:
            cursor += tile - wide
        if cursor >= tile * high:
            plane, cursor = plane + 1, 0
    shared.first[np.uint64(edges)] = many
    r.head[np.uint64(runs)] = n
    return Batch(n + many, runs + many, n, runs, edges), Cursor(count, plane, cursor)
