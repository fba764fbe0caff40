"""Shade: attributes and light at what is visible. Floats decorate.

Every tile's visible samples become fragments: one for a pixel and triangle, however many samples they share (or one for every sample when
supersampling), at the pixel's centre if the triangle has all its samples, else at the mean of those it has, which lies inside it. Fragments
are evaluated in batches, planar, so that the arithmetic runs in vector registers; a run of fragments of one triangle is set up once.

Perspective-correct barycentric coordinates come from the exact edge functions of the snapped corners: b_i = e_i / w_i over their sum (the
paper on barycentric hardware, with the division by w added), so they never leave 0..1 inside, and depend on the position alone.
Derivatives per pixel are analytic: d(u) = (sum_i d(e_i) u_i / w_i - u sum_i d(e_i) / w_i) / sum_i e_i / w_i.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.bin import Bins, Clipped
from luxel.raster.channels import (
    BATCH,
    CB,
    CR,
    DXX,
    DYX,
    FRAGMENTS,
    FRONT,
    FX,
    FY,
    FZ,
    NX,
    OA,
    OB,
    OG,
    OR,
    PITCH,
    PX,
    PY,
    PZ,
    TX,
    TZ,
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
from luxel.raster.encode import encode, srgb_code, unit_code
from luxel.raster.geometry import Geometry
from luxel.raster.lanes import prefetch
from luxel.raster.lighting import LightTable, light
from luxel.raster.materials import (
    NEEDS_COLOR,
    NEEDS_FACE,
    NEEDS_NORMAL,
    NEEDS_TANGENT,
    NEEDS_UV0,
    NEEDS_UV1,
    NEEDS_VIEW,
    MaterialTable,
)  # fmt: skip
from luxel.raster.surface import surface

_F = np.float32
_GREEN, _BLUE, _ALPHA = np.int32(8), np.int32(16), np.int32(24)

NEEDS_POSITION = 1 << 30
"""Beside the materials' NEEDS_*: world positions, for lights that are somewhere and for views."""


class Eye(NamedTuple):
    """(3,) float64 place of the eye, and (3,) unit direction towards it with `parallel` True for orthographic cameras."""

    place: Array
    direction: Array
    parallel: bool


class Target(NamedTuple):
    """Where shaded pixels go; arrays that are not wanted have no rows.

    Attributes:
        color: (h, w) uint32, sRGB and straight alpha, bytes R G B A.
        linear: (h, w, 4) float32, premultiplied.
        samples: (tiles, 4 * s * tile * tile) float32, premultiplied colour of every sample, planar; when it has rows, pixels are not written.
    """

    color: Array
    linear: Array
    samples: Array


class Fragments(NamedTuple):
    """A batch before shading; (FRAGMENTS,) each: drawn triangle, pixel in the tile, row of the material table, the samples it has; and
    for its runs of one triangle, (FRAGMENTS + 1,) the first fragment of each, and (FRAGMENTS, 4) source triangle and vertices."""

    triangle: Array
    pixel: Array
    material: Array
    mask: Array
    head: Array
    source: Array


