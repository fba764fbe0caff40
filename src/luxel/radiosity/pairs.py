"""Pairs: the exchange of two polygons with everything that stands between them.

The double integral of |cos cos| V / (pi r^2) over both, square metres: divided by either's area it is the form factor to the other. The polygons
are first cut by each other's planes, so that all that is left faces; then integrated as if alone (`luxel.radiosity.exchange`); and where the
shaft between them is not empty (`luxel.radiosity.shaft`), integrated again with what hides (`luxel.radiosity.obstructed`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.exchange import contour_integral, over_points
from luxel.radiosity.obstructed import CELLS, LEVELS, PARTS, PLANES, RAYS, by_parts
from luxel.radiosity.occlusion import Occlusion, occluded
from luxel.radiosity.shadow import CORNERS as PIECE_CORNERS
from luxel.radiosity.shadow import PIECES
from luxel.radiosity.shaft import BLOCKERS, CORNERS, HIDDEN, Side, find_blockers, height_range
from luxel.radiosity.surfaces import RULES, Polygons

_R1, _R2, _R3 = RULES[1:]
NOT_PLAIN = -1.0
_NEAR = 0.7  # sizes over distance from which quadrature points on both do not pay


class World(NamedTuple):
    """All that may be asked about while pairs are integrated.

    Attributes:
        polygons: What is integrated over.
        obstacles: What hides, the polygons merged.
        owner: (p,) int64: the obstacle that a polygon is a part of.
        box, link, order: The hierarchy over the obstacles.
        occlusion: The obstacles' triangles, for rays.
    """

    polygons: Polygons
    obstacles: Polygons
    owner: Array
    box: Array
    link: Array
    order: Array
    occlusion: Occlusion


class Wanted(NamedTuple):
    """How good: relative error; absolute error of a form factor; levels of cells always looked at; most batches of rays; sidedness."""

    tolerance: float
    floor: float
    levels: int
    batches: int
    one_sided: bool


class Scratch(NamedTuple):
    """What one thread works in; of the sizes see `make_scratch`.

    Attributes:
        a, b, c: Corners of two sides and of a cell.
        blockers, found: By level of cells, which obstacles stand between and how many.
        planes, bounds, terms: Of the shaft; its box; of the contour integral.
        cells, samples: That are still to be looked at; of one of them.
        pieces, counts: What is left of a polygon behind obstacles.
        points: Of both polygons, where rays begin and end.
        part_a, part_b, parts: Corners of parts of the two sides, and which pairs of parts are still to be looked at.
    """

    a: Array
    b: Array
    c: Array
    blockers: Array
    found: Array
    planes: Array
    bounds: Array
    terms: Array
    cells: Array
    samples: Array
    pieces: Array
    counts: Array
    points: Array
    part_a: Array
    part_b: Array
    parts: Array


@jit.kernel
def make_scratch():
    """Scratch for one thread."""
    return Scratch(
        np.zeros((CORNERS, 3)), np.zeros((CORNERS, 3)), np.zeros((4, 3)), np.zeros((LEVELS, BLOCKERS), np.int64), np.zeros(LEVELS, np.int64),
        np.zeros((PLANES, 4)), np.zeros(6), np.zeros((2, CORNERS, CORNERS)), np.zeros((CELLS, 6)), np.zeros((4, 6)),
        np.zeros((PIECES + 2, PIECE_CORNERS, 3)), np.zeros(PIECES, np.int64), np.zeros((2, RAYS, 4)),
        np.zeros((CORNERS, 3)), np.zeros((CORNERS, 3)), np.zeros((PARTS, 9)),
    )  # fmt: skip


@jit.part
def _alone(points_a, points_b, normal_a, normal_b, a, b, cut, wanted, floor, terms):
    """The exchange of two polygons that see all of each other, and the error estimated."""
    dx, dy, dz = b.x - a.x, b.y - a.y, b.z - a.z
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    size = a.radius + b.radius
    if not cut and size < _NEAR * distance:
        ratio = size / distance
        one = over_points(points_a, points_b, 0, _R1, normal_a, normal_b)
        if 4.0 * ratio * ratio * one <= floor:
            return one, floor
        two = over_points(points_a, points_b, _R1, _R2, normal_a, normal_b)
        error = abs(two - one) * ratio * ratio
        if error <= max(wanted.tolerance * two, floor):
            return two, error
        three = over_points(points_a, points_b, _R2, _R3, normal_a, normal_b)
        error = abs(three - two) * ratio * ratio
        if error <= max(wanted.tolerance * three, floor):
            return three, error
    return contour_integral(a.corners, a.sides, b.corners, b.sides, max(distance, size), wanted.tolerance, floor, terms)


@jit.part
def _facing(world, p, q, a, b, cut, wanted, floor, scratch, only_plain):
    """The exchange of polygon p, or the part `a` cut from it, with `b` of polygon q, and the error estimated; see `exchange`."""
    polygons = world.polygons
    normal_p, normal_q = polygons.normal[p], polygons.normal[q]
    value, error = _alone(polygons.points[p], polygons.points[q], normal_p, normal_q, a, b, cut, wanted, floor, scratch.terms)
    if value <= 0.0:
        return 0.0, 0.0
    found = find_blockers(
        world.obstacles, world.box, world.link, world.order, world.owner[p], world.owner[q], a, b, scratch.blockers[0], scratch.planes, scratch.bounds
    )
    if found == HIDDEN:
        return 0.0, 0.0
    if found == 0:
        return value, error
    if value <= floor:
        hidden = occluded(world.occlusion, a.x, a.y, a.z, b.x, b.y, b.z, -1, -1)
        return (0.0 if hidden else value), value
    if only_plain is not None:
        return 0.0, NOT_PLAIN
    return by_parts(world, p, q, a, b, found, value, wanted, floor, scratch)


@jit.part
def _whole_side(polygons, p, sign, out):
    """Polygon p, seen from the side of its normal times `sign`; its corners are copied to `out`."""
    for k in range(polygons.sides[p]):
        for axis in range(3):
            out[k, axis] = polygons.corners[p, k, axis]
    n, c = polygons.normal[p], polygons.centre[p]
    return Side(out, np.int64(polygons.sides[p]), sign * n[0], sign * n[1], sign * n[2], c[0], c[1], c[2], polygons.radius[p])


@jit.part
def _cut_side(polygons, p, sign, q, above, out):
    """The part of polygon p on the side `above` (1 or -1) of the plane of q, seen from the side `sign` of p; a count below 3 if there is none."""
    n, c = polygons.normal[q], polygons.centre[q]
    corners, count = polygons.corners[p], polygons.sides[p]
    made = np.int64(0)
    ax, ay, az = corners[count - 1, 0], corners[count - 1, 1], corners[count - 1, 2]
    a = above * ((ax - c[0]) * n[0] + (ay - c[1]) * n[1] + (az - c[2]) * n[2])
    for k in range(count):
        bx, by, bz = corners[k, 0], corners[k, 1], corners[k, 2]
        b = above * ((bx - c[0]) * n[0] + (by - c[1]) * n[1] + (bz - c[2]) * n[2])
        if (a > 0.0 and b < 0.0) or (a < 0.0 and b > 0.0):
            t = a / (a - b)
            out[made, 0], out[made, 1], out[made, 2] = ax + t * (bx - ax), ay + t * (by - ay), az + t * (bz - az)
            made += 1
        if b >= 0.0:
            out[made, 0], out[made, 1], out[made, 2] = bx, by, bz
            made += 1
        ax, ay, az, a = bx, by, bz, b
    x = y = z = radius = 0.0
    for k in range(made):
        x, y, z = x + out[k, 0] / made, y + out[k, 1] / made, z + out[k, 2] / made
    for k in range(made):
        radius = max(radius, (out[k, 0] - x) ** 2 + (out[k, 1] - y) ** 2 + (out[k, 2] - z) ** 2)
    m = polygons.normal[p]
    return Side(out, made, sign * m[0], sign * m[1], sign * m[2], x, y, z, math.sqrt(radius))


@jit.part
def exchange(world, p, q, wanted, scratch, only_plain=None):
    """The exchange of polygons p and q, square metres, and the error estimated. From both sides of each, or from the fronts only.

    If `only_plain` is not None, the error is `NOT_PLAIN` where something stands between them, which takes `Scratch` from `cells` on.
    """
    polygons = world.polygons
    epsilon = polygons.epsilon[0]
    np_, cp, nq, cq = polygons.normal[p], polygons.centre[p], polygons.normal[q], polygons.centre[q]
    low_q, high_q = height_range(np_[0], np_[1], np_[2], cp[0], cp[1], cp[2], polygons.corners[q], polygons.sides[q])
    low_p, high_p = height_range(nq[0], nq[1], nq[2], cq[0], cq[1], cq[2], polygons.corners[p], polygons.sides[p])
    if wanted.one_sided and (high_q <= epsilon or high_p <= epsilon):
        return 0.0, 0.0
    if (low_q >= -epsilon and high_q <= epsilon) or (low_p >= -epsilon and high_p <= epsilon):
        return 0.0, 0.0
    floor = wanted.floor * min(polygons.area[p], polygons.area[q])
    cut = not ((low_q >= -epsilon or high_q <= epsilon) and (low_p >= -epsilon or high_p <= epsilon))
    value = error = 0.0
    for sides in range(4):
        sign_p, sign_q = 1.0 - 2.0 * (sides & 1), 1.0 - (sides & 2)
        if wanted.one_sided and sides:
            break
        if (high_q if sign_p > 0.0 else -low_q) <= epsilon or (high_p if sign_q > 0.0 else -low_p) <= epsilon:
            continue
        if cut:
            a, b = _cut_side(polygons, p, sign_p, q, sign_q, scratch.a), _cut_side(polygons, q, sign_q, p, sign_p, scratch.b)
        else:
            a, b = _whole_side(polygons, p, sign_p, scratch.a), _whole_side(polygons, q, sign_q, scratch.b)
        if a.sides >= 3 and b.sides >= 3 and a.radius > epsilon and b.radius > epsilon:
            part, wrong = _facing(world, p, q, a, b, cut, wanted, floor, scratch, only_plain)
            if only_plain is not None and wrong < 0.0:
                return 0.0, NOT_PLAIN
            value, error = value + part, error + wrong
    return value, error
