"""Fragments: what is visible in a tile, in planar batches with their attributes. Floats decorate.

Every tile's visible samples become fragments: one for a pixel and triangle, however many samples they share (or one for every sample when
supersampling), at the pixel's centre if the triangle has all its samples, else at the mean of those it has, which lies inside it. Batches
are planar, so that the arithmetic runs in vector registers; a run of fragments of one triangle is set up once.

Perspective-correct barycentric coordinates come from the exact edge functions of the snapped corners: b_i = s_i / (s_0 + s_1 + s_2) with
s_i = e_i / w_i (the paper on barycentric hardware, with the division by w added). The s_i are planes over the picture, evaluated from a
point of the tile near the triangle. Derivatives per pixel are analytic: d(u) = (sum_i d(s_i) u_i - u sum_i d(s_i)) / sum_i s_i.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
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
from luxel.raster.lanes import prefetch
from luxel.raster.materials import NEEDS_COLOR, NEEDS_FACE, NEEDS_NORMAL, NEEDS_TANGENT, NEEDS_UV0, NEEDS_UV1, NEEDS_VIEW

_F = np.float32

NEEDS_POSITION = 1 << 30
"""Beside the materials' NEEDS_*: world positions, for lights that are somewhere and for views."""


class Eye(NamedTuple):
    """(3,) float64 place of the eye, and (3,) unit direction towards it with `parallel` True for orthographic cameras."""

    place: Array
    direction: Array
    parallel: bool

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
SIZE = BATCH + 27 * PITCH
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
