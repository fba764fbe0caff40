"""Tipsify: fast triangle reordering (Sander, Nehab, Barczak 2007, "Fast Triangle Reordering for Vertex Locality and Reduced Overdraw").

Fans around one vertex after another. The next is, among the vertices of the last fan, the oldest one of which all triangles can still be
drawn before it leaves the cache; at a dead end the vertex last seen that has triangles left, then the first such of the input.

What a fan reads of memory is asked for when its vertex is first seen, some fans before.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.checks import MOST_INDICES
from luxel.layout.fans import FIRST, LEFT, ROW, STAMP, U, at, fans
from luxel.layout.gather import gather

_NONE = np.uint32(0xFFFFFFFF)
_LINE = U(14)
"""Words on from a row's first that are likely in the next cache line, and still of the same fan."""


@jit.inlined
def _ask(v, vertex, rows):
    """Have the rows of v brought near."""
    row = ROW * U(vertex[at(v, FIRST)])
    jit.prefetch(rows, row)
    jit.prefetch(rows, row + _LINE)


@jit.inlined
def _next_of_fan(recent, first, last, vertex, now, cache):
    """The vertex of the last fan with most of its time in the cache gone, among those that can be finished in time; _NONE if none has triangles."""
    best, most = _NONE, np.int64(-1)
    for i in range(first, last):
        v = recent[i]
        left, age = np.int64(vertex[at(v, LEFT)]), now - np.int64(vertex[at(v, STAMP)])
        priority = age if age + 2 * left <= cache else np.int64(0)
        priority = priority if left > 0 else np.int64(-1)
        best = v if priority > most else best
        most = max(priority, most)
    return best


@jit.inlined
def _draw(a, b, c, now, cache, vertex, triangles, done):
    """Draw (a, b, c), turned as `luxel.layout.gather` would, so that what the cache holds comes first; return the loads.

    No branch: half of them would be guessed wrong.
    """
    stamp_a, stamp_b, stamp_c = np.int64(vertex[at(a, STAMP)]), np.int64(vertex[at(b, STAMP)]), np.int64(vertex[at(c, STAMP)])
    out_a, out_b, out_c = np.int64(now - stamp_a >= cache), np.int64(now - stamp_b >= cache), np.int64(now - stamp_c >= cache)
    once, twice = out_a & (out_b ^ 1), out_b & (out_c ^ 1)  # turned to (b, c, a) or (c, a, b)
    after = once & out_c  # c is loaded before a
    vertex[at(a, STAMP)] = now + out_a + after if out_a else stamp_a
    vertex[at(b, STAMP)] = now + out_a + out_b if out_b else stamp_b
    now += out_a + out_b + out_c
    vertex[at(c, STAMP)] = now - after if out_c else stamp_c
    vertex[at(a, LEFT)] -= U(1)
    vertex[at(b, LEFT)] -= U(1)
    vertex[at(c, LEFT)] -= U(1)
    triangles[ROW * done + U(2 * once + twice)] = a
    triangles[ROW * done + U(1 - once + twice)] = b
    triangles[ROW * done + U(2 - once - 2 * twice)] = c
    return now


@jit.kernel
def _tipsify(rows, cache, vertex, drawn, recent, source, triangles):
    """Write the order into `source` and `triangles`; return the loads of a FIFO of `cache`.

    `drawn` (m,) holds 0, `recent` (3 m,) is scratch. All arrays are unsigned and have one axis.
    """
    m = U(len(source))
    now, done, seen, cursor, focus = np.int64(cache), U(0), U(0), U(0), _NONE
    while done < m:
        if focus == _NONE:
            while vertex[at(cursor, LEFT)] == 0:
                cursor += U(1)
            focus = np.uint32(cursor)
        first, last_b, last_c = seen, _NONE, _NONE
        for i in range(U(vertex[at(focus, FIRST)]), U(vertex[at(U(focus) + U(1), FIRST)])):
            t, b, c = rows[ROW * i], rows[ROW * i + U(1)], rows[ROW * i + U(2)]
            if drawn[t]:
                continue
            drawn[t] = 1
            source[done] = t
            now = _draw(focus, b, c, now, cache, vertex, triangles, done)
            done += U(1)
            recent[seen] = b
            seen += U(b != last_c)  # neighbours in a fan share an edge
            recent[seen] = c
            seen += U(c != last_b)
            last_b, last_c = b, c
            _ask(b, vertex, rows)
            _ask(c, vertex, rows)
        focus = _next_of_fan(recent, first, seen, vertex, now, cache)
        while focus == _NONE and seen > 0:
            seen -= U(1)
            if vertex[at(recent[seen], LEFT)] > 0:
                focus = recent[seen]
    return now - cache


def tipsify(faces: Array, vertex_count: int, cache: int) -> tuple[Array, Array, int]:
    """Tipsify's order for a FIFO of `cache` vertices: (m,) int32 which triangles, (m, 3) int32 the triangles, turned, and the loads."""
    m, word = len(faces), np.uint32
    cache = min(cache, MOST_INDICES // 2, 3 * m + 3)  # nothing leaves so large a cache
    source, triangles, mesh = np.empty(m, np.int32), np.empty((m, 3), np.int32), fans(faces, vertex_count)
    scratch = np.zeros(m, np.uint8), np.empty(3 * m, word)
    loads = int(_tipsify(mesh.rows, cache, mesh.vertex, *scratch, source.view(word), triangles.reshape(-1).view(word)))
    if mesh.proper:
        return source, triangles, loads
    return source, *gather(faces, source, vertex_count, cache)  # a triangle that names a vertex twice was counted as if it did not
