"""Tipsify: fast triangle reordering (Sander, Nehab, Barczak 2007, "Fast Triangle Reordering for Vertex Locality and Reduced Overdraw").

Fans around one vertex after another. The next is, among the vertices of the last fan, the oldest one of which all triangles can still be
drawn before it leaves the cache; at a dead end the vertex last seen that has triangles left, then the first such of the input.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.adjacency import Adjacency
from luxel.layout.gather import turned

_STAMP, _LEFT = 0, 1
_NONE = np.uint32(0xFFFFFFFF)


@jit.part
def _next_of_fan(recent, first, last, vertex, now, cache):
    """The vertex of the last fan with most of its time in the cache gone, among those that can be finished in time; _NONE if none has triangles."""
    best, most = _NONE, np.int64(-1)
    for i in range(first, last):
        v = recent[i]
        left, age = np.int64(vertex[v, _LEFT]), now - vertex[v, _STAMP]
        priority = age if age + 2 * left <= cache else np.int64(0)
        priority = priority if left > 0 else np.int64(-1)
        best = v if priority > most else best
        most = max(priority, most)
    return best


@jit.kernel
def _tipsify(faces, start, rows, cache, vertex, drawn, recent, source, triangles):
    """Write the order into `source` and `triangles`; return the loads of a FIFO of `cache`.

    `vertex` (n, 2) and `recent` (3 m,) are scratch, `drawn` (m,) holds 0. All arrays are unsigned.
    """
    n, m = len(vertex), len(faces)
    for v in range(n):
        vertex[v, _STAMP], vertex[v, _LEFT] = 0, start[v + 1] - start[v]
    now, done, seen, cursor = np.int64(cache), np.uint64(0), np.uint64(0), np.uint64(0)
    one, focus, last = np.uint64(1), _NONE, _NONE
    while done < m:
        if focus == _NONE:
            while vertex[cursor, _LEFT] == 0:
                cursor += one
            focus = np.uint32(cursor)
        first = seen
        for i in range(start[focus], start[focus + np.uint32(1)]):
            t = rows[i]
            if drawn[t] == 0:
                drawn[t] = 1
                source[done] = t
                a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
                a, b, c, _ = turned(a, b, c, now - vertex[a, _STAMP] >= cache, now - vertex[b, _STAMP] >= cache, now - vertex[c, _STAMP] >= cache)
                triangles[done, 0], triangles[done, 1], triangles[done, 2] = a, b, c
                for corner in range(3):
                    v = triangles[done, corner]
                    vertex[v, _LEFT] -= 1
                    if now - vertex[v, _STAMP] >= cache:
                        now += 1
                        vertex[v, _STAMP] = now
                    recent[seen] = v
                    seen += np.uint64((v != focus) & (v != last))  # neighbours in a fan share an edge
                    last = v
                done += one
        focus = _next_of_fan(recent, first, seen, vertex, now, cache)
        while focus == _NONE and seen > 0:
            seen -= one
            if vertex[recent[seen], _LEFT] > 0:
                focus = recent[seen]
    return now - cache


def tipsify(faces: Array, rows: Adjacency, cache: int) -> tuple[Array, Array, int]:
    """Tipsify's order for a FIFO of `cache` vertices: (m,) int32 which triangles, (m, 3) int32 the triangles, turned, and the loads."""
    n, m = len(rows.start) - 1, len(faces)
    source, triangles, word = np.empty(m, np.int32), np.empty((m, 3), np.int32), np.uint32
    arrays = (array.view(word) for array in (faces, rows.start, rows.triangles))
    scratch = np.empty((n, 2), word), np.zeros(m, np.uint8), np.empty(3 * m, word)
    return source, triangles, int(_tipsify(*arrays, cache, *scratch, source.view(word), triangles.view(word)))
