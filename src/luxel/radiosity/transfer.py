"""Transfer: the share of a receiving point's hemisphere that a flat shooter fills, near and far.

The form factor from a point with normal n to a surface, F = integral of cos_r cos_s / (pi r^2) dA, times the shooter's radiosity is the
irradiance at the point. Three ways to it, from cheap to exact:

* `disc_factor`: the shooter as a disc about its centre, cos_r cos_s A / (pi r^2 + A). Exact for a disc straight ahead, finite when near.
* `subdivided_factor`: four such discs.
* `polygon_factor`: Lambert's formula for a polygon, clipped to the receiver's horizon.

`disc_error` bounds the relative error of the first, and with half the size that of the second; `method` chooses by it.

Lambert's formula after Baum, Rushmeier, Winget, "Improving radiosity solutions through the use of analytically determined form-factors"
(1989), equation 7. It sums, over the edges, the angle that an edge fills times the cosine between n and the normal of the plane through edge
and point. Here the angle over its sine is a polynomial of its cosine, which keeps every digit of small angles and needs no arc tangent.

The bound. Let y be a point of the shooter relative to its centroid, in units of the distance r; q = the largest |y|, m = the mean of |y|^2 (at
most q^2 / 3 for triangles and parallelograms). Relative to its value at the centroid the integrand is f(y) = (1 + w.y / cos_r) / |e + y|^4
with e the unit vector to the centroid and w the receiver's normal within the shooter's plane: the shooter's cosine times r is the
distance of the plane and the same all over it. The mean of f less 1 is the mean of y' H(x) y / 2, H the second derivatives of f at
some x of the shooter, since the mean of y is 0. Within the plane the second derivatives of |e + y|^-4 have eigenvalues from -4 to 24 s^2 - 4,
over the sixth power of the distance, where s is the sine of the shooter's angle as seen at x; and the product with w adds at most 8 s |w| / cos_r
over the fifth. With the extremes of s and of the distance over |y| <= q that is an interval for the exact factor, and the disc's
1 / (1 + A / (pi r^2)) is compared with its ends. It is a bound, not an estimate: at 45 degrees it is about twice the true error.
"""

from __future__ import annotations

import math

from luxel import jit

DISC, SUBDIVIDED, POLYGON = 0, 1, 2
_PI = math.pi
# acos(x) / sqrt(1 - x^2) for x in 0..1 as a polynomial of 2 x - 1, to 1e-15: a Chebyshev fit, even powers first, then odd.
_EVEN = (
    1.209199576156145, 0.06973319205208463, 0.005861628973709484, 0.0005447740048700659, 5.307358997714355e-05,
    5.314722827590733e-06, 5.408461238751362e-07, 5.720420450648281e-08, 4.78858821063021e-09, 1.058917711680302e-09,
)  # fmt: skip
_ODD = (
    -0.26360014128128456, -0.019837146922516247, -0.001772928460299343, -0.0001693099555522558, -1.6749097681573505e-05,
    -1.6937941459825798e-06, -1.7354960338082845e-07, -1.8430571821933148e-08, -1.5670908696069492e-09, -3.3870201029189114e-10,
)  # fmt: skip


@jit.device
def disc_factor(cos_r, cos_s, r2, area):
    """Form factor from a point to a disc of `area` m2, centre at squared distance `r2`, cosines at receiver and shooter; 0 from behind."""
    return max(cos_r, 0.0) * max(cos_s, 0.0) * area / (_PI * r2 + area)


@jit.part
def angle_over_sine(cosine, sine):
    """The angle from 0 to pi over its sine, given both; 0 where it is infinite."""
    u = 2.0 * abs(cosine) - 1.0
    v = u * u
    even = odd = 0.0
    for i in range(9, -1, -1):
        even = even * v + _EVEN[i]
        odd = odd * v + _ODD[i]
    acute = even + u * odd
    if cosine >= 0.0:
        return acute
    return _PI / sine - acute if sine > 1e-12 else 0.0


@jit.part
def edge_term(ax, ay, az, bx, by, bz, nx, ny, nz):
    """An edge's part of Lambert's sum: its angle times the cosine between the normal and the plane through the edge and the origin."""
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    lengths = math.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    if not lengths > 0.0:
        return 0.0
    sine = math.sqrt(cx * cx + cy * cy + cz * cz) / lengths
    cosine = (ax * bx + ay * by + az * bz) / lengths
    return (nx * cx + ny * cy + nz * cz) / lengths * angle_over_sine(min(max(cosine, -1.0), 1.0), sine)


@jit.device
def polygon_factor(px, py, pz, nx, ny, nz, corners, k):
    """Form factor from the point p with unit normal n to a convex polygon, exact to rounding.

    Args:
        px, py, pz, nx, ny, nz: Point and normal.
        corners: (k or more, 3), metres, in one plane, counter-clockwise seen from the front.
        k: How many corners, at least 3.

    Returns:
        The factor, 0..1: positive if the point sees the polygon's front, negative if it sees the back; 0 from the polygon's own plane.
        What lies below the point's horizon does not count.
    """
    total = 0.0
    ax, ay, az = corners[k - 1, 0] - px, corners[k - 1, 1] - py, corners[k - 1, 2] - pz
    a = nx * ax + ny * ay + nz * az
    out_x = out_y = out_z = in_x = in_y = in_z = 0.0
    clipped = False
    for i in range(k):
        bx, by, bz = corners[i, 0] - px, corners[i, 1] - py, corners[i, 2] - pz
        b = nx * bx + ny * by + nz * bz
        if a > 0.0 and b > 0.0:
            total += edge_term(ax, ay, az, bx, by, bz, nx, ny, nz)
        elif a > 0.0 or b > 0.0:
            t = a / (a - b)
            hx, hy, hz = ax + t * (bx - ax), ay + t * (by - ay), az + t * (bz - az)  # on the horizon
            if a > 0.0:
                total += edge_term(ax, ay, az, hx, hy, hz, nx, ny, nz)
                out_x, out_y, out_z = hx, hy, hz
            else:
                total += edge_term(hx, hy, hz, bx, by, bz, nx, ny, nz)
                in_x, in_y, in_z = hx, hy, hz
            clipped = True
        ax, ay, az, a = bx, by, bz, b
    if clipped:
        total += edge_term(out_x, out_y, out_z, in_x, in_y, in_z, nx, ny, nz)
    return total * (-0.5 / _PI)