# Rows of the batch that only this file uses. Of fragments: place in the tile in pixels; s_i = e_i w_i; 1 / sum of s_i.
QX, QY, S0, S1, S2, INVERSE = (BATCH + PITCH * row for row in range(6))
# Of runs: corners (x, y in fixed point from the tile's corner, weight); planes of s_i: a 3, b 3, c 3; reference point in pixels; side seen.
X0, Y0, W0, X1, Y1, W1, X2, Y2, W2 = (BATCH + PITCH * row for row in range(6, 15))
A0, A1, A2, B0, B1, B2, C0, C1, C2, RX, RY, SIDE = (BATCH + PITCH * row for row in range(15, 27))
_SIZE = BATCH + 27 * PITCH
# The same as unsigned numbers, for fast indexing, and so that the compiler makes one version of a function for all rows.
_QX, _QY, _S0, _S1, _S2, _INVERSE, _FRONT = (np.uint64(row) for row in (QX, QY, S0, S1, S2, INVERSE, FRONT))
_NX, _PX, _CR, _CB, _U0, _U0X, _U0Y, _U1, _U1X, _U1Y = (np.uint64(row) for row in (NX, PX, CR, CB, U0, U0X, U0Y, U1, U1X, U1Y))
_TX, _TZ, _DXX, _DYX = (np.uint64(row) for row in (TX, TZ, DXX, DYX))
_X0, _Y0, _W0, _X1, _Y1, _W1, _X2, _Y2, _W2 = (np.uint64(row) for row in (X0, Y0, W0, X1, Y1, W1, X2, Y2, W2))
_A0, _A1, _A2, _B0, _B1, _B2, _C0, _C1, _C2 = (np.uint64(row) for row in (A0, A1, A2, B0, B1, B2, C0, C1, C2))
_RX, _RY, _SIDE = (np.uint64(row) for row in (RX, RY, SIDE))
_PITCH = np.uint64(PITCH)
_FIRST, _THIRD, _TWO, _THREE = (np.int64(number) for number in (0, 2, 2, 3))
_AHEAD = 8  # runs; so early are their vertices asked for


@jit.inlined
def add_run(g, f, n, runs, t, pixel, x, y, count):
    """Append `count` fragments of triangle `t`, at the centres of the pixels from (x, y) to the right; returns the number of runs.

    Arrays are written in whole groups of eight, which vectorise without a remainder: what goes too far is written again by the next run.
    """
    triangle, pixels = f.triangle, f.pixel
    if n == 0 or triangle[n - 1] != t:
        f.head[runs] = n
        runs += 1
    first = np.uint64(n)
    for k in range(first, np.uint64(n + ((count + 7) & ~7))):
        step = np.int32(k - first)
        triangle[k] = t
        pixels[k] = np.int32(pixel + step)
        g[_QX + k] = _F(x) + _F(0.5) + _F(step)
        g[_QY + k] = _F(y) + _F(0.5)
    return runs


