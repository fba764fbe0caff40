"""The fans of look-ahead's partial orders: a tree that is cut at the root as the orders come to agree, and at the leaves as they are given up."""

from __future__ import annotations

from typing import NamedTuple

from luxel import jit
from luxel.arrays import Array


class Tree(NamedTuple):
    """Fans that may still become part of the order: parent, and where their triangles end in `triangles`; `size`: fans in use."""

    parent: Array
    end: Array
    triangles: Array
    size: Array


@jit.part
def grow(tree, orders, beam, count):
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
def prune(beam, count, depth, tree, orders):
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
def commit(beam, count, tree, orders, tips, keep, source, written):
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
