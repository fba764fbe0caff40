"""Exchange between two polygons that see all of each other: the double integral of cos cos / (pi r^2) over both.

Three ways, by distance: Gauss-Legendre points on both (`over_points`), of rising order; and near or touching the contour integral

    1 / (2 pi) sum over edges of both (u . v) integral integral ln r ds dt

(Stokes' theorem; Sparrow 1963), the inner integral in closed form, the outer by Gauss-Legendre in a variable that crowds the points at the edge's
ends, where the integrand of touching polygons is singular. Pieces are halved until two results agree.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.radiosity.surfaces import RULES

_R1, _R2, _R3 = RULES[1:]
_NODES = tuple(float(x) for x in (np.polynomial.legendre.leggauss(6)[0] + 1) / 2)
_WEIGHTS = tuple(float(x) for x in np.polynomial.legendre.leggauss(6)[1] / 2)
_MOST_PIECES = 64


@jit.part
def over_points(a, b, first, last, na, nb):
    """The integral by the points first .. last - 1 of both polygons' rules (rows x, y, z, weight) and their unit normals, of any sign."""
    nax, nay, naz, nbx, nby, nbz = na[0], na[1], na[2], nb[0], nb[1], nb[2]
    total = 0.0
    for i in range(np.uint64(first), np.uint64(last)):
        x, y, z = a[i, 0], a[i, 1], a[i, 2]
        row = 0.0
        for j in range(np.uint64(first), np.uint64(last)):
            dx, dy, dz = b[j, 0] - x, b[j, 1] - y, b[j, 2] - z
            r2 = dx * dx + dy * dy + dz * dz
            row += b[j, 3] * (nax * dx + nay * dy + naz * dz) * (nbx * dx + nby * dy + nbz * dz) / (r2 * r2)
        total += a[i, 3] * row
    return abs(total) / math.pi


@jit.part
def _antiderivative(y, d2, d):
    """Of ln(y^2 + d^2) / 2 with respect to y."""
    square = y * y + d2
    if square <= 0.0:
        return 0.0
    return 0.5 * y * math.log(square) - y + (d * math.atan(y / d) if d > 0.0 else 0.0)


@jit.part
def _edge_pair(a, i, j, b, k, l, pieces, scale):
    """u . v times the double integral of ln(r / scale) along the edges a[i] a[j] and b[k] b[l], in units of `scale`."""
    ux, uy, uz = (a[j, 0] - a[i, 0]) * scale, (a[j, 1] - a[i, 1]) * scale, (a[j, 2] - a[i, 2]) * scale
    vx, vy, vz = (b[l, 0] - b[k, 0]) * scale, (b[l, 1] - b[k, 1]) * scale, (b[l, 2] - b[k, 2]) * scale
    along = ux * vx + uy * vy + uz * vz
    length = math.sqrt(vx * vx + vy * vy + vz * vz)
    if along == 0.0 or length == 0.0:
        return 0.0
    vx, vy, vz = vx / length, vy / length, vz / length
    sx, sy, sz = (a[i, 0] - b[k, 0]) * scale, (a[i, 1] - b[k, 1]) * scale, (a[i, 2] - b[k, 2]) * scale
    total = 0.0
    for piece in range(pieces):
        for n in range(6):
            z = (piece + _NODES[n]) / pieces
            t = z * z * z * (10.0 - z * (15.0 - 6.0 * z))
            weight = _WEIGHTS[n] * 30.0 * z * z * (1.0 - z) * (1.0 - z)
            wx, wy, wz = sx + t * ux, sy + t * uy, sz + t * uz
            y = wx * vx + wy * vy + wz * vz
            cx, cy, cz = wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx
            d2 = cx * cx + cy * cy + cz * cz
            d = math.sqrt(d2)
            total += weight * (_antiderivative(length - y, d2, d) - _antiderivative(-y, d2, d))
    return total * along / length / pieces


@jit.part
def _contour(a, count_a, b, count_b, pieces, scale):
    total = 0.0
    for i in range(count_a):
        j = i + 1 if i + 1 < count_a else 0
        for k in range(count_b):
            l = k + 1 if k + 1 < count_b else 0
            total += _edge_pair(a, i, j, b, k, l, pieces, scale)
    return abs(total) / (2.0 * math.pi * scale * scale)


@jit.part
def contour_integral(a, count_a, b, count_b, radius, tolerance, floor):
    """The integral over the contours of two polygons (corners (k, 3)), and an estimate of its error.

    Args:
        radius: Their size or distance, metres, about; the unit in which logarithms are taken.
        tolerance, floor: The relative or the absolute error (m2) at which to stop, whichever allows more.
    """
    scale = 1.0 / radius
    pieces = np.int64(1)
    value = error = 0.0
    while pieces <= _MOST_PIECES:
        finer = _contour(a, count_a, b, count_b, pieces, scale)
        error = abs(finer - value)
        value = finer
        if pieces > 1 and error <= max(tolerance * value, floor):
            break
        pieces *= 2
    return value, error
