"""Ranks of MPI that share a bake (`luxel.radiosity.labour`).

Elements are dealt out block by block, as cards are: they lie in the order of their tree, so each rank has some of every part of the scene, and all
are done at about the same time. What each has found of its own is pooled, so that everybody has all of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.cluster.items import pack, unpack
from luxel.radiosity.hemicube import ItemBuffers
from luxel.radiosity.labour import Team
from luxel.radiosity.transport import BLOCK

T = TypeVar("T")


class Ranks(Team):
    """All ranks of `comm`, with so many threads each; they call the same methods in the same order."""

    def __init__(self, comm: Comm, threads: int) -> None:
        self.comm, self.threads, self.leads, self.size, self.here = comm, threads, comm.rank == 0, comm.size, comm.here

    def mine(self, n: int, grain: int = BLOCK) -> Array:
        """One block of `grain` in so many."""
        return dealt(n, grain, self.comm.rank, self.size)

    def join(self, part: Array, n: int, grain: int = BLOCK) -> Array:
        """What all have of n items, on all of them."""
        lead, blocks = part.shape[:-1], -(-n // grain)
        padded = np.empty((*lead, blocks * grain), part.dtype)
        by_block = padded.reshape(*lead, blocks, grain)
        for rank, flat in enumerate(self.comm.pool(part)):
            theirs = flat.reshape(*lead, -1) if flat.size else np.empty((*lead, 0), part.dtype)
            whole = theirs.shape[-1] // grain
            by_block[..., blocks_of(n, grain, rank, self.size)[:whole], :] = theirs[..., : whole * grain].reshape(*lead, whole, grain)
            if theirs.shape[-1] > whole * grain:  # the last block of all is not full
                padded[..., n // grain * grain : n] = theirs[..., whole * grain :]
        return np.ascontiguousarray(padded[..., :n])

    def collect(self, part: Array, n: int, grain: int = BLOCK) -> Array | None:
        """What all have of n items, on rank 0."""
        if not self.leads:
            self.comm.move([(0, part)], [])
            return None
        which = [dealt(n, grain, rank, self.size) for rank in range(self.size)]
        got = [np.empty((len(some), *part.shape[1:]), part.dtype) for some in which[1:]]
        self.comm.move([], list(enumerate(got, 1)))
        whole = np.empty((n, *part.shape[1:]), part.dtype)
        for some, theirs in zip(which, [part, *got], strict=True):
            whole[some] = theirs
        return whole

    def once(self, work: Callable[[], T]) -> T:
        """Rank 0 does it."""
        result: T = self.comm.share(work() if self.leads else None)
        return result

    def drawn(self, seen: ItemBuffers, draw: Callable[[int, int], Array]) -> Array:
        """Each rank draws a part of the hemicubes, and tells all others of it (`luxel.cluster.items`)."""
        shares = self.comm.share_out(len(seen.resolution))
        first, last = shares[self.comm.rank]
        told = draw(first, last) if last > first else np.zeros((0, 2))
        data, lengths = (self.comm.pool(part) for part in pack(seen.part(first, last), self.threads))
        for rank, (begin, end) in enumerate(shares):
            if rank != self.comm.rank:
                unpack(data[rank], lengths[rank], seen.part(begin, end), self.threads)
        return np.concatenate(self.comm.pool(told)).reshape(-1, 2)


def blocks_of(n: int, grain: int, rank: int, size: int) -> Array:
    """(k,) int64: which blocks of `grain` are a rank's: one of every `size`, with each round the next, so that no rank has all the even ones."""
    blocks = -(-n // grain)
    rounds = np.arange(-(-blocks // size))
    mine = rounds * size + (rank + rounds) % size
    return mine[mine < blocks]


def dealt(n: int, grain: int, rank: int, size: int) -> Array:
    """(k,) int64: which of n items are a rank's."""
    items = (blocks_of(n, grain, rank, size)[:, None] * grain + np.arange(grain)).ravel()
    return items[items < n]
