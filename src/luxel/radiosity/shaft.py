"""Shaft: which polygons may stand between two others.

Two convex polygons that face each other span a convex shaft, their hull. The hierarchy over all polygons is walked with the shaft's box, the two
polygons' planes and a capsule around it; what is left is tried exactly: a polygon cannot hide anything if it lies behind one of the two, if
its own plane has both on one side, or if a supporting plane of the shaft (through an edge of one and a corner of the other) has it outside.
After Haines and Wallace, "Shaft culling for efficient ray-traced radiosity" (1991).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array

BLOCKERS = 64
"""How many are told; more are counted as BLOCKERS + 1."""
HIDDEN = -1
CORNERS = 5  # of a quadrilateral cut by a plane


class Side(NamedTuple):
    """One of two polygons that face each other.

    Attributes:
        corners: (CORNERS, 3) float64.
        sides: As many as corners.
        nx, ny, nz: Unit normal toward the other.
        x, y, z, radius: Centroid, and the largest distance of a corner from it.
    """

    corners: Array
    sides: int
    nx: float
    ny: float
    nz: float
    x: float
    y: float
    z: float
    radius: float


@jit.part
def height_range(nx, ny, nz, x, y, z, corners, count):
    """Least and largest height of corners over the plane through (x, y, z) with normal n."""
    low = high = (corners[0, 0] - x) * nx + (corners[0, 1] - y) * ny + (corners[0, 2] - z) * nz
    for k in range(1, count):
        h = (corners[k, 0] - x) * nx + (corners[k, 1] - y) * ny + (corners[k, 2] - z) * nz
        low, high = min(low, h), max(high, h)
    return low, high


@jit.part
def _shaft_box(a, b, box):
    """The box around both polygons, into box[0:6]."""
    for axis in range(3):
        low = high = a.corners[0, axis]
        for k in range(1, a.sides):
            low, high = min(low, a.corners[k, axis]), max(high, a.corners[k, axis])
        for k in range(b.sides):
            low, high = min(low, b.corners[k, axis]), max(high, b.corners[k, axis])
        box[axis], box[axis + 3] = low, high


@jit.part
def _support(edges, others, epsilon, planes, count):
    """Add the planes through an edge of one polygon and a corner of the other that have both on one side: unit normals outward, and offsets."""
    for i in range(edges.sides):
        j = i + 1 if i + 1 < edges.sides else 0
        x, y, z = edges.corners[i, 0], edges.corners[i, 1], edges.corners[i, 2]
        ux, uy, uz = edges.corners[j, 0] - x, edges.corners[j, 1] - y, edges.corners[j, 2] - z
        for k in range(others.sides):
            vx, vy, vz = others.corners[k, 0] - x, others.corners[k, 1] - y, others.corners[k, 2] - z
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            if length <= epsilon * epsilon:
                continue
            nx, ny, nz = nx / length, ny / length, nz / length
            low, high = height_range(nx, ny, nz, x, y, z, edges.corners, edges.sides)
            if low < -epsilon and high > epsilon:
                continue
            least, most = height_range(nx, ny, nz, x, y, z, others.corners, others.sides)
            low, high = min(low, least), max(high, most)
            if (low < -epsilon and high > epsilon) or count == len(planes):
                continue
            sign = 1.0 if high <= epsilon else -1.0
            planes[count, 0], planes[count, 1], planes[count, 2] = sign * nx, sign * ny, sign * nz
            planes[count, 3] = sign * (nx * x + ny * y + nz * z)
            count += 1
    return count


@jit.part
def _outside(polygons, t, planes, count, epsilon):
    """Whether polygon t lies outside one of the supporting planes."""
    for p in range(count):
        low = math.inf
        for k in range(polygons.sides[t]):
            c = polygons.corners[t]
            low = min(low, c[k, 0] * planes[p, 0] + c[k, 1] * planes[p, 1] + c[k, 2] * planes[p, 2] - planes[p, 3])
        if low >= -epsilon:
            return True
    return False


@jit.part
def _behind(polygons, t, side, epsilon):
    """Whether polygon t lies behind one of the two, or on its plane."""
    _, high = height_range(side.nx, side.ny, side.nz, side.x, side.y, side.z, polygons.corners[t], polygons.sides[t])
    return high <= epsilon


@jit.part
def _covers(polygons, t, a, b):
    """Whether every segment between corners of the two, and so every segment between the two, passes within polygon t, which parts them."""
    corners, count = polygons.corners[t], polygons.sides[t]
    for i in range(a.sides):
        x, y, z = a.corners[i, 0], a.corners[i, 1], a.corners[i, 2]
        for j in range(b.sides):
            dx, dy, dz = b.corners[j, 0] - x, b.corners[j, 1] - y, b.corners[j, 2] - z
            positive = negative = False
            for k in range(count):
                m = k + 1 if k + 1 < count else 0
                ex, ey, ez = corners[k, 0] - x, corners[k, 1] - y, corners[k, 2] - z
                fx, fy, fz = corners[m, 0] - x, corners[m, 1] - y, corners[m, 2] - z
                s = dx * (ey * fz - ez * fy) + dy * (ez * fx - ex * fz) + dz * (ex * fy - ey * fx)
                positive |= s >= 0.0
                negative |= s <= 0.0
            if positive and negative:
                return False
    return True


@jit.part
def _node_misses(box, node, a, b, bounds, reach, epsilon):
    """Whether a node's box cannot touch the shaft between the two."""
    n = np.uint64(node)
    x, y, z = 0.5 * (box[n, 0] + box[n, 3]), 0.5 * (box[n, 1] + box[n, 4]), 0.5 * (box[n, 2] + box[n, 5])
    hx, hy, hz = box[n, 3] - x, box[n, 4] - y, box[n, 5] - z
    if x + hx < bounds[0] or x - hx > bounds[3] or y + hy < bounds[1] or y - hy > bounds[4]:
        return True
    if z + hz < bounds[2] or z - hz > bounds[5]:
        return True
    if (x - a.x) * a.nx + (y - a.y) * a.ny + (z - a.z) * a.nz + abs(a.nx) * hx + abs(a.ny) * hy + abs(a.nz) * hz <= epsilon:
        return True
    if (x - b.x) * b.nx + (y - b.y) * b.ny + (z - b.z) * b.nz + abs(b.nx) * hx + abs(b.ny) * hy + abs(b.nz) * hz <= epsilon:
        return True
    dx, dy, dz = b.x - a.x, b.y - a.y, b.z - a.z
    wx, wy, wz = x - a.x, y - a.y, z - a.z
    t = (wx * dx + wy * dy + wz * dz) / (dx * dx + dy * dy + dz * dz)
    t = min(max(t, 0.0), 1.0)
    wx, wy, wz = wx - t * dx, wy - t * dy, wz - t * dz
    far = reach + math.sqrt(hx * hx + hy * hy + hz * hz)
    return wx * wx + wy * wy + wz * wz > far * far


