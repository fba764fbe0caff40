"""Greedy orders for a FIFO cache in one pass: K-Cache-Reorder (Lin and Yu 2006), its variant of 2016, and one with a fitted cost.

Vertices are white (not in the cache), grey (in it) or black (all their triangles drawn). The grey vertex of least cost becomes the focus, and
all its triangles are drawn; without a grey one the vertex last seen that has triangles left, then the first white one of the input.

The costs' terms, and how they are read here (readings differ between codes):

- C1: vertices that must be loaded to draw all undrawn triangles of v, one more than `open` - `left` but at least 0 (0 if `open` is 0): `left` is the
  number of its undrawn triangles, `open` that of their corners outside the cache, a corner counted once a triangle. On a fan that is exact.
- C2: triangles drawn before v turns black: `left`.
- C3: 1 - (age + C1) / K: v's place in the cache when it turns black, 1 at the new end and 0 at the old end, so that old vertices that
  survive are cheap. One that would be gone before it is done has `gone` instead.

`greedy` costs what a search over such tables found best (see `_fitted`): fitted for FIFOs of 12 and 16 on fandisk, lionstatue and beetle.
`lin-yu` costs k1 C1 - k2 C2 + k3 C3, `greedy-2016` k1 C1 + k2 / C2 + k3 C3 + C1 / C2. A cost depends on the age, `open` and `left` only, so it is
a table, and the pass is the same for all of them.

What differs from both papers: C1 is kept while vertices enter and leave the cache, so a candidate costs one look-up, and a fan starts at its oldest
end (see docs/decisions/0008-mesh-layout.md).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.adjacency import Adjacency, bounded

OPEN, LEFT = 16, 8
"""The table's cells along `open` and `left`; larger numbers count as the largest."""
VALENCE = 32
"""Most triangles of a vertex; hubs with more are cut."""
_STACK = 1 << 16
_DRAWN = 100
_STAMP, _LEFT, _OPEN, _FIRST = 0, 1, 2, 3
_ONE, _NONE = np.uint32(1), np.uint32(0xFFFFFFFF)
_MOST_OPEN, _MOST_LEFT = np.uint32(OPEN - 1), np.uint32(LEFT)


@jit.kernel
def _records(start, vertex):
    """Fill `vertex` (n, 4): stamp, triangles left, open corners, first row."""
    for v in range(len(vertex)):
        valence = start[v + 1] - start[v]
        vertex[v, _STAMP] = 0
        vertex[v, _LEFT] = valence
        vertex[v, _OPEN] = 2 * valence
        vertex[v, _FIRST] = start[v]


@jit.kernel
def _corners(faces, face):
    """Fill `face` (m, 4): the three vertices, and how many of them the cache holds."""
    for t in range(len(face)):
        face[t, 0], face[t, 1], face[t, 2], face[t, 3] = faces[t, 0], faces[t, 1], faces[t, 2], 0


@jit.part
def _shift(v, by, vertex, face, start, rows):
    """Vertex v enters (`by` 1) or leaves (-1) the cache: tell its undrawn triangles and their other corners."""
    for i in range(vertex[v, _FIRST], start[v + _ONE]):
        t = rows[i]
        if face[t, 3] < 4:
            face[t, 3] += by
            vertex[face[t, 0], _OPEN] -= by
            vertex[face[t, 1], _OPEN] -= by
            vertex[face[t, 2], _OPEN] -= by
    vertex[v, _OPEN] += by * vertex[v, _LEFT]


@jit.part
def _draw(t, vertex, face, now, cache, source, done):
    """Triangle t is drawn."""
    a, b, c = face[t, 0], face[t, 1], face[t, 2]
    if face[t, 3] != 3:  # one that needed two vertices, of which the first pushed the third out
        out_a, out_b, out_c = now - vertex[a, _STAMP] >= cache, now - vertex[b, _STAMP] >= cache, now - vertex[c, _STAMP] >= cache
        vertex[a, _OPEN] -= out_b + out_c
        vertex[b, _OPEN] -= out_a + out_c
        vertex[c, _OPEN] -= out_a + out_b
    face[t, 3] = _DRAWN
    vertex[a, _LEFT] -= 1
    vertex[b, _LEFT] -= 1
    vertex[c, _LEFT] -= 1
    source[done] = t


