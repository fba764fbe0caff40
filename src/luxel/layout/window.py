"""What look-ahead's partial orders hold, and what happens to it when they draw.

The orders differ only in the last few dozen fans. So each holds a small private state (a few kilobytes, copied when an order branches) over a window
of the mesh with numbers of its own; vertices enter the window when some order first loads them, and `sweep` renumbers what is still needed.

Indices are unsigned (see `luxel.layout.greedy`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.greedy import VALENCE

DRAWN = 100
"""In place of the number of corners that the cache holds."""
NONE, NOWHERE = np.uint32(0xFFFFFFFF), np.uint16(0xFFFF)
STACK = 4096


class Whole(NamedTuple):
    """The mesh: faces (m, 3), adjacency, triangles left around each vertex as of the last sweep, what is drawn, and places in the window or -1."""

    faces: Array
    start: Array
    rows: Array
    left: Array
    drawn: Array
    vertex_place: Array
    triangle_place: Array


class Window(NamedTuple):
    """The part of the mesh that the orders differ in, with numbers of its own.

    Attributes:
        corners: (t, 3) int16, the vertices of a triangle, as places.
        triangles: (t,) int32, its number in the mesh.
        vertices: (v,) int32.
        rows: (v, VALENCE) int16, triangles around a vertex, as places.
        counts: (v,) int16, how many of them there are.
        known: (v,) uint8, whether they are all.
        size: (2,) int64, triangles and vertices in use.
    """

    corners: Array
    triangles: Array
    vertices: Array
    rows: Array
    counts: Array
    known: Array
    size: Array


class Orders(NamedTuple):
    """The partial orders, one a row.

    Attributes:
        held: (s, t) int16, how many corners of a triangle the cache holds, or DRAWN.
        left, open: (s, v) int16, as of the greedy order.
        stamp: (s, v) int32, when the vertex was last loaded.
        ring: (s, r) int16, the vertices loaded last.
        now, lost, done: (s,) int32, vertices loaded, dropped alive, and triangles drawn.
        mark: (s,) uint64, a hash of the triangles drawn.
        node: (s,) int32, the last fan in the tree.
        fresh: (s, f) int32, triangles of the last fan.
        fresh_count: (s,) int32.
    """

    held: Array
    left: Array
    open: Array
    stamp: Array
    ring: Array
    now: Array
    lost: Array
    done: Array
    mark: Array
    node: Array
    fresh: Array
    fresh_count: Array


@jit.inlined
def _mix(t):
    """Bits of a triangle's number, scrambled (Stafford's variant 13 of the 64-bit finalizer)."""
    x = np.uint64(t) + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@jit.part
def place_vertex(v, whole, window, orders, cache):
    """The place of vertex v, a new one if it has none. No order has loaded it, nor a neighbour by an undrawn triangle, so all see it alike."""
    p = whole.vertex_place[v]
    if p >= 0:
        return np.uint32(p)
    p = window.size[1]
    window.size[1] = p + 1
    whole.vertex_place[v] = p
    window.vertices[p], window.counts[p], window.known[p] = v, 0, 0
    left = whole.left[v]
    for s in range(len(orders.now)):
        orders.left[s, p] = left
        orders.open[s, p] = 2 * left
        orders.stamp[s, p] = -cache
    return np.uint32(p)


@jit.part
def _know(p, whole, window, orders, cache):
    """Bring all undrawn triangles of the vertex at p into the window; False if there is no room."""
    if window.known[p]:
        return True
    if window.size[0] + VALENCE > len(window.triangles) or window.size[1] + 2 * VALENCE > len(window.vertices):
        return False
    v = window.vertices[p]
    for i in range(whole.start[v], whole.start[v + np.uint32(1)]):
        t = whole.rows[i]
        if whole.drawn[t] or whole.triangle_place[t] >= 0:
            continue
        q = window.size[0]
        window.size[0] = q + 1
        whole.triangle_place[t] = q
        window.triangles[q] = t
        for s in range(len(orders.now)):
            orders.held[s, q] = 0
        for corner in range(3):
            u = place_vertex(whole.faces[t, corner], whole, window, orders, cache)
            window.corners[q, corner] = u
            window.rows[u, window.counts[u]] = q
            window.counts[u] += 1
    window.known[p] = 1
    return True


@jit.inlined
def copy_order(a, b, window, orders):
    """Order b becomes a copy of order a."""
    triangles, vertices = window.size[0], window.size[1]
    for i in range(triangles):
        orders.held[b, i] = orders.held[a, i]
    for i in range(vertices):
        orders.left[b, i] = orders.left[a, i]
    for i in range(vertices):
        orders.open[b, i] = orders.open[a, i]
    for i in range(vertices):
        orders.stamp[b, i] = orders.stamp[a, i]
    for i in range(orders.ring.shape[1]):
        orders.ring[b, i] = orders.ring[a, i]
    orders.now[b], orders.lost[b], orders.done[b] = orders.now[a], orders.lost[a], orders.done[a]
    orders.mark[b], orders.node[b], orders.fresh_count[b] = orders.mark[a], orders.node[a], 0


@jit.inlined
def _shift(s, p, by, window, orders):
    """In order s the vertex at p enters (`by` 1) or leaves (-1) the cache."""
    for i in range(window.counts[p]):
        t = window.rows[p, i]
        if orders.held[s, t] < 4:
            orders.held[s, t] += by
            orders.open[s, window.corners[t, 0]] -= by
            orders.open[s, window.corners[t, 1]] -= by
            orders.open[s, window.corners[t, 2]] -= by
    orders.open[s, p] += by * orders.left[s, p]


@jit.inlined
def draw(s, t, cache, window, orders):
    """Order s draws the triangle at t, with a cache that holds `cache` vertices."""
    a, b, c = window.corners[t, 0], window.corners[t, 1], window.corners[t, 2]
    if orders.held[s, t] != 3:
        gone = orders.now[s] - cache
        out_a, out_b, out_c = orders.stamp[s, a] <= gone, orders.stamp[s, b] <= gone, orders.stamp[s, c] <= gone
        orders.open[s, a] -= out_b + out_c
        orders.open[s, b] -= out_a + out_c
        orders.open[s, c] -= out_a + out_b
    orders.held[s, t] = DRAWN
    orders.left[s, a] -= 1
    orders.left[s, b] -= 1
    orders.left[s, c] -= 1
    number = window.triangles[t]
    orders.mark[s] ^= _mix(number)
    orders.fresh[s, orders.fresh_count[s]] = number
    orders.fresh_count[s] += 1
    orders.done[s] += 1


@jit.inlined
def push(s, p, keep, cache, whole, window, orders):
    """Order s loads the vertex at p, draws `keep` (or NONE), drops the oldest vertex and draws what it can; False if the window is full."""
    if not _know(p, whole, window, orders, cache):
        return False
    mask = np.uint64(orders.ring.shape[1] - 1)
    now = orders.now[s] + 1
    orders.now[s] = now
    old = orders.ring[s, np.uint64(now - cache) & mask]
    orders.ring[s, np.uint64(now) & mask] = p
    orders.stamp[s, p] = now
    _shift(s, p, 1, window, orders)
    if keep != NONE:
        draw(s, keep, cache + 1, window, orders)
    if old != NOWHERE and orders.left[s, old] > 0:
        _shift(s, old, -1, window, orders)
        orders.lost[s] += 1
    if orders.left[s, p] > 0:
        for i in range(window.counts[p]):
            t = np.uint32(window.rows[p, i])
            if orders.held[s, t] == 3:
                draw(s, t, cache, window, orders)
    return True


@jit.part
def sweep(beam, count, cache, whole, window, orders, stack, cursors, vertex_to, triangle_to):
    """Keep of the window what is in some cache, around it, or drawn by some orders only; renumber it."""
    triangles, vertices = window.size[0], window.size[1]
    mask = orders.ring.shape[1] - 1
    for p in range(vertices):
        vertex_to[p] = 0
        window.known[p] = 0
    for i in range(count):
        s = beam[i]
        for age in range(min(cache, np.int64(orders.now[s]))):
            p = orders.ring[s, (orders.now[s] - age) & mask]
            vertex_to[p] = 1
            window.known[p] = 1
    kept = 0
    for t in range(triangles):
        drawn, near = 0, False
        for i in range(count):
            drawn += orders.held[beam[i], t] == DRAWN
        for corner in range(3):
            near |= window.known[window.corners[t, corner]] == 1
        triangle_to[t] = -1
        if drawn == count:
            whole.drawn[window.triangles[t]] = 1
            for corner in range(3):
                whole.left[window.vertices[window.corners[t, corner]]] -= 1
        elif near or drawn > 0:
            triangle_to[t] = kept
            kept += 1
            for corner in range(3):
                vertex_to[window.corners[t, corner]] = 1
        if triangle_to[t] < 0:
            whole.triangle_place[window.triangles[t]] = -1
    used = 0
    for p in range(vertices):
        v = window.vertices[p]
        if vertex_to[p] > 0:
            vertex_to[p] = used
            window.vertices[used], window.known[used], window.counts[used] = v, window.known[p], 0
            whole.vertex_place[v] = used
            used += 1
        else:
            vertex_to[p] = -1
            whole.vertex_place[v] = -1
            if whole.left[v] > 0 and orders.stamp[beam[0], p] > -cache:
                stack[cursors[0] % STACK] = v
                cursors[0] += 1
    for t in range(triangles):
        q = triangle_to[t]
        if q >= 0:
            window.triangles[q] = window.triangles[t]
            whole.triangle_place[window.triangles[q]] = q
            for corner in range(3):
                u = vertex_to[window.corners[t, corner]]
                window.corners[q, corner] = u
                window.rows[u, window.counts[u]] = q
                window.counts[u] += 1
    window.size[0], window.size[1] = kept, used
    for i in range(count):
        s = beam[i]
        for t in range(triangles):
            if triangle_to[t] >= 0:
                orders.held[s, triangle_to[t]] = orders.held[s, t]
        for p in range(vertices):
            q = vertex_to[p]
            if q >= 0:
                orders.left[s, q], orders.open[s, q], orders.stamp[s, q] = orders.left[s, p], orders.open[s, p], orders.stamp[s, p]
        for age in range(min(cache, np.int64(orders.now[s]))):
            k = (orders.now[s] - age) & mask
            orders.ring[s, k] = vertex_to[orders.ring[s, k]]