@jit.part
def _judge(polygons, t, a, b, epsilon):
    """Whether polygon t may stand between the two, as far as the planes of the three tell: 0, 1, or HIDDEN if it hides everything."""
    if _behind(polygons, t, a, epsilon) or _behind(polygons, t, b, epsilon):
        return 0
    nx, ny, nz = polygons.normal[t, 0], polygons.normal[t, 1], polygons.normal[t, 2]
    x, y, z = polygons.centre[t, 0], polygons.centre[t, 1], polygons.centre[t, 2]
    low_a, high_a = height_range(nx, ny, nz, x, y, z, a.corners, a.sides)
    low_b, high_b = height_range(nx, ny, nz, x, y, z, b.corners, b.sides)
    if min(low_a, low_b) >= -epsilon or max(high_a, high_b) <= epsilon:
        return 0
    if ((high_a < 0.0 and low_b > 0.0) or (low_a > 0.0 and high_b < 0.0)) and _covers(polygons, t, a, b):
        return HIDDEN
    return 1


@jit.part
def find_blockers(polygons, box, link, order, p, q, a, b, blockers, planes, bounds):
    """Write the polygons that may hide a part of `a` from `b` to `blockers`.

    Args:
        polygons, box, link, order: The obstacles, `Polygons`, and the `Boxes` over them.
        p, q: The obstacles that `a` and `b` are parts of.
        a, b: `Side`.
        blockers, planes, bounds: Scratch: (BLOCKERS,) int64, (40, 4) and (6,) float64.

    Returns:
        How many, BLOCKERS + 1 if there are more, HIDDEN if one hides everything.
    """
    epsilon = polygons.epsilon[0]
    _shaft_box(a, b, bounds)
    reach = max(a.radius, b.radius) + epsilon
    found, support = np.int64(0), np.int64(-1)
    node, nodes = np.int64(0), len(link)
    while node < nodes:
        if _node_misses(box, node, a, b, bounds, reach, epsilon):
            node = np.int64(link[node, 0])
            continue
        leaf = link[node, 1]
        for item in range(leaf >> 3, (leaf >> 3) + (leaf & 7)):
            t = np.int64(order[item])
            between = 0 if t in (p, q) else _judge(polygons, t, a, b, epsilon)
            if between == HIDDEN:
                return HIDDEN
            if not between:
                continue
            if support < 0:
                support = _support(b, a, epsilon, planes, _support(a, b, epsilon, planes, np.int64(0)))
            if _outside(polygons, t, planes, support, epsilon):
                continue
            if found == BLOCKERS:
                return BLOCKERS + 1
            blockers[found] = t
            found += 1
        node += 1
    return found


@jit.part
def keep_blockers(polygons, a, b, given, number, kept, planes):
    """Write those of the `number` blockers in `given` that may hide a part of the smaller `a` from `b` to `kept`; returned as by `find_blockers`."""
    epsilon = polygons.epsilon[0]
    found, support = np.int64(0), np.int64(-1)
    for k in range(number):
        t = given[k]
        between = _judge(polygons, t, a, b, epsilon)
        if between == HIDDEN:
            return HIDDEN
        if not between:
            continue
        if support < 0:
            support = _support(b, a, epsilon, planes, _support(a, b, epsilon, planes, np.int64(0)))
        if not _outside(polygons, t, planes, support, epsilon):
            kept[found] = t
            found += 1
    return found
