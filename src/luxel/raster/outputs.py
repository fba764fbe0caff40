"""Outputs beside colour: depth, ids, normals, positions, ... of the first sample of each pixel. Never averaged."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.bin import Bins, Clipped
from luxel.raster.fragments import find_part
from luxel.raster.geometry import Geometry

_F = np.float32

SHAPES = {
    "depth": ((), np.float32, np.inf), "triangle": ((), np.int32, -1), "object": ((), np.int32, -1), "material": ((), np.int32, -1),
    "normal": ((3,), np.float32, 0), "position": ((3,), np.float32, 0), "barycentric": ((3,), np.float32, 0),
    "texcoord": ((2,), np.float32, 0), "motion": ((2,), np.float32, 0),
}  # fmt: skip
"""Name: (shape of a pixel's value, dtype, value where there is nothing)."""


class Outputs(NamedTuple):
    """(h, w, ...) arrays as in `SHAPES`; those that are not wanted are (0, 0, ...)."""

    depth: Array
    triangle: Array
    object: Array
    material: Array
    normal: Array
    position: Array
    barycentric: Array
    texcoord: Array
    motion: Array

    @classmethod
    def wanted(cls, names: set[str], width: int, height: int) -> Outputs:
        """Arrays of the outputs named, filled with nothing; empty ones for the rest."""
        kinds = {name: SHAPES[name] for name in names & set(SHAPES)}
        return _NOTHING._replace(**{name: np.full((height, width, *shape), nothing, dtype) for name, (shape, dtype, nothing) in kinds.items()})


_NOTHING = Outputs(*(np.empty((0, 0, *shape), dtype) for shape, dtype, _ in SHAPES.values()))


@jit.inlined
def write_pixel(t, d, x, y, ox, oy, geometry, screen, screen_f, clipped, clipped_f, sx, sy, full, near, far, parallel, motion_from, previous,
                out):  # fmt: skip
    """Write the outputs of pixel (x, y) of a window, at (ox, oy): its sample at (sx, sy) sees triangle `t` at depth `d`."""
    triangles, positions, normals, texcoords = geometry.triangles, geometry.positions, geometry.normals, geometry.texcoords
    m = len(triangles)
    fx, fy = np.float64((x << 8) + sx), np.float64((y << 8) + sy)
    source = t
    if t < m:
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        x0, y0, w0 = np.float64(screen[a, 0]), np.float64(screen[a, 1]), np.float64(screen_f[a, 3])
        x1, y1, w1 = np.float64(screen[b, 0]), np.float64(screen[b, 1]), np.float64(screen_f[b, 3])
        x2, y2, w2 = np.float64(screen[c, 0]), np.float64(screen[c, 1]), np.float64(screen_f[c, 3])
    else:
        k = t - m
        source = clipped.source[k]
        a, b, c = triangles[source, 0], triangles[source, 1], triangles[source, 2]
        cs = clipped.screen
        x0, y0, w0 = np.float64(cs[k, 0, 0]), np.float64(cs[k, 0, 1]), np.float64(clipped_f[k, 0, 3])
        x1, y1, w1 = np.float64(cs[k, 1, 0]), np.float64(cs[k, 1, 1]), np.float64(clipped_f[k, 1, 3])
        x2, y2, w2 = np.float64(cs[k, 2, 0]), np.float64(cs[k, 2, 1]), np.float64(clipped_f[k, 2, 3])
    s0 = ((y2 - y1) * (fx - x1) + (x1 - x2) * (fy - y1)) * w0
    s1 = ((y0 - y2) * (fx - x2) + (x2 - x0) * (fy - y2)) * w1
    s2 = ((y1 - y0) * (fx - x0) + (x0 - x1) * (fy - y0)) * w2
    inverse = 1.0 / (s0 + s1 + s2)
    b0, b1, b2 = s0 * inverse, s1 * inverse, s2 * inverse
    if t >= m:
        q, k = clipped.corners, t - m
        b0, b1, b2 = (
            b0 * q[k, 0, 0] + b1 * q[k, 1, 0] + b2 * q[k, 2, 0], b0 * q[k, 0, 1] + b1 * q[k, 1, 1] + b2 * q[k, 2, 1],
            b0 * q[k, 0, 2] + b1 * q[k, 1, 2] + b2 * q[k, 2, 2],
        )  # fmt: skip
    if len(out.depth) > 0:
        out.depth[oy, ox] = far - d * (far - near) if parallel else near / d
    if len(out.triangle) > 0:
        out.triangle[oy, ox] = source
    if len(out.object) > 0 or len(out.material) > 0:
        part = find_part(geometry.part_start, source)
        if len(out.object) > 0:
            out.object[oy, ox] = geometry.part_object[part]
        if len(out.material) > 0:
            out.material[oy, ox] = geometry.part_material[part]
    if len(out.barycentric) > 0:
        out.barycentric[oy, ox, 0], out.barycentric[oy, ox, 1], out.barycentric[oy, ox, 2] = _F(b0), _F(b1), _F(b2)
    if len(out.texcoord) > 0 and len(texcoords) > 0:
        for k in range(2):
            out.texcoord[oy, ox, k] = b0 * texcoords[a, k] + b1 * texcoords[b, k] + b2 * texcoords[c, k]
    if len(out.normal) > 0:
        nx = b0 * normals[a, 0] + b1 * normals[b, 0] + b2 * normals[c, 0]
        ny = b0 * normals[a, 1] + b1 * normals[b, 1] + b2 * normals[c, 1]
        nz = b0 * normals[a, 2] + b1 * normals[b, 2] + b2 * normals[c, 2]
        scale = 1.0 / max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-30)
        out.normal[oy, ox, 0], out.normal[oy, ox, 1], out.normal[oy, ox, 2] = _F(nx * scale), _F(ny * scale), _F(nz * scale)
    if len(out.position) > 0 or motion_from:
        wx = b0 * positions[a, 0] + b1 * positions[b, 0] + b2 * positions[c, 0]
        wy = b0 * positions[a, 1] + b1 * positions[b, 1] + b2 * positions[c, 1]
        wz = b0 * positions[a, 2] + b1 * positions[b, 2] + b2 * positions[c, 2]
        if len(out.position) > 0:
            out.position[oy, ox, 0], out.position[oy, ox, 1], out.position[oy, ox, 2] = _F(wx), _F(wy), _F(wz)
        if motion_from:
            cw = previous[3, 0] * wx + previous[3, 1] * wy + previous[3, 2] * wz + previous[3, 3]
            cx = (previous[0, 0] * wx + previous[0, 1] * wy + previous[0, 2] * wz + previous[0, 3]) / cw
            cy = (previous[1, 0] * wx + previous[1, 1] * wy + previous[1, 2] * wz + previous[1, 3]) / cw
            out.motion[oy, ox, 0] = _F(ox + sx / 256 - (cx * 0.5 + 0.5) * full[0])
            out.motion[oy, ox, 1] = _F(oy + sy / 256 - (0.5 - cy * 0.5) * full[1])


