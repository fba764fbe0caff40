"""Less overdraw for little vertex cache: the order is cut into clusters, and those that face outwards are drawn first.

Sander, Nehab, Barczak 2007, "Fast Triangle Reordering for Vertex Locality and Reduced Overdraw", section 4. A cluster begins where a triangle
misses three times, since the cache is of little use across it, and where those since the last cut already have nearly the miss ratio of
the whole stretch: there a cut costs little. Clusters are sorted by how far they stand out: (their centroid - the mesh's) . their normal.

What differs: the cache is simulated with the size, policy or GPU model that the order was made for (a step that assumes 16 entries costs an
order made for 12 from 5 to 14 %); how much may be cut is found by measuring the whole order against a limit, not assumed; and of the
candidates (with and without the first kind of cut, and the input), the one whose overdraw measures least is taken. So neither measure can
get worse than what was asked.
"""

from __future__ import annotations

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

_RATIOS = (0.0, *(1 + np.geomspace(0.002, 2, 60)).tolist())
"""Miss ratio of a cluster so far over that of the stretch it is cut from, below which it is cut; 0: only where a stretch ends."""

_STRETCHES = (3, 4)
"""Misses of a triangle at which a stretch begins; 4: the whole order is one."""

_JUDGES = 10
"""Views, beside the six axes, by which candidates are compared."""


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
def _cut(triangles, missed, bound, cache, ratio, stamp, start):
    """First triangles of the clusters into `start`; `stamp` (n,) int64 holds -cache. Return how many there are."""
    m, count, now = len(triangles), 0, np.int64(0)
    begin = 0
    while begin < m:
        end, total = begin + 1, np.int64(missed[begin])
        while end < m and missed[end] < bound:
            total += missed[end]
            end += 1
        wanted = ratio * total / (end - begin)
        start[count] = begin
        count += 1
        since, paid = 0, 0
        now += cache  # each cluster is judged from an empty cache
        for t in range(begin, end - 1):
            for corner in range(3):
                v = triangles[t, corner]
                if now - stamp[v] >= cache:
                    now += 1
                    stamp[v] = now
                    paid += 1
            since += 1
            if paid <= wanted * since:
                start[count] = t + 1
                count += 1
                since, paid = 0, 0
                now += cache
        begin = end
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

    first = missed(faces)
    before, score = int(first.sum(dtype=np.int64)), _standing_out(faces, points)
    start = np.empty(len(faces), np.int32)

    def candidate(bound: int, ratio: float) -> tuple[Array, int, float] | None:
        """The order cut in this way, the clusters and their cost; None beyond the limit."""
        clusters = int(_cut(faces, first, bound, size, ratio, np.full(n, -size, np.int64), start))
        source = _by_cluster(start[:clusters], len(faces), score)
        cost = int(missed(faces[source]).sum(dtype=np.int64)) / before
        return (source, clusters, cost) if cost <= limit else None

    best, kept = overdraw(faces, points, _JUDGES, cull, threads=threads).mean, None
    plain = best
    for bound in _STRETCHES:
        for found in _within(candidate, bound):
            seen = overdraw(faces[found[0]], points, _JUDGES, cull, threads=threads).mean
            best, kept = (seen, found) if seen < best else (best, kept)
    if kept is None:
        return Sorted(faces, np.arange(len(faces), dtype=np.int32), 1, 1.0, 1.0)
    source, clusters, cost = kept
    return Sorted(faces[source], source, clusters, cost, plain / best)


def _within(candidate: Any, bound: int) -> list[Any]:
    """Candidates within the limit: the stretches uncut, and those cut as often as it allows."""
    uncut = candidate(bound, _RATIOS[0])
    if uncut is None:
        return []
    low, high, most = 0, len(_RATIOS), uncut
    while high - low > 1:
        middle = (low + high) // 2
        found = candidate(bound, _RATIOS[middle])
        low, high, most = (low, middle, most) if found is None else (middle, high, found)
    return [uncut, most] if uncut[1] < most[1] else [uncut]


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
