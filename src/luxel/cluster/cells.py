"""Cells: a k-d tree whose leaves cut a mesh into parts of about as many triangles, the same on all ranks and for any number of them.

Its cuts are quantiles of a sample along the longest axis of each box: Bentley, "Multidimensional binary search trees used for associative searching"
(1975); as a division of work, recursive coordinate bisection, Berger and Bokhari (1987).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array


class Cells(NamedTuple):
    """A k-d tree of `count` leaves.

    Attributes:
        count: Leaves.
        axis: (nodes,) int32: of a node's cut.
        cut: (nodes,) float32: what lies below it is on the left.
        child: (nodes, 2) int32: nodes, or ~leaf.
    """

    count: int  # type: ignore[assignment]
    axis: Array
    cut: Array
    child: Array


def cells(points: Array, count: int) -> Cells:
    """A tree of `count` cells with about as many of the points (n, 3) float32, which are finite, in each."""
    axis, cut, child = (np.zeros(shape, dtype) for shape, dtype in ((count - 1, np.int32), (count - 1, np.float32), ((count - 1, 2), np.int32)))
    made = 0

    def grow(inside: Array, first: int, leaves: int) -> int:
        nonlocal made
        if leaves == 1:
            return ~first
        node, made = made, made + 1
        if len(inside):
            axis[node] = np.ptp(inside, 0).argmax()
            along = inside[:, axis[node]]
            at = len(along) * (leaves // 2) // leaves
            cut[node] = np.partition(along, at)[at]
        left = inside[:, axis[node]] < cut[node]
        child[node, 0] = grow(inside[left], first, leaves // 2)
        child[node, 1] = grow(inside[~left], first + leaves // 2, leaves - leaves // 2)
        return node

    grow(points, 0, count)
    return Cells(count, axis, cut, child)


@jit.kernel
def _descend(points, axis, cut, child, out):
    for i in range(len(points)):
        node = 0
        while node >= 0:
            node = child[node, 0 if points[i, axis[node]] < cut[node] else 1]
        out[i] = ~node


def cell_of(cells: Cells, points: Array) -> Array:
    """(n,) int32: the cell that each of points (n, 3) float32 lies in; what is no number lies in the last."""
    out = np.zeros(len(points), np.int32)
    if cells.count > 1:
        _descend(np.ascontiguousarray(points, np.float32), cells.axis, cells.cut, cells.child, out)
    return out
