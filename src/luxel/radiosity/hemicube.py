"""Hemicube: what a batch of shooters sees, drawn by the rasteriser (Cohen and Greenberg 1985, "The hemi-cube").

A shooter looks through five square faces of a cube around it: one above it and four on the sides, of which the lower half lies below its
horizon and is not drawn. Each face is one tile of `cover`: the rasteriser's own set-up, coverage and depth, of which only the loading of
corners is different here, because the same vertices serve five projections.

Frame of a shooter: rows right, up, axis of `frames`, its normal last. Faces, as axis / right / up of the picture:
0: +z / +x / +y,  1: +x / +y / +z,  2: -x / +y / +z,  3: +y / +x / +z,  4: -y / +x / +z.
Depth is near / (distance along the face's axis): 1 at the near plane, 0 at infinity, `BEHIND` where nothing is.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import float_bits, floor32
from luxel.memory import reusable
from luxel.raster.clip import clip_polygon
from luxel.raster.constants import NOTHING
from luxel.raster.cover import BEHIND, draw_batch
from luxel.raster.lanes import LANES
from luxel.raster.setup import BATCH, SIZE, X0, X1, X2, Y0, Y1, Y2, Z0, Z1, Z2, T, place_batch, set_up_batch

FACES = 5
RESOLUTIONS = (16, 32, 64, 128)
"""Pixels along a face; the largest is the rasteriser's largest tile."""

_F, _I = np.float32, np.int32
_CENTRE = 128  # of a pixel, in fixed point
GUARD = 8.0  # triangles are cut at this many half widths of a face
MOST = 9  # corners of a triangle cut by six planes

# Bits of a vertex: below the horizon, and on which side of the planes between faces it lies.
DOWN = 1
_X_OVER_Z, _X_UNDER_Z, _NX_OVER_Z, _NX_UNDER_Z, _Y_OVER_Z, _Y_UNDER_Z, _NY_OVER_Z, _NY_UNDER_Z = (1 << i for i in range(1, 9))
_Y_OVER_X, _Y_UNDER_X, _Y_OVER_NX, _Y_UNDER_NX = (1 << i for i in range(9, 13))

# A triangle whose corners share one of these bits is not on the face.
OUT = (
    _X_OVER_Z | _NX_OVER_Z | _Y_OVER_Z | _NY_OVER_Z,
    _X_UNDER_Z | _Y_OVER_X | _Y_UNDER_NX,
    _NX_UNDER_Z | _Y_OVER_NX | _Y_UNDER_X,
    _Y_UNDER_Z | _Y_UNDER_X | _Y_UNDER_NX,
    _NY_UNDER_Z | _Y_OVER_NX | _Y_OVER_X,
)


class ItemBuffers(NamedTuple):
    """What shooters see.

    Attributes:
        start: (s + 1,) int64: shooter i has elements start[i] .. start[i + 1] - 1 of the two others: its faces, one after the other, row by row.
        resolution: (s,) int64, pixels along a face.
        depth: float32, near / (distance along the face's axis); `BEHIND` where nothing is.
        ids: int32, triangle ids; `NOTHING` where nothing is.
        near: Metres.
    """

    start: Array
    resolution: Array
    depth: Array
    ids: Array
    near: float

    def part(self, first: int, last: int) -> ItemBuffers:
        """Of shooters first .. last - 1, in the same arrays."""
        return self._replace(start=self.start[first : last + 1], resolution=self.resolution[first:last])


@jit.inlined
def _bit(condition, bit):
    return _I(bit) if condition else _I(0)


@jit.inlined
def side_bits(vx, vy, vz, near):
    """The bits of a vertex in the shooter's frame."""
    code = _bit(vz <= near, DOWN) | _bit(vx > vz, _X_OVER_Z) | _bit(vx < vz, _X_UNDER_Z) | _bit(-vx > vz, _NX_OVER_Z)
    code |= _bit(-vx < vz, _NX_UNDER_Z) | _bit(vy > vz, _Y_OVER_Z) | _bit(vy < vz, _Y_UNDER_Z) | _bit(-vy > vz, _NY_OVER_Z)
    code |= _bit(-vy < vz, _NY_UNDER_Z) | _bit(vy > vx, _Y_OVER_X) | _bit(vy < vx, _Y_UNDER_X)
    return code | _bit(vy > -vx, _Y_OVER_NX) | _bit(vy < -vx, _Y_UNDER_NX)


