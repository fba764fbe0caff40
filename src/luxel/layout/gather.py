"""Triangles in their new order, each turned so that a FIFO looks up what it holds before what it must load.

Where a first miss would push out a vertex that the same triangle needs, it comes after it: one load or two of three can always be made the last, and
the winding stays.

What a FIFO holds depends on all triangles before. Threads share the work all the same: each takes a piece and begins it with an empty cache. Then,
piece after piece, the beginning is done again with what the piece before left in the cache, beside the empty one, until both have loaded the same
vertices for a whole cache: from there on they hold the same, and what was done stands. So the result is that of one thread, to the byte.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.checks import MOST_INDICES
from luxel.layout.fans import ROW, U

PIECE = 1 << 16
"""Triangles of a piece."""
_LARGEST = 1024
"""Vertices of a cache that is soon filled; with larger ones there is one piece."""
_NONE = np.uint32(0xFFFFFFFF)


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


@jit.inlined
def _looked_up(faces, t, pushed, cache, stamp):
    """Triangle t, turned, and how many of its vertices a FIFO with these stamps does not hold."""
    a, b, c = faces[ROW * t], faces[ROW * t + U(1)], faces[ROW * t + U(2)]
    return turned(a, b, c, pushed - stamp[a] >= cache, pushed - stamp[b] >= cache, pushed - stamp[c] >= cache)


@jit.inlined
def _drawn(i, a, b, c, outs, pushed, cache, stamp, triangles):
    """Draw (a, b, c) as number i; return the vertices pushed since the start."""
    triangles[ROW * i], triangles[ROW * i + U(1)], triangles[ROW * i + U(2)] = a, b, c
    if outs:
        for corner in range(3):
            v = triangles[ROW * i + U(corner)]
            if pushed - stamp[v] >= cache:
                pushed += 1
                stamp[v] = pushed
    return pushed


@jit.parallel_kernel
def _pieces(queue, faces, source, cache, size, vertex_count, triangles, loads, held):
    """Each piece from an empty cache: fill `triangles`, `loads` (p,), and `held` (p, cache), the vertices loaded last, the oldest first.

    All whole numbers of arrays are unsigned but `loads`; `held` holds _NONE.
    """
    stamp = np.zeros(vertex_count, np.uint32)
    pushed, piece = np.int64(0), jit.take(queue)
    while piece < len(loads):
        pushed += cache  # all is out
        began, first, last = pushed, U(piece * size), U(min(len(source), (piece + 1) * size))
        for i in range(first, last):
            a, b, c, outs = _looked_up(faces, source[i], pushed, cache, stamp)
            pushed = _drawn(i, a, b, c, outs, pushed, cache, stamp, triangles)
        loads[piece] = pushed - began
        _remember(first, last, pushed, stamp, triangles, held[piece])
        piece = jit.take(queue)


@jit.part
def _remember(first, last, pushed, stamp, triangles, held):
    """Put the vertices in the cache into `held`, the oldest first: they are found among the last triangles, by their stamps."""
    cache = len(held)
    missing, i = np.int64(0), ROW * last
    for k in range(cache):
        missing += held[k] == _NONE
    while missing > 0 and i > ROW * first:
        i -= U(1)
        v = triangles[i]
        place = cache - 1 - (pushed - np.int64(stamp[v]))
        if place >= 0 and held[place] == _NONE:
            held[place] = v
            missing -= 1


@jit.kernel
def _join(faces, source, cache, size, cold, warm, triangles, loads, held):
    """Do the beginning of each piece again with what the one before leaves in the cache. `cold` and `warm` (n,) hold 0; the rest as in `_pieces`."""
    pushed, pushed_cold = np.int64(0), np.int64(0)
    for piece in range(1, len(loads)):
        pushed, pushed_cold, same = pushed + cache, pushed_cold + cache, 0
        for k in range(cache):
            if held[piece - 1, k] != _NONE:
                pushed += 1
                warm[held[piece - 1, k]] = pushed
        began, began_cold, i = pushed, pushed_cold, U(piece * size)
        first, last = i, U(min(len(source), (piece + 1) * size))
        while i < last and same < cache:
            x, y, z, outs_cold = _looked_up(faces, source[i], pushed_cold, cache, cold)
            after_cold = _drawn(i, x, y, z, outs_cold, pushed_cold, cache, cold, triangles)
            a, b, c, outs = _looked_up(faces, source[i], pushed, cache, warm)
            after = _drawn(i, a, b, c, outs, pushed, cache, warm, triangles)
            alike = outs == outs_cold and (outs == 0 or (a == x and b == y))
            same = same + after - pushed if alike else 0
            pushed, pushed_cold, i = after, after_cold, i + U(1)
        loads[piece] += (pushed - began) - (pushed_cold - began_cold)
        if same < cache:  # it ends before they agree
            for k in range(cache):
                held[piece, k] = _NONE
            for k in range(cache):
                v = held[piece - 1, k]
                place = cache - 1 - (pushed - np.int64(warm[v])) if v != _NONE else np.int64(-1)
                if place >= 0:
                    held[piece, place] = v
            _remember(first, last, pushed, warm, triangles, held[piece])


def gather(faces: Array, source: Array, vertex_count: int, cache: int, threads: int = 1) -> tuple[Array, int]:
    """(m, 3) int32: `faces[source]`, turned for a FIFO of `cache`; and how many vertices it loads."""
    m, word = len(source), np.uint32
    cache = min(cache, MOST_INDICES // 2, 3 * len(faces) + 3)  # nothing leaves so large a cache
    size = PIECE if cache <= _LARGEST and threads > 1 else max(m, 1)
    triangles, loads = np.empty_like(faces), np.zeros(-(-m // size), np.int64)
    held = np.full((len(loads), cache if len(loads) > 1 else 0), _NONE)  # one piece need not remember
    flat, order, out = (array.reshape(-1).view(word) for array in (faces, source, triangles))
    jit.run(_pieces, min(threads, len(loads)), flat, order, cache, size, vertex_count, out, loads, held)
    if len(loads) > 1:
        _join(flat, order, cache, size, np.zeros(vertex_count, word), np.zeros(vertex_count, word), out, loads, held)
    return triangles, int(loads.sum())


def left_in_cache(faces: Array, vertex_count: int, cache: int) -> Array:
    """(k,) int32: the vertices that a FIFO of `cache` holds after `faces`, drawn from an empty one and turned; the oldest first."""
    m, word = len(faces), np.uint32
    held, source = np.full((1, cache), _NONE), np.arange(m, dtype=word)
    jit.run(_pieces, 1, faces.reshape(-1).view(word), source, cache, max(m, 1), vertex_count, np.empty(3 * m, word), np.zeros(1, np.int64), held)
    return held[held != _NONE].view(np.int32)
