"""`order`: the triangles of a mesh in an order that a cache of transformed vertices likes."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.layout import batch
from luxel.layout.adjacency import Adjacency, adjacency
from luxel.layout.cache import POLICIES, misses
from luxel.layout.checks import SMALLEST_CACHE, checked_cache, checked_triangles, checked_weights, positive, whole
from luxel.layout.fitted import FITTED
from luxel.layout.forsyth import forsyth
from luxel.layout.gather import gather
from luxel.layout.greedy import cost_table, greedy
from luxel.layout.lookahead import DEPTH, SEARCH_WEIGHTS, WIDTH, look_ahead
from luxel.layout.partition import Crew, Regions, Work, in_parts, part_size
from luxel.layout.patches import patches
from luxel.layout.risk import risk_table
from luxel.layout.seams import join
from luxel.layout.simple import morton, shuffled
from luxel.layout.tipsify import tipsify


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


@dataclass
class _Job:
    """A mesh, what to order it for, and what the orders share."""

    faces: Array
    vertices: int
    positions: object
    cache: int
    policy: str
    model: batch.Model | None
    weights: tuple[float, ...] | None = None
    width: int = WIDTH
    depth: int = DEPTH
    threads: int = 1
    progress: Callable[[int, int], None] | None = None
    crew: Crew | None = None
    _rows: Adjacency | None = None
    _regions: Regions | None = None

    @property
    def is_fifo(self) -> bool:
        """Whether the target is a plain FIFO, which the orders count themselves."""
        return self.policy == "fifo" and not self.model

    @property
    def fit(self) -> str:
        """Which of the fitted costs suits the target."""
        return next((name for name, model in batch.MODELS.items() if model == self.model and name in FITTED), "fifo")

    @property
    def modelled(self) -> int:
        """The FIFO that the orders are made for. Batches forget all at their end, which a smaller cache stands for; no more than
        `LARGEST_CACHE` is searched.
        """
        if self.model and (self.model.warp or self.model.group):
            return max(SMALLEST_CACHE, min(4 * self.model.cache // 5, BATCH_CACHE))
        return min(self.cache, LARGEST_CACHE)

    @property
    def rows(self) -> Adjacency:
        if self._rows is None:
            self._rows = adjacency(self.faces, self.vertices, self.threads)
        return self._rows

    def score(self, triangles: Array) -> float:
        """Misses per triangle on the target."""
        missed = batch.misses(triangles, self.model, self.vertices) if self.model else misses(triangles, self.cache, self.policy, self.vertices)
        return int(missed.sum(dtype=np.int64)) / len(triangles)

    def in_parts(self, work: Work) -> Array:
        """The order that `work` gives the mesh, or part after part of a large one."""
        size = part_size(len(self.faces))
        if size >= len(self.faces):
            return work(self.faces, self.vertices)
        if self._regions is None:
            self._regions = Regions(self.faces, self.rows, size)
        source = in_parts(self._regions, self.threads, work, self.progress, self.crew)
        join(self.faces, source, size, self.modelled, cost_table("greedy", None, self.modelled))
        return source


def _greedy(job: _Job, name: str, fit: str = "fifo") -> Array:
    costs = cost_table(name, job.weights, job.modelled, fit)
    return job.in_parts(partial(greedy, cache=job.modelled, costs=costs))


def _patches(job: _Job) -> Array:
    model = job.model if job.model and job.model.warp and job.model.group else batch.MODELS["nvidia"]
    return patches(job.faces, job.rows, model)  # not in parts: a part that ends within a batch would shift all batches after it


def _look_ahead(job: _Job) -> Array:
    k = job.modelled
    costs, others, risk = cost_table("lin-yu", SEARCH_WEIGHTS, k), cost_table("greedy", None, k), risk_table(k)
    if part_size(len(job.faces)) >= len(job.faces):
        return look_ahead(job.faces, job.rows, k, job.width, job.depth, costs, others, risk)
    return job.in_parts(partial(_look_ahead_part, k, job.width, job.depth, costs, others, risk))


def _look_ahead_part(cache: int, width: int, depth: int, costs: Array, others: Array, risk: Array, faces: Array, vertices: int) -> Array:
    return look_ahead(faces, adjacency(faces, vertices), cache, width, depth, costs, others, risk)


_MADE: dict[str, Callable[[_Job], Array]] = {
    "file": lambda job: np.arange(len(job.faces), dtype=np.int32),
    "random": lambda job: shuffled(len(job.faces)),
    "morton": lambda job: morton(job.faces, job.positions, job.vertices),
    "forsyth": lambda job: forsyth(job.faces, job.rows),
    "greedy": lambda job: _greedy(job, "greedy", job.fit),
    "greedy-fifo": lambda job: _greedy(job, "greedy"),
    "lin-yu": lambda job: _greedy(job, "lin-yu"),
    "greedy-2016": lambda job: _greedy(job, "greedy-2016"),
    "look-ahead": _look_ahead,
    "patches": _patches,
}
ORDERS = (*_MADE, "tipsify", "auto")
LARGEST_CACHE, BATCH_CACHE = 128, 11
MOST_WIDTH = 64
PER_WIDTH = 3.5
"""Look-ahead takes about that many times as long as one greedy pass, for each order it keeps."""


def order(triangles: object, vertex_count: int | None = None, order: str = "auto", cache: int = 12, policy: str = "fifo",
          profile: str | batch.Model | None = None, positions: object = None, weights: Sequence[float] | None = None, width: int | None = None,
          depth: int | None = None, threads: int | None = None, seconds: float | None = None,
          progress: Callable[[int, int], None] | None = None, crew: Crew | None = None) -> Ordered:  # fmt: skip
    """Reorder the triangles of a mesh for the cache of transformed vertices.

    Args:
        triangles: (m, 3) int32 vertex indices.
        vertex_count: Vertices of the mesh; None: one more than the largest index.
        order: One of `ORDERS`: "file" (as it is), "random", "morton", "tipsify", "forsyth", "greedy", "lin-yu", "greedy-2016", "look-ahead",
            "patches" (see their modules), "greedy-fifo" ("greedy" with the cost of plain FIFOs, whatever the GPU), or "auto": the best of the
            input, one greedy pass and look-ahead on the target (and "greedy-fifo" and patches for GPUs), found by simulating it.
        cache: Vertices the cache holds, at least 3.
        policy: "fifo" or "lru".
        profile: Order for a GPU instead of `cache` and `policy`: "nvidia", "amd", "intel", "mobile", or a `batch.Model`.
        positions: (n, 3), needed by "morton".
        weights: k1, k2, k3 and, if there is a fourth, `gone` of "lin-yu" and "greedy-2016" (see `luxel.layout.greedy`).
        width: Orders that look-ahead keeps side by side: 4 unless told; 1 is fast, 64 is the best.
        depth: Look-ahead settles on one beginning at the latest after that many fans: 64 unless told.
        threads: Threads that order the parts of a mesh of more than 131072 triangles; None: all cores. The order does not depend on it.
        seconds: About how long "auto" may take on this machine: it widens look-ahead as far as the time of the greedy pass lets it hope. None:
            it takes `width`; a core does about 0.5 million triangles a second at 4.
        progress: Called with the triangles done and their number, after each part of a large mesh.
        crew: What orders those parts in place of threads: see `luxel.layout.partition`.

    Returns:
        A permutation: every triangle once, in its winding.

    Raises:
        InputError: An index is out of range, there are no triangles or 2^31 indices, the cache holds fewer than 3, positions are missing or not
            finite where they are needed, or a name or number is not one that is expected.
    """
    faces, n = checked_triangles(triangles, vertex_count, empty=False)
    if order not in ORDERS:
        raise InputError(f"order: expected one of {', '.join(ORDERS)}, got {order!r}")
    if policy not in POLICIES:
        raise InputError(f"policy: expected one of {', '.join(POLICIES)}, got {policy!r}")
    model = None if profile is None else batch.model_of(profile)
    job = _Job(
        faces, n, positions, checked_cache(model.cache if model else cache), policy, model, checked_weights(weights),
        whole(width, "width", 1) if width is not None else WIDTH, whole(depth, "depth", 1) if depth is not None else DEPTH,
        jit.checked_threads(threads), progress, crew,
    )  # fmt: skip
    if order == "auto":
        return _auto(job, None if seconds is None else positive(seconds, "seconds"))
    return _best([_try(job, order)])


def _drawn(job: _Job, name: str, source: Array) -> tuple[Array, float]:
    """The triangles in the order of `source`, turned for the target, and their misses per triangle on it."""
    if name == "file":
        return job.faces, job.score(job.faces)
    triangles, loads = gather(job.faces, source, job.vertices, job.cache, job.threads)
    return triangles, loads / len(source) if job.is_fifo else job.score(triangles)


def _try(job: _Job, name: str) -> tuple[Trial, Array, Array]:
    began = time.perf_counter()
    if name == "tipsify":  # turns its triangles itself
        source, drawn, loads = tipsify(job.faces, job.vertices, job.cache)
        acmr = loads / len(source) if job.is_fifo else job.score(drawn)
    else:
        source = _MADE[name](job)
        drawn, acmr = _drawn(job, name, source)
    return Trial(name, acmr, time.perf_counter() - began), drawn, source


def _auto(job: _Job, seconds: float | None) -> Ordered:
    began = time.perf_counter()
    tried = [_try(job, "file"), _try(job, "greedy")]
    if seconds is not None:
        left = seconds - (time.perf_counter() - began)
        job.width = int(min(MOST_WIDTH, left / (PER_WIDTH * max(tried[1][0].seconds, 1e-6))))
    if job.fit != "fifo":
        tried.append(_try(job, "greedy-fifo"))
    if job.model and job.model.group:
        tried.append(_try(job, "patches"))
    if job.width > 0:
        tried.append(_try(job, "look-ahead"))
    return _best(tried)


def _best(tried: list[tuple[Trial, Array, Array]]) -> Ordered:
    """The first of those with the fewest misses."""
    trial, triangles, source = min(tried, key=lambda one: one[0].acmr)
    return Ordered(triangles, source, trial.order, trial.acmr, tuple(one[0] for one in tried))
