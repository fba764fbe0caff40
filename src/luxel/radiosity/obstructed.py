"""Obstructed: the exchange of two polygons that face each other, with obstacles between them.

Cells of one of the two are integrated over, each point's view of the other cut by the exact shadow (`luxel.radiosity.shadow`); part by part where
there are too many obstacles for that, and by rays where parts have too many too. `luxel.radiosity.pairs` has what all of these work on.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.radiosity.exchange import contour_integral
from luxel.radiosity.occlusion import occluded
from luxel.radiosity.shadow import visible_factor
from luxel.radiosity.shaft import BLOCKERS, HIDDEN, Side, find_blockers, height_range, keep_blockers

_GAUSS = (0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0)
_DEEPEST = 9  # halvings of a cell
_INNER = 2.0 + math.sqrt(3.0)  # weight of the two inner samples in the third difference of four, which lie as _GAUSS in either half
_JUMP = 0.04  # of the third difference: what a cell and its quarters would differ by, had they not agreed by chance
_LEEWAY = 2.0  # a cell's quarters are so much closer to the truth than it is
_STAKE = 1000.0  # floors that a cell must be worth to be quartered unasked
RAYS = 64
LEVELS, PLANES, CELLS = _DEEPEST + 2, 40, 4 * _DEEPEST + 8
_SMALLEST = 6  # quarterings of a pair, of either side
PARTS = 4 * _SMALLEST + 4  # that wait at most; a polygon of five corners has eight quarters, at first
_DOUBT = 0.01  # what rays may be off by, as a share of what two sides would exchange if alone


@jit.part
def _bilinear(a, piece, u, v, out):
    """A point of one of the at most two bilinear patches of a polygon, into out[0:3], and how much area a unit of u and v is there."""
    i, j, k = (0, 1, 2) if piece == 0 else (0, 3, 4)
    l = (3 if a.sides > 3 else 2) if piece == 0 else 4
    c = a.corners
    p, q, r, s = (1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v
    for axis in range(3):
        out[axis] = p * c[i, axis] + q * c[j, axis] + r * c[k, axis] + s * c[l, axis]
    ux, uy, uz = _across(c, i, j, k, l, v, 0), _across(c, i, j, k, l, v, 1), _across(c, i, j, k, l, v, 2)
    vx, vy, vz = _across(c, i, l, k, j, u, 0), _across(c, i, l, k, j, u, 1), _across(c, i, l, k, j, u, 2)
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return math.sqrt(x * x + y * y + z * z)


@jit.inlined
def _across(c, i, j, k, l, t, axis):
    """A coordinate of the patch's derivative from side i l to side j k."""
    return (1 - t) * (c[j, axis] - c[i, axis]) + t * (c[k, axis] - c[l, axis])


@jit.part
def _cell(world, a, b, blockers, found, piece, u, v, size, row, column, scratch):
    """The integral over one cell of `a`, by 2 x 2 points, put into the samples; negative if the shadow needs more pieces than there are."""
    total = 0.0
    place = scratch.bounds
    for i in range(2):
        for j in range(2):
            weight = _bilinear(a, piece, u + size * _GAUSS[i], v + size * _GAUSS[j], place)
            factor = visible_factor(
                place[0], place[1], place[2], a.nx, a.ny, a.nz, b, world.obstacles, blockers, found, scratch.pieces, scratch.counts, scratch.planes
            )
            if factor < 0.0:
                return -1.0
            scratch.samples[row + i, column + j] = weight * factor
            total += weight * factor
    return 0.25 * size * size * total


@jit.part
def _cell_side(a, piece, u, v, size, out):
    """A cell of `a` as a `Side` of its own."""
    _bilinear(a, piece, u, v, out[0])
    _bilinear(a, piece, u + size, v, out[1])
    _bilinear(a, piece, u + size, v + size, out[2])
    _bilinear(a, piece, u, v + size, out[3])
    return Side(out, np.int64(4), a.nx, a.ny, a.nz, a.x, a.y, a.z, a.radius)


