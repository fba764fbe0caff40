"""Directory: a number for each vertex of a mesh, of which each rank keeps those of a run of vertices, and which all ranks ask and tell together."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.cluster.comm import Comm


class Directory:
    """(n,) int32 over the ranks. All ranks make each call, with as many vertices as they like.

    Args:
        comm: The ranks.
        count: Of vertices.
        fill: What each number is at first; None: the vertex's own.

    Attributes:
        first, last: Vertices whose numbers are here: first .. last - 1.
        values: Their numbers.
    """

    def __init__(self, comm: Comm, count: int, fill: int | None = None) -> None:
        self.comm = comm
        shares = comm.share_out(count)
        self.first, self.last = shares[comm.rank]
        self._ends = np.array([last for _, last in shares], np.int64)
        self._starts = np.array([first for first, _ in shares], np.int64)
        self.values = np.arange(self.first, self.last, dtype=np.int32) if fill is None else np.full(self.last - self.first, fill, np.int32)

    def _routed(self, vertices: Array) -> tuple[Array, Array]:
        """An order of vertices (k,) by the rank that keeps them, and how many each does."""
        owner = np.searchsorted(self._ends, vertices, side="right")
        return np.argsort(owner, kind="stable"), np.bincount(owner, minlength=self.comm.size)

    def _send(self, array: Array, order: Array, counts: Array) -> list[Array]:
        return self.comm.exchange(np.split(array[order].astype(np.int32, copy=False), np.cumsum(counts)[:-1]))

    def get(self, vertices: Array) -> Array:
        """(k,) int32: the numbers of vertices (k,)."""
        order, counts = self._routed(vertices)
        asked = self._send(vertices, order, counts)
        got = np.concatenate(self.comm.exchange([self.values[part - self.first] for part in asked]))
        out = np.empty(len(vertices), np.int32)
        out[order] = got
        return out

    def put(self, vertices: Array, numbers: Array, least: bool = False) -> None:
        """Give vertices (k,), each of which comes once, their numbers (k,); with `least` only where those are less than what is there."""
        order, counts = self._routed(vertices)
        places, values = self._send(vertices, order, counts), self._send(numbers, order, counts)
        for place, value in zip(places, values, strict=True):
            at = place - self.first
            self.values[at] = np.minimum(self.values[at], value) if least else value
