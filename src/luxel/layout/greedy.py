"""Greedy orders for a FIFO cache in one pass: K-Cache-Reorder (Lin and Yu 2006), its variant of 2016, and one with a fitted cost.

Vertices are white (not in the cache), grey (in it) or black (all their triangles drawn). The grey vertex of least cost becomes the focus, and
all its triangles are drawn; without a grey one the vertex last seen that has triangles left, then the first white one of the input.

The costs' terms, and how they are read here (readings differ between codes):

- C1: vertices that must be loaded to draw all undrawn triangles of v, one more than `open` - `left` but at least 0 (0 if `open` is 0): `left` is the
  number of its undrawn triangles, `open` that of their corners outside the cache, a corner counted once a triangle. On a fan that is exact.
- C2: triangles drawn before v turns black: `left`.
- C3: 1 - (age + C1) / K: v's place in the cache when it turns black, 1 at the new end and 0 at the old end, so that old vertices that
  survive are cheap. One that would be gone before it is done has `gone` instead.

`greedy` costs what a search over such tables found best (`luxel.layout.fitted`).
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
from luxel.layout.adjacency import adjacency, bounded
from luxel.layout.fans import FIRST, LEFT, OPEN, ROW, STAMP, U, at, fans
from luxel.layout.fitted import FITTED, fitted_cost

OPEN_CELLS, LEFT_CELLS = 16, 8
"""The table's cells along `open` and `left`; larger numbers count as the largest."""
VALENCE = 32
"""Most triangles of a vertex; hubs with more are cut."""
_STACK = 1 << 16
_DRAWN = np.uint8(100)
_NONE, _NO_ROW = np.uint32(0xFFFFFFFF), U(0xFFFFFFFFFFFFFFFF)
_MOST_OPEN, _MOST_LEFT = np.uint32(OPEN_CELLS - 1), np.uint32(LEFT_CELLS)
_AGE = U((LEFT_CELLS + 1) * OPEN_CELLS)


@jit.part
def _shift(v, by, vertex, held, rows):
    """Vertex v enters (`by` 1) or leaves (-1) the cache: tell its undrawn triangles and their other corners.

    Return by bits which of its triangles need no more vertex. What is drawn is told nothing, without a branch: half would be guessed wrong.
    """
    ready, bit, step = U(0), U(1), np.uint32(by)
    for i in range(U(vertex[at(v, FIRST)]), U(vertex[at(U(v) + U(1), FIRST)])):
        t = rows[ROW * i]
        add = step if held[t] < 4 else np.uint32(0)
        now_held = np.uint8(held[t] + add)
        held[t] = now_held
        vertex[at(rows[ROW * i + U(1)], OPEN)] -= add
        vertex[at(rows[ROW * i + U(2)], OPEN)] -= add
        ready |= bit if now_held == 3 else U(0)
        bit <<= U(1)
    return ready


@jit.part
def _draw(t, a, b, c, now, cache, vertex, held, source, done):
    """Triangle t = (a, b, c) is drawn."""
    if held[t] != 3:  # one that needed two vertices, of which the first pushed the third out
        out_a, out_b, out_c = now - vertex[at(a, STAMP)] >= cache, now - vertex[at(b, STAMP)] >= cache, now - vertex[at(c, STAMP)] >= cache
        vertex[at(a, OPEN)] -= out_b + out_c
        vertex[at(b, OPEN)] -= out_a + out_c
        vertex[at(c, OPEN)] -= out_a + out_b
    held[t] = _DRAWN
    vertex[at(a, LEFT)] -= 1
    vertex[at(b, LEFT)] -= 1
    vertex[at(c, LEFT)] -= 1
    source[done] = t


