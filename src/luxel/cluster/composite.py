"""Composite: the visibility of many ranks becomes one, by depth and id, without any rank holding all of it twice.

Every rank has drawn its triangles over the whole screen: an id and a depth at every sample. In each round ranks form groups of k, cut the tiles
that they still answer for into k parts, and send each other those parts of theirs; so after the last round each rank has its own tiles, seen by all.

- direct: one round, k = the number of ranks. Every rank sends to every other (Hsu 1993; Neumann 1994).
- swap: rounds of k = 2 (Ma et al., "Parallel volume rendering using binary-swap compositing", 1994). Of ranks beyond a power of two, each first
  shares the merging with a partner and then hands over what it has.
- radix: rounds of k up to 4, whatever primes the number of ranks has (Peterka et al., "A configurable algorithm for parallel image-compositing
  applications", 2009).

Only what is covered travels: of the tiles that anybody has drawn to, as runs of samples (run-length coding after Ahrens and Painter, "Efficient
sort-last rendering using compression-based image compositing", 1998). The nearest sample wins, and of equally near ones the lower id, so the order of
merging does not matter.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.raster.constants import NOTHING
from luxel.raster.cover import BEHIND

COMPOSITIONS = ("direct", "swap", "radix")
_RADIX = 4


@jit.kernel
def _measure(slots, samples, ids):
    words = 0
    for slot in slots:
        covered = runs = 0
        before = False
        for i in range(samples):
            here = ids[slot, i] >= 0
            covered += here
            runs += here and not before
            before = here
        words += 2 * (runs + covered) + (2 if runs > 0 else 0)
    return words


@jit.kernel
def _pack(slots, samples, ids, depths, out):
    at = 0
    for slot in slots:
        head, runs, i = at, 0, 0
        at += 2
        while i < samples:
            if ids[slot, i] < 0:
                i += 1
                continue
            start = i
            while i < samples and ids[slot, i] >= 0:
                i += 1
            count = i - start
            out[at], out[at + 1] = start, count
            for k in range(count):
                out[at + 2 + k], out[at + 2 + count + k] = depths[slot, start + k], ids[slot, start + k]
            at += 2 + 2 * count
            runs += 1
        if runs > 0:
            out[head], out[head + 1] = slot, runs
        else:
            at = head


def pack(slots: Array, samples: int, ids: Array, depths: Array) -> Array:
    """What is covered of tiles, as words.

    Args:
        slots: (k,) int64, rows of `ids` and `depths`.
        samples: In each row.
        ids: (tiles, ...) int32, `NOTHING` where nothing is.
        depths: The same, float32.

    Returns:
        (n,) int32: for each tile that is not empty its row and number of runs, and for each run its first sample, length, depths (bits) and ids.
    """
    out = np.empty(_measure(slots, samples, ids), np.int32)
    _pack(slots, samples, ids, depths.view(np.int32), out)
    return out


@jit.kernel
def _merge(words, float_words, ids, depths):
    at, merged = 0, 0
    while at < len(words):
        slot, runs = words[at], words[at + 1]
        at += 2
        for _ in range(runs):
            start, count = words[at], words[at + 1]
            for k in range(count):
                d, t, i = float_words[at + 2 + k], words[at + 2 + count + k], start + k
                here = depths[slot, i]
                if d > here or (d == here and t < ids[slot, i]):
                    depths[slot, i], ids[slot, i] = d, t
            at += 2 + 2 * count
            merged += count
    return merged


def merge(words: Array, ids: Array, depths: Array) -> int:
    """Merge what `pack` made into `ids` and `depths`; returns the number of samples that it held."""
    return int(_merge(words, words.view(np.float32), ids, depths))


def clear(slots: Array, ids: Array, depths: Array) -> None:
    """Leave nothing in rows `slots`."""
    ids[slots], depths[slots] = NOTHING, BEHIND


def radices(size: int, composition: str) -> list[int]:
    """How many ranks exchange parts in each round; the product is `size`, or for "swap" the power of two below."""
    if composition == "direct":
        return [size] if size > 1 else []
    if composition == "swap":
        return [2] * (size.bit_length() - 1)
    out, left = [], size
    for k in (_RADIX, *range(2, size + 1)):
        while left % k == 0:
            out.append(k)
            left //= k
    return out


def regions(slots: Array, size: int, composition: str) -> list[Array]:
    """The tiles that each rank has in the end, of `slots`."""
    steps = radices(size, composition)
    out = []
    for rank in range(size):
        mine, stride = slots, 1
        for k in steps:
            mine = np.array_split(mine, k)[rank // stride % k]
            stride *= k
        out.append(mine if rank < math.prod(steps) else mine[:0])
    return out


def composite(slots: Array, samples: int, ids: Array, depths: Array, comm: Comm, composition: str) -> int:
    """Merge all ranks' visibility, so that each has what is seen in its own tiles, `regions(slots, ...)[rank]`; other rows are left in between.

    Args:
        slots: (k,) int64 rows that anybody has drawn to; the same on all ranks, and cleared where a rank has not.
        samples: In each row.
        ids: (tiles, ...) int32, global ids; changed.
        depths: The same, float32; changed.
        comm: The ranks.
        composition: One of COMPOSITIONS.

    Returns:
        How many samples this rank has merged.
    """
    steps, rank, merged = radices(comm.size, composition), comm.rank, 0
    whole = math.prod(steps)

    def exchange(partners: list[int], parts: list[Array], own: int) -> int:
        """Give each partner its part, and merge what all of them have of part `own`."""
        out = {partner: pack(part, samples, ids, depths) for k, (partner, part) in enumerate(zip(partners, parts, strict=True)) if k != own}
        got = comm.trade(out, out)
        return sum(merge(got[partner], ids, depths) for partner in out)

    if rank >= whole or rank + whole < comm.size:  # ranks beyond the power of two, and their partners
        low, high = rank % whole, rank % whole + whole
        halves = np.array_split(slots, 2)
        merged += exchange([low, high], halves, int(rank == high))
        if rank == high:
            comm.trade({low: pack(halves[1], samples, ids, depths)}, [])
            return merged
        clear(halves[1], ids, depths)
        merged += merge(comm.trade({}, [high])[high], ids, depths)
    stride, mine = 1, slots
    for k in steps:
        own = rank // stride % k
        parts = np.array_split(mine, k)
        merged += exchange([rank + (j - own) * stride for j in range(k)], parts, own)
        mine, stride = parts[own], stride * k
    return merged