@jit.inlined
def in_frame(rows, x, y, z):
    """A vector in the frame with these rows, nine numbers."""
    r0, r1, r2, u0, u1, u2, n0, n1, n2 = rows
    return r0 * x + r1 * y + r2 * z, u0 * x + u1 * y + u2 * z, n0 * x + n1 * y + n2 * z


@jit.part
def _look(first, last, positions, frame, center, x, y, z, codes, near):
    """Vertices first .. last - 1 in the shooter's frame, and where they lie."""
    rows = frame[0, 0], frame[0, 1], frame[0, 2], frame[1, 0], frame[1, 1], frame[1, 2], frame[2, 0], frame[2, 1], frame[2, 2]
    cx, cy, cz = center[0], center[1], center[2]
    for i in range(np.uint64(first), np.uint64(last)):
        vx, vy, vz = in_frame(rows, positions[0, i] - cx, positions[1, i] - cy, positions[2, i] - cz)
        x[i], y[i], z[i] = vx, vy, vz
        codes[i] = side_bits(vx, vy, vz, near)


@jit.part
def _sort(triangles, codes, lists, counts):
    """Which triangles may be on which face."""
    for face in range(FACES):
        counts[face] = 0
    for t in range(np.uint64(0), np.uint64(len(triangles))):
        shared = codes[np.uint64(triangles[t, 0])] & codes[np.uint64(triangles[t, 1])] & codes[np.uint64(triangles[t, 2])]
        if shared & DOWN == 0:
            for face in range(FACES):
                lists[face, np.uint64(counts[face])] = t
                counts[face] += shared & OUT[face] == 0


@jit.inlined
def turned(face, x, y, z):
    """Right, up and axis coordinates of a point on `face`."""
    if face == 0:
        return x, y, z
    if face == 1:
        return y, z, x
    if face == 2:
        return y, z, -x
    if face == 3:
        return x, z, y
    return x, z, -y


@jit.inlined
def is_within(right, up, axis, near):
    """Whether a corner is beyond the near plane and within the guard band of a face."""
    limit = _F(GUARD)
    return (axis > near) & (abs(right) <= limit * axis) & (abs(up) <= limit * axis)


@jit.inlined
def snapped(right, up, axis, half, near):
    """Where a corner is on its face, in fixed point, and its depth."""
    scale = _F(1.0) / axis
    return _I(floor32(right * scale * half + half + _F(0.5))), _I(floor32(half - up * scale * half + _F(0.5))), near * scale


@jit.part
def _place(i, k, right, up, axis, half, near, c):
    """Corner `k` of entry `i` of the batch."""
    px, py, depth = snapped(right, up, axis, half, near)
    z = float_bits(depth)
    if k == 0:
        c[X0 + i], c[Y0 + i], c[Z0 + i] = px, py, z
    elif k == 1:
        c[X1 + i], c[Y1 + i], c[Z1 + i] = px, py, z
    else:
        c[X2 + i], c[Y2 + i], c[Z2 + i] = px, py, z


@jit.inlined
def _is_flat(i, c):
    """Whether entry `i` of the batch has no area on the screen."""
    ux, uy = np.int64(c[X1 + i]) - np.int64(c[X0 + i]), np.int64(c[Y1 + i]) - np.int64(c[Y0 + i])
    vx, vy = np.int64(c[X2 + i]) - np.int64(c[X0 + i]), np.int64(c[Y2 + i]) - np.int64(c[Y0 + i])
    return ux * vy == vx * uy


@jit.part
def _draw(n, c, resolution, high, depth, ids):
    set_up_batch(n, c)
    place_batch(n, _CENTRE, _CENTRE, resolution, resolution, high, c)
    draw_batch(n, c, _CENTRE, _CENTRE, 0, resolution, depth, ids, None)


