"""Forsyth's linear-speed vertex cache optimisation (2006): the triangle of highest score next, for an LRU of 32 modelled, good at many sizes.

A vertex scores for its place in the modelled cache, falling with the power 1.5, and more the fewer triangles it has left; the three of the last
triangle score alike, so that none of its sides is preferred. A triangle scores the sum of its vertices.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.adjacency import Adjacency, bounded

_CACHE = 32
_DECAY, _LAST, _VALENCE_SCALE, _VALENCE_POWER = 1.5, 0.75, 2.0, 0.5
_MOST = 32


def _scores() -> tuple[Array, Array]:
    """Score by place in the cache (the last cell: not in it), and by triangles left."""
    place = np.arange(_CACHE + 4)
    cached = np.where(place < 3, _LAST, np.clip(1 - (place - 3) / (_CACHE - 3), 0, 1) ** _DECAY)
    cached[_CACHE:] = 0
    left = np.arange(_MOST + 1)
    return cached.astype(np.float32), (_VALENCE_SCALE * np.maximum(left, 1) ** -_VALENCE_POWER * (left > 0)).astype(np.float32)


@jit.kernel
def _forsyth(faces, start, rows, left, score, drawn, by_place, by_left, source):
    """Write the order into `source`; `left` (n,) holds the valences, `score` (n,) what they score outside the cache."""
    m = len(faces)
    cache, before = np.full(_CACHE + 3, -1, np.int32), np.full(_CACHE + 3, -1, np.int32)
    held, cursor, best = 0, 0, -1
    for done in range(m):
        if best < 0:
            while drawn[cursor]:
                cursor += 1
            best = cursor
        source[done] = best
        drawn[best] = True
        for i in range(held):
            before[i] = cache[i]
        count = 0
        for corner in range(3):
            v = faces[best, corner]
            left[v] -= 1
            if not (count > 0 and cache[0] == v) and not (count > 1 and cache[1] == v):
                cache[count] = v
                count += 1
        a, b, c = faces[best, 0], faces[best, 1], faces[best, 2]
        for i in range(held):
            v = before[i]
            if v != a and v != b and v != c:
                cache[count] = v
                count += 1
        for i in range(count):
            v = cache[i]
            score[v] = by_place[min(i, _CACHE)] + by_left[left[v]]
        held = min(count, _CACHE)
        best, highest = -1, np.float32(0)
        for i in range(count):
            v = cache[i]
            if left[v] > 0:
                for j in range(start[v], start[v + 1]):
                    t = rows[j]
                    if not drawn[t]:
                        total = score[faces[t, 0]] + score[faces[t, 1]] + score[faces[t, 2]]
                        if total > highest:
                            best, highest = t, total
    return m


def forsyth(faces: Array, rows: Adjacency) -> Array:
    """(m,) int32: the triangles in Forsyth's order."""
    faces, rows = bounded(faces, rows, _MOST)
    by_place, by_left = _scores()
    left, source = np.diff(rows.start), np.empty(len(faces), np.int32)
    _forsyth(faces, *rows, left, by_left[left], np.zeros(len(faces), np.bool_), by_place, by_left, source)
    return source
