"""Exact simulators of a cache of transformed vertices, and the measures made of them.

The vertices of a triangle are looked up in the order of its indices. A FIFO of `cache` vertices forgets a vertex after `cache` further
misses, hit or not; an LRU forgets the one that was not used for the longest time. So a triangle's first miss can push out its own third
vertex, and which index comes first can matter.

ACMR (average cache miss ratio) and ATVR (average transformed vertex ratio) count the same misses, by triangle and by vertex:
ATVR = ACMR * triangles / vertices used.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.layout.checks import checked_cache, checked_triangles

POLICIES = ("fifo", "lru")


@jit.kernel
def _fifo(triangles, cache, stamp, missed):
    """Misses of each triangle; `stamp` (n,) int32 holds -cache. A vertex pushed by miss p is in the cache until miss p + cache."""
    pushed = 0
    for t in range(len(triangles)):
        misses = 0
        for corner in range(3):
            v = triangles[t, corner]
            if pushed - stamp[v] >= cache:
                pushed += 1
                stamp[v] = pushed
                misses += 1
        missed[t] = misses
    return pushed


@jit.kernel
def _lru(triangles, cache, before, after, missed):
    """Misses of each triangle; `before` and `after` (n + 1,) int32 hold -1, and become a ring whose head n stands before the newest."""
    head = len(before) - 1
    before[head] = after[head] = head
    held, total = 0, 0
    for t in range(len(triangles)):
        misses = 0
        for corner in range(3):
            v = triangles[t, corner]
            if after[v] >= 0:
                after[before[v]], before[after[v]] = after[v], before[v]
            else:
                misses += 1
                held += 1
                if held > cache:
                    oldest = before[head]
                    before[head] = before[oldest]
                    after[before[head]] = head
                    after[oldest] = -1
                    held = cache
            newest = after[head]
            after[head], before[newest] = v, v
            before[v], after[v] = head, newest
        missed[t] = misses
        total += misses
    return total


def misses(triangles: object, cache: int = 12, policy: str = "fifo", vertex_count: int | None = None) -> Array:
    """Cache misses of each triangle, drawn in the order given from an empty cache.

    Args:
        triangles: (m, 3) int32 vertex indices.
        cache: Vertices the cache holds, at least 3.
        policy: "fifo" or "lru".
        vertex_count: Vertices of the mesh; None: one more than the largest index.

    Returns:
        (m,) uint8, 0 .. 3; the picture of hits and misses is made of it.

    Raises:
        InputError: An index is out of range, the cache holds fewer than 3, or the policy has another name.
    """
    faces, n = checked_triangles(triangles, vertex_count)
    cache = min(checked_cache(cache), 3 * len(faces) + 3)  # nothing leaves so large a cache
    missed = np.empty(len(faces), np.uint8)
    if policy == "fifo":
        _fifo(faces, cache, np.full(n, -cache, np.int32), missed)
    elif policy == "lru":
        _lru(faces, cache, np.full(n + 1, -1, np.int32), np.full(n + 1, -1, np.int32), missed)
    else:
        raise InputError(f"policy: expected one of {', '.join(POLICIES)}, got {policy!r}")
    return missed


def acmr(triangles: object, cache: int = 12, policy: str = "fifo", vertex_count: int | None = None) -> float:
    """Average cache miss ratio: misses per triangle.

    Best: vertices used / triangles, where every vertex misses once: 0.5 on a large closed mesh. Worst: 3. A FIFO of K on a regular grid
    reaches (K - 1) / (2 (K - 2)) with strips, 0.55 at 12.

    Raises:
        InputError: As of `misses`, or there are no triangles.
    """
    faces, n = checked_triangles(triangles, vertex_count, empty=False)
    return int(misses(faces, cache, policy, n).sum(dtype=np.int64)) / len(faces)


def atvr(triangles: object, cache: int = 12, policy: str = "fifo", vertex_count: int | None = None) -> float:
    """Average transformed vertex ratio: misses per vertex used. Best: 1. Worst: 3 triangles / vertices, about 6.

    Raises:
        InputError: As of `misses`, or there are no triangles.
    """
    faces, n = checked_triangles(triangles, vertex_count, empty=False)
    return int(misses(faces, cache, policy, n).sum(dtype=np.int64)) / used_vertices(faces, n)


def used_vertices(triangles: Array, vertex_count: int) -> int:
    """How many vertices some triangle names."""
    used = np.zeros(vertex_count, np.bool_)
    used[triangles.ravel()] = True
    return int(np.count_nonzero(used))
