"""Tipsify: fast triangle reordering (Sander, Nehab, Barczak 2007, "Fast Triangle Reordering for Vertex Locality and Reduced Overdraw").

Fans around one vertex after another. The next is, among the vertices of the last fan, the oldest one of which all triangles can still be
drawn before it leaves the cache; at a dead end the vertex last seen that has triangles left, then the first such of the input.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.adjacency import Adjacency


@jit.part
def _next_of_fan(recent, first, last, live, stamp, now, cache):
    """The vertex of the last fan with most of its time in the cache gone, among those that can be finished in time; -1 if none has triangles."""
    best, most = -1, -1
    for i in range(first, last):
        v = recent[i]
        left = live[v]
        if left > 0:
            age = now - stamp[v]
            priority = age if age + 2 * left <= cache else 0
            if priority > most:
                best, most = v, priority
    return best


@jit.kernel
def _tipsify(faces, start, rows, cache, live, stamp, drawn, recent, source):
    """Write the order into `source`; `live` (n,) and `stamp` (n,) hold 0, `drawn` (m,) False, `recent` (3 m,) is scratch."""
    n = len(live)
    for v in range(n):
        live[v] = start[v + 1] - start[v]
    now, done, seen, cursor = cache + 1, 0, 0, 0
    focus = -1
    while True:
        if focus < 0:
            while cursor < n and live[cursor] == 0:
                cursor += 1
            if cursor == n:
                return done
            focus = cursor
        first = seen
        for i in range(start[focus], start[focus + 1]):
            t = rows[i]
            if not drawn[t]:
                drawn[t] = True
                source[done] = t
                done += 1
                for corner in range(3):
                    v = faces[t, corner]
                    recent[seen] = v
                    seen += 1
                    live[v] -= 1
                    if now - stamp[v] > cache:
                        stamp[v] = now
                        now += 1
        focus = _next_of_fan(recent, first, seen, live, stamp, now, cache)
        while focus < 0 and seen > 0:
            seen -= 1
            if live[recent[seen]] > 0:
                focus = recent[seen]


def tipsify(faces: Array, rows: Adjacency, cache: int) -> Array:
    """(m,) int32: the triangles in Tipsify's order for a FIFO of `cache` vertices."""
    n, m = len(rows.start) - 1, len(faces)
    source = np.empty(m, np.int32)
    _tipsify(faces, *rows, cache, np.empty(n, np.int32), np.zeros(n, np.int32), np.zeros(m, np.bool_), np.empty(3 * m, np.int32), source)
    return source