@jit.device
def subdivided_factor(px, py, pz, nx, ny, nz, sx, sy, sz, area, corners, k):
    """Form factor from the point p with normal n to a triangle (k = 3) or parallelogram (k = 4) of `area` and unit normal s, as four discs.

    The four are the midpoint triangles, or the quarters. Positive from the front, 0 from behind.
    """
    total = 0.0
    mx, my, mz = _middle(corners, k, 0), _middle(corners, k, 1), _middle(corners, k, 2)
    for i in range(4):
        # A corner's triangle has its centroid half-way from the corner to the middle, as a quarter has; the fourth triangle in the middle.
        half = 0.5 if i < k else 0.0
        c = i if i < k else 0
        dx = mx + half * (corners[c, 0] - mx) - px
        dy = my + half * (corners[c, 1] - my) - py
        dz = mz + half * (corners[c, 2] - mz) - pz
        r2 = dx * dx + dy * dy + dz * dz
        if r2 > 0.0:
            r = math.sqrt(r2)
            total += disc_factor((nx * dx + ny * dy + nz * dz) / r, -(sx * dx + sy * dy + sz * dz) / r, r2, 0.25 * area)
    return total


@jit.part
def _middle(corners, k, axis):
    """A coordinate of the centroid of a triangle or parallelogram."""
    total = 0.0
    for i in range(k):
        total += corners[i, axis]
    return total / k


@jit.device
def disc_error(cos_r, cos_s, cos_n, q, share):
    """Upper bound of the relative error of `disc_factor` for a triangle or parallelogram, derived at the top of this file.

    Args:
        cos_r, cos_s: Cosines at the receiver and at the shooter, of the line to the shooter's centroid.
        cos_n: Cosine between the two normals.
        q: Largest distance of a corner from the centroid, over the distance r.
        share: Area / (pi r^2).

    Returns:
        The bound; infinity where the disc is no use: from behind, across the horizon, or too near.
    """
    return _bound(cos_r, cos_s, math.sqrt(max(1.0 - cos_n * cos_n, 0.0)), q, share, share)


@jit.part
def _bound(cos_r, cos_s, along, q, least_share, most_share):
    """The bound for any receiver and shooter with these or larger cosines, these or smaller `along` (of the receiver's normal in the shooter's
    plane) and q, and a share between the two: it grows with all of them."""
    if cos_s <= 0.0 or q >= 1.0 or along * q >= cos_r or cos_r <= 0.0:
        return math.inf
    lift = along / cos_r
    offset = math.sqrt(max(1.0 - cos_s * cos_s, 0.0))
    low, high = max(offset - q, 0.0), offset + q
    near2, far2 = cos_s * cos_s + low * low, cos_s * cos_s + high * high  # squared distances at x
    near6, far6 = near2 * near2 * near2, far2 * far2 * far2
    sine2 = high * high / far2
    bend = 24.0 * sine2 - 4.0
    mixed = 8.0 * math.sqrt(sine2 * near2) * lift / near6
    most = (bend * (1.0 + lift * q) / near6 if bend > 0.0 else bend * (1.0 - lift * q) / far6) + mixed
    least = -4.0 * (1.0 + lift * q) / near6 - mixed
    # Half of m: at most q^2 / 6, and at least area / (12 r^2), as the area of triangles and parallelograms is at most 6 m r^2.
    lowest = 1.0 + q * q / 6.0 * least
    highest = 1.0 + (q * q / 6.0 if most > 0.0 else _PI * least_share / 12.0) * most
    if lowest <= 0.0 or highest <= 0.0:
        return math.inf
    return max(1.0 / ((1.0 + least_share) * lowest) - 1.0, 1.0 - 1.0 / ((1.0 + most_share) * highest))


@jit.device
def method(cos_r, cos_s, cos_n, q, share, tolerance):
    """The cheapest of DISC, SUBDIVIDED and POLYGON whose relative error stays below `tolerance`; arguments as for `disc_error`.

    A quarter's centroid lies within q / 2 of the whole's: its distance, cosines and share have these bounds.
    """
    along = math.sqrt(max(1.0 - cos_n * cos_n, 0.0))
    if _bound(cos_r, cos_s, along, q, share, share) <= tolerance:
        return DISC
    near, far = 1.0 - 0.5 * q, 1.0 + 0.5 * q
    if near > 0.0:
        least, most = 0.25 * share / (far * far), 0.25 * share / (near * near)
        if _bound((cos_r - 0.5 * q * along) / far, cos_s / far, along, 0.5 * q / near, least, most) <= tolerance:
            return SUBDIVIDED
    return POLYGON