@jit.part
def _roughness(f):
    """How far the 4 x 4 samples of a cell's quarters are from quadratic, by their third differences along each row and column.

    A cell agrees with its quarters, by chance, where a shadow begins anywhere in its middle fifth: the samples themselves tell that it does.
    """
    total = 0.0
    for k in range(4):
        total += abs(f[3, k] - f[0, k] + _INNER * (f[1, k] - f[2, k])) + abs(f[k, 3] - f[k, 0] + _INNER * (f[k, 1] - f[k, 2]))
    return 0.25 * total


@jit.part
def _partly_hidden(world, a, b, found, whole, tolerance, levels, floor, scratch):
    """The integral over `a` of what each of its points sees of `b`, and the error estimated; negative if the shadow needs too many pieces.

    `whole` is the value without obstacles, `levels` how many of cells are always looked at. Each cell asks anew which obstacles are in its own
    shaft, so most are soon clear or hidden for certain. Others may differ from their quarters by a share of the error that falls with their side:
    those with kinks are as many as the kinks are long.
    """
    cells = scratch.cells
    depth, total, error, seen = 0, 0.0, 0.0, 0.0
    for piece in range(1 if a.sides < 5 else 2):
        cells[depth, 0], cells[depth, 1], cells[depth, 2], cells[depth, 3], cells[depth, 4], cells[depth, 5] = piece, 0.0, 0.0, 1.0, 0.0, 0.0
        depth += 1
    scratch.found[0] = found
    while depth:
        depth -= 1
        piece, u, v, size, value = np.int64(cells[depth, 0]), cells[depth, 1], cells[depth, 2], cells[depth, 3], cells[depth, 4]
        level = np.int64(cells[depth, 5])
        cell = _cell_side(a, piece, u, v, size, scratch.c)
        kept = scratch.blockers[level + 1]
        between = keep_blockers(world.obstacles, cell, b, scratch.blockers[level], scratch.found[level], kept, scratch.planes)
        if between == HIDDEN:
            continue
        scratch.found[level + 1] = between
        half, quarters = 0.5 * size, 0.0
        for i in range(4 if level else 5):
            x, y, extent = (u + half * (i & 1), v + half * (i >> 1), half) if i < 4 else (u, v, size)
            part = _cell(world, a, b, kept, between, piece, x, y, extent, 2 * (i & 1), 2 * (i >> 1), scratch)
            if part < 0.0:
                return -1.0, 0.0
            if i == 4:  # nothing larger has told the value of the whole piece
                value = part
                continue
            quarters += part
            row = depth + i
            cells[row, 0], cells[row, 1], cells[row, 2], cells[row, 3], cells[row, 4], cells[row, 5] = piece, x, y, half, part, level + 1
        if level == 0:
            seen += quarters
        allowed = max(_LEEWAY * tolerance * max(seen, 0.02 * whole), floor)
        gap = abs(quarters - value)
        if between:
            gap = max(gap, _JUMP * _roughness(scratch.samples) * size * size)
        stake = whole * size * size  # what is at stake, about
        sure = between == 0 or level >= levels or stake <= _STAKE * floor
        if (sure and gap <= allowed * size) or stake <= floor or level == _DEEPEST:
            total += quarters
            error += gap / _LEEWAY
        else:
            depth += 4
    return total, error


@jit.part
def _sequence(i, base):
    """Number i of van der Corput's sequence to a base."""
    value, scale = 0.0, 1.0 / base
    while i:
        value += scale * (i % base)
        i //= base
        scale /= base
    return value


@jit.part
def _ray_points(a, first, base_u, base_v, turn, rows):
    """RAYS points spread over a polygon, x, y, z and weight: Halton's, moved by `turn`."""
    for k in range(RAYS):
        u, v = _sequence(first + k, base_u) + turn, _sequence(first + k, base_v) + turn
        u, v = u - math.floor(u), v - math.floor(v)
        piece = 0
        if a.sides == 5:
            u *= 2.0
            piece = 1 if u >= 1.0 else 0
            u -= piece
        rows[k, 3] = _bilinear(a, piece, u, v, rows[k])


