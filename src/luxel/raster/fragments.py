"""Fragments: the attributes of what is visible in a tile, in planar batches. Floats decorate.

Perspective-correct barycentric coordinates come from the exact edge functions of the snapped corners: b_i = s_i / (s_0 + s_1 + s_2) with
s_i = e_i / w_i (the paper on barycentric hardware, with the division by w added). The s_i are planes over the picture, so
sum_i s_i (u_i - u_0) is one for each attribute u, and u - u_0 is its quotient by the plane of sum_i s_i. A triangle is set up once in a tile:
its planes are stored, from a point of the tile near the triangle; and its runs (see `runs`) are filled from them, eight fragments at a time.
Derivatives per pixel are analytic: with a for the slope of u's plane and a_w for that of the sum W, du/dx = (a - (u - u_0) a_w) / W.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.bin import Clipped
from luxel.raster.channels import (
    BATCH,
    CR,
    DXX,
    DYX,
    FRONT,
    FX,
    NX,
    PITCH,
    PX,
    PY,
    PZ,
    TX,
    U0,
    U0X,
    U0Y,
    U1,
    U1X,
    U1Y,
    VX,
    VY,
    VZ,
)  # fmt: skip
from luxel.raster.geometry import Geometry
from luxel.raster.lanes import prefetch
from luxel.raster.materials import NEEDS_COLOR, NEEDS_FACE, NEEDS_NORMAL, NEEDS_TANGENT, NEEDS_UV0, NEEDS_UV1, NEEDS_VIEW
from luxel.raster.rows import derivative, fill, inverse_ramp, ramp, scaled_ramp

_F = np.float32

NEEDS_POSITION = 1 << 30
"""Beside the materials' NEEDS_*: world positions, for lights that are somewhere and for views."""
NEEDS_ANYTHING = NEEDS_POSITION | NEEDS_NORMAL | NEEDS_FACE | NEEDS_VIEW | NEEDS_UV0 | NEEDS_UV1 | NEEDS_TANGENT | NEEDS_COLOR
_DIVIDED = NEEDS_POSITION | NEEDS_VIEW | NEEDS_TANGENT | NEEDS_COLOR | NEEDS_UV0 | NEEDS_UV1


class Eye(NamedTuple):
    """(3,) float64 place of the eye, and (3,) unit direction towards it with `parallel` True for orthographic cameras."""

    place: Array
    direction: Array
    parallel: bool


class Drawn(NamedTuple):
    """What is drawn, and where it lies on the screen.

    Attributes:
        geometry: Of the whole scene.
        screen: (n, 4) int32, from `project`.
        screen_f: (n, 4) float32, the same bits.
        clipped: From `clip`.
        clipped_f: `clipped.screen` as float32, the same bits.
    """

    geometry: Geometry
    screen: Array
    screen_f: Array
    clipped: Clipped
    clipped_f: Array


def drawn(geometry: Geometry, screen: Array, clipped: Clipped) -> Drawn:
    """All of `Drawn`."""
    return Drawn(geometry, screen, screen.view(np.float32), clipped, clipped.screen.view(np.float32))


# Rows of the batch that only this file uses. Of fragments: 1 / sum of s_i. Of triangles to set up: corners (x, y in fixed point from the
# tile's corner, weight); planes of s_i: a 3, b 3, c 3; reference point in pixels; side seen.
INVERSE = BATCH
X0, Y0, W0, X1, Y1, W1, X2, Y2, W2 = (BATCH + PITCH * row for row in range(1, 10))
A0, A1, A2, B0, B1, B2, C0, C1, C2, RX, RY, SIDE = (BATCH + PITCH * row for row in range(10, 22))
SIZE = BATCH + 22 * PITCH
# The same as unsigned numbers: Numba tests signed indices for being negative, which keeps the compiler from vectorising.
_X0, _Y0, _W0, _X1, _Y1, _W1, _X2, _Y2, _W2 = (np.uint64(row) for row in (X0, Y0, W0, X1, Y1, W1, X2, Y2, W2))
_A0, _A1, _A2, _B0, _B1, _B2, _C0, _C1, _C2 = (np.uint64(row) for row in (A0, A1, A2, B0, B1, B2, C0, C1, C2))
_RX, _RY, _SIDE = (np.uint64(row) for row in (RX, RY, SIDE))
_AHEAD = 8  # triangles; so early are their vertices asked for

