"""Look-ahead: a beam of greedy orders kept side by side.

A greedy order judges the next fan by what it costs now; what it leaves behind is paid for later. Here `width` partial orders are kept, each is
continued by two foci, and the best `width` of all continuations go on. Two that have drawn the same triangles count once. The foci are those of two
costs: where one is caught in a bad habit, such as strips a little too wide for the cache, the other leads out.

An order is judged by what it will have cost in the end. Every vertex is loaded once; each time one is dropped with triangles left, it must be
loaded once more. So the vertices dropped alive are counted, and for every live vertex in the cache the chance that it will be dropped alive is
added: `risk`, a table over its age, its open corners and its triangles left (the terms of `luxel.layout.greedy`), fitted by counting how often
that happened. Triangles done count against it at the rate at which an average triangle costs.

The partial orders differ only in the last few dozen fans. So each holds a small private state (a few kilobytes, copied when an order branches) over
a window of the mesh with numbers of its own; vertices enter the window when some order first loads them, and `_sweep` renumbers what is still needed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.adjacency import Adjacency, bounded
from luxel.layout.greedy import LEFT, OPEN, VALENCE

_FAN = 8
"""Vertices loaded before a fan is left."""
_DRAWN = 100
_MOST_LEFT, _MOST_OPEN = np.uint64(LEFT), np.uint64(OPEN - 1)
_NONE, _NOWHERE = np.uint32(0xFFFFFFFF), np.uint16(0xFFFF)
_STACK = 4096
RATE = 0.1
"""Vertices lost for each triangle of a good order."""
LIMIT = 256
"""Triangles of the window at which it is swept."""
WIDTH, DEPTH = 4, 64
SEARCH_WEIGHTS = (1.0, 0.5, 0.7, 1.0)
"""Of `lin-yu`, by whose cost one of an order's two foci is chosen; the other is that of `greedy`."""


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
        held: (s, t) int16, how many corners of a triangle the cache holds, or _DRAWN.
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


class Tree(NamedTuple):
    """Fans that may still become part of the order: parent, and where their triangles end in `triangles`; `size`: fans in use."""

    parent: Array
    end: Array
    triangles: Array
    size: Array


@jit.inlined
def _mix(t):
    """Bits of a triangle's number, scrambled (Stafford's variant 13 of the 64-bit finalizer)."""
    x = np.uint64(t) + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@jit.part
def _place_vertex(v, whole, window, orders, cache):
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
            u = _place_vertex(whole.faces[t, corner], whole, window, orders, cache)
            window.corners[q, corner] = u
            window.rows[u, window.counts[u]] = q
            window.counts[u] += 1
    window.known[p] = 1
    return True


@jit.inlined
def _copy(a, b, window, orders):
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
def _draw(s, t, cache, window, orders):
    """Order s draws the triangle at t, with a cache that holds `cache` vertices."""
    a, b, c = window.corners[t, 0], window.corners[t, 1], window.corners[t, 2]
    if orders.held[s, t] != 3:
        gone = orders.now[s] - cache
        out_a, out_b, out_c = orders.stamp[s, a] <= gone, orders.stamp[s, b] <= gone, orders.stamp[s, c] <= gone
        orders.open[s, a] -= out_b + out_c
        orders.open[s, b] -= out_a + out_c
        orders.open[s, c] -= out_a + out_b
    orders.held[s, t] = _DRAWN
    orders.left[s, a] -= 1
    orders.left[s, b] -= 1
    orders.left[s, c] -= 1
    number = window.triangles[t]
    orders.mark[s] ^= _mix(number)
    orders.fresh[s, orders.fresh_count[s]] = number
    orders.fresh_count[s] += 1
    orders.done[s] += 1


@jit.inlined
def _push(s, p, keep, cache, whole, window, orders):
    """Order s loads the vertex at p, draws `keep` (or _NONE), drops the oldest vertex and draws what it can; False if the window is full."""
    if not _know(p, whole, window, orders, cache):
        return False
    mask = np.uint64(orders.ring.shape[1] - 1)
    now = orders.now[s] + 1
    orders.now[s] = now
    old = orders.ring[s, np.uint64(now - cache) & mask]
    orders.ring[s, np.uint64(now) & mask] = p
    orders.stamp[s, p] = now
    _shift(s, p, 1, window, orders)
    if keep != _NONE:
        _draw(s, keep, cache + 1, window, orders)
    if old != _NOWHERE and orders.left[s, old] > 0:
        _shift(s, old, -1, window, orders)
        orders.lost[s] += 1
    if orders.left[s, p] > 0:
        for i in range(window.counts[p]):
            t = np.uint32(window.rows[p, i])
            if orders.held[s, t] == 3:
                _draw(s, t, cache, window, orders)
    return True


