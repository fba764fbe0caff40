"""Transfer: the share of a receiving point's hemisphere that a flat shooter fills, near and far.

The form factor from a point with normal n to a surface, F = integral of cos_r cos_s / (pi r^2) dA, times the shooter's radiosity is the
irradiance at the point. Two ways to it:

* `spread_factor`, from afar: the value at the surface's centre, put right for how far the surface spreads about it.
* `polygon_factor`: Lambert's formula for a polygon, clipped to the receiver's horizon.

Of a square three of its sides away the first is off by a tenth of a per cent in the median and by 3 % at most, just above the horizon, which falls
with the square of the distance; of one that the horizon cuts, by 4 % of what it would be straight ahead, which falls with the distance. Nearer than
that the second is used (`share.FLAT`).

Lambert's formula after Baum, Rushmeier, Winget, "Improving radiosity solutions through the use of analytically determined form-factors"
(1989), equation 7. It sums, over the edges, the angle that an edge fills times the cosine between n and the normal of the plane through edge
and point. Here the angle over its sine is a polynomial of its cosine, which keeps every digit of small angles and needs no arc tangent.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit

_PI = math.pi
_F = np.float32
_PER_PI = _F(1 / np.pi)
# acos(x) / sqrt(1 - x^2) for x in 0..1 as a polynomial of 2 x - 1, to 1e-15: a Chebyshev fit, even powers first, then odd.
_EVEN = (
    1.209199576156145, 0.06973319205208463, 0.005861628973709484, 0.0005447740048700659, 5.307358997714355e-05,
    5.314722827590733e-06, 5.408461238751362e-07, 5.720420450648281e-08, 4.78858821063021e-09, 1.058917711680302e-09,
)  # fmt: skip
_ODD = (
    -0.26360014128128456, -0.019837146922516247, -0.001772928460299343, -0.0001693099555522558, -1.6749097681573505e-05,
    -1.6937941459825798e-06, -1.7354960338082845e-07, -1.8430571821933148e-08, -1.5670908696069492e-09, -3.3870201029189114e-10,
)  # fmt: skip


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


@jit.inlined
def spread_factor(cos_r, cos_s, cos_n, r2, area, spread):
    """Form factor from a point to a flat surface of mean square extent `spread` along its axes, right to the second order of extent over distance.

    cos_r and cos_s are times r. The integrand f = cos_r cos_s / r^2 has in the surface's plane the Laplacian (8 - 24 cos_s^2 - 8 cos_n cos_s /
    cos_r) f / r^2, of which half times `spread` is the difference of its mean from its value at the centre; straight ahead that is -4 spread / r^2,
    as of a disc.
    """
    base, inverse = cos_r * cos_s, _F(1.0) / r2
    bend = _F(4.0) * spread * inverse * (base - cos_s * cos_s * (_F(3.0) * base * inverse + cos_n))
    mean = base + bend if bend > _F(0.0) else base * base / (base - bend)
    return mean * area * (inverse * inverse * _PER_PI)
