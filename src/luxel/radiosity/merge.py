"""Merge: neighbouring polygons of one plane made into fewer, as long as they stay convex with at most four corners.

A wall of a thousand patches is one obstacle, and a surface of many triangles in a plane is integrated over as one: pairs fall with the square.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array

_ROUNDS = 40  # each can halve the polygons of a plane along one direction


class Merged(NamedTuple):
    """Polygons, and where those given went.

    Attributes:
        corners: (k, 4, 3) float64, counter-clockwise; a triangle's last corner is there twice.
        group: (k,) as given.
        owner: (m,) int64: the polygon of the result that each of those given is a part of.
    """

    corners: Array
    group: Array
    owner: Array


def merge(corners: Array, group: Array, epsilon: float, across_groups: bool = False) -> Merged:
    """Merge (m, 4, 3) polygons of one group, (m,) int, or of all; corners within `epsilon` metres of a line or plane lie on it."""
    owner = np.arange(len(corners))
    for number in range(_ROUNDS):
        first, second, union, key = _candidates(corners, group, epsilon, across_groups, by_length=number == 0)
        chosen = _disjoint(first, second, key, len(corners))
        if not len(chosen):
            if number:
                break
            continue
        kept = np.ones(len(corners), bool)
        kept[second[chosen]] = False
        place = np.cumsum(kept) - 1
        place[second[chosen]] = place[first[chosen]]
        corners[first[chosen]] = union[chosen]
        corners, group, owner = corners[kept], group[kept], place[owner]
    return Merged(corners, group, owner)


def counts_of(corners: Array) -> Array:
    """(m,) int32: 3 for polygons whose last corner is there twice, else 4."""
    return np.where((corners[:, 2] == corners[:, 3]).all(1), 3, 4).astype(np.int32)


def _candidates(corners: Array, group: Array, epsilon: float, across_groups: bool, by_length: bool) -> tuple[Array, Array, Array, Array]:
    """Pairs of polygons whose union is convex with at most four corners: both, (k, 4, 3) the union, (k,) what goes first, smallest."""
    count = counts_of(corners)
    _, vertex = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 4)
    following = np.take_along_axis(vertex, (np.arange(4) + 1) % count[:, None], 1)
    polygon, slot = np.nonzero(np.arange(4) < count[:, None])
    start, end = vertex[polygon, slot], following[polygon, slot]
    many = int(vertex.max(initial=0)) + 1
    key = np.minimum(start, end) * many + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    one, two = order[same], order[same + 1]
    fits = (start[one] == end[two]) & (polygon[one] != polygon[two]) & (across_groups | (group[polygon[one]] == group[polygon[two]]))
    one, two = one[fits], two[fits]
    union, whole = _unions(corners, count, polygon[one], slot[one], polygon[two], slot[two], epsilon)
    one, two, union = one[whole], two[whole], union[whole]
    edge = corners[polygon[one], slot[one]] - corners[polygon[two], slot[two]]
    length = np.linalg.norm(edge, axis=1)
    if by_length:  # quadrilaterals are most often cut along the longest edge
        return polygon[one], polygon[two], union, -length
    # One direction before the next: grids merge to strips, and strips to rectangles.
    direction = np.round(np.abs(edge) / np.maximum(length, 1e-300)[:, None], 2) @ (1e6, 1e3, 1.0)
    return polygon[one], polygon[two], union, direction


def _unions(corners: Array, count: Array, p: Array, i: Array, q: Array, j: Array, epsilon: float) -> tuple[Array, Array]:
    """Unions of polygons p and q, whose edges i and j are one, as (k, 4, 3) corners, and which of them are right."""

    def corner(polygon: Array, slot: Array) -> Array:
        return corners[polygon, slot % count[polygon]]

    # Around: the common edge's end, the other corners of p, the edge's start, the other corners of q; a triangle's other is there twice.
    loop = np.stack([
        corner(p, i + 1), corner(p, i + 2), corner(p, i + count[p] - 1), corner(p, i), corner(q, j + 2), corner(q, j + count[q] - 1),
    ], 1)  # fmt: skip
    kept = np.ones(loop.shape[:2], bool)
    kept[:, 2], kept[:, 5] = count[p] == 4, count[q] == 4
    normal = np.cross(loop[:, 1] - loop[:, 0], loop[:, 3] - loop[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    flat = (np.abs(((loop - loop[:, :1]) * normal[:, None]).sum(2)) <= epsilon).all(1)
    kept[:, 0] = _bend(loop[:, 5], loop[:, 0], loop[:, 1], normal) > epsilon
    kept[:, 3] = _bend(loop[:, 2], loop[:, 3], loop[:, 4], normal) > epsilon
    hollow = (_bend(loop[:, 5], loop[:, 0], loop[:, 1], normal) < -epsilon) | (_bend(loop[:, 2], loop[:, 3], loop[:, 4], normal) < -epsilon)
    number = kept.sum(1)
    packed = np.take_along_axis(loop, np.argsort(~kept, axis=1, kind="stable")[:, :4, None], 1)
    packed[number == 3, 3] = packed[number == 3, 2]
    return packed, flat & ~hollow & (number <= 4) & _convex(packed, normal, epsilon)


def _bend(before: Array, corner: Array, after: Array, normal: Array) -> Array:
    """How far a corner stands out of the line between its neighbours, metres; negative inward."""
    base = after - before
    height = (np.cross(corner - before, after - corner) * normal).sum(1)
    return height / np.maximum(np.linalg.norm(base, axis=1), 1e-300)


def _convex(corners: Array, normal: Array, epsilon: float) -> Array:
    """Whether every corner stands out."""
    last = corners[:, 3]
    three = (corners[:, 2] == last).all(1)
    inner = _bend(corners[:, 0], corners[:, 1], corners[:, 2], normal) > epsilon
    end = np.where(three, _bend(corners[:, 1], corners[:, 2], corners[:, 0], normal), _bend(corners[:, 1], corners[:, 2], last, normal)) > epsilon
    close = np.where(three, np.inf, _bend(corners[:, 2], last, corners[:, 0], normal)) > epsilon
    begin = np.where(three, _bend(corners[:, 2], corners[:, 0], corners[:, 1], normal), _bend(last, corners[:, 0], corners[:, 1], normal)) > epsilon
    return inner & end & close & begin


def _disjoint(first: Array, second: Array, key: Array, m: int) -> Array:
    """Pairs of which none shares a polygon, in order of `key`; a polygon whose best partner is taken waits for the next round."""
    best = np.full(m, np.inf)
    np.minimum.at(best, first, key)
    np.minimum.at(best, second, key)
    good = np.flatnonzero((key == best[first]) & (key == best[second]))
    free, chosen = np.ones(m, bool), []
    for k in good[np.argsort(first[good], kind="stable")].tolist():
        if free[first[k]] and free[second[k]]:
            free[first[k]] = free[second[k]] = False
            chosen.append(k)
    return np.array(chosen, np.int64)