@jit.inlined
def _best_triangle(s, p, window, orders):
    """The undrawn triangle of the vertex at p with most corners in the cache; the one whose other corner there is oldest, of equals."""
    best, rank = _NONE, np.int64(-1) << 40
    for i in range(window.counts[p]):
        t = np.uint32(window.rows[p, i])
        held = np.int64(orders.held[s, t])
        if held < 4:
            stamp = np.int64(-1)
            for corner in range(3):
                u = window.corners[t, corner]
                stamp = max(stamp, np.int64(orders.stamp[s, u]) if u != p else np.int64(-1))
            this = (held << 32) - stamp
            best = t if this > rank else best
            rank = max(this, rank)
    return best


@jit.part
def _fan(s, focus, cache, whole, window, orders):
    """Order s draws the triangles of the vertex at `focus`, until it is black or gone; False if the window is full."""
    if orders.stamp[s, focus] <= orders.now[s] - cache and not _push(s, focus, _NONE, cache, whole, window, orders):
        return False
    end = orders.now[s] + _FAN
    while orders.left[s, focus] > 0 and orders.stamp[s, focus] > orders.now[s] - cache and orders.now[s] < end:
        t = _best_triangle(s, focus, window, orders)
        first, last = _NONE, _NONE
        for corner in range(3):
            u = np.uint32(window.corners[t, corner])
            if orders.stamp[s, u] <= orders.now[s] - cache and u != last:
                first, last = last, u
        if first != _NONE and not _push(s, first, _NONE, cache, whole, window, orders):
            return False
        keep = t if orders.held[s, t] < 4 else _NONE
        if last != _NONE and orders.stamp[s, last] <= orders.now[s] - cache:
            if not _push(s, last, keep, cache, whole, window, orders):
                return False
        elif keep != _NONE:
            _draw(s, keep, cache, window, orders)
    return True


@jit.inlined
def _risk(s, cache, risk, orders):
    """Sum over the live vertices of the cache of the chance to be dropped alive."""
    mask, now = np.uint64(orders.ring.shape[1] - 1), np.uint64(orders.now[s])
    total = np.float32(0)
    for age in range(min(np.uint64(cache), now)):
        p = orders.ring[s, (now - age) & mask]
        left, opened = np.uint64(orders.left[s, p]), np.uint64(orders.open[s, p])
        total += risk[age, min(left, _MOST_LEFT), min(opened, _MOST_OPEN)]
    return total


@jit.inlined
def _candidates(s, cache, costs, other_costs, orders, chosen):
    """Two foci: the grey vertex of least cost, and that of the other costs; the second of the first if they agree. Return how many there are."""
    mask, now = np.uint64(orders.ring.shape[1] - 1), np.uint64(orders.now[s])
    first, second, other = _NONE, _NONE, _NONE
    least, next_least, other_least = np.float32(np.inf), np.float32(np.inf), np.float32(np.inf)
    held = min(np.uint64(cache), now)
    for k in range(held):
        age = held - np.uint64(1) - k
        p = np.uint32(orders.ring[s, (now - age) & mask])
        left, opened = min(np.uint64(orders.left[s, p]), _MOST_LEFT), min(np.uint64(orders.open[s, p]), _MOST_OPEN)
        cost, other_cost = costs[age, left, opened], other_costs[age, left, opened]
        if cost < least:
            second, next_least = first, least
            first, least = p, cost
        elif cost < next_least:
            second, next_least = p, cost
        other = p if other_cost < other_least else other
        other_least = min(other_cost, other_least)
    chosen[0] = first
    chosen[1] = second if other == first else other
    return (first != _NONE) + (second != _NONE)