# Columns of what is stored of a triangle that is set up: reference point and side; plane of W (a, b, c); then for each column of an attribute
# its plane (a, b, c) and its value at corner 0.
AT_X, AT_Y, AT_SIDE, WEIGHT, NORMAL = 0, 1, 2, 3, 6
POSITION = NORMAL + 4 * 3
COLOR = POSITION + 4 * 3
TEXCOORD0 = COLOR + 4 * 4
TEXCOORD1 = TEXCOORD0 + 4 * 2
TANGENT = TEXCOORD1 + 4 * 2
FACE = TANGENT + 4 * 4
STORED = FACE + 3


@jit.inlined
def planes(x0, y0, w0, x1, y1, w1, x2, y2, w2, extent):
    """Planes of s_i = e_i w_i as a (per pixel along x) 3, b (along y) 3, c (at the reference point) 3, float32; the reference point's x and
    y in pixels; and the sign that made them positive inside. Positions are fixed point from the tile's corner, float64.

    The reference point is that of the tile nearest to corner 0: exact there, so accurate at all of a small triangle and in all of a tile,
    and a matter of triangle and tile alone.
    """
    rx, ry = min(max(x0, 0.0), extent), min(max(y0, 0.0), extent)
    e0 = (y2 - y1) * (rx - x1) + (x1 - x2) * (ry - y1)
    e1 = (y0 - y2) * (rx - x2) + (x2 - x0) * (ry - y2)
    e2 = (y1 - y0) * (rx - x0) + (x0 - x1) * (ry - y0)
    front = 1.0 if e0 + e1 + e2 > 0.0 else -1.0
    w0, w1, w2 = w0 * front, w1 * front, w2 * front
    u0, u1, u2 = w0 * 256.0, w1 * 256.0, w2 * 256.0
    return (
        (_F((y2 - y1) * u0), _F((y0 - y2) * u1), _F((y1 - y0) * u2), _F((x1 - x2) * u0), _F((x2 - x0) * u1), _F((x0 - x1) * u2),
         _F(e0 * w0), _F(e1 * w1), _F(e2 * w2)),
        _F(rx * (1 / 256)), _F(ry * (1 / 256)), _F(front),
    )  # fmt: skip


@jit.inlined
def source_planes(p, c):
    """From planes over a piece made by clipping to planes over its source; c (3, 3): the piece's corners in the source."""
    return (
        p[0] * c[0, 0] + p[1] * c[1, 0] + p[2] * c[2, 0], p[0] * c[0, 1] + p[1] * c[1, 1] + p[2] * c[2, 1],
        p[0] * c[0, 2] + p[1] * c[1, 2] + p[2] * c[2, 2],
        p[3] * c[0, 0] + p[4] * c[1, 0] + p[5] * c[2, 0], p[3] * c[0, 1] + p[4] * c[1, 1] + p[5] * c[2, 1],
        p[3] * c[0, 2] + p[4] * c[1, 2] + p[5] * c[2, 2],
        p[6] * c[0, 0] + p[7] * c[1, 0] + p[8] * c[2, 0], p[6] * c[0, 1] + p[7] * c[1, 1] + p[8] * c[2, 1],
        p[6] * c[0, 2] + p[7] * c[1, 2] + p[8] * c[2, 2],
    )  # fmt: skip


