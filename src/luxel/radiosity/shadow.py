"""Shadow: what a point sees of a polygon behind others, exactly, and its integral over a second polygon.

Seen from a point a convex obstacle throws a pyramid of shadow behind itself. Cutting the polygon along the pyramid's sides leaves convex pieces
outside; the next obstacle cuts those. The pieces' form factors (Lambert) add up to the exact one of the visible part. Over the second polygon that
function is continuous, with kinks: it is integrated by cells of 2 x 2 Gauss points that are quartered where a cell and its quarters differ.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.radiosity.transfer import edge_term

PIECES, CORNERS = 96, 16
OVERFLOW = -1.0


@jit.part
def _cut(pieces, source, count, mx, my, mz, m, tolerance, inside, outside):
    """Cut the piece `source` of `count` corners by the plane through mx x + my y + mz z = m.

    The parts above and below go to the rows `inside` and `outside`, unless all of it is one of them; returns their numbers of corners, 0 where
    there is no part; -1 if too many.
    """
    above = below = False
    for k in range(count):
        h = pieces[source, k, 0] * mx + pieces[source, k, 1] * my + pieces[source, k, 2] * mz - m
        above |= h > tolerance
        below |= h < -tolerance
    if not above:
        return 0, count
    if not below:
        return count, 0
    n_in, n_out = np.int64(0), np.int64(0)
    ax, ay, az = pieces[source, count - 1, 0], pieces[source, count - 1, 1], pieces[source, count - 1, 2]
    a = ax * mx + ay * my + az * mz - m
    for k in range(count):
        if max(n_in, n_out) + 2 > CORNERS:
            return -1, -1
        bx, by, bz = pieces[source, k, 0], pieces[source, k, 1], pieces[source, k, 2]
        b = bx * mx + by * my + bz * mz - m
        if (a > 0.0 and b < 0.0) or (a < 0.0 and b > 0.0):
            t = a / (a - b)
            x, y, z = ax + t * (bx - ax), ay + t * (by - ay), az + t * (bz - az)
            pieces[inside, n_in, 0], pieces[inside, n_in, 1], pieces[inside, n_in, 2] = x, y, z
            pieces[outside, n_out, 0], pieces[outside, n_out, 1], pieces[outside, n_out, 2] = x, y, z
            n_in += 1
            n_out += 1
        if b >= 0.0:
            pieces[inside, n_in, 0], pieces[inside, n_in, 1], pieces[inside, n_in, 2] = bx, by, bz
            n_in += 1
        if b <= 0.0:
            pieces[outside, n_out, 0], pieces[outside, n_out, 1], pieces[outside, n_out, 2] = bx, by, bz
            n_out += 1
        ax, ay, az, a = bx, by, bz, b
    return n_in, n_out


@jit.part
def _pyramid(polygons, t, x, y, z, epsilon, planes):
    """The planes that bound the shadow of polygon t seen from a point, relative to it: normals inward and offsets. How many; 0 if there is none."""
    nx, ny, nz = polygons.normal[t, 0], polygons.normal[t, 1], polygons.normal[t, 2]
    c, count = polygons.corners[t], polygons.sides[t]
    height = (c[0, 0] - x) * nx + (c[0, 1] - y) * ny + (c[0, 2] - z) * nz
    if abs(height) <= epsilon:
        return 0
    sign = 1.0 if height > 0.0 else -1.0
    planes[0, 0], planes[0, 1], planes[0, 2], planes[0, 3] = sign * nx, sign * ny, sign * nz, sign * height
    for k in range(count):
        m = k + 1 if k + 1 < count else 0
        ax, ay, az = c[k, 0] - x, c[k, 1] - y, c[k, 2] - z
        bx, by, bz = c[m, 0] - x, c[m, 1] - y, c[m, 2] - z
        ux, uy, uz = sign * (ay * bz - az * by), sign * (az * bx - ax * bz), sign * (ax * by - ay * bx)
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        length = 1.0 / length if length > 0.0 else 0.0
        planes[k + 1, 0], planes[k + 1, 1], planes[k + 1, 2], planes[k + 1, 3] = ux * length, uy * length, uz * length, 0.0
    return count + 1


@jit.part
def _misses(pieces, row, count, planes, sides, tolerance):
    """Whether a piece lies outside one of the planes."""
    for s in range(sides):
        high = -math.inf
        for k in range(count):
            h = pieces[row, k, 0] * planes[s, 0] + pieces[row, k, 1] * planes[s, 1] + pieces[row, k, 2] * planes[s, 2] - planes[s, 3]
            high = max(high, h)
        if high <= tolerance:
            return True
    return False


@jit.part
def _outer_parts(pieces, counts, row, number, planes, sides, tolerance):
    """Write what of piece `row` lies outside the pyramid behind the first `number` pieces. How many pieces there are then; -1 if too many,
    and -2 if the whole piece lies outside."""
    source, count, spare = row, counts[row], np.int64(PIECES)
    for s in range(sides):
        if number == PIECES:
            return -1
        n_in, n_out = _cut(pieces, source, count, planes[s, 0], planes[s, 1], planes[s, 2], planes[s, 3], tolerance, spare, number)
        if n_in < 3:
            return -1 if n_in < 0 else -2
        if n_out == 0:
            continue
        if n_out >= 3:
            counts[number] = n_out
            number += 1
        source, count, spare = spare, n_in, 2 * PIECES + 1 - spare
    return number


@jit.part
def _subtract(pieces, counts, number, planes, sides, tolerance):
    """Take a pyramid away from the first `number` pieces; how many pieces there are then, or -1 if too many."""
    row, last = np.int64(0), number  # those from row to last - 1 are still to be cut, those from last on are outside
    while row < last:
        after = np.int64(-2)
        if not _misses(pieces, row, counts[row], planes, sides, tolerance):
            after = _outer_parts(pieces, counts, row, number, planes, sides, tolerance)
        if after == -1:
            return -1
        if after == -2:
            row += 1
            continue
        number, last = after - 1, last - 1
        _move(pieces, counts, last, row)
        _move(pieces, counts, number, last)
    return number


@jit.part
def _move(pieces, counts, source, target):
    if source != target:
        counts[target] = counts[source]
        for k in range(counts[source]):
            for c in range(3):
                pieces[target, k, c] = pieces[source, k, c]


@jit.part
def visible_factor(x, y, z, nx, ny, nz, b, polygons, blockers, found, pieces, counts, planes):
    """Form factor from a point with normal n to what it sees of polygon `b` (a `Side` wholly above its horizon) behind `found` blockers.

    Scratch: pieces (PIECES + 2, CORNERS, 3) float64, counts (PIECES,) int64, planes (6, 4) float64. OVERFLOW if that does not do.
    """
    epsilon = polygons.epsilon[0]
    for k in range(b.sides):
        pieces[0, k, 0], pieces[0, k, 1], pieces[0, k, 2] = b.corners[k, 0] - x, b.corners[k, 1] - y, b.corners[k, 2] - z
    counts[0] = b.sides
    number = np.int64(1)
    for k in range(found):
        sides = _pyramid(polygons, blockers[k], x, y, z, epsilon, planes)
        if sides:
            number = _subtract(pieces, counts, number, planes, sides, 1e-9 * b.radius)
            if number <= 0:
                return 0.0 if number == 0 else OVERFLOW
    total = 0.0
    for row in range(number):
        piece, count = pieces[row], counts[row]
        lambert = 0.0
        for k in range(count):
            m = k + 1 if k + 1 < count else 0
            lambert += edge_term(piece[k, 0], piece[k, 1], piece[k, 2], piece[m, 0], piece[m, 1], piece[m, 2], nx, ny, nz)
        total += abs(lambert)
    return total * (0.5 / math.pi)