@jit.part
def _push(v, keep, now, done, cache, vertex, face, start, rows, ring, stack, source):
    """Load v as the vertex number `now`, draw triangle `keep` (or _NONE), drop the oldest, draw what can be drawn; return how many are done."""
    mask = np.uint64(len(ring) - 1)
    old = ring[np.uint64(now - cache) & mask]
    ring[np.uint64(now) & mask] = v
    stack[np.uint64(now) & np.uint64(_STACK - 1)] = v
    vertex[v, _STAMP] = now
    _shift(v, 1, vertex, face, start, rows)
    if keep != _NONE:
        _draw(keep, vertex, face, now, cache + 1, source, done)
        done += 1
    if old != _NONE and vertex[old, _LEFT] > 0:
        _shift(old, -1, vertex, face, start, rows)
    if vertex[v, _LEFT] > 0:
        for i in range(vertex[v, _FIRST], start[v + _ONE]):
            t = rows[i]
            if face[t, 3] == 3:
                _draw(t, vertex, face, now, cache, source, done)
                done += 1
    return done


@jit.part
def _best_triangle(v, vertex, face, start, rows):
    """The undrawn triangle of v with most corners in the cache; the one whose other corner there is oldest, of equals."""
    best, rank = _NONE, np.int64(-1)
    for i in range(vertex[v, _FIRST], start[v + _ONE]):
        t = rows[i]
        held = np.int64(face[t, 3])
        if held < 4:
            stamp = np.int64(0)
            for corner in range(3):
                u = face[t, corner]
                stamp = max(stamp, np.int64(vertex[u, _STAMP]) if u != v else np.int64(0))
            this = (held << 32) + 0xFFFFFFFF - stamp
            best = t if this > rank else best
            rank = max(this, rank)
    return best


@jit.inlined
def _cheapest(now, cache, vertex, ring, costs):
    """The grey vertex of least cost, _NONE if none is grey; the oldest of equals. Black ones cost infinity: a branch would be guessed wrong."""
    mask, best, least = np.uint64(len(ring) - 1), _NONE, np.float32(np.inf)
    held = min(cache, now - cache)
    for k in range(np.uint64(held)):
        age = np.uint64(held - 1) - k
        v = ring[(np.uint64(now) - age) & mask]
        cost = costs[age, min(vertex[v, _LEFT], _MOST_LEFT), min(vertex[v, _OPEN], _MOST_OPEN)]
        best = v if cost < least else best
        least = min(cost, least)
    return best


@jit.part
def _finish(focus, now, done, cache, vertex, face, start, rows, ring, stack, source):
    """Draw the triangles of `focus`, until it is black or gone; return the vertices loaded and the triangles done."""
    while vertex[focus, _LEFT] > 0 and now - vertex[focus, _STAMP] < cache:
        t = _best_triangle(focus, vertex, face, start, rows)
        first, last = _NONE, _NONE
        for corner in range(3):
            u = face[t, corner]
            if now - vertex[u, _STAMP] >= cache and u != last:
                first, last = last, u
        if first != _NONE:
            now += 1
            done = _push(first, _NONE, now, done, cache, vertex, face, start, rows, ring, stack, source)
        keep = t if face[t, 3] < 4 else _NONE
        if last != _NONE and now - vertex[last, _STAMP] >= cache:
            now += 1
            done = _push(last, keep, now, done, cache, vertex, face, start, rows, ring, stack, source)
        elif keep != _NONE:
            _draw(keep, vertex, face, now, cache, source, done)
            done += 1
    return now, done