@jit.part
def _push(v, focus, keep, now, done, cache, vertex, held, rows, ring, stack, source):
    """Load v as number `now`, draw the triangle of `focus` at `keep` (or _NO_ROW), drop the oldest, draw what can be; return the triangles done."""
    mask = U(len(ring) - 1)
    old = ring[U(now - cache) & mask]
    ring[U(now) & mask] = v
    stack[U(now) & U(_STACK - 1)] = v
    vertex[at(v, STAMP)] = now
    ready = _shift(v, 1, vertex, held, rows)
    if keep != _NO_ROW:
        _draw(rows[keep], focus, rows[keep + U(1)], rows[keep + U(2)], now, cache + 1, vertex, held, source, done)
        done += U(1)
    if old != _NONE and vertex[at(old, LEFT)] > 0:
        _shift(old, -1, vertex, held, rows)
    first = U(vertex[at(v, FIRST)])
    while ready:
        row = ROW * (first + U(jit.lowest_bit(ready)))
        ready &= ready - U(1)
        if held[rows[row]] == 3:
            _draw(rows[row], v, rows[row + U(1)], rows[row + U(2)], now, cache, vertex, held, source, done)
            done += U(1)
    return done


@jit.part
def _best_triangle(v, vertex, held, rows):
    """The row of the undrawn triangle of v with most corners in the cache; the one whose other corner there is oldest, of equals."""
    best, rank = U(0), np.int64(-1)
    for i in range(U(vertex[at(v, FIRST)]), U(vertex[at(U(v) + U(1), FIRST)])):
        corners = np.int64(held[rows[ROW * i]])
        stamp = max(vertex[at(rows[ROW * i + U(1)], STAMP)], vertex[at(rows[ROW * i + U(2)], STAMP)])
        this = (corners << 32) + 0xFFFFFFFF - np.int64(stamp)
        this = this if corners < 4 else np.int64(-2)
        best = i if this > rank else best
        rank = max(this, rank)
    return ROW * best


@jit.inlined
def _cheapest(now, cache, vertex, ring, costs):
    """The grey vertex of least cost, _NONE if none is grey; the oldest of equals. Black ones cost infinity: a branch would be guessed wrong."""
    mask, best, least = U(len(ring) - 1), _NONE, np.float32(np.inf)
    held = U(min(cache, now - cache))
    for k in range(held):
        age = held - U(1) - k
        v = ring[(U(now) - age) & mask]
        cost = costs[age * _AGE + U(min(vertex[at(v, LEFT)], _MOST_LEFT)) * U(OPEN_CELLS) + min(vertex[at(v, OPEN)], _MOST_OPEN)]
        best = v if cost < least else best
        least = min(cost, least)
    return best


@jit.part
def _finish(focus, now, done, cache, vertex, held, rows, ring, stack, source):
    """Draw the triangles of `focus`, until it is black or gone; return the vertices loaded and the triangles done."""
    while vertex[at(focus, LEFT)] > 0 and now - vertex[at(focus, STAMP)] < cache:
        row = _best_triangle(focus, vertex, held, rows)
        t, b, c = rows[row], rows[row + U(1)], rows[row + U(2)]
        out_b, out_c = now - vertex[at(b, STAMP)] >= cache, b != c and now - vertex[at(c, STAMP)] >= cache
        if out_b and out_c:  # c first: 0.3 % fewer loads at 12 than b first
            now += 1
            done = _push(c, focus, _NO_ROW, now, done, cache, vertex, held, rows, ring, stack, source)
        keep = row if held[t] < 4 else _NO_ROW
        last = b if out_b else c
        if (out_b or out_c) and now - vertex[at(last, STAMP)] >= cache:
            now += 1
            done = _push(last, focus, keep, now, done, cache, vertex, held, rows, ring, stack, source)
        elif keep != _NO_ROW:
            _draw(t, focus, b, c, now, cache, vertex, held, source, done)
            done += U(1)
    return now, done


