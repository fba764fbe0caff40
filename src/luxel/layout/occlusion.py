"""Less overdraw for little vertex cache: the order is cut into clusters, and those that face outwards are drawn first.

After Sander, Nehab, Barczak 2007, "Fast Triangle Reordering for Vertex Locality and Reduced Overdraw", section 4: clusters are sorted by how
far they stand out, (their centroid - the mesh's) . their normal. There an order is cut where a triangle misses three times, and wherever the cluster
so far, from an empty cache, has nearly the miss ratio of its surroundings.

What differs: what a cut costs is simulated at every triangle, how many more misses there are when the cache is empty there; an order is cut where
that is cheap for the misses since the last cut. The cache has the size that the order was made for (a step that assumes 16 entries costs an order
made for 12 from 8 to 35 %). How freely to cut is found by measuring the sorted order, on the cache, policy or GPU model asked for, against a
limit. And the result is taken only if its overdraw measures less. So neither measure can get worse than what was asked.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.layout import batch
from luxel.layout.cache import misses
from luxel.layout.checks import checked_cache, checked_triangles
from luxel.layout.overdraw import overdraw

LIMIT = 1.05
"""How many times the cache misses of its input a sorted order may have, unless said otherwise: more buys next to nothing."""

_RATES = np.geomspace(0.002, 4, 80).tolist()
"""How many misses a cut may cost for each miss since the last cut."""

_WINDOW = 48
"""Misses, at most, after which a cache that was emptied is taken to be as it would have been; twice its size suffices."""

_JUDGES = 10
"""Views, beside the six axes, by which the sorted order is compared with the input."""


class Sorted(NamedTuple):
    """An order sorted for overdraw.

    Attributes:
        triangles: (m, 3) int32.
        source: (m,) int32: triangle i was triangle `source[i]` of the input.
        clusters: How many there were to sort; 1 if the input was best as it was.
        cost: Cache misses over those of the input; at most the limit.
        gain: Mean overdraw of the input over that of the result; at least 1.
    """

    triangles: Array
    source: Array
    clusters: int
    cost: float
    gain: float


@jit.kernel
def _penalties(triangles, missed, cache, window, stamp, penalty):
    """How many misses it costs to draw on with an empty cache, before each triangle; `stamp` (n,) int64 holds -cache."""
    m, now = len(triangles), np.int64(0)
    for first in range(m):
        now += cache
        paid, before, t = 0, 0, first
        while t < m and paid < window:
            for corner in range(3):
                v = triangles[t, corner]
                if now - stamp[v] >= cache:
                    now += 1
                    stamp[v] = now
                    paid += 1
            before += missed[t]
            t += 1
        penalty[first] = paid - before


@jit.kernel
def _cut(missed, penalty, rate, start):
    """First triangles of the clusters into `start`. Return how many there are."""
    count, before = 0, 0
    for t in range(len(missed)):
        if t == 0 or penalty[t] <= rate * before:
            start[count] = t
            count += 1
            before = 0
        before += missed[t]
    return count


def sort_clusters(triangles: object, positions: object, cache: int = 12, policy: str = "fifo", profile: str | batch.Model | None = None,
                  limit: float = LIMIT, cull: bool = True, threads: int | None = None) -> Sorted:  # fmt: skip
    """Reorder clusters of an order made for the vertex cache so that it has less overdraw.

    Args:
        triangles: (m, 3) int32, in that order.
        positions: (n, 3) float32.
        cache, policy, profile: The target, as the order was made for.
        limit: How many times the cache misses of the input the result may have, at least 1.
        cull: Back faces are not drawn.
        threads: None: all that the process may use.

    Raises:
        InputError: An index is out of range, there are no triangles, a position is not finite, or the limit is below 1.
    """
    if not 1 <= limit < np.inf:
        raise InputError(f"limit: expected a finite factor of at least 1, got {limit!r}")
    points = checked(positions, ("n", 3), np.float32, "positions")
    faces, n = checked_triangles(triangles, len(points), empty=False)
    model = None if profile is None else batch.model_of(profile)
    size = min(checked_cache(model.cache if model else cache), 3 * len(faces) + 3)

    def missed(order: Array) -> Array:
        return batch.misses(order, model, n) if model else misses(order, cache, policy, n)

    before, score = int(missed(faces).sum(dtype=np.int64)), _standing_out(faces, points)
    penalty, start = np.empty(len(faces), np.int32), np.empty(len(faces), np.int32)
    near = misses(faces, size, "fifo", n)  # cuts are judged by a FIFO of this size; the result by the target itself
    _penalties(faces, near, size, min(2 * size, _WINDOW), np.full(n, -size, np.int64), penalty)

    def candidate(rate: float) -> tuple[Array, int, float] | None:
        """The order cut at this rate and sorted, the clusters and their cost; None beyond the limit."""
        clusters = int(_cut(near, penalty, rate, start))
        source = _by_cluster(start[:clusters], len(faces), score)
        cost = int(missed(faces[source]).sum(dtype=np.int64)) / before
        return (source, clusters, cost) if cost <= limit else None

    found = _most(candidate)
    orders = [faces] if found is None else [faces, faces[found[0]]]
    seen = [overdraw(order, points, _JUDGES, cull, threads=threads).mean for order in orders]
    if found is None or seen[1] >= seen[0]:
        return Sorted(faces, np.arange(len(faces), dtype=np.int32), 1, 1.0, 1.0)
    source, clusters, cost = found
    return Sorted(orders[1], source, clusters, cost, seen[0] / seen[1])


def _most(candidate: Callable[[float], Any]) -> Any:
    """The candidate that is cut as freely as the limit allows; None if none is within it."""
    low, high, most = -1, len(_RATES), None
    while high - low > 1:
        middle = (low + high) // 2
        found = candidate(_RATES[middle])
        low, high, most = (low, middle, most) if found is None else (middle, high, found)
    return most


def _standing_out(faces: Array, points: Array) -> tuple[Array, Array, Array]:
    """Per triangle: twice its area, its centroid times that, and its area normal; float64."""
    corners = points[faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.sqrt((normals * normals).sum(1))
    return areas, corners.mean(1) * areas[:, None], normals


def _by_cluster(start: Array, m: int, score: tuple[Array, Array, Array]) -> Array:
    """(m,) int32: the triangles, clusters that stand out most first."""
    areas, centres, normals = (np.add.reduceat(values, start, 0) for values in score)
    middle = centres.sum(0) / max(areas.sum(), 1e-300)
    centres = centres / np.where(areas > 0, areas, 1)[:, None]
    length = np.sqrt((normals * normals).sum(1))
    out = ((centres - middle) * normals).sum(1) / np.where(length > 0, length, 1)
    order = np.argsort(-out, kind="stable")
    counts = np.diff(start, append=m)[order]
    ends = np.cumsum(counts)
    return (np.repeat(start[order] - (ends - counts), counts) + np.arange(m)).astype(np.int32)
