"""Nearest: the first triangle a ray meets, and from which side, and what lies on a surface: where a ray lost in a crack between triangles is no harm.

Of two back to back in one place it is the one that faces the ray, as in `luxel.radiosity.packet`.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.occlusion import Occlusion

_CHUNK = 256
_AT = ((0.56, 0.25, 0.19), (0.19, 0.56, 0.25), (0.25, 0.19, 0.56))  # weights of a triangle's corners; not on where others are often cut
_BEHIND = 4.0  # times `Occlusion.epsilon`: from where a triangle's back is asked


@jit.part
def _meets(c, ox, oy, oz, dx, dy, dz, epsilon):
    """Where on the segment from o by d the triangle of row `c` of `Occlusion.corners` is, 0..1, or 2, its back a little
    farther; and the product of d and its normal."""
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
    if not (s >= 0.0 and t >= 0.0 and s + t <= whole):
        return 2.0, slope
    return (height + epsilon) / slope if slope > 0.0 else at, slope


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


@jit.part
def _meets_any(scene, chosen, ox, oy, oz, dx, dy, dz):
    """Whether the segment from o by d meets a chosen triangle, even one in the same place as another."""
    ix, iy, iz = 1.0 / dx, 1.0 / dy, 1.0 / dz
    box, link, epsilon = scene.box, scene.link, scene.epsilon[0]
    node, nodes = np.uint64(0), np.uint64(len(link))
    while node < nodes:
        x0, x1 = (box[node, 0] - ox) * ix, (box[node, 3] - ox) * ix
        y0, y1 = (box[node, 1] - oy) * iy, (box[node, 4] - oy) * iy
        z0, z1 = (box[node, 2] - oz) * iz, (box[node, 5] - oz) * iz
        near = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), 0.0))
        far = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), 1.0))
        if near > far:
            node = np.uint64(link[node, 0])
            continue
        leaf = link[node, 1]
        for item in range(leaf >> 3, (leaf >> 3) + (leaf & 7)):
            if chosen[scene.triangle[item]] and _meets(scene.corners[item], ox, oy, oz, dx, dy, dz, epsilon)[0] < 1.0:
                return True
        node += np.uint64(1)
    return False


@jit.parallel_kernel
def _find_covered(queue, scene, chosen, position, normal, below, above, result):
    scene, chosen, position, normal = jit.borrow(scene), jit.borrow(chosen), jit.borrow(position), jit.borrow(normal)
    chunk = jit.take(queue)
    while chunk * _CHUNK < len(position):
        for i in range(chunk * _CHUNK, min(len(position), (chunk + 1) * _CHUNK)):
            x, y, z = np.float64(position[i, 0]), np.float64(position[i, 1]), np.float64(position[i, 2])
            nx, ny, nz = np.float64(normal[i, 0]), np.float64(normal[i, 1]), np.float64(normal[i, 2])
            down, way = below[i], below[i] + above[i]
            result[i] = _meets_any(scene, chosen, x - down * nx, y - down * ny, z - down * nz, way * nx, way * ny, way * nz)
        chunk = jit.take(queue)


def covered(scene: Occlusion, chosen: Array, position: Array, normal: Array, in_place: Array, above: Array, threads: int) -> Array:
    """(n,) bool: which points have a chosen triangle right above them; holes of masks cover, too.

    Args:
        chosen: (m,) bool.
        position, normal: (n, 3) float32: points, and the unit normals of their surface.
        in_place: (n,) bool: a triangle in the point's own place covers it.
        above: (n,) float64, metres: what is so near above it lies on it.
    """
    result = np.zeros(len(position), np.bool_)
    jit.run(_find_covered, threads, scene, chosen, position, normal, _BEHIND * scene.epsilon[0] * in_place, above, result)
    return result


@jit.part
def _is_backed(scene, a, b, c, point, away):
    """Whether a ray to the back of the triangle at a point of it, from `away` (3,) metres behind, meets a front."""
    w0, w1, w2 = _AT[point]
    x, y, z = w0 * a[0] + w1 * b[0] + w2 * c[0], w0 * a[1] + w1 * b[1] + w2 * c[1], w0 * a[2] + w1 * b[2] + w2 * c[2]
    met, side, _ = nearest(scene, x - away[0], y - away[1], z - away[2], 2.0 * away[0], 2.0 * away[1], 2.0 * away[2])
    return met >= 0 and side < 0.0


@jit.parallel_kernel
def _find_backed(queue, scene, positions, triangles, normals, result):
    scene, positions, triangles, normals = jit.borrow(scene), jit.borrow(positions), jit.borrow(triangles), jit.borrow(normals)
    chunk = jit.take(queue)
    while chunk * _CHUNK < len(triangles):
        for t in range(chunk * _CHUNK, min(len(triangles), (chunk + 1) * _CHUNK)):
            a, b, c = positions[triangles[t, 0]], positions[triangles[t, 1]], positions[triangles[t, 2]]
            first, second = _is_backed(scene, a, b, c, 0, normals[t]), _is_backed(scene, a, b, c, 1, normals[t])
            result[t] = _is_backed(scene, a, b, c, 2, normals[t]) if first != second else first
        chunk = jit.take(queue)


def backed(scene: Occlusion, positions: Array, triangles: Array, normals: Array, threads: int) -> Array:
    """(m,) bool: which triangles have, in the same place, others that face the other way: at two of three points of each.

    Args:
        positions: (n, 3) float64, metres.
        triangles: (m, 3) int32.
        normals: (m, 3) float64, unit length.
    """
    result = np.zeros(len(triangles), np.bool_)
    jit.run(_find_backed, threads, scene, positions, triangles, _BEHIND * scene.epsilon[0] * normals, result)
    return result