@jit.part
def _restart(s, cache, whole, window, orders, stack, cursors):
    """Where order s goes on with no grey vertex: the vertex of the window loaded last, one that a sweep left behind, or the input's next."""
    best, latest = -1, -cache - 1
    for p in range(window.size[1]):
        if orders.left[s, p] > 0 and orders.stamp[s, p] > latest:
            best, latest = p, np.int64(orders.stamp[s, p])
    if best >= 0:
        return best
    while cursors[0] > 0:
        v = stack[(cursors[0] - 1) % _STACK]
        if whole.left[v] > 0 and whole.vertex_place[v] < 0:
            return _place_vertex(v, whole, window, orders, cache)
        cursors[0] -= 1
    v = cursors[1]
    while v < len(whole.left) and (whole.left[v] == 0 or whole.vertex_place[v] >= 0):
        cursors[1] += whole.left[v] == 0 and cursors[1] == v
        v += 1
    return _place_vertex(v, whole, window, orders, cache) if v < len(whole.left) else -1


@jit.inlined
def _insert(c, score, beam, scores, count, width, orders, spare):
    """Put order c among the best, which stay sorted; what falls out becomes spare. Return how many there are."""
    for i in range(count):
        if orders.mark[beam[i]] == orders.mark[c]:
            if not score < scores[i]:
                return _release(c, spare, count)
            _release(beam[i], spare, 0)
            for j in range(i, count - 1):
                beam[j], scores[j] = beam[j + 1], scores[j + 1]
            count -= 1
            break
    if count == width:
        if not score < scores[count - 1]:
            return _release(c, spare, count)
        _release(beam[count - 1], spare, 0)
        count -= 1
    i = count
    while i > 0 and score < scores[i - 1]:
        beam[i], scores[i] = beam[i - 1], scores[i - 1]
        i -= 1
    beam[i], scores[i] = c, score
    return count + 1


@jit.inlined
def _release(c, spare, count):
    spare[0] += 1
    spare[spare[0]] = c
    return count


@jit.part
def _grow(tree, orders, beam, count):
    """Hang the last fan of each order into the tree."""
    for i in range(count):
        s = beam[i]
        node = tree.size[0]
        end = tree.end[node - 1]
        for k in range(orders.fresh_count[s]):
            tree.triangles[end + k] = orders.fresh[s, k]
        tree.parent[node], tree.end[node] = orders.node[s], end + orders.fresh_count[s]
        tree.size[0] = node + 1
        orders.node[s] = node


@jit.part
def _prune(beam, count, depth, tree, orders):
    """Keep the orders that share with the best one all but its last `depth` fans; return how many."""
    ancestor = orders.node[beam[0]]
    for _ in range(depth):
        if ancestor == 0:
            return count
        ancestor = tree.parent[ancestor]
    return _descendants(beam, count, ancestor, tree, orders)


@jit.part
def _descendants(beam, count, ancestor, tree, orders):
    kept = 0
    for i in range(count):
        node = orders.node[beam[i]]
        while node > ancestor:
            node = tree.parent[node]
        if node == ancestor:
            beam[kept], beam[i] = beam[i], beam[kept]
            kept += 1
    return kept


@jit.part
def _common(beam, count, tree, orders, tips):
    """The last fan that all orders share: a parent's number is smaller than its child's."""
    for i in range(count):
        tips[i] = orders.node[beam[i]]
    while True:
        low, high = 0, 0
        for i in range(1, count):
            low = i if tips[i] < tips[low] else low
            high = i if tips[i] > tips[high] else high
        if tips[low] == tips[high]:
            return tips[low]
        tips[high] = tree.parent[tips[high]]


@jit.part
def _commit(beam, count, tree, orders, tips, keep, source, written):
    """Write what all orders share and drop it from the tree, with the fans that no order came from; return how many triangles are written."""
    common = _common(beam, count, tree, orders, tips)
    total, node = 0, common
    while node > 0:
        total += tree.end[node] - tree.end[node - 1]
        node = tree.parent[node]
    place, node = written + total, common
    while node > 0:
        for k in range(tree.end[node] - 1, tree.end[node - 1] - 1, -1):
            place -= 1
            source[place] = tree.triangles[k]
        node = tree.parent[node]
    size = tree.size[0]
    for node in range(size):
        keep[node] = -1
    for i in range(count):
        node = orders.node[beam[i]]
        while node > common and keep[node] < 0:
            keep[node] = 1
            node = tree.parent[node]
    keep[common] = 0
    fans, end, first = 1, 0, tree.end[common]
    before = tree.end[0]
    for node in range(1, size):
        first, last = before, tree.end[node]
        before = last
        if node > common and keep[node] > 0:
            for k in range(first, last):
                tree.triangles[end + k - first] = tree.triangles[k]
            end += last - first
            tree.parent[fans], tree.end[fans] = keep[tree.parent[node]], end
            keep[node] = fans
            fans += 1
    tree.end[0], tree.size[0] = 0, fans
    for i in range(count):
        orders.node[beam[i]] = keep[orders.node[beam[i]]]
    return written + total


