"""`order`: the triangles of a mesh in an order that a cache of transformed vertices likes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.layout import batch
from luxel.layout.adjacency import Adjacency, adjacency
from luxel.layout.cache import misses
from luxel.layout.checks import checked_cache, checked_triangles
from luxel.layout.simple import morton, shuffled
from luxel.layout.tipsify import tipsify

ORDERS = ("file", "random", "morton", "tipsify", "auto")


@dataclass(frozen=True)
class Trial:
    """One order that was tried: its name, its misses per triangle on the target, and the seconds it took."""

    order: str
    acmr: float
    seconds: float


@dataclass(frozen=True, eq=False)
class Ordered:
    """The triangles of a mesh in a new order.

    Attributes:
        triangles: (m, 3) int32, in the new order. Each keeps its winding; its first corner may be another.
        source: (m,) int32: triangle i was triangle `source[i]` of the input.
        order: Name of the order that won.
        acmr: Misses per triangle on the target: the FIFO, LRU or GPU model asked for.
        trials: What was tried, in turn.
    """

    triangles: Array
    source: Array
    order: str
    acmr: float
    trials: tuple[Trial, ...]


@jit.kernel
def _gather(faces, source, cache, stamp, triangles):
    """The triangles in the order of `source`, turned so that what a FIFO holds is looked up before what it must load."""
    pushed = 0
    for i in range(len(source)):
        t = source[i]
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        in_a, in_b, in_c = pushed - stamp[a] < cache, pushed - stamp[b] < cache, pushed - stamp[c] < cache
        if (in_b and not in_a) or (in_b and in_c and not in_a):
            a, b, c, in_a, in_b, in_c = b, c, a, in_b, in_c, in_a
        elif in_c and not (in_a and in_b):
            a, b, c, in_a, in_b, in_c = c, a, b, in_c, in_a, in_b
        triangles[i, 0], triangles[i, 1], triangles[i, 2] = a, b, c
        for corner in range(3):
            v = triangles[i, corner]
            if pushed - stamp[v] >= cache:
                pushed += 1
                stamp[v] = pushed
    return pushed


@dataclass
class _Job:
    """A mesh, what to order it for, and what the orders share."""

    faces: Array
    vertices: int
    positions: object
    cache: int
    policy: str
    model: batch.Model | None
    _rows: Adjacency | None = None

    @property
    def rows(self) -> Adjacency:
        if self._rows is None:
            self._rows = adjacency(self.faces, self.vertices)
        return self._rows

    def score(self, triangles: Array) -> float:
        """Misses per triangle on the target."""
        missed = batch.misses(triangles, self.model, self.vertices) if self.model else misses(triangles, self.cache, self.policy, self.vertices)
        return int(missed.sum(dtype=np.int64)) / len(triangles)

    def gather(self, source: Array) -> Array:
        triangles = np.empty_like(self.faces)
        _gather(self.faces, source, self.cache, np.full(self.vertices, -self.cache, np.int32), triangles)
        return triangles


_MADE: dict[str, Callable[[_Job], Array]] = {
    "random": lambda job: shuffled(len(job.faces)),
    "morton": lambda job: morton(job.faces, job.positions, job.vertices),
    "tipsify": lambda job: tipsify(job.faces, job.rows, job.cache),
}


def order(triangles: object, vertex_count: int | None = None, order: str = "auto", cache: int = 12, policy: str = "fifo",
          profile: str | batch.Model | None = None, positions: object = None, weights: object = None, width: int | None = None,
          depth: int | None = None, threads: int | None = None, seconds: float | None = None,
          progress: Callable[[int, int], None] | None = None) -> Ordered:  # fmt: skip
    """Reorder the triangles of a mesh for the cache of transformed vertices.

    Args:
        triangles: (m, 3) int32 vertex indices.
        vertex_count: Vertices of the mesh; None: one more than the largest index.
        order: One of `ORDERS`.
        cache: Vertices the cache holds, at least 3.
        policy: "fifo" or "lru".
        profile: Order for a GPU instead of `cache` and `policy`: "nvidia", "amd", "intel", "mobile", or a `batch.Model`.
        positions: (n, 3), needed by "morton".

    Raises:
        InputError: An index is out of range, there are no triangles or too many, the cache holds fewer than 3, or a name is not known.
    """
    faces, n = checked_triangles(triangles, vertex_count, empty=False)
    if order not in ORDERS:
        raise InputError(f"order: expected one of {', '.join(ORDERS)}, got {order!r}")
    if policy not in ("fifo", "lru"):
        raise InputError(f"policy: expected fifo or lru, got {policy!r}")
    model = None if profile is None else batch.model_of(profile)
    job = _Job(faces, n, positions, min(checked_cache(model.cache if model else cache), 3 * len(faces) + 3), policy, model)
    jit.checked_threads(threads)
    best: tuple[float, str, Array, Array] | None = None
    trials = []
    for name in ("file", "tipsify") if order == "auto" else (order,):
        began = time.perf_counter()
        source = np.arange(len(faces), dtype=np.int32) if name == "file" else _MADE[name](job)
        drawn = faces if name == "file" else job.gather(source)
        acmr = job.score(drawn)
        trials.append(Trial(name, acmr, time.perf_counter() - began))
        if best is None or acmr < best[0]:
            best = acmr, name, drawn, source
    assert best is not None
    return Ordered(best[2], best[3], best[1], best[0], tuple(trials))
