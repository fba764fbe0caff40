"""Bounding volume hierarchy: built by binned surface area heuristic, walked without a stack.

Nodes lie in depth-first order and each knows the first node behind its subtree (`skip`): a walk goes to the next node where its box is touched and to
`skip` where it is not. So it needs no memory of its own, and any kernel, on the CPU or the GPU, can ask for visibility a pair at a time.

Built after Wald, "On fast construction of SAH-based bounding volume hierarchies" (2007); sorted the same for any number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array

_BINS = 16
_LEAF = 3  # items that are tested together rather than split
_MOST = 7  # items in a leaf: three bits of its code
_DEEP = 80  # from here on items are halved as they come, so that the stack has an end


class Boxes(NamedTuple):
    """The hierarchy over boxes of anything.

    Attributes:
        box: (n, 6) float32, least and largest x, y, z of each node, widened by a rounding or two.
        link: (n, 2) int32: the first node behind the subtree; and 8 * first + count of the items of a leaf, 0 for other nodes.
        order: (m,) int32: the items in the order of the leaves.
    """

    box: Array
    link: Array
    order: Array


def build(low: Array, high: Array) -> Boxes:
    """The hierarchy over the boxes `low`, `high`, (m, 3) float32 each, finite; m may be 0."""
    m = len(low)
    if m == 0:
        return Boxes(np.zeros((0, 6), np.float32), np.zeros((0, 2), np.int32), np.zeros(0, np.int32))
    bounds = np.ascontiguousarray(np.concatenate([low, high], 1), np.float32)
    order = np.arange(m, dtype=np.int32)
    box, link = np.empty((2 * m, 6), np.float32), np.empty((2 * m, 2), np.int32)
    count = _build(bounds, order, box, link)
    box = box[:count].copy()
    margin = np.float32(float(np.abs(bounds).max()) * 2.0**-22)  # flat boxes must not be missed by a rounding
    box[:, :3] -= margin
    box[:, 3:] += margin
    return Boxes(box, link[:count].copy(), order)


@jit.part
def _surround(bounds, order, first, last, out):
    """The box around some items, into `out`."""
    for axis in range(3):
        least, most = bounds[order[first], axis], bounds[order[first], axis + 3]
        for k in range(first + 1, last):
            item = order[k]
            least, most = min(least, bounds[item, axis]), max(most, bounds[item, axis + 3])
        out[axis], out[axis + 3] = least, most


@jit.part
def _half_area(box):
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x


@jit.part
def _centre(bounds, item, axis):
    """Twice the centre of an item's box."""
    return np.float64(bounds[item, axis]) + np.float64(bounds[item, axis + 3])


@jit.part
def _bin_of(bounds, item, axis, least, scale):
    return min(max(np.int64((_centre(bounds, item, axis) - least) * scale), 0), _BINS - 1)


@jit.part
def _split_cost(bins, counts, right):
    """The cheapest plane between bins: how many bins lie left of it, and the cost, area times items."""
    box = bins[_BINS]
    for side in (1, 0):  # right to left, then left to right with the costs of the rest at hand
        for c in range(3):
            box[c], box[c + 3] = np.inf, -np.inf
        number, best, cheapest = 0, 0, np.inf
        for step in range(_BINS - 1):
            b = _BINS - 1 - step if side else step
            if counts[b]:
                number += counts[b]
                for c in range(3):
                    box[c], box[c + 3] = min(box[c], bins[b, c]), max(box[c + 3], bins[b, c + 3])
            cost = _half_area(box) * number if number else np.inf
            if side:
                right[b] = cost
            elif cost + right[b + 1] < cheapest:
                best, cheapest = b + 1, cost + right[b + 1]
    return best, cheapest


@jit.part
def _best_split(bounds, order, first, last, bins, counts, right):
    """Axis, bins to the left, least centre and scale of the best plane, and its cost; cost infinity if all centres are one."""
    best_axis, best_place, best_least, best_scale, best = 0, 0, 0.0, 0.0, np.inf
    for axis in range(3):
        least, most = np.inf, -np.inf
        for k in range(first, last):
            value = _centre(bounds, order[k], axis)
            least, most = min(least, value), max(most, value)
        scale = _BINS / (most - least) if most > least else np.inf
        if not scale < np.inf:
            continue
        counts[:] = 0
        bins[:, :3] = np.inf
        bins[:, 3:] = -np.inf
        for k in range(first, last):
            item = order[k]
            b = _bin_of(bounds, item, axis, least, scale)
            counts[b] += 1
            for c in range(3):
                bins[b, c], bins[b, c + 3] = min(bins[b, c], bounds[item, c]), max(bins[b, c + 3], bounds[item, c + 3])
        place, cost = _split_cost(bins, counts, right)
        if cost < best:
            best_axis, best_place, best_least, best_scale, best = axis, place, least, scale, cost
    return best_axis, best_place, best_least, best_scale, best


@jit.part
def _partition(bounds, order, first, last, axis, place, least, scale):
    """Bring the items left of the plane to the front; where the others begin."""
    i, j = first, last - 1
    while i <= j:
        if _bin_of(bounds, order[i], axis, least, scale) < place:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i


@jit.kernel
def _build(bounds, order, box, link):
    """Fill the nodes depth first, and sort `order`; returns how many nodes there are."""
    own_bins, own_counts, own_right = np.empty((_BINS + 1, 6)), np.zeros(_BINS, np.int64), np.full(_BINS + 1, np.inf)
    bins, counts, right = jit.borrow(own_bins), jit.borrow(own_counts), jit.borrow(own_right)
    own_stack = np.empty((_DEEP + 40, 2), np.int64)
    stack = jit.borrow(own_stack)
    spans = np.empty((len(link), 2), np.int64)
    nodes, depth = 0, 1
    stack[0, 0], stack[0, 1] = 0, len(order)
    while depth:
        depth -= 1
        first, last = stack[depth, 0], stack[depth, 1]
        node, number = nodes, last - first
        nodes += 1
        spans[node, 0], spans[node, 1] = first, last
        _surround(bounds, order, first, last, box[node])
        link[node, 1] = 8 * first + number
        if number <= _LEAF:
            continue
        axis, place, least, scale, cost = _best_split(bounds, order, first, last, bins, counts, right)
        if number <= _MOST and cost >= number * _half_area(box[node]):
            continue
        link[node, 1] = 0
        middle = first + number // 2
        if cost < np.inf and depth < _DEEP:
            middle = _partition(bounds, order, first, last, axis, place, least, scale)
        stack[depth, 0], stack[depth, 1] = middle, last
        stack[depth + 1, 0], stack[depth + 1, 1] = first, middle
        depth += 2
    for node in range(nodes - 1, -1, -1):
        if link[node, 1]:
            link[node, 0] = node + 1
        else:
            link[node, 0] = link[link[node + 1, 0], 0]
    own_bins[0, 0], own_counts[0], own_right[0], own_stack[0, 0] = 0, 0, 0, 0  # the scratch must live until here
    return nodes