@jit.part
def _sweep(beam, count, cache, whole, window, orders, stack, cursors, vertex_to, triangle_to):
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
            drawn += orders.held[beam[i], t] == _DRAWN
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
                stack[cursors[0] % _STACK] = v
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


@jit.kernel
def _beam(whole, window, orders, tree, cache, width, depth, limit, rate, costs, other_costs, risk, beam, following, scores, spare, chosen, tips, keep,
          stack, cursors, vertex_to, triangle_to, source):  # fmt: skip
    """Write the order into `source`."""
    m = len(whole.faces)
    count, written, room, memory = 1, 0, limit, depth
    beam[0] = 0
    while orders.done[beam[0]] < m:
        if window.size[0] > room or tree.size[0] + width > len(tree.parent):
            count = _shrink(beam, count, memory, spare, tree, orders)
            written = _commit(beam, count, tree, orders, tips, keep, source, written)
            _sweep(beam, count, cache, whole, window, orders, stack, cursors, vertex_to, triangle_to)
            room = max(limit, 2 * window.size[0])
        found = _step(beam, count, cache, width, rate, costs, other_costs, risk, whole, window, orders, following, scores, spare, chosen, stack,
                      cursors)  # fmt: skip
        if found < 0:  # the window is full: the orders have to agree sooner
            memory, room = memory // 2, 0
            continue
        memory = depth
        _grow(tree, orders, following, found)
        for i in range(count):
            _release(beam[i], spare, 0)
        for i in range(found):
            beam[i] = following[i]
        count = found
        for i in range(count):
            if orders.done[beam[i]] == m:
                beam[0], beam[i] = beam[i], beam[0]
    return _commit(beam, 1, tree, orders, tips, keep, source, written)


@jit.part
def _step(beam, count, cache, width, rate, costs, other_costs, risk, whole, window, orders, following, scores, spare, chosen, stack, cursors):
    """Continue every order by its best foci; the best of what comes of it are `following`. Return how many, or -1 if the window is full."""
    found = 0
    for i in range(count):
        s = beam[i]
        some = _candidates(s, cache, costs, other_costs, orders, chosen)
        if some == 0:
            chosen[0] = _restart(s, cache, whole, window, orders, stack, cursors)
            some = 1
        for k in range(some):
            c = spare[spare[0]]
            spare[0] -= 1
            _copy(s, c, window, orders)
            if not _fan(c, chosen[k], cache, whole, window, orders):
                _release(c, spare, 0)
                for j in range(found):
                    _release(following[j], spare, 0)
                return -1
            score = orders.lost[c] - rate * orders.done[c] + _risk(c, cache, risk, orders)
            found = _insert(c, score, following, scores, found, width, orders, spare)
    return found


@jit.part
def _shrink(beam, count, depth, spare, tree, orders):
    """Prune, and make the orders that go spare; return how many stay."""
    kept = _prune(beam, count, depth, tree, orders)
    for i in range(kept, count):
        _release(beam[i], spare, 0)
    return kept


_RISK = (
    (0.5, 0.0, 0.2, 0.0, 0.015),
    (1.7, 0.0, 0.7, 0.005, 0.04),
    (2.5, 0.25, 0.5, 0.06, 0.18),
    (0.0, 0.82, 0.3, 0.1, 0.2),
    (0.0, 1.0, 0.3, 0.05, 0.4),
)
"""For C1 = 1 .. 5 and more: loads left at which half are dropped alive (constant, times the cache), the slope's width (same), the least chance."""


