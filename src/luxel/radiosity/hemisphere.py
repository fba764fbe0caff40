"""Hemisphere: the item buffer of the 2016 paper, for comparison with the hemicube.

Every vertex goes to the unit hemisphere, p / |p|, and from there straight down to the disc that the shooter's picture shows. Edges stay straight
between the projected vertices where true ones would bend, so a large triangle covers what it does not hide, and leaves out what it does. It is
one picture in place of five, and exact in the limit of small triangles; a test shows how the error falls.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import float_bits
from luxel.raster.constants import NOTHING
from luxel.raster.cover import BEHIND, draw_batch
from luxel.raster.lanes import LANES
from luxel.raster.setup import BATCH, SIZE, X0, X1, X2, Y0, Y1, Y2, Z0, Z1, Z2, T, place_batch, set_up_batch

_F, _I = np.float32, np.int32
_CENTRE = 128  # of a pixel, in fixed point
_LEVEL = 1e-6  # of its distance: no corner is nearer the horizon than this, so none lies on the disc's rim


@jit.part
def _raised(triangles, t, positions, center, frame, p, q):
    """The corners of triangle `t` in the shooter's frame, cut at the horizon; returns how many there are in `p` (rows x y z)."""
    for i in range(3):
        v = triangles[t, i]
        x, y, z = positions[0, v] - center[0], positions[1, v] - center[1], positions[2, v] - center[2]
        for k in range(3):
            q[i, k] = frame[k, 0] * x + frame[k, 1] * y + frame[k, 2] * z
    n = 0
    for i in range(3):
        j = i + 1 if i < 2 else 0
        a, b = q[i, 2], q[j, 2]
        if a > 0.0:
            p[n, 0], p[n, 1], p[n, 2] = q[i, 0], q[i, 1], a
            n += 1
        if (a > 0.0) != (b > 0.0):
            s = a / (a - b)
            p[n, 0], p[n, 1], p[n, 2] = q[i, 0] + s * (q[j, 0] - q[i, 0]), q[i, 1] + s * (q[j, 1] - q[i, 1]), 0.0
            n += 1
    return n


@jit.part
def _corner(p, row, half, near):
    """A corner's place in the picture (fixed point) and its depth, near over distance."""
    x, y, z = p[row, 0], p[row, 1], p[row, 2]
    distance = max(np.sqrt(x * x + y * y + z * z), near)
    z = max(z, _LEVEL * distance)
    scale = half / np.sqrt(x * x + y * y + z * z)
    return _I(np.floor(x * scale + half + 0.5)), _I(np.floor(half - y * scale + 0.5)), float_bits(_F(near / distance))


@jit.parallel_kernel
def _see(queue, positions, triangles, centers, frames, resolution, near, depths, ids):
    own_c, own_p, own_q = np.zeros(SIZE, np.int32), np.zeros((6, 3)), np.zeros((3, 3))
    c, p, q = jit.borrow(own_c), jit.borrow(own_p), jit.borrow(own_q)
    positions, triangles, depths, ids = jit.borrow(positions), jit.borrow(triangles), jit.borrow(depths), jit.borrow(ids)
    half = 128.0 * resolution
    s = jit.take(queue)
    while s < len(centers):
        depth, drawn = depths[s], ids[s]
        depth[:] = BEHIND
        drawn[:] = NOTHING
        n = np.uint64(0)
        for t in range(len(triangles) + 1):
            corners = _raised(triangles, t, positions, centers[s], frames[s], p, q) if t < len(triangles) else 0
            if n + np.uint64(max(corners - 2, 0)) > np.uint64(BATCH) or t == len(triangles):
                set_up_batch(n, c)
                place_batch(n, _CENTRE, _CENTRE, resolution, resolution, resolution, c)
                draw_batch(n, c, _CENTRE, _CENTRE, 0, resolution, depth, drawn, None)
                n = np.uint64(0)
            for k in range(1, corners - 1):
                x0, y0, z0 = _corner(p, 0, half, near)
                x1, y1, z1 = _corner(p, k, half, near)
                x2, y2, z2 = _corner(p, k + 1, half, near)
                if np.int64(x1 - x0) * np.int64(y2 - y0) != np.int64(x2 - x0) * np.int64(y1 - y0):
                    c[T + n] = t
                    c[X0 + n], c[Y0 + n], c[Z0 + n] = x0, y0, z0
                    c[X1 + n], c[Y1 + n], c[Z1 + n] = x1, y1, z1
                    c[X2 + n], c[Y2 + n], c[Z2 + n] = x2, y2, z2
                    n += np.uint64(1)
        s = jit.take(queue)
    own_c[0], own_p[0, 0], own_q[0, 0] = 0, 0, 0  # they live until here


def see_hemisphere(positions: Array, triangles: Array, centers: Array, frames: Array, resolution: int, near: float,
                   threads: int) -> tuple[Array, Array]:  # fmt: skip
    """Draw what s shooters see as discs.

    Args:
        positions: (3, n) float32: x, y and z of the vertices, metres.
        triangles: (m, 3) int32.
        centers: (s, 3) float32, metres.
        frames: (s, 3, 3) float32: rows right, up and normal of each shooter, orthonormal.
        resolution: Pixels along a side, at most 128.
        near: Metres; what is nearer counts as this near.

    Returns:
        ids (s, resolution, resolution) int32, -1 where nothing is, and depth, float32: near over distance, -1 where nothing is. A pixel shows the
        direction (x, y, sqrt(1 - x^2 - y^2)) with x from -1 to 1 along a row and y from 1 to -1 down a column.
    """
    shape = (len(centers), resolution * resolution + LANES)
    depth, ids = np.empty(shape, np.float32), np.empty(shape, np.int32)
    jit.run(_see, min(threads, len(centers)), positions, triangles, centers, frames, resolution, float(near), depth, ids)
    size = resolution * resolution
    return ids[:, :size].reshape(-1, resolution, resolution), depth[:, :size].reshape(-1, resolution, resolution)
