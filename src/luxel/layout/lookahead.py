"""Look-ahead: a beam of greedy orders kept side by side.

A greedy order judges the next fan by what it costs now; what it leaves behind is paid for later. Here `width` partial orders are kept, each is
continued by two foci, and the best `width` of all continuations go on. Two that have drawn the same triangles count once. The foci are those of two
costs: where one is caught in a bad habit, such as strips a little too wide for the cache, the other leads out.

An order is judged by what it will have cost in the end. Every vertex is loaded once; each time one is dropped with triangles left, it must be
loaded once more. So the vertices dropped alive are counted, and for every live vertex in the cache the chance that it will be dropped alive is
added: `risk`, a table over its age, its open corners and its triangles left (the terms of `luxel.layout.greedy`), fitted by counting how often
that happened. Triangles done count against it at the rate at which an average triangle costs.

What the orders hold is in `luxel.layout.window`, the fans they share in `luxel.layout.tree`.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.adjacency import Adjacency, bounded
from luxel.layout.greedy import LEFT_CELLS, OPEN_CELLS, VALENCE
from luxel.layout.tree import Tree, commit, grow, prune
from luxel.layout.window import NONE, NOWHERE, STACK, Orders, Whole, Window, copy_order, draw, place_vertex, push, sweep

_FAN = 8
"""Vertices loaded before a fan is left."""
_MOST_LEFT, _MOST_OPEN = np.uint64(LEFT_CELLS), np.uint64(OPEN_CELLS - 1)
RATE = 0.1
"""Vertices lost for each triangle of a good order."""
LIMIT = 256
"""Triangles of the window at which it is swept."""
WIDTH, DEPTH = 4, 64
SEARCH_WEIGHTS = (1.0, 0.5, 0.7, 1.0)
"""Of `lin-yu`, by whose cost one of an order's two foci is chosen; the other is that of `greedy`."""


@jit.inlined
def _best_triangle(s, p, window, orders):
    """The undrawn triangle of the vertex at p with most corners in the cache; the one whose other corner there is oldest, of equals."""
    best, rank = NONE, np.int64(-1) << 40
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
    if orders.stamp[s, focus] <= orders.now[s] - cache and not push(s, focus, NONE, cache, whole, window, orders):
        return False
    end = orders.now[s] + _FAN
    while orders.left[s, focus] > 0 and orders.stamp[s, focus] > orders.now[s] - cache and orders.now[s] < end:
        t = _best_triangle(s, focus, window, orders)
        first, last = NONE, NONE
        for corner in range(3):
            u = np.uint32(window.corners[t, corner])
            if orders.stamp[s, u] <= orders.now[s] - cache and u != last:
                first, last = last, u
        if first != NONE and not push(s, first, NONE, cache, whole, window, orders):
            return False
        keep = t if orders.held[s, t] < 4 else NONE
        if last != NONE and orders.stamp[s, last] <= orders.now[s] - cache:
            if not push(s, last, keep, cache, whole, window, orders):
                return False
        elif keep != NONE:
            draw(s, keep, cache, window, orders)
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
    first, second, other = NONE, NONE, NONE
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
    return (first != NONE) + (second != NONE)


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
        v = stack[(cursors[0] - 1) % STACK]
        if whole.left[v] > 0 and whole.vertex_place[v] < 0:
            return place_vertex(v, whole, window, orders, cache)
        cursors[0] -= 1
    v = cursors[1]
    while v < len(whole.left) and (whole.left[v] == 0 or whole.vertex_place[v] >= 0):
        cursors[1] += whole.left[v] == 0 and cursors[1] == v
        v += 1
    return place_vertex(v, whole, window, orders, cache) if v < len(whole.left) else -1


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
            written = commit(beam, count, tree, orders, tips, keep, source, written)
            sweep(beam, count, cache, whole, window, orders, stack, cursors, vertex_to, triangle_to)
            room = max(limit, 2 * window.size[0])
        found = _step(beam, count, cache, width, rate, costs, other_costs, risk, whole, window, orders, following, scores, spare, chosen, stack,
                      cursors)  # fmt: skip
        if found < 0:  # the window is full: the orders have to agree sooner
            memory, room = memory // 2, 0
            continue
        memory = depth
        grow(tree, orders, following, found)
        for i in range(count):
            _release(beam[i], spare, 0)
        for i in range(found):
            beam[i] = following[i]
        count = found
        for i in range(count):
            if orders.done[beam[i]] == m:
                beam[0], beam[i] = beam[i], beam[0]
    return commit(beam, 1, tree, orders, tips, keep, source, written)


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
            copy_order(s, c, window, orders)
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
    kept = prune(beam, count, depth, tree, orders)
    for i in range(kept, count):
        _release(beam[i], spare, 0)
    return kept


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
        ring=np.full((slots, 1 << cache.bit_length()), NOWHERE, short), now=np.zeros(slots, word), lost=np.zeros(slots, word),
        done=np.zeros(slots, word), mark=np.zeros(slots, np.uint64), node=np.zeros(slots, word),
        fresh=np.empty((slots, (_FAN + 2) * VALENCE), word), fresh_count=np.zeros(slots, word),
    )  # fmt: skip
    tree = Tree(np.zeros(fans, word), np.zeros(fans, word), np.empty(fans * (_FAN + 2) * VALENCE, word), np.ones(1, np.int64))
    return whole, window, orders, tree


def _by_left(table: Array, black: float) -> Array:
    """(cache, LEFT_CELLS + 1, OPEN_CELLS) float32: `table` with its last two axes exchanged, and a row for vertices that have none left."""
    turned = np.full((len(table), LEFT_CELLS + 1, OPEN_CELLS), black, np.float32)
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
        tips, np.zeros(len(tree.parent), np.int64), np.zeros(STACK, np.int32), cursors,
        np.zeros(len(window.vertices), np.int32), np.zeros(len(window.triangles), np.int32), source,
    )  # fmt: skip
    return source