@jit.part
def gather_pixels(g, f, cursor, ids, tile, wide, high):
    """The fragments of the tile's rows from `cursor` on, one sample a pixel, until the batch is full.

    Returns (fragments, runs of one triangle, next pixel).
    """
    n, runs = 0, 0
    while cursor < tile * high and n + wide <= FRAGMENTS:
        row, x = np.uint64(cursor), 0
        while x < wide:
            t = ids[row + np.uint64(x)]
            first = x
            x += 1
            while x < wide and ids[row + np.uint64(x)] == t:
                x += 1
            if t >= 0:
                runs = add_run(g, f, n, runs, t, cursor + first, first, cursor // tile, x - first)
                n += x - first
        cursor += tile
    return n, runs, cursor


@jit.part
def gather_samples(g, f, cursor, ids, pattern, every_sample, tile, wide, high):
    """The same for several samples a pixel, with the samples that each fragment has."""
    n, runs, samples, pixels = 0, 0, len(pattern), tile * tile
    triangle, pixel, mask, head = f.triangle, f.pixel, f.mask, f.head
    differ = f.material  # the materials are not known yet: their place is free
    last = tile * high
    everything = ~np.uint64(0) >> np.uint64(64 - samples)
    while cursor < last and n + samples <= FRAGMENTS:
        x, y = cursor % tile, cursor // tile
        row = np.uint64(cursor - x)
        for k in range(np.uint64(0), np.uint64(wide)):
            differ[k] = 1 if every_sample else 0
        for s in range(1, samples):
            plane = row + np.uint64(s * pixels)
            for k in range(np.uint64(0), np.uint64(wide)):
                differ[k] |= ids[plane + k] ^ ids[row + k]
        while x < wide and n + samples <= FRAGMENTS:
            here, first = np.int64(row) + x, x
            t = ids[here]
            x += 1
            if differ[first] == 0:
                while x < wide and differ[x] == 0 and ids[row + np.uint64(x)] == t and n + x - first < FRAGMENTS:
                    x += 1
                if t >= 0:
                    runs = add_run(g, f, n, runs, t, here, first, y, x - first)
                    mask[n : n + x - first] = everything
                    n += x - first
                continue
            done = np.uint64(0)
            for s in range(samples):
                t = ids[s * pixels + here]
                if t < 0 or done >> np.uint64(s) & np.uint64(1) != np.uint64(0):
                    continue
                bits, count, sum_x, sum_y = np.uint64(0), 0, 0, 0
                for r in range(s, s + 1 if every_sample else samples):
                    same = np.int64(ids[r * pixels + here] == t)
                    bits |= np.uint64(same) << np.uint64(r)
                    count += same
                    sum_x += same * pattern[r, 0]
                    sum_y += same * pattern[r, 1]
                done |= bits
                if n == 0 or triangle[n - 1] != t:
                    head[runs] = n
                    runs += 1
                triangle[n], pixel[n], mask[n] = t, here, bits
                share = _F(1 / 256) / _F(count)
                g[QX + n], g[QY + n] = _F(first) + _F(sum_x) * share, _F(y) + _F(sum_y) * share
                n += 1
        cursor = np.int64(row) + (tile if x >= wide else x)
    return n, runs, cursor


# Loops below run over unsigned numbers: Numba tests signed indices for being negative, which keeps the compiler from vectorising.


@jit.inlined
def spread2(g, i, j, row, values, column, v):
    """Two columns of an attribute of vertices `v` at fragments i .. j, divided by the sum of s_i."""
    p0, p1, p2 = values[v[0], column], values[v[1], column], values[v[2], column]
    q0, q1, q2 = values[v[0], column + 1], values[v[1], column + 1], values[v[2], column + 1]
    p, q = row, row + _PITCH
    for k in range(i, j):
        s0, s1, s2, inverse = g[_S0 + k], g[_S1 + k], g[_S2 + k], g[_INVERSE + k]
        g[p + k] = (s0 * p0 + s1 * p1 + s2 * p2) * inverse
        g[q + k] = (s0 * q0 + s1 * q1 + s2 * q2) * inverse


@jit.inlined
def spread3(g, i, j, row, values, v):
    """An attribute with three columns of vertices `v` at fragments i .. j, not divided by the sum of s_i."""
    p0, p1, p2 = values[v[0], 0], values[v[1], 0], values[v[2], 0]
    q0, q1, q2 = values[v[0], 1], values[v[1], 1], values[v[2], 1]
    r0, r1, r2 = values[v[0], 2], values[v[1], 2], values[v[2], 2]
    p, q, r = row, row + _PITCH, row + _PITCH + _PITCH
    for k in range(i, j):
        s0, s1, s2 = g[_S0 + k], g[_S1 + k], g[_S2 + k]
        g[p + k] = s0 * p0 + s1 * p1 + s2 * p2
        g[q + k] = s0 * q0 + s1 * q1 + s2 * q2
        g[r + k] = s0 * r0 + s1 * r1 + s2 * r2


@jit.inlined
def divide3(g, i, j, row):
    """Divide an attribute with three columns by the sum of s_i."""
    p, q, r = row, row + _PITCH, row + _PITCH + _PITCH
    for k in range(i, j):
        inverse = g[_INVERSE + k]
        g[p + k] *= inverse
        g[q + k] *= inverse
        g[r + k] *= inverse


@jit.inlined
def derive(g, i, j, row, x_row, y_row, values, columns, v, p, footprint):
    """Derivatives per pixel (times `footprint`) along x and y of the divided attribute in `row`."""
    sum_a, sum_b = p[0] + p[1] + p[2], p[3] + p[4] + p[5]
    for column in range(columns):
        p0, p1, p2 = values[v[0], column], values[v[1], column], values[v[2], column]
        a, b = p[0] * p0 + p[1] * p1 + p[2] * p2, p[3] * p0 + p[4] * p1 + p[5] * p2
        shift = np.uint64(column) * _PITCH
        for k in range(i, j):
            scale, here = g[_INVERSE + k] * footprint, g[row + shift + k]
            g[x_row + shift + k] = (a - here * sum_a) * scale
            g[y_row + shift + k] = (b - here * sum_b) * scale


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


@jit.inlined
def face_normal(g, i, j, positions, v):
    """Geometric normal of the triangle, by its winding."""
    a, b, c = v
    ux, uy, uz = positions[b, 0] - positions[a, 0], positions[b, 1] - positions[a, 1], positions[b, 2] - positions[a, 2]
    vx, vy, vz = positions[c, 0] - positions[a, 0], positions[c, 1] - positions[a, 1], positions[c, 2] - positions[a, 2]
    for k in range(i, j):
        g[FX + k], g[FY + k], g[FZ + k] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@jit.part
def load_runs(g, f, n, runs, px, py, triangles, screen, screen_f, clipped_source, clipped_screen, clipped_f, normals):
    """Load the corners of the runs' triangles."""
    m = len(triangles)
    ox, oy = np.int64(px * 256), np.int64(py * 256)
    triangle, head, source = f.triangle, f.head, f.source
    head[runs] = n
    for run in range(runs):
        t = triangle[head[run]]
        if run + _AHEAD < runs:
            ahead = triangle[head[run + _AHEAD]]
            if ahead < m:
                for k in range(3):
                    vertex = np.int64(triangles[ahead, k])
                    prefetch(screen, vertex * 4)
                    prefetch(normals, vertex * 3)
        if run + 2 * _AHEAD < runs:
            ahead = triangle[head[run + 2 * _AHEAD]]
            if ahead < m:
                prefetch(triangles, np.int64(ahead) * 3)
        if t < m:
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            source[run, 0] = t
            g[X0 + run], g[Y0 + run], g[W0 + run] = _F(screen[a, 0] - ox), _F(screen[a, 1] - oy), screen_f[a, 3]
            g[X1 + run], g[Y1 + run], g[W1 + run] = _F(screen[b, 0] - ox), _F(screen[b, 1] - oy), screen_f[b, 3]
            g[X2 + run], g[Y2 + run], g[W2 + run] = _F(screen[c, 0] - ox), _F(screen[c, 1] - oy), screen_f[c, 3]
        else:
            k, whole = t - m, clipped_source[t - m]
            a, b, c = triangles[whole, 0], triangles[whole, 1], triangles[whole, 2]
            source[run, 0] = whole
            for corner in range(3):
                row = X0 + 3 * corner * PITCH + run
                g[row], g[row + PITCH] = _F(clipped_screen[k, corner, 0] - ox), _F(clipped_screen[k, corner, 1] - oy)
                g[row + 2 * PITCH] = clipped_f[k, corner, 3]
        source[run, 1], source[run, 2], source[run, 3] = a, b, c


@jit.part
def set_up_runs(g, runs, extent):
    """Planes of s_i of all runs at once; see `planes`."""
    for k in range(np.uint64(0), np.uint64(runs)):
        p, rx, ry, front = planes(
            np.float64(g[_X0 + k]), np.float64(g[_Y0 + k]), np.float64(g[_W0 + k]), np.float64(g[_X1 + k]), np.float64(g[_Y1 + k]),
            np.float64(g[_W1 + k]), np.float64(g[_X2 + k]), np.float64(g[_Y2 + k]), np.float64(g[_W2 + k]), extent,
        )  # fmt: skip
        g[_A0 + k], g[_A1 + k], g[_A2 + k], g[_B0 + k], g[_B1 + k], g[_B2 + k] = p[0], p[1], p[2], p[3], p[4], p[5]
        g[_C0 + k], g[_C1 + k], g[_C2 + k], g[_RX + k], g[_RY + k], g[_SIDE + k] = p[6], p[7], p[8], rx, ry, front


@jit.part
def attributes(g, f, n, runs, px, py, tile, geometry, screen, screen_f, clipped, clipped_f, features, footprint, eye, rich):
    """Fill the rows of a batch that `features` asks for, a run of fragments of one triangle at a time."""
    triangles, starts, triangle, material = geometry.triangles, geometry.part_start, f.triangle, f.material
    positions, normals, colors, tangents = geometry.positions, geometry.normals, geometry.colors, geometry.tangents
    texcoords, texcoords1, part_material = geometry.texcoords, geometry.texcoords1, geometry.part_material
    m, part, parts, head, source = len(triangles), 0, len(part_material), f.head, f.source
    divided = features & (NEEDS_POSITION | NEEDS_VIEW | NEEDS_TANGENT | NEEDS_COLOR | NEEDS_UV0 | NEEDS_UV1) != 0
    if parts == 1:
        material[:n] = part_material[0]
    load_runs(g, f, n, runs, px, py, triangles, screen, screen_f, clipped.source, clipped.screen, clipped_f, normals)
    set_up_runs(g, runs, np.float64(tile * 256))
    for run in range(runs):
        i, j, t = head[run], head[run + 1], triangle[head[run]]
        p = (g[A0 + run], g[A1 + run], g[A2 + run], g[B0 + run], g[B1 + run], g[B2 + run], g[C0 + run], g[C1 + run], g[C2 + run])
        if t >= m:
            p = source_planes(p, clipped.corners[t - m])
        rx, ry, front = g[RX + run], g[RY + run], g[SIDE + run]
        v = source[run, 1], source[run, 2], source[run, 3]
        # In whole groups of eight, as in `add_run`.
        first, last = np.uint64(i), np.uint64(i + ((j - i + 7) & ~7))
        if parts > 1:
            if source[run, 0] < starts[part] or source[run, 0] >= starts[part + 1]:
                part = find_part(starts, source[run, 0])
            for k in range(first, last):
                material[k] = part_material[part]
        for k in range(first, last):
            dx, dy = g[_QX + k] - rx, g[_QY + k] - ry
            g[_S0 + k] = p[0] * dx + p[3] * dy + p[6]
            g[_S1 + k] = p[1] * dx + p[4] * dy + p[7]
            g[_S2 + k] = p[2] * dx + p[5] * dy + p[8]
            g[_FRONT + k] = front
        if divided:
            for k in range(first, last):
                g[_INVERSE + k] = _F(1.0) / (g[_S0 + k] + g[_S1 + k] + g[_S2 + k])
        if features & NEEDS_NORMAL:  # of any length: no division
            spread3(g, first, last, _NX, normals, v)
        if features & (NEEDS_POSITION | NEEDS_VIEW | NEEDS_TANGENT):
            spread3(g, first, last, _PX, positions, v)
            divide3(g, first, last, _PX)
        if features & NEEDS_FACE:
            face_normal(g, first, last, positions, v)
        if features & NEEDS_COLOR:
            spread2(g, first, last, _CR, colors, _FIRST, v)
            spread2(g, first, last, _CB, colors, _THIRD, v)
        if rich is not None:
            if features & NEEDS_UV0:
                spread2(g, first, last, _U0, texcoords, _FIRST, v)
                derive(g, first, last, _U0, _U0X, _U0Y, texcoords, _TWO, v, p, footprint)
            if features & NEEDS_UV1:
                spread2(g, first, last, _U1, texcoords1, _FIRST, v)
                derive(g, first, last, _U1, _U1X, _U1Y, texcoords1, _TWO, v, p, footprint)
            if features & NEEDS_TANGENT:
                if len(tangents) > 0:
                    spread2(g, first, last, _TX, tangents, _FIRST, v)
                    spread2(g, first, last, _TZ, tangents, _THIRD, v)
                derive(g, first, last, _PX, _DXX, _DYX, positions, _THREE, v, p, footprint)
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


@jit.part
def write_opaque(g, pixel, n, tile, exposure, codes, color, top, left):
    """Write the fragments, one a pixel and opaque, straight to the picture; `codes` (FRAGMENTS,) uint32 is scratch."""
    encode(g, n, exposure, codes)
    log2 = 0
    while tile >> (log2 + 1):
        log2 += 1
    for i in range(np.uint64(0), np.uint64(n)):
        y = np.int64(pixel[i]) >> log2
        color[np.uint64(top + y), np.uint64(left + (np.int64(pixel[i]) & (tile - 1)))] = codes[i]


@jit.part
def set_pixels(g, pixel, n, pixels, sums):
    """Put the fragments, one a pixel, into `sums` (4 * pixels,), premultiplied."""
    for i in range(n):
        p, alpha = pixel[i], g[OA + i]
        sums[p], sums[pixels + p] = g[OR + i] * alpha, g[OG + i] * alpha
        sums[2 * pixels + p], sums[3 * pixels + p] = g[OB + i] * alpha, alpha


@jit.part
def add_to_pixels(g, f, n, samples, pixels, sums):
    """Add the fragments to `sums` (4 * pixels,), each by its share of the pixel's samples, premultiplied."""
    pixel, mask = f.pixel, f.mask
    everything = ~np.uint64(0) >> np.uint64(64 - samples)
    for i in range(n):
        share, rest = 0, mask[i]
        if rest == everything:
            share = samples
        else:
            while rest != np.uint64(0):
                rest &= rest - np.uint64(1)
                share += 1
        p, alpha = pixel[i], g[OA + i] * (_F(share) / _F(samples))
        sums[p] += g[OR + i] * alpha
        sums[pixels + p] += g[OG + i] * alpha
        sums[2 * pixels + p] += g[OB + i] * alpha
        sums[3 * pixels + p] += alpha


@jit.part
def lay_over_samples(g, f, n, samples, pixels, colors):
    """Composite the fragments over what their samples hold, premultiplied; `colors` (4 * samples * pixels,)."""
    plane = samples * pixels
    for i in range(n):
        alpha = g[OA + i]
        under = _F(1.0) - alpha
        for s in range(samples):
            if f.mask[i] >> np.uint64(s) & np.uint64(1) != np.uint64(0):
                p = s * pixels + f.pixel[i]
                colors[p] = g[OR + i] * alpha + colors[p] * under
                colors[plane + p] = g[OG + i] * alpha + colors[plane + p] * under
                colors[2 * plane + p] = g[OB + i] * alpha + colors[2 * plane + p] * under
                colors[3 * plane + p] = alpha + colors[3 * plane + p] * under


@jit.part
def write_row(sums, first, plane, y, left, count, exposure, background, color, linear):
    """Lay `count` summed, premultiplied pixels over the background and write them from pixel (left, y) on, to the outputs that are wanted."""
    br, bg, bb, ba = background[0], background[1], background[2], background[3]
    if len(linear) > 0:
        for x in range(count):
            p = first + x
            under = _F(1.0) - sums[3 * plane + p]
            linear[y, left + x, 0] = sums[p] * exposure + under * br
            linear[y, left + x, 1] = sums[plane + p] * exposure + under * bg
            linear[y, left + x, 2] = sums[2 * plane + p] * exposure + under * bb
            linear[y, left + x, 3] = sums[3 * plane + p] + under * ba
    if len(color) > 0:
        row = color[y]
        for x in range(count):
            p = np.uint64(first + x)
            alpha = sums[np.uint64(3 * plane) + p]
            under = _F(1.0) - alpha
            alpha = alpha + under * ba
            inverse = _F(1.0) / max(alpha, _F(1e-30))
            red = srgb_code((sums[p] * exposure + under * br) * inverse)
            green = srgb_code((sums[np.uint64(plane) + p] * exposure + under * bg) * inverse)
            blue = srgb_code((sums[np.uint64(2 * plane) + p] * exposure + under * bb) * inverse)
            row[np.uint64(left + x)] = np.uint32(
                np.int32(red | np.int32(green << _GREEN)) | np.int32(np.int32(blue << _BLUE) | np.int32(unit_code(alpha) << _ALPHA))
            )


@jit.part
def write_tile(sums, empty, tile, px, py, wide, high, exposure, background, color, linear):
    """Write a tile's summed pixels; all pixels of an empty one are the same."""
    for y in range(1 if empty else high):
        write_row(sums, y * tile, tile * tile, py + y, px, wide, exposure, background, color, linear)
    if empty and len(color) > 0:
        color[py + 1 : py + high, px : px + wide] = color[py, px]
    if empty and len(linear) > 0:
        for k in range(4):
            linear[py + 1 : py + high, px : px + wide, k] = linear[py, px, k]


@jit.parallel_kernel
def _shade(queue, first_tile, last_tile, across, tile, width, height, occupied, all_ids, pattern, every_sample, geometry, screen, screen_f,
           clipped, clipped_f, materials, lights, eye, features, rich, footprint, exposure, background, left, top, target):  # fmt: skip
    geometry, clipped, materials, lights = jit.borrow(geometry), jit.borrow(clipped), jit.borrow(materials), jit.borrow(lights)
    screen, screen_f, clipped_f, pattern = jit.borrow(screen), jit.borrow(screen_f), jit.borrow(clipped_f), jit.borrow(pattern)
    ids, eye, background, target = jit.borrow(all_ids), jit.borrow(eye), jit.borrow(background), jit.borrow(target)
    samples, pixels = len(pattern), tile * tile
    own_g, own_sums = np.zeros(_SIZE, np.float32), np.zeros(4 * pixels, np.float32)
    own_f = Fragments(
        np.zeros(FRAGMENTS + 8, np.int32), np.zeros(FRAGMENTS + 8, np.int32), np.zeros(FRAGMENTS + 8, np.int32), np.ones(FRAGMENTS, np.uint64),
        np.zeros(FRAGMENTS + 1, np.int32), np.zeros((FRAGMENTS, 4), np.int32),
    )
    g, sums, f = jit.borrow(own_g), jit.borrow(own_sums), jit.borrow(own_f)
    own_codes = np.zeros(FRAGMENTS, np.uint32)
    codes = jit.borrow(own_codes)
    to_samples = len(target.samples) > 0
    direct = samples == 1 and not to_samples and len(target.linear) == 0  # nothing is blended: no sums are needed
    number = first_tile + jit.take(queue)
    while number < last_tile:
        slot = number - first_tile
        px, py = (number % across) * tile, (number // across) * tile
        wide, high = min(tile, width - px), min(tile, height - py)
        empty = occupied[number] == 0
        if empty or direct:
            for plane in range(4):
                sums[plane * pixels : plane * pixels + wide] = _F(0.0)
        else:
            sums[:] = _F(0.0)
        if direct:
            write_tile(sums, True, tile, left + px, top + py, wide, high, exposure, background, target.color, target.linear)
        cursor = tile * high if empty else 0
        while cursor < tile * high:
            if samples == 1:
                n, runs, cursor = gather_pixels(g, f, cursor, ids[slot], tile, wide, high)
            else:
                n, runs, cursor = gather_samples(g, f, cursor, ids[slot], pattern, every_sample, tile, wide, high)
            attributes(g, f, n, runs, px, py, tile, geometry, screen, screen_f, clipped, clipped_f, features, footprint, eye, rich)
            surface(g, f.material, n, materials, rich)
            light(g, n, lights, rich)
            if to_samples:
                lay_over_samples(g, f, n, samples, pixels, target.samples[slot])
            elif direct:
                write_opaque(g, f.pixel, n, tile, exposure, codes, target.color, top + py, left + px)
            elif samples == 1:
                set_pixels(g, f.pixel, n, pixels, sums)
            else:
                add_to_pixels(g, f, n, samples, pixels, sums)
        if not to_samples and not direct:
            write_tile(sums, empty, tile, left + px, top + py, wide, high, exposure, background, target.color, target.linear)
        number = first_tile + jit.take(queue)
    own_g[0] = own_sums[0] + own_f.triangle[0] + own_codes[0]  # the scratch must live until here: borrowing does not keep it


def shade(bins: Bins, occupied: Array, first_tile: int, last_tile: int, width: int, height: int, ids: Array, pattern: Array,
          every_sample: bool, geometry: Geometry, screen: Array, clipped: Clipped, materials: MaterialTable, lights: LightTable, eye: Eye,
          features: int, exposure: float, background: Array, left: int, top: int, target: Target, threads: int) -> None:  # fmt: skip
    """Shade tiles first_tile .. last_tile - 1.

    Args:
        bins: Their size and number across.
        occupied: (tiles,) uint8 of the whole window, 0 where no triangle may be and ids are not to be read.
        ids: (tiles, ...) int32, from `cover` or `layer`.
        every_sample: Supersampling: every sample is shaded, as if it were a pixel of a finer picture.
        features: The rows of a batch to fill: NEEDS_* of `materials`, and NEEDS_POSITION.
        exposure: Factor of the light.
        background: (4,) float32, linear and premultiplied.
        left, top: Where the window lies in the target.
        target: What is written.
    """
    footprint = _F(1 / math.sqrt(len(pattern)) if every_sample else 1)
    jit.run(
        _shade, min(threads, last_tile - first_tile), first_tile, last_tile, bins.across, bins.tile, width, height, occupied, ids, pattern,
        every_sample, geometry, screen, screen.view(np.float32), clipped, clipped.screen.view(np.float32), materials, lights, eye, features,
        True if materials.rich else None, footprint, _F(exposure), background, left, top, target,
    )  # fmt: skip


@jit.parallel_kernel
def _light_vertices(queue, normals, positions, colors, vertex_material, materials, lights, eye, lit):
    positions, normals, colors, lit = jit.borrow(positions), jit.borrow(normals), jit.borrow(colors), jit.borrow(lit)
    materials, lights, eye, vertex_material = jit.borrow(materials), jit.borrow(lights), jit.borrow(eye), jit.borrow(vertex_material)
    own_g = np.zeros(_SIZE, np.float32)
    g = jit.borrow(own_g)
    block = jit.take(queue)
    while block * FRAGMENTS < len(positions):
        first = block * FRAGMENTS
        n = min(FRAGMENTS, len(positions) - first)
        for i in range(n):
            g[FRONT + i] = _F(1.0)
            for k in range(3):
                g[NX + k * PITCH + i] = normals[first + i, k]
                g[PX + k * PITCH + i] = positions[first + i, k]
            for k in range(4):
                g[CR + k * PITCH + i] = colors[first + i, k] if len(colors) > 0 else _F(1.0)
        view_vectors(g, n, eye)
        surface(g, vertex_material[first:], n, materials, None)
        light(g, n, lights, None)
        for i in range(n):
            lit[first + i, 0], lit[first + i, 1], lit[first + i, 2] = g[OR + i], g[OG + i], g[OB + i]
            lit[first + i, 3] = g[OA + i]
        block = jit.take(queue)
    own_g[0] = 0  # the scratch must live until here: borrowing does not keep it


def light_vertices(geometry: Geometry, chosen: Array, materials: MaterialTable, lights: LightTable, eye: Eye, threads: int) -> Array:
    """Vertex colours for Gouraud shading.

    Args:
        chosen: (materials,) bool: the rows of `materials` that are Gouraud; other vertices keep their colour.
        materials: From `pack_materials` with vertices=True.

    Returns:
        (n, 4) float32.
    """
    count = len(geometry.positions)
    material = np.zeros(count, np.int32)
    for i, row in enumerate(geometry.part_material):
        material[geometry.triangles[geometry.part_start[i] : geometry.part_start[i + 1]]] = row
    lit = np.empty((count, 4), np.float32)
    jit.run(_light_vertices, min(threads, 1 + count // FRAGMENTS), geometry.normals, geometry.positions, geometry.colors, material, materials,
            lights, eye, lit)  # fmt: skip
    rest = ~chosen[material]
    if rest.any():
        lit[rest] = geometry.colors[rest] if len(geometry.colors) else 1.0
    return lit