@jit.part
def _by_rays(world, a, b, whole, wanted, batches, floor, scratch):
    """The share of `whole` that is seen, by at most `batches` of pairs of points weighted with what they would exchange; and the error expected."""
    weights = squares = seen = 0.0
    value, error = 0.0, whole
    for batch in range(batches):
        _ray_points(a, batch * RAYS, 2, 3, 0.37, scratch.points[0])
        _ray_points(b, batch * RAYS, 5, 7, 0.71, scratch.points[1])
        for k in range(RAYS):
            p, q = scratch.points[0, k], scratch.points[1, k]
            dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 == 0.0:
                continue
            cosines = (a.nx * dx + a.ny * dy + a.nz * dz) * (b.nx * dx + b.ny * dy + b.nz * dz)
            weight = p[3] * q[3] * abs(cosines) / (r2 * r2)
            weights += weight
            squares += weight * weight
            if not occluded(world.occlusion, p[0], p[1], p[2], q[0], q[1], q[2], -1, -1):
                seen += weight
        share = seen / weights if weights > 0.0 else 0.0
        value = whole * share
        # As for independent rays, had one more been seen and one more hidden.
        spread = share * (1.0 - share) + 1.0 / (RAYS * (batch + 1))
        error = whole * math.sqrt(spread * squares) / weights if weights > 0.0 else 0.0
        if error <= max(wanted.tolerance * value, floor) or (wanted.batches <= 64 and (share == 0.0 or share == 1.0)):
            break
    return value, error


@jit.part
def _height(polygons, t, side):
    """How far polygon t is above the plane of a `Side` at least, as a share of the side's size; no less than a thousandth."""
    low, _ = height_range(side.nx, side.ny, side.nz, side.x, side.y, side.z, polygons.corners[t], polygons.sides[t])
    return max(low / side.radius, 1e-3)


@jit.part
def _softer_on_first(polygons, a, b, blockers, found):
    """Whether the hardest shadow between a and b is softer on a than on b: that is the one to integrate over.

    The penumbra of an obstacle's edge is as wide on a as b is large, times the edge's distance to a over that to b. What a box that all but stands
    on a polygon hides from it is a step; seen from far, the box hides a little more or less of the polygon.
    """
    hardest_a = hardest_b = math.inf
    for k in range(found):
        soft = _height(polygons, blockers[k], a) / _height(polygons, blockers[k], b)
        hardest_a, hardest_b = min(hardest_a, soft), min(hardest_b, 1.0 / soft)
    return hardest_a >= hardest_b


@jit.part
def _part_side(side, piece, u, v, size, out):
    """A cell of a `Side` as a `Side` with a centre and radius of its own; all of the side if `piece` is negative."""
    if piece < 0:
        return side
    cell = _cell_side(side, piece, u, v, size, out)
    x = y = z = radius = 0.0
    for k in range(4):
        x, y, z = x + 0.25 * out[k, 0], y + 0.25 * out[k, 1], z + 0.25 * out[k, 2]
    for k in range(4):
        radius = max(radius, (out[k, 0] - x) ** 2 + (out[k, 1] - y) ** 2 + (out[k, 2] - z) ** 2)
    return Side(out, cell.sides, cell.nx, cell.ny, cell.nz, x, y, z, math.sqrt(radius))


@jit.part
def _fewer_by_first(polygons, a, b, blockers, found):
    """Whether quartering a, rather than b, leaves fewer of the obstacles between parts.

    At an obstacle the shaft is as wide as either polygon is large, times the obstacle's share of the way from the other.
    """
    by_a = by_b = 0.0
    for k in range(found):
        x, y, z = polygons.centre[blockers[k], 0], polygons.centre[blockers[k], 1], polygons.centre[blockers[k], 2]
        from_a = abs((x - a.x) * a.nx + (y - a.y) * a.ny + (z - a.z) * a.nz)
        from_b = abs((x - b.x) * b.nx + (y - b.y) * b.ny + (z - b.z) * b.nz)
        way = max(from_a + from_b, polygons.epsilon[0])
        by_a, by_b = by_a + a.radius * from_b / way, by_b + b.radius * from_a / way
    return by_a >= by_b


