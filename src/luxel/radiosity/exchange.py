"""Exchange between two polygons that see all of each other: the double integral of cos cos / (pi r^2) over both.

Three ways, by distance: Gauss-Legendre points on both (`over_points`), of rising order; and near or touching the contour integral

    1 / (2 pi) sum over edges of both (u . v) integral integral ln r ds dt

(Stokes' theorem; Sparrow 1963), the inner integral in closed form, the outer by Gauss-Legendre. Inner is the longer edge of the two, so the outer
integrand varies little along the shorter, but where that comes near the other's ends or passes close by its line: it is all but singular there, and
singular where polygons touch. The shorter edge is cut at these places, and the points crowd at the ends of what is cut. The parts are
halved until two results agree, for each pair of edges: sums of all pairs can agree by chance, as errors of different signs cancel.
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
_CLOSE = 0.2  # of an edge's length: what is farther from it needs no cut


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


@jit.inlined
def _square(x, y, z):
    return x * x + y * y + z * z


@jit.part
def _cuts(s, u, v, length):
    """Where along the edge s + t u, 0 <= t <= 1, the integrand has its near singularities, rising; 0 for each that is too far to matter.

    They are the points nearest to the ends of the other edge, from the origin to `length` times the unit vector v, and to its inside.
    """
    uu, uv = _square(*u), u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    su, sv = s[0] * u[0] + s[1] * u[1] + s[2] * u[2], s[0] * v[0] + s[1] * v[1] + s[2] * v[2]
    across = uu - uv * uv  # of u, the square of the part that is normal to v
    first, second = -su / uu, (length * uv - su) / uu
    third = (sv * uv - su) / across if across > 1e-9 * uu else 0.0
    y = sv + third * uv
    limit = _CLOSE * _CLOSE * uu
    if _square(s[0] + first * u[0], s[1] + first * u[1], s[2] + first * u[2]) > limit:
        first = 0.0
    if _square(s[0] + second * u[0] - length * v[0], s[1] + second * u[1] - length * v[1], s[2] + second * u[2] - length * v[2]) > limit:
        second = 0.0
    if not 0.0 < y < length or _square(s[0] + third * u[0] - y * v[0], s[1] + third * u[1] - y * v[1], s[2] + third * u[2] - y * v[2]) > limit:
        third = 0.0
    first, second, third = min(max(first, 0.0), 1.0), min(max(second, 0.0), 1.0), min(max(third, 0.0), 1.0)
    low, high = min(first, second, third), max(first, second, third)
    return low, first + second + third - low - high, high


@jit.part
def _part(s, u, v, length, start, width, pieces):
    """The double integral of ln r over the other edge and the part of s + t u from t = start on, `width` long, as a share of u's length."""
    total = 0.0
    for piece in range(pieces):
        for n in range(6):
            z = (piece + _NODES[n]) / pieces
            t = start + width * z * z * z * (10.0 - z * (15.0 - 6.0 * z))
            weight = _WEIGHTS[n] * 30.0 * z * z * (1.0 - z) * (1.0 - z)
            wx, wy, wz = s[0] + t * u[0], s[1] + t * u[1], s[2] + t * u[2]
            y = wx * v[0] + wy * v[1] + wz * v[2]
            d2 = _square(wy * v[2] - wz * v[1], wz * v[0] - wx * v[2], wx * v[1] - wy * v[0])
            d = math.sqrt(d2)
            total += weight * (_antiderivative(length - y, d2, d) - _antiderivative(-y, d2, d))
    return total * width / pieces


@jit.part
def _edge_pair(a, i, j, b, k, l, pieces, scale):
    """u . v times the double integral of ln(r / scale) along the edges u = a[i] a[j] and v = b[k] b[l], in units of `scale`."""
    u = (a[j, 0] - a[i, 0]) * scale, (a[j, 1] - a[i, 1]) * scale, (a[j, 2] - a[i, 2]) * scale
    v = (b[l, 0] - b[k, 0]) * scale, (b[l, 1] - b[k, 1]) * scale, (b[l, 2] - b[k, 2]) * scale
    s = (a[i, 0] - b[k, 0]) * scale, (a[i, 1] - b[k, 1]) * scale, (a[i, 2] - b[k, 2]) * scale
    along = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    if along == 0.0:
        return 0.0
    if _square(*u) > _square(*v):
        u, v, s = v, u, (-s[0], -s[1], -s[2])
    length = math.sqrt(_square(*v))
    v = v[0] / length, v[1] / length, v[2] / length
    low, middle, high = _cuts(s, u, v, length)
    total = _part(s, u, v, length, high, 1.0 - high, pieces) if high < 1.0 else 0.0
    if low > 0.0:
        total += _part(s, u, v, length, 0.0, low, pieces)
    if middle > low:
        total += _part(s, u, v, length, low, middle - low, pieces)
    if high > middle:
        total += _part(s, u, v, length, middle, high - middle, pieces)
    return total * along / length


@jit.part
def contour_integral(a, count_a, b, count_b, radius, tolerance, floor, terms):
    """The integral over the contours of two polygons (corners (k, 3)), and an estimate of its error.

    Args:
        radius: Their size or distance, metres, about; the unit in which logarithms are taken.
        tolerance, floor: The relative or the absolute error (m2) at which to stop, whichever allows more.
        terms: Scratch, (2, k, k) float64.
    """
    scale, unit = 1.0 / radius, radius * radius / (2.0 * math.pi)
    pieces, enough = np.int64(1), 0.0
    while True:
        total = error = 0.0
        for i in range(count_a):
            for k in range(count_b):
                if pieces == 1 or terms[1, i, k] > enough:
                    before = 0.0 if pieces == 1 else terms[0, i, k]
                    terms[0, i, k] = _edge_pair(a, i, i + 1 if i + 1 < count_a else 0, b, k, k + 1 if k + 1 < count_b else 0, pieces, scale)
                    terms[1, i, k] = abs(terms[0, i, k] - before)
                total += terms[0, i, k]
                error += terms[1, i, k]
        allowed = max(tolerance * abs(total), floor / unit)
        if (pieces > 1 and error <= allowed) or pieces == _MOST_PIECES:
            return abs(total) * unit, error * unit
        if pieces > 1:
            enough = allowed / (count_a * count_b)
        pieces *= 2