@jit.inlined
def find_part(starts, t):
    """Which range of `starts` holds t."""
    low, high = 0, len(starts) - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if starts[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@jit.part
def load_corners(g, count, numbers, sources, px, py, drawn):
    """Load the corners of `count` triangles into the batch, and their source triangle and vertices into `sources` (>= count, 4) int32."""
    triangles, normals, screen, screen_f = drawn.geometry.triangles, drawn.geometry.normals, drawn.screen, drawn.screen_f
    clipped_source, clipped_screen, clipped_f, m = drawn.clipped.source, drawn.clipped.screen, drawn.clipped_f, len(triangles)
    ox, oy = np.int32(px * 256), np.int32(py * 256)
    for i in range(count):
        t = numbers[i]
        source = t if t < m else clipped_source[t - m]
        sources[i, 0] = source
        for k in range(3):
            vertex = triangles[source, k]
            sources[i, k + 1] = vertex
            prefetch(screen, np.int64(vertex) * 4)
            prefetch(normals, np.int64(vertex) * 3)
    for i in range(np.uint64(0), np.uint64(count)):
        if numbers[i] < m:
            a, b, c = np.uint64(sources[i, 1]), np.uint64(sources[i, 2]), np.uint64(sources[i, 3])
            g[_X0 + i], g[_Y0 + i], g[_W0 + i] = _F(np.int32(screen[a, 0] - ox)), _F(np.int32(screen[a, 1] - oy)), screen_f[a, 3]
            g[_X1 + i], g[_Y1 + i], g[_W1 + i] = _F(np.int32(screen[b, 0] - ox)), _F(np.int32(screen[b, 1] - oy)), screen_f[b, 3]
            g[_X2 + i], g[_Y2 + i], g[_W2 + i] = _F(np.int32(screen[c, 0] - ox)), _F(np.int32(screen[c, 1] - oy)), screen_f[c, 3]
        else:
            k = numbers[i] - m
            for corner in range(3):
                row = np.uint64(X0 + 3 * corner * PITCH) + i
                g[row], g[row + np.uint64(PITCH)] = _F(clipped_screen[k, corner, 0] - ox), _F(clipped_screen[k, corner, 1] - oy)
                g[row + np.uint64(2 * PITCH)] = clipped_f[k, corner, 3]


@jit.part
def find_planes(g, count, extent):
    """Planes of s_i of `count` triangles at once; see `planes`."""
    for k in range(np.uint64(0), np.uint64(count)):
        p, rx, ry, front = planes(
            np.float64(g[_X0 + k]), np.float64(g[_Y0 + k]), np.float64(g[_W0 + k]), np.float64(g[_X1 + k]), np.float64(g[_Y1 + k]),
            np.float64(g[_W1 + k]), np.float64(g[_X2 + k]), np.float64(g[_Y2 + k]), np.float64(g[_W2 + k]), extent,
        )  # fmt: skip
        g[_A0 + k], g[_A1 + k], g[_A2 + k], g[_B0 + k], g[_B1 + k], g[_B2 + k] = p[0], p[1], p[2], p[3], p[4], p[5]
        g[_C0 + k], g[_C1 + k], g[_C2 + k], g[_RX + k], g[_RY + k], g[_SIDE + k] = p[6], p[7], p[8], rx, ry, front


@jit.inlined
def store(record, column, p, values, k, a, b, c):
    """Store the plane of column `k` of an attribute, to be divided by W, less its value at corner 0."""
    origin = values[a, k]
    u, v = values[b, k] - origin, values[c, k] - origin
    record[column] = p[1] * u + p[2] * v
    record[column + 1] = p[4] * u + p[5] * v
    record[column + 2] = p[7] * u + p[8] * v
    record[column + 3] = origin


@jit.inlined
def store_normal(record, p, normals, a, b, c):
    """Store the planes of the normal, which may have any length: it is not divided, so it needs no W."""
    for k in range(3):
        n0, n1, n2 = normals[a, k], normals[b, k], normals[c, k]
        record[NORMAL + 4 * k] = p[0] * n0 + p[1] * n1 + p[2] * n2
        record[NORMAL + 4 * k + 1] = p[3] * n0 + p[4] * n1 + p[5] * n2
        record[NORMAL + 4 * k + 2] = p[6] * n0 + p[7] * n1 + p[8] * n2


@jit.inlined
def store_face(record, positions, a, b, c):
    """Store the geometric normal of the triangle, by its winding."""
    ux, uy, uz = positions[b, 0] - positions[a, 0], positions[b, 1] - positions[a, 1], positions[b, 2] - positions[a, 2]
    vx, vy, vz = positions[c, 0] - positions[a, 0], positions[c, 1] - positions[a, 1], positions[c, 2] - positions[a, 2]
    record[FACE], record[FACE + 1], record[FACE + 2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@jit.part
def set_up(g, first, last, setups, px, py, tile, drawn, features, rich):
    """Store the planes of the triangles that are set up at first .. last - 1."""
    geometry, clipped = drawn.geometry, drawn.clipped
    positions, normals, colors, tangents = geometry.positions, geometry.normals, geometry.colors, geometry.tangents
    texcoords, texcoords1, part_material = geometry.texcoords, geometry.texcoords1, geometry.part_material
    numbers, sources, starts, part, m = setups.triangle[first:], setups.sources, geometry.part_start, 0, len(geometry.triangles)
    load_corners(g, last - first, numbers, sources, px, py, drawn)
    find_planes(g, last - first, np.float64(tile * 256))
    for i in range(np.uint64(0), np.uint64(last - first)):
        record = setups.stored[np.uint64(first) + i]
        p = (g[_A0 + i], g[_A1 + i], g[_A2 + i], g[_B0 + i], g[_B1 + i], g[_B2 + i], g[_C0 + i], g[_C1 + i], g[_C2 + i])
        if numbers[i] >= m:
            p = source_planes(p, clipped.corners[numbers[i] - m])
        source, a, b, c = sources[i, 0], np.uint64(sources[i, 1]), np.uint64(sources[i, 2]), np.uint64(sources[i, 3])
        if source < starts[part] or source >= starts[part + 1]:
            part = find_part(starts, source)
        setups.material[np.uint64(first) + i] = part_material[part]
        record[AT_X], record[AT_Y], record[AT_SIDE] = g[_RX + i], g[_RY + i], g[_SIDE + i]
        if features & NEEDS_NORMAL:
            store_normal(record, p, normals, a, b, c)
        if features & _DIVIDED:
            record[WEIGHT], record[WEIGHT + 1], record[WEIGHT + 2] = p[0] + p[1] + p[2], p[3] + p[4] + p[5], p[6] + p[7] + p[8]
        if features & (NEEDS_POSITION | NEEDS_VIEW | NEEDS_TANGENT):
            for k in range(3):
                store(record, POSITION + 4 * k, p, positions, k, a, b, c)
        if features & NEEDS_FACE:
            store_face(record, positions, a, b, c)
        if features & NEEDS_COLOR:
            for k in range(4):
                store(record, COLOR + 4 * k, p, colors, k, a, b, c)
        if rich is not None:
            if features & NEEDS_UV0:
                for k in range(2):
                    store(record, TEXCOORD0 + 4 * k, p, texcoords, k, a, b, c)
            if features & NEEDS_UV1:
                for k in range(2):
                    store(record, TEXCOORD1 + 4 * k, p, texcoords1, k, a, b, c)
            if features & NEEDS_TANGENT and len(tangents) > 0:
                for k in range(4):
                    store(record, TANGENT + 4 * k, p, tangents, k, a, b, c)


@jit.inlined
def spread(g, i, count, row, record, column, columns, x, dy):
    """The first `columns` columns of an attribute at `count` fragments from `i` on, from x, dy on, divided by W."""
    for k in range(columns):
        at = column + 4 * k
        scaled_ramp(g, row + k * PITCH + i, count, INVERSE + i, x, record[at], record[at + 1] * dy + record[at + 2], record[at + 3])


@jit.inlined
def derive(g, i, count, row, x_row, y_row, record, column, columns, footprint):
    """Derivatives per pixel (times `footprint`) along x and y of the attribute that is in `row`."""
    for k in range(columns):
        at, here = column + 4 * k, row + k * PITCH + i
        derivative(g, x_row + k * PITCH + i, count, INVERSE + i, here, record[at + 3], record[at], record[WEIGHT], footprint)
        derivative(g, y_row + k * PITCH + i, count, INVERSE + i, here, record[at + 3], record[at + 1], record[WEIGHT + 1], footprint)


@jit.part
def attributes(g, r, runs, n, material, setups, parts, tangents, features, footprint, eye, rich):
    """Fill the rows of a batch that `features` asks for, and `material` (FRAGMENTS,) int32, run by run."""
    r.head[runs] = n
    for run in range(np.uint64(0), np.uint64(runs)):
        i, setup = np.int64(r.head[run]), np.uint64(r.setup[run])
        count, record = np.int64(r.head[run + np.uint64(1)]) - i, setups.stored[setup]
        x, dy = r.x[run] - record[AT_X], r.y[run] - record[AT_Y]
        if parts > 1:
            row = setups.material[setup]
            for k in range(i, i + count):
                material[k] = row
        fill(g, FRONT + i, count, record[AT_SIDE])
        if features & NEEDS_NORMAL:
            for k in range(3):
                at = NORMAL + 4 * k
                ramp(g, NX + k * PITCH + i, count, x, record[at], record[at + 1] * dy + record[at + 2])
        if features & NEEDS_FACE:
            for k in range(3):
                fill(g, FX + k * PITCH + i, count, record[FACE + k])
        if features & _DIVIDED:
            inverse_ramp(g, INVERSE + i, count, x, record[WEIGHT], record[WEIGHT + 1] * dy + record[WEIGHT + 2])
            if features & (NEEDS_POSITION | NEEDS_VIEW | NEEDS_TANGENT):
                spread(g, i, count, PX, record, POSITION, 3, x, dy)
            if features & NEEDS_COLOR:
                spread(g, i, count, CR, record, COLOR, 4, x, dy)
            if rich is not None:
                if features & NEEDS_UV0:
                    spread(g, i, count, U0, record, TEXCOORD0, 2, x, dy)
                    derive(g, i, count, U0, U0X, U0Y, record, TEXCOORD0, 2, footprint)
                if features & NEEDS_UV1:
                    spread(g, i, count, U1, record, TEXCOORD1, 2, x, dy)
                    derive(g, i, count, U1, U1X, U1Y, record, TEXCOORD1, 2, footprint)
                if features & NEEDS_TANGENT:
                    if tangents:
                        spread(g, i, count, TX, record, TANGENT, 4, x, dy)
                    derive(g, i, count, PX, DXX, DYX, record, POSITION, 3, footprint)
    if features & NEEDS_VIEW:
        view_vectors(g, n, eye)


@jit.part
def view_vectors(g, n, eye):
    """Unit vectors from the fragments to the eye."""
    if eye.parallel:
        for i in range(n):
            g[VX + i], g[VY + i], g[VZ + i] = eye.direction[0], eye.direction[1], eye.direction[2]
        return
    ex, ey, ez = eye.place[0], eye.place[1], eye.place[2]
    for i in range(n):
        x, y, z = ex - g[PX + i], ey - g[PY + i], ez - g[PZ + i]
        inverse = _F(1.0) / _F(math.sqrt(max(x * x + y * y + z * z, _F(1e-30))))
        g[VX + i], g[VY + i], g[VZ + i] = x * inverse, y * inverse, z * inverse