@jit.part
def _quarter(parts, depth, sides, column):
    """Replace the pair of parts in row `depth` by those with the quarters of one of the two, told from `column` on; the row after them.

    `sides`: Corners of that one.
    """
    piece, u, v, half = parts[depth, column], parts[depth, column + 1], parts[depth, column + 2], 0.5 * parts[depth, column + 3]
    other = 4 - column
    o, p, q, r, level = parts[depth, other], parts[depth, other + 1], parts[depth, other + 2], parts[depth, other + 3], parts[depth, 8] + 1.0
    first, count = max(piece, 0.0), 8 if piece < 0.0 and sides == 5 else 4
    for row in range(count):
        k = depth + row
        parts[k, column], parts[k, column + 1], parts[k, column + 2] = first + (row >> 2), u + half * (row & 1), v + half * (row >> 1 & 1)
        parts[k, column + 3], parts[k, 8] = half, level
        parts[k, other], parts[k, other + 1], parts[k, other + 2], parts[k, other + 3] = o, p, q, r
    return depth + count


@jit.part
def by_parts(world, p, q, a, b, found, whole, wanted, floor, scratch):
    """The exchange of `a` with `b`, of polygons p and q, with `found` obstacles between them, and the error estimated. `whole`: without them.

    Where obstacles are too many, or cut too much, the pair is quartered: fewer are between parts. Of parts half as large there are four, whose errors
    are of either sign: each may be off by twice the share. Where all that parts exchange is worth little, or they are the smallest, rays must do.
    """
    parts, blockers = scratch.parts, scratch.blockers[0]
    for k in range(9):
        parts[0, k] = 0.0
    parts[0, 0] = parts[0, 4] = -1.0
    parts[0, 3] = parts[0, 7] = 1.0
    depth, all_of_it, value, error = np.int64(0), whole, 0.0, 0.0
    one, other = a, b
    while True:  # the pair in row `depth`, with `found` obstacles between
        level = np.int64(parts[depth, 8])
        share = 0.5**level * floor
        part, wrong = -1.0, 0.0
        if 0 <= found <= BLOCKERS:
            soft = _softer_on_first(world.obstacles, one, other, blockers, found)
            first, second = (one, other) if soft else (other, one)
            size = parts[depth, 3 if soft else 7]
            levels = wanted.levels
            while size < 1.0 and levels:
                size, levels = 2.0 * size, levels - 1
            part, wrong = _partly_hidden(world, first, second, found, whole, 2.0**level * wanted.tolerance, levels, share, scratch)
            part = min(part, whole)
        if part < 0.0 and (level == _SMALLEST or _DOUBT * whole <= share):
            part, wrong = _by_rays(world, one, other, whole, wanted, max(wanted.batches >> 2 * level, 1), share, scratch)
        if part >= 0.0:
            value, error = value + part, error + wrong
        else:
            by_first = _fewer_by_first(world.obstacles, one, other, blockers, min(found, BLOCKERS))
            depth = _quarter(parts, depth, one.sides if by_first else other.sides, 0 if by_first else 4)
        found = np.int64(0)
        while found == 0:  # on to the next pair with obstacles between
            if depth == 0:
                return min(value, all_of_it), error
            depth -= 1
            row = parts[depth]
            one = _part_side(a, np.int64(row[0]), row[1], row[2], row[3], scratch.part_a)
            other = _part_side(b, np.int64(row[4]), row[5], row[6], row[7], scratch.part_b)
            found = find_blockers(
                world.obstacles, world.box, world.link, world.order, world.owner[p], world.owner[q], one, other, blockers, scratch.planes,
                scratch.bounds,
            )  # fmt: skip
            if found == HIDDEN:
                found = np.int64(0)
                continue
            size = max(one.radius + other.radius, math.sqrt((one.x - other.x) ** 2 + (one.y - other.y) ** 2 + (one.z - other.z) ** 2))
            share = 0.5 ** row[8] * floor
            whole, wrong = contour_integral(one.corners, one.sides, other.corners, other.sides, size, wanted.tolerance, share, scratch.terms)
            if found == 0:
                value, error = value + whole, error + wrong