@jit.kernel
def _greedy(vertex, face, start, rows, cache, costs, ring, stack, source):
    """Write the order into `source`; `ring` holds _NONE in a power of two places, more than `cache`. All but `costs` and `source` are uint32:
    Numba counts negative indices from the end, which unsigned ones need not be asked for."""
    m = len(face)
    now, done, cursor = np.int64(cache), 0, 0
    while done < m:
        focus = _cheapest(now, cache, vertex, ring, costs)
        if focus == _NONE:
            top, bottom = now, max(np.int64(cache), now - _STACK)
            while top > bottom and vertex[stack[top & (_STACK - 1)], _LEFT] == 0:
                top -= 1
            if top > bottom:
                focus = stack[top & (_STACK - 1)]
            else:
                while vertex[cursor, _LEFT] == 0:
                    cursor += 1
                focus = np.uint32(cursor)
            now += 1
            done = _push(focus, _NONE, now, done, cache, vertex, face, start, rows, ring, stack, source)
        now, done = _finish(focus, now, done, cache, vertex, face, start, rows, ring, stack, source)
    return now


WEIGHTS = {"lin-yu": (1.0, 0.5, 0.7, 1.0), "greedy-2016": (1.0, 0.5, 1.3, 1.0)}
"""k1, k2, k3 and `gone` of each cost."""


_LOAD = np.array([0.0, 0.768, 1.681, 3.071, 4.284, 4.52])
_LAST = np.array([0.0, -0.162, -1.574, -1.965, -2.178, -3.675])
_SLOPE = np.array([0.42, 0.962, 0.887, 0.784, 0.952, -0.62])
_CURVE = np.array([1.001, -1.2, 0.58, 0.05, -0.019, 0.291])
_GONE = -0.169
"""The fitted cost, by C1 = 0 .. 5 and by triangles left = 1 .. 6, and more."""


def _fitted(age: Array, c1: Array, left: Array, cache: int) -> Array:
    """The table of `greedy`: a load for C1, one for C2, and a parabola over the place in the cache by the time v turns black."""
    c, last = np.minimum(c1, 5), np.minimum(left, 6) - 1
    place = (age + c) / cache
    cost = _LOAD[c] + _LAST[last] + np.where(place > 1, _GONE, place * (_CURVE[c] * place - _SLOPE[c]))
    return np.ascontiguousarray(cost, np.float32)


@lru_cache(64)
def cost_table(name: str, weights: tuple[float, ...] | None, cache: int) -> Array:
    """(cache, OPEN, LEFT) float32, read-only: the cost of a vertex by age, open corners and triangles left - 1.

    Args:
        name: "greedy", "lin-yu" or "greedy-2016".
        weights: k1, k2, k3 and, if there is a fourth, `gone` of the last two; None: those of `WEIGHTS`.
        cache: Vertices of the FIFO.
    """
    age, opened, left = np.ogrid[:cache, :OPEN, 1 : LEFT + 1]
    c1 = np.where(opened > 0, np.maximum(opened - left + 1, 0), 0)
    if name == "greedy":
        return _read_only(_fitted(age, c1, left, cache))
    k1, k2, k3, gone = (*(weights or WEIGHTS[name]), WEIGHTS[name][3])[:4]
    c3 = np.where(age + c1 <= cache, 1 - (age + c1) / cache, gone)
    cost = k1 * c1 - k2 * left + k3 * c3 if name == "lin-yu" else k1 * c1 + k2 / left + k3 * c3 + c1 / left
    return _read_only(np.ascontiguousarray(np.broadcast_to(cost, (cache, OPEN, LEFT)), np.float32))


def _read_only(table: Array) -> Array:
    table.flags.writeable = False
    return table


def greedy(faces: Array, rows: Adjacency, cache: int, costs: Array) -> Array:
    """(m,) int32: the triangles in the greedy order of these costs for a FIFO of `cache` vertices."""
    faces, rows = bounded(faces, rows, VALENCE)
    n, m = len(rows.start) - 1, len(faces)
    vertex, face, source = np.empty((n, 4), np.uint32), np.empty((m, 4), np.uint32), np.empty(m, np.int32)
    _records(rows.start, vertex)
    _corners(faces, face)
    ring = np.full(1 << cache.bit_length(), _NONE)
    table = np.full((cache, LEFT + 1, OPEN), np.inf, np.float32)
    table[:, 1:] = costs.transpose(0, 2, 1)
    start, triangles = rows.start.view(np.uint32), rows.triangles.view(np.uint32)
    _greedy(vertex, face, start, triangles, cache, table, ring, np.empty(_STACK, np.uint32), source)
    return source