@jit.part
def _draw_face(face, count, entries, triangles, x, y, z, resolution, near, guard, p, q, depth, ids, c):
    """Draw the listed triangles on one face."""
    half, high = _F(resolution * 128), resolution if face == 0 else resolution // 2
    n = np.uint64(0)
    for e in range(np.uint64(0), np.uint64(count)):
        t = entries[e]
        v0, v1, v2 = np.uint64(triangles[np.uint64(t), 0]), np.uint64(triangles[np.uint64(t), 1]), np.uint64(triangles[np.uint64(t), 2])
        ax, ay, az = turned(face, x[v0], y[v0], z[v0])
        bx, by, bz = turned(face, x[v1], y[v1], z[v1])
        dx, dy, dz = turned(face, x[v2], y[v2], z[v2])
        if is_within(ax, ay, az, near) & is_within(bx, by, bz, near) & is_within(dx, dy, dz, near):
            if n + np.uint64(1) > np.uint64(BATCH):
                _draw(n, c, resolution, high, depth, ids)
                n = np.uint64(0)
            c[T + n] = t
            _place(n, 0, ax, ay, az, half, near, c)
            _place(n, 1, bx, by, bz, half, near, c)
            _place(n, 2, dx, dy, dz, half, near, c)
            n += np.uint64(not _is_flat(n, c))
            continue
        p[0, 0], p[0, 1], p[0, 2], p[0, 3] = ax, ay, near, az
        p[1, 0], p[1, 1], p[1, 2], p[1, 3] = bx, by, near, bz
        p[2, 0], p[2, 1], p[2, 2], p[2, 3] = dx, dy, near, dz
        corners = clip_polygon(p, q, 3, 0.0, guard)
        for k in range(1, corners - 1):
            if n + np.uint64(1) > np.uint64(BATCH):
                _draw(n, c, resolution, high, depth, ids)
                n = np.uint64(0)
            c[T + n] = t
            _place(n, 0, _F(p[0, 0]), _F(p[0, 1]), _F(p[0, 3]), half, near, c)
            _place(n, 1, _F(p[k, 0]), _F(p[k, 1]), _F(p[k, 3]), half, near, c)
            _place(n, 2, _F(p[k + 1, 0]), _F(p[k + 1, 1]), _F(p[k + 1, 3]), half, near, c)
            n += np.uint64(not _is_flat(n, c))
    _draw(n, c, resolution, high, depth, ids)


@jit.parallel_kernel
def _see(queue, positions, triangles, centers, frames, start, resolutions, near, depths, ids):
    vertices = positions.shape[1]
    own_xyz, own_codes = np.empty((3, vertices), np.float32), np.empty(vertices, np.int32)
    own_lists, own_counts = np.empty((FACES, len(triangles) + 1), np.int32), np.zeros(FACES, np.int64)
    own_c, own_p, own_q = np.zeros(SIZE, np.int32), np.zeros((MOST + 1, 7)), np.zeros((2 * MOST, 7))
    own_guard = np.array([-GUARD, GUARD, -GUARD, GUARD])
    xyz, codes, lists, counts = jit.borrow(own_xyz), jit.borrow(own_codes), jit.borrow(own_lists), jit.borrow(own_counts)
    c, p, q, guard = jit.borrow(own_c), jit.borrow(own_p), jit.borrow(own_q), jit.borrow(own_guard)
    positions, triangles, centers, frames = jit.borrow(positions), jit.borrow(triangles), jit.borrow(centers), jit.borrow(frames)
    depths, ids = jit.borrow(depths), jit.borrow(ids)
    s = jit.take(queue)
    while s < len(centers):
        resolution = resolutions[s]
        x, y, z = xyz[0], xyz[1], xyz[2]
        _look(0, vertices, positions, frames[s], centers[s], x, y, z, codes, near)
        _sort(triangles, codes, lists, counts)
        for face in range(FACES):
            first = start[s] + face * resolution * resolution
            depth, drawn = depths[first : first + resolution * resolution + LANES], ids[first : first + resolution * resolution + LANES]
            depth[: resolution * resolution] = BEHIND
            drawn[: resolution * resolution] = NOTHING
            _draw_face(face, counts[face], lists[face], triangles, x, y, z, resolution, near, guard, p, q, depth, drawn, c)
        s = jit.take(queue)
    own_xyz[0, 0] = own_codes[0] + own_lists[0, 0] + own_counts[0] + own_c[0] + own_p[0, 0] + own_q[0, 0] + own_guard[0]  # they live until here