def risk_table(cache: int) -> Array:
    """(cache, OPEN, LEFT) float32: the chance that a vertex is dropped alive, by age, open corners and triangles left - 1.

    Certain if fewer loads remain than C1; else a logistic curve over the loads that remain, fitted to counts at caches of 8, 12, 16 and 32 on
    fandisk, lionstatue and beetle.
    """
    age, opened, left = np.ogrid[:cache, :OPEN, 1 : LEFT + 1]
    c1 = np.where(opened > 0, np.maximum(opened - left + 1, 1), 0)
    remaining = cache - 1 - age
    half, per_cache, width, width_per_cache, least = np.array(_RISK).T[:, np.clip(c1, 1, len(_RISK)) - 1]
    steepness = np.clip((half + per_cache * cache - remaining) / (width + width_per_cache * cache), -50, 50)
    chance = least + (1 - least) / (1 + np.exp(-steepness))
    return np.ascontiguousarray(np.where(c1 > remaining, 1.0, np.where(c1 > 0, chance, 0.0)), np.float32)


def _scratch(faces: Array, rows: Adjacency, cache: int, width: int, depth: int) -> tuple[Whole, Window, Orders, Tree]:
    """What a beam works on, with one order that has drawn nothing."""
    n, m = len(rows.start) - 1, len(faces)
    t = min(8192, 1 << max(2048, 2 * (cache + 3 * _FAN) * VALENCE, 4 * width * depth).bit_length())
    v, slots, fans = 2 * t, 2 * width + 2, 1024 + 4 * width * depth
    short, word = np.uint16, np.int32
    whole = Whole(
        faces=faces.view(np.uint32), start=rows.start.view(np.uint32), rows=rows.triangles.view(np.uint32), left=np.diff(rows.start),
        drawn=np.zeros(m, np.uint8), vertex_place=np.full(n, -1, word), triangle_place=np.full(m, -1, word),
    )  # fmt: skip
    window = Window(
        corners=np.empty((t, 3), short), triangles=np.empty(t, np.uint32), vertices=np.empty(v, np.uint32), rows=np.empty((v, VALENCE), short),
        counts=np.empty(v, short), known=np.empty(v, np.uint8), size=np.zeros(2, np.int64),
    )  # fmt: skip
    orders = Orders(
        held=np.empty((slots, t), short), left=np.empty((slots, v), short), open=np.empty((slots, v), short), stamp=np.empty((slots, v), word),
        ring=np.full((slots, 1 << cache.bit_length()), _NOWHERE, short), now=np.zeros(slots, word), lost=np.zeros(slots, word),
        done=np.zeros(slots, word), mark=np.zeros(slots, np.uint64), node=np.zeros(slots, word),
        fresh=np.empty((slots, (_FAN + 2) * VALENCE), word), fresh_count=np.zeros(slots, word),
    )  # fmt: skip
    tree = Tree(np.zeros(fans, word), np.zeros(fans, word), np.empty(fans * (_FAN + 2) * VALENCE, word), np.ones(1, np.int64))
    return whole, window, orders, tree


def _by_left(table: Array, black: float) -> Array:
    """(cache, LEFT + 1, OPEN) float32: `table` with its last two axes exchanged, and a row for vertices that have none left."""
    turned = np.full((len(table), LEFT + 1, OPEN), black, np.float32)
    turned[:, 1:] = table.transpose(0, 2, 1)
    return turned


def look_ahead(faces: Array, rows: Adjacency, cache: int, width: int, depth: int, costs: Array, other_costs: Array, risk: Array) -> Array:
    """(m,) int32: the triangles in the best order that a beam of `width` greedy orders finds for a FIFO of `cache` vertices."""
    faces, rows = bounded(faces, rows, VALENCE)
    whole, window, orders, tree = _scratch(faces, rows, cache, width, depth)
    slots, source = len(orders.now), np.empty(len(faces), np.int32)
    spare = np.arange(slots, dtype=np.uint32)  # the first counts the others
    spare[0] = slots - 1
    beam, following, chosen = (np.zeros(k, np.uint32) for k in (slots, slots, 2))
    tips, cursors = np.zeros(slots, np.int64), np.zeros(2, np.int64)
    tables = _by_left(costs, np.inf), _by_left(other_costs, np.inf), _by_left(risk, 0)
    _beam(
        whole, window, orders, tree, cache, width, depth, LIMIT, RATE, *tables, beam, following, np.zeros(slots), spare, chosen,
        tips, np.zeros(len(tree.parent), np.int64), np.zeros(_STACK, np.int32), cursors,
        np.zeros(len(window.vertices), np.int32), np.zeros(len(window.triangles), np.int32), source,
    )  # fmt: skip
    return source
