"""Triangles in their new order, each turned so that a FIFO looks up what it holds before what it must load.

Where a first miss would push out a vertex that the same triangle needs, it comes after it: one load or two of three can always be made the last, and
the winding stays.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.checks import MOST_INDICES


@jit.inlined
def turned(a, b, c, out_a, out_b, out_c):
    """The triangle (a, b, c) turned so that the vertices that are out of the cache come last, and how many there are."""
    loads = out_a + out_b + out_c
    if loads and loads < 3:
        if out_a and not out_b:
            a, b, c = b, c, a
        elif not out_c:
            a, b, c = c, a, b
    return a, b, c, loads


@jit.kernel
def _gather(faces, source, cache, stamp, triangles):
    """Fill `triangles` and return the loads. All arrays are uint32 (see `luxel.layout.greedy`), `stamp` (n,) holds 0."""
    pushed = np.int64(cache)
    for i in range(np.uint64(len(source))):
        t = source[i]
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        a, b, c, loads = turned(a, b, c, pushed - stamp[a] >= cache, pushed - stamp[b] >= cache, pushed - stamp[c] >= cache)
        triangles[i, 0], triangles[i, 1], triangles[i, 2] = a, b, c
        if loads:
            for corner in range(3):
                v = triangles[i, corner]
                if pushed - stamp[v] >= cache:
                    pushed += 1
                    stamp[v] = pushed
    return pushed - cache


def gather(faces: Array, source: Array, vertex_count: int, cache: int) -> tuple[Array, int]:
    """(m, 3) int32: `faces[source]`, turned for a FIFO of `cache`; and how many vertices it loads."""
    triangles = np.empty_like(faces)
    cache = min(cache, MOST_INDICES // 2, 3 * len(faces) + 3)  # nothing leaves so large a cache
    arrays = (array.view(np.uint32) for array in (faces, source))
    return triangles, int(_gather(*arrays, cache, np.zeros(vertex_count, np.uint32), triangles.view(np.uint32)))
