"""Patches: a tree over the elements of a surface, whose upper nodes shoot and whose lower ones take over near a receiver.

The tree is a k-d tree in position and normal: a node whose normals differ much is split by normal, any other along its longest side, in the
middle; distances along the node's own normal count more, so that parallel surfaces part before a surface is cut. The first nodes small and
flat enough, from the root down, are the patches. Elements are put in the tree's order, so that a node is a range of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array

_ACROSS = 3.0  # how much more a distance along the normal counts
_DEEPEST = 128
_LIFT = 0.25  # of a patch's radius
_HIDDEN = 0.35  # of its elements: a table's leg is no wall

_F = np.float32


class Tree(NamedTuple):
    """Nodes over n elements.

    Attributes:
        order: (n,) int32: element i of the tree is row order[i] of what it was built from.
        span: (nodes, 2) int32: first element of a node, and the one after its last.
        child: (nodes,) int32: the first of its two children, which are neighbours; -1 for a single element.
        place: (nodes, 9) float32: centre x y z, radius about it, unit normal x y z, area, mean square distance from the centre along an axis.
        patches: (p,) int32: the nodes that shoot, in the order of their elements, of which each is in exactly one.
        patch_of: (n,) int32: which entry of `patches` an element is in.
    """

    order: Array
    span: Array
    child: Array
    place: Array
    patches: Array
    patch_of: Array


@jit.part
def _measure(first, last, order, position, normal, area, place):
    """Fill `place` of a node and return the size of its box and of its normals' box along their longest sides, and which those are."""
    cx = cy = cz = nx = ny = nz = total = 0.0
    for i in range(first, last):
        e = order[i]
        a = np.float64(area[e])
        total += a
        cx, cy, cz = cx + a * position[e, 0], cy + a * position[e, 1], cz + a * position[e, 2]
        nx, ny, nz = nx + a * normal[e, 0], ny + a * normal[e, 1], nz + a * normal[e, 2]
    scale = 1.0 / total if total > 0.0 else 0.0
    cx, cy, cz = cx * scale, cy * scale, cz * scale
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    if length > 1e-12 * total and length > 0.0:
        nx, ny, nz = nx / length, ny / length, nz / length
    else:
        e = order[first]
        nx, ny, nz = np.float64(normal[e, 0]), np.float64(normal[e, 1]), np.float64(normal[e, 2])
    radius = spread = 0.0
    for i in range(first, last):
        e = order[i]
        a = np.float64(area[e])
        dx, dy, dz = position[e, 0] - cx, position[e, 1] - cy, position[e, 2] - cz
        square = dx * dx + dy * dy + dz * dz
        radius = max(radius, np.sqrt(square) + np.sqrt(a * 0.5))
        spread += a * (square * 0.5 + a / 12.0)  # an element is taken for a square
    place[0], place[1], place[2], place[3] = cx, cy, cz, radius
    place[4], place[5], place[6], place[7] = nx, ny, nz, total
    place[8] = spread * scale


@jit.part
def _widest(first, last, order, values, weights):
    """The column of `values` whose weighted range over the elements is largest: (column, range, its middle)."""
    column, widest, middle = 0, _F(-1.0), _F(0.0)
    for k in range(3):
        low = high = values[order[first], k]
        for i in range(first + 1, last):
            v = values[order[i], k]
            low, high = min(low, v), max(high, v)
        if (high - low) * weights[k] > widest:
            column, widest, middle = k, (high - low) * weights[k], low + (high - low) * _F(0.5)
    return column, widest, middle


@jit.part
def _split(first, last, order, values, column, middle, scratch):
    """Put the elements below `middle` first, keeping their order; returns where the others begin, or the middle of the range if all are alike."""
    below = above = 0
    for i in range(first, last):
        if values[order[i], column] < middle:
            order[first + below] = order[i]
            below += 1
        else:
            scratch[above] = order[i]
            above += 1
    for i in range(above):
        order[first + below + i] = scratch[i]
    if below == 0 or above == 0:
        return first + (last - first) // 2
    return first + below