@jit.parallel_kernel
def _outputs(queue, first_tile, last_tile, across, tile, width, height, occupied, ids, depths, geometry, screen, screen_f, clipped, clipped_f,
             pattern, full, near, far, parallel, motion_from, previous, left, top, out):  # fmt: skip
    sx, sy = np.int64(pattern[0, 0]), np.int64(pattern[0, 1])
    number = first_tile + jit.take(queue)
    while number < last_tile:
        slot = number - first_tile
        px, py = (number % across) * tile, (number // across) * tile
        pixels = tile * min(tile, height - py) if occupied[number] else 0
        for i in range(pixels):
            x, y, t = px + i % tile, py + i // tile, ids[slot, i]
            if t < 0 or x >= width:
                continue
            d = depths[slot, i] if len(depths) > 0 else _F(0.0)
            write_pixel(t, d, x, y, left + x, top + y, geometry, screen, screen_f, clipped, clipped_f, sx, sy, full, near, far, parallel,
                        motion_from, previous, out)  # fmt: skip
        number = first_tile + jit.take(queue)


def write_outputs(bins: Bins, occupied: Array, first_tile: int, last_tile: int, width: int, height: int, ids: Array, depths: Array,
                  geometry: Geometry, screen: Array, clipped: Clipped, pattern: Array, full: tuple[int, int], near: float, far: float, parallel: bool,
                  previous: Array | None, left: int, top: int, outputs: Outputs, threads: int) -> None:  # fmt: skip
    """Fill `outputs` from the first sample of the pixels of tiles first_tile .. last_tile - 1.

    Args:
        ids, depths: From `cover`, depths kept.
        full: Width and height of the whole picture.
        near, far, parallel: Of the camera, which turn stored depth into metres.
        previous: (4, 4) float64, clip_from_world of the camera that motion is measured from, or None.
        left, top: Where the window lies in the outputs.
    """
    jit.run(
        _outputs, min(threads, last_tile - first_tile), first_tile, last_tile, bins.across, bins.tile, width, height, occupied, ids, depths,
        geometry, screen, screen.view(np.float32), clipped, clipped.screen.view(np.float32), pattern, np.array(full, np.float64),
        _F(near), _F(far), parallel, len(outputs.motion) > 0, np.eye(4) if previous is None else previous, left, top, outputs,
    )  # fmt: skip
