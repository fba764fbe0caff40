"""Nearest: the first triangle a ray meets, and from which side: for statistics, where a ray lost in a crack between triangles is no harm."""

from __future__ import annotations

import numpy as np

from luxel import jit


@jit.part
def _meets(c, ox, oy, oz, dx, dy, dz, epsilon):
    """Where on the segment from o by d the triangle of row `c` of `Occlusion.corners` is, 0..1, or 2; and the product of d and its normal."""
    nx, ny, nz = np.float64(c[9]), np.float64(c[10]), np.float64(c[11])
    slope = nx * dx + ny * dy + nz * dz
    ax, ay, az = c[0] - ox, c[1] - oy, c[2] - oz
    height = nx * ax + ny * ay + nz * az
    if slope == 0.0 or abs(height) <= epsilon:  # it lies in the triangle's plane, or starts there
        return 2.0, slope
    at = height / slope
    if not 0.0 < at < 1.0:
        return 2.0, slope
    px, py, pz = dx * at - ax, dy * at - ay, dz * at - az
    ux, uy, uz, vx, vy, vz = c[3] - c[0], c[4] - c[1], c[5] - c[2], c[6] - c[0], c[7] - c[1], c[8] - c[2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    pu, pv = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
    whole = uu * vv - uv * uv
    s, t = pu * vv - pv * uv, pv * uu - pu * uv
    return at if s >= 0.0 and t >= 0.0 and s + t <= whole else 2.0, slope


@jit.device
def nearest(scene, ox, oy, oz, dx, dy, dz):
    """The first triangle of `scene` (an `Occlusion`) on the segment from o by d, float64 metres.

    Returns:
        Its row in the mesh or -1; the product of d and its normal, below 0 where the segment comes from the front; and where it is met, 0..1.
    """
    found, side, reach = np.int64(-1), 0.0, 1.0
    ix, iy, iz = 1.0 / dx, 1.0 / dy, 1.0 / dz
    box, link, epsilon = scene.box, scene.link, scene.epsilon[0]
    node, nodes = np.uint64(0), np.uint64(len(link))
    while node < nodes:
        x0, x1 = (box[node, 0] - ox) * ix, (box[node, 3] - ox) * ix
        y0, y1 = (box[node, 1] - oy) * iy, (box[node, 4] - oy) * iy
        z0, z1 = (box[node, 2] - oz) * iz, (box[node, 5] - oz) * iz
        near = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), 0.0))
        far = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), reach))
        if near > far:
            node = np.uint64(link[node, 0])
            continue
        leaf = link[node, 1]
        for item in range(leaf >> 3, (leaf >> 3) + (leaf & 7)):
            at, slope = _meets(scene.corners[item], ox, oy, oz, dx, dy, dz, epsilon)
            if at < reach:
                found, side, reach = np.int64(scene.triangle[item]), slope, at
        node += np.uint64(1)
    return found, side, reach
