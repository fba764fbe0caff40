"""Seams of a large mesh: where the order of one part ends and that of the next begins.

Each part was ordered from an empty cache, by itself. Around every seam the last triangles of a part and the first of the next are drawn again, in one
greedy pass that begins with what the cache holds by then; that is kept if fewer vertices are loaded from there to well behind the seam.
"""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.layout.gather import gather, left_in_cache
from luxel.layout.greedy import greedy

_REACH = 128
"""Triangles on either side of a seam that are drawn again."""
_LEAD = 128
"""Triangles before and behind those, and four for each vertex of the cache: so that it is known what the cache holds, and counted what that saves."""


def join(faces: Array, source: Array, size: int, cache: int, costs: Array) -> None:
    """Draw the seams of an order again, in place.

    Args:
        faces: (m, 3) int32.
        source: (m,) int32, an order in parts of `size` triangles; changed.
        size: Of a part.
        cache: Of the FIFO.
        costs: Of the greedy pass, from `greedy.cost_table`.
    """
    reach, lead = min(_REACH, size // 2), _LEAD + 4 * cache
    for seam in range(size, len(source), size):
        first, last = max(0, seam - reach - lead), min(len(source), seam + reach + lead)
        begin, end = seam - reach - first, min(seam + reach, last) - first
        near = source[first:last]
        vertices, local = np.unique(faces[near], return_inverse=True)
        inside = local.reshape(-1, 3).astype(np.int32)
        held = left_in_cache(inside[:begin], len(vertices), cache)
        plain = np.arange(len(near), dtype=np.int32)
        again = plain.copy()
        again[begin:end] = begin + greedy(inside[begin:end], len(vertices), cache, costs, held)
        before, after = (gather(inside, order, len(vertices), cache)[1] for order in (plain, again))
        if after < before:
            source[first:last] = near[again]