def see(positions: Array, triangles: Array, centers: Array, frames: Array, resolution: Array, near: float, threads: int) -> ItemBuffers:
    """Draw the hemicubes of s shooters.

    Args:
        positions: (3, n) float32: x, y and z of the vertices, metres.
        triangles: (m, 3) int32.
        centers: (s, 3) float32, metres.
        frames: (s, 3, 3) float32: rows right, up and normal of each shooter, orthonormal.
        resolution: (s,) int64, each of `RESOLUTIONS`.
        near: Metres; what is nearer, or no higher above the shooter's plane, is not seen.
    """
    seen = room_for(resolution, near)
    see_into(seen, positions, triangles, centers, frames, threads)
    return seen


def room_for(resolution: Array, near: float) -> ItemBuffers:
    """Item buffers of shooters that nothing is drawn in yet, not even that there is nothing; as in `see`."""
    start = np.zeros(len(resolution) + 1, np.int64)
    np.cumsum(FACES * resolution**2, out=start[1:])
    depth, ids = reusable((int(start[-1]) + LANES,), np.float32), reusable((int(start[-1]) + LANES,), np.int32)
    return ItemBuffers(start, resolution, depth, ids, near)


def see_into(seen: ItemBuffers, positions: Array, triangles: Array, centers: Array, frames: Array, threads: int) -> None:
    """Draw the hemicubes of the shooters that `seen` has room for, as `see`; what lies behind them in its arrays is spoilt for `LANES` elements."""
    near, threads = np.float32(seen.near), min(threads, len(centers))
    jit.run(_see, threads, positions, triangles, centers, frames, seen.start, seen.resolution, near, seen.depth, seen.ids)


def frames_of(normals: Array) -> Array:
    """(s, 3, 3) float32 frames whose third rows are `normals` (s, 3), unit length (Duff et al. 2017, "Building an orthonormal basis, revisited")."""
    n = normals.astype(np.float64)
    sign = np.where(n[:, 2] >= 0, 1.0, -1.0)
    a = -1.0 / (sign + n[:, 2])
    b = n[:, 0] * n[:, 1] * a
    right = np.stack([1 + sign * n[:, 0] ** 2 * a, sign * b, -sign * n[:, 0]], 1)
    up = np.stack([b, sign + n[:, 1] ** 2 * a, -n[:, 1]], 1)
    return np.stack([right, up, n], 1).astype(np.float32)


@cache
def delta_form_factors(resolution: int) -> Array:
    """(5, resolution, resolution) float64: the form factor of each pixel, from a differential element at the cube's centre; 0 below the
    horizon; they sum to 1 (Cohen and Greenberg 1985, eq. 7 and 8, integrated over the pixel and not only sampled)."""
    edges = np.linspace(-1.0, 1.0, resolution + 1)
    x, y = edges[None, :], edges[::-1, None]

    def corner(x: Array, y: Array) -> Array:  # of a rectangle from the axis to (x, y) on the top face: half of the differential factor
        return (x / np.sqrt(1 + x * x) * np.arctan(y / np.sqrt(1 + x * x)) + y / np.sqrt(1 + y * y) * np.arctan(x / np.sqrt(1 + y * y))) / (2 * np.pi)

    def side(x: Array, y: Array) -> Array:  # to a perpendicular rectangle, 0 .. x across and 0 .. y up, at distance 1
        return (np.arctan(x) - np.arctan(x / np.sqrt(1 + y * y)) / np.sqrt(1 + y * y)) / (2 * np.pi)

    def over_pixels(f: Array) -> Array:
        return np.abs(f[:-1, 1:] - f[:-1, :-1] - f[1:, 1:] + f[1:, :-1])

    top = over_pixels(corner(x, y))
    flank = over_pixels(side(x, np.maximum(y, 0.0)))
    factors = np.stack([top, flank, flank, flank, flank])
    factors.flags.writeable = False  # it is handed out again
    return factors