@jit.kernel
def _build(position, normal, area, extent, bend, order, span, child, place, is_patch):
    """Fill the tree; returns how many nodes it has. `extent` (metres) of an element's patch, `bend` of the normals' box."""
    n = len(order)
    stack, inside = np.empty(_DEEPEST * 2, np.int64), np.zeros(2 * n, np.uint8)
    scratch, weights, same = np.empty(n, np.int32), np.ones(3, np.float32), np.ones(3, np.float32)
    span[0, 0], span[0, 1] = 0, n
    nodes, stack[0], depth = 1, 0, 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        first, last = np.int64(span[node, 0]), np.int64(span[node, 1])
        _measure(first, last, order, position, normal, area, place[node])
        for k in range(3):
            weights[k] = _F(1.0) + _F(_ACROSS) * abs(place[node, 4 + k])
        axis, size, middle = _widest(first, last, order, position, weights)
        side, turn, half = _widest(first, last, order, normal, same)
        bent = turn > bend
        patch = inside[node] == 0 and not bent and size <= extent[order[first]]
        if last - first == 1:
            child[node] = -1
            is_patch[node] = 1 - inside[node]
            continue
        is_patch[node] = patch
        if bent:
            cut = _split(first, last, order, normal, side, half, scratch)
        else:
            cut = _split(first, last, order, position, axis, middle, scratch)
        child[node] = nodes
        span[nodes, 0], span[nodes, 1], span[nodes + 1, 0], span[nodes + 1, 1] = first, cut, cut, last
        inside[nodes] = inside[nodes + 1] = 1 if patch else inside[node]
        # The smaller half is done first, so the stack stays shallow.
        large, small = (nodes, nodes + 1) if cut - first > last - cut else (nodes + 1, nodes)
        stack[depth], stack[depth + 1] = large, small
        depth += 2
        nodes += 2
    return nodes


def build_tree(position: Array, normal: Array, area: Array, extent: Array, bend: float = 0.35) -> Tree:
    """Cluster elements.

    Args:
        position: (n, 3) float32, metres. n >= 1.
        normal: (n, 3) float32, unit length.
        area: (n,) float32, m2.
        extent: (n,) float32, metres: how long the sides of an element's patch may be.
        bend: How much the normals of a patch may differ along an axis.
    """
    n = len(position)
    order, span, child = np.arange(n, dtype=np.int32), np.empty((2 * n, 2), np.int32), np.empty(2 * n, np.int32)
    place, is_patch = np.empty((2 * n, 9), np.float32), np.zeros(2 * n, np.uint8)
    nodes = _build(position, normal, area, extent, np.float32(bend), order, span, child, place, is_patch)
    patches = np.flatnonzero(is_patch[:nodes]).astype(np.int32)
    patches = patches[np.argsort(span[patches, 0], kind="stable")]
    patch_of = np.repeat(np.arange(len(patches), dtype=np.int32), span[patches, 1] - span[patches, 0])
    return Tree(order, span[:nodes].copy(), child[:nodes].copy(), place[:nodes].copy(), patches, patch_of)


def patch_starts(tree: Tree) -> Array:
    """(p + 1,) int64: where the elements of each patch begin, and their end."""
    return np.append(tree.span[tree.patches, 0], len(tree.order)).astype(np.int64)


def ranges(spans: Array) -> Array:
    """The numbers of the elements of (k, 2) spans, one span after the other."""
    sizes = spans[:, 1] - spans[:, 0]
    return np.repeat(spans[:, 0] - np.cumsum(sizes) + sizes, sizes) + np.arange(int(sizes.sum()))


def middles(tree: Tree, nodes: Array, position: Array) -> Array:
    """(k,) the element of each node that is nearest to its centre; position (n, 3), in the tree's order."""
    spans = tree.span[nodes].astype(np.int64)
    sizes, elements = spans[:, 1] - spans[:, 0], ranges(spans)
    distance = ((position[elements] - np.repeat(tree.place[nodes, :3], sizes, 0)) ** 2).sum(1)
    first = np.cumsum(sizes) - sizes
    best = np.flatnonzero(distance == np.repeat(np.minimum.reduceat(distance, first), sizes))
    return elements[best[np.searchsorted(best, first)]]


def connected(tree: Tree, position: Array, normal: Array, sees: Callable[[Array, Array], Array]) -> Tree:
    """The same tree with patches cut until the middle of each sees nearly all its elements, so that none reaches through a wall that stands on it.

    Args:
        position, normal: (n, 3), in the tree's order.
        sees: From (k, 3) and (k, 3) to (k,) bool. It is asked for points lifted off the surface by a share of the patch's radius.
    """
    accepted, nodes = [], tree.patches
    while len(nodes):
        spans = tree.span[nodes].astype(np.int64)
        sizes, elements = spans[:, 1] - spans[:, 0], ranges(spans)
        lift = np.repeat(_LIFT * tree.place[nodes, 3], sizes)[:, None]
        middle = np.repeat(middles(tree, nodes, position), sizes)
        seen = sees(position[middle] + lift * normal[middle], position[elements] + lift * normal[elements])
        hidden = np.add.reduceat(~seen, np.cumsum(sizes) - sizes, dtype=np.int64)
        whole = (hidden <= _HIDDEN * sizes) | (tree.child[nodes] < 0)
        accepted.append(nodes[whole])
        first = tree.child[nodes[~whole]]
        nodes = np.stack([first, first + 1], 1).ravel()
    patches = np.concatenate(accepted).astype(np.int32)
    patches = patches[np.argsort(tree.span[patches, 0], kind="stable")]
    sizes = tree.span[patches, 1] - tree.span[patches, 0]
    return tree._replace(patches=patches, patch_of=np.repeat(np.arange(len(patches), dtype=np.int32), sizes))