@jit.kernel
def _greedy(warm, cache, costs, vertex, held, rows, ring, stack, source):
    """Write the order into `source`; `ring` holds _NONE in a power of two places, more than `cache`. Arrays of whole numbers are unsigned.

    `warm` (k,) are vertices that the cache holds at the beginning, the oldest first.
    """
    m = U(len(source))
    now, done, cursor = np.int64(cache), U(0), U(0)
    for i in range(U(len(warm))):
        now += 1
        done = _push(warm[i], _NONE, _NO_ROW, now, done, cache, vertex, held, rows, ring, stack, source)
    while done < m:
        focus = _cheapest(now, cache, vertex, ring, costs)
        if focus == _NONE:
            top, bottom = now, max(np.int64(cache), now - _STACK)
            while top > bottom and vertex[at(stack[U(top) & U(_STACK - 1)], LEFT)] == 0:
                top -= 1
            if top > bottom:
                focus = stack[U(top) & U(_STACK - 1)]
            else:
                while vertex[at(cursor, LEFT)] == 0:
                    cursor += U(1)
                focus = np.uint32(cursor)
            now += 1
            done = _push(focus, _NONE, _NO_ROW, now, done, cache, vertex, held, rows, ring, stack, source)
        now, done = _finish(focus, now, done, cache, vertex, held, rows, ring, stack, source)
    return now


_COLD = np.zeros(0, np.int32)
WEIGHTS = {"lin-yu": (1.0, 0.5, 0.7, 1.0), "greedy-2016": (1.0, 0.5, 1.3, 1.0)}
"""k1, k2, k3 and `gone` of each cost."""


@lru_cache(64)
def cost_table(name: str, weights: tuple[float, ...] | None, cache: int, target: str = "fifo") -> Array:
    """(cache, OPEN_CELLS, LEFT_CELLS) float32, read-only: the cost of a vertex by age, open corners and triangles left - 1.

    Args:
        name: "greedy", "lin-yu" or "greedy-2016".
        weights: k1, k2, k3 and, if there is a fourth, `gone` of the last two; None: those of `WEIGHTS`.
        cache: Vertices of the FIFO.
        target: Which of `fitted.FITTED` "greedy" takes.
    """
    age, opened, left = np.ogrid[:cache, :OPEN_CELLS, 1 : LEFT_CELLS + 1]
    c1 = np.where(opened > 0, np.maximum(opened - left + 1, 0), 0)
    if name == "greedy":
        return _read_only(fitted_cost(FITTED[target], age, c1, left, cache))
    k1, k2, k3, gone = (*(weights or WEIGHTS[name]), WEIGHTS[name][3])[:4]
    c3 = np.where(age + c1 <= cache, 1 - (age + c1) / cache, gone)
    cost = k1 * c1 - k2 * left + k3 * c3 if name == "lin-yu" else k1 * c1 + k2 / left + k3 * c3 + c1 / left
    return _read_only(np.ascontiguousarray(np.broadcast_to(cost, (cache, OPEN_CELLS, LEFT_CELLS)), np.float32))


def _read_only(table: Array) -> Array:
    table.flags.writeable = False
    return table


def greedy(faces: Array, vertex_count: int, cache: int, costs: Array, warm: Array = _COLD) -> Array:
    """(m,) int32: the triangles in the greedy order of these costs for a FIFO of `cache` vertices.

    Args:
        faces: (m, 3) int32 below `vertex_count`.
        vertex_count: Of the mesh.
        cache: Of the FIFO.
        costs: From `cost_table`.
        warm: (k,) int32 different vertices that the cache holds at the beginning, the oldest first; at most `cache`.
    """
    mesh = fans(faces, vertex_count)
    if mesh.most > VALENCE:
        faces, rows = bounded(faces, adjacency(faces, vertex_count), VALENCE)
        mesh = fans(faces, len(rows.start) - 1)
    m, word = len(faces), np.uint32
    table = np.full((cache, LEFT_CELLS + 1, OPEN_CELLS), np.inf, np.float32)
    table[:, 1:] = costs.transpose(0, 2, 1)
    source, ring = np.empty(m, np.int32), np.full(1 << cache.bit_length(), _NONE)
    scratch = np.zeros(m, np.uint8), mesh.rows, ring, np.empty(_STACK, word)
    _greedy(warm.view(word), cache, table.reshape(-1), mesh.vertex, *scratch, source.view(word))
    return source
