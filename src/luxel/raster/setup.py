"""Set-up: a batch of a bin's triangles made ready for `cover`, all at once and so in vector registers.

Small triangles, which are most of a fine mesh, get their edge functions in int32, exact because they are small and near the tile; of the
others only the depth is prepared. Then they are placed, once for each sample of a pixel. All numbers lie in rows of one int32 buffer,
those marked float32 by their bits: one buffer, so that the compiler knows that rows do not overlap.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.jit import bits_float, float_bits
from luxel.raster.edge import edge_bias, edges
from luxel.raster.lanes import LANES, prefetch

BATCH = 128
"""Triangles; and rows of the largest tile."""

SMALL = 32
"""Pixels; triangles no wider and no higher are small."""

# Rows. In: drawn triangle; corners, fixed point from the tile's corner, and their depths (float32).
T, X0, Y0, Z0, X1, Y1, Z1, X2, Y2, Z2 = (np.uint64(BATCH * row) for row in range(10))
# Out of `set_up_batch`: 1 if it is small; its box; edge functions at the tile's corner (small ones only).
FEW, LEFT, RIGHT, TOP, BOTTOM = (np.uint64(BATCH * row) for row in range(10, 15))
A0, B0, C0, A1, B1, C1, A2, B2, C2 = (np.uint64(BATCH * row) for row in range(15, 24))
# The same, float32: depth at the reference pixel and its steps; range of depth; from the reference pixel to the tile's corner, pixels.
DEPTH, STEP_X, STEP_Y, LOW, HIGH, FROM_X, FROM_Y = (np.uint64(BATCH * row) for row in range(24, 31))
# Out of `place_batch`, for one sample: what is to be drawn; pixel of the group in which the box begins, pixels from there across, rows;
# edge functions there (small ones only).
KIND, AT, ACROSS, DOWN, E0, E1, E2 = (np.uint64(BATCH * row) for row in range(31, 38))
# The same, float32: from the reference pixel to the sample there; depth of a point.
AT_X, AT_Y, POINT_DEPTH = (np.uint64(BATCH * row) for row in range(38, 41))
# Of one triangle, for each row: first and last pixel from the tile's edge.
SPAN_LEFT, SPAN_RIGHT = (np.uint64(BATCH * row) for row in range(41, 43))
# Out of `place_four`: edge functions where the triangle is placed, of each of four samples; and the samples' places in the pixel, float32, x of
# each and then y of each.
EDGES = np.uint64(BATCH * 43)
OFFSETS = np.uint64(BATCH * 55)
# The greatest of the edge functions of the four samples at eight pixels from there on; and -1 / B, float32, 0 if B is.
MOST0, MOST1, MOST2, ROW0, ROW1, ROW2 = (np.uint64(BATCH * row) for row in range(56, 62))
SIZE = 62 * BATCH

NONE, POINT, FEW_PIXELS, MANY = range(4)
"""Kinds: not at any of these samples; at one only; small; large."""

_F, _I = np.float32, np.int32
_BEYOND = 1e6  # pixels; right of every tile
_SMALL = np.int32(SMALL << 8)
_ZERO, _SEVEN, _EIGHT, _ROUND, _GROUP = (np.int32(number) for number in (0, 7, 8, 255, -LANES))
_NONE, _POINT, _FEW, _MANY = (np.int32(number) for number in (NONE, POINT, FEW_PIXELS, MANY))


@jit.inlined
def depth_plane(x0, y0, z0, x1, y1, z1, x2, y2, z2):
    """Depth per pixel along x and y, and at the corner of the pixel that holds corner 0; float64 arithmetic, float32 results."""
    ux, uy, vx, vy = np.float64(x1 - x0), np.float64(y1 - y0), np.float64(x2 - x0), np.float64(y2 - y0)
    uz, vz = np.float64(z1) - np.float64(z0), np.float64(z2) - np.float64(z0)
    scale = 1.0 / (ux * vy - vx * uy)
    dx, dy = (uz * vy - vz * uy) * scale, (ux * vz - vx * uz) * scale
    base = np.float64(z0) - dx * np.float64(x0 & 255) - dy * np.float64(y0 & 255)
    return _F(base), _F(dx * 256.0), _F(dy * 256.0)


@jit.inlined
def depth_from(z, zx, zy, low, high, across, down):
    """Depth so many pixels right of and below the reference pixel: float32, and always in this order of operations."""
    depth = (z + zy * down) + zx * across
    depth = depth if depth > low else low
    return depth if depth < high else high


@jit.part
def load_batch(first, last, px, py, bin_ids, triangles, screen, clipped_screen, c):
    """Load the corners of entries first .. last - 1 of the bins; (px, py) is the tile's corner in pixels."""
    m = len(triangles)
    ox, oy = _I(px << 8), _I(py << 8)
    for q in range(first, last):  # every vertex is asked for before the first is read: large meshes do not fit in the core's cache
        t = bin_ids[q]
        if t < m:
            k = np.uint64(t)
            v0, v1, v2 = triangles[k, 0], triangles[k, 1], triangles[k, 2]
            prefetch(screen, np.int64(v0) * 4)
            prefetch(screen, np.int64(v1) * 4)
            prefetch(screen, np.int64(v2) * 4)
            i = np.uint64(q - first)
            c[X0 + i], c[X1 + i], c[X2 + i] = v0, v1, v2
    for i in range(np.uint64(0), np.uint64(last - first)):
        t = bin_ids[np.uint64(first) + i]
        c[T + i] = t
        if t < m:
            v0, v1, v2 = np.uint64(c[X0 + i]), np.uint64(c[X1 + i]), np.uint64(c[X2 + i])
            c[X0 + i], c[Y0 + i], c[Z0 + i] = _I(screen[v0, 0] - ox), _I(screen[v0, 1] - oy), screen[v0, 2]
            c[X1 + i], c[Y1 + i], c[Z1 + i] = _I(screen[v1, 0] - ox), _I(screen[v1, 1] - oy), screen[v1, 2]
            c[X2 + i], c[Y2 + i], c[Z2 + i] = _I(screen[v2, 0] - ox), _I(screen[v2, 1] - oy), screen[v2, 2]
        else:
            k = np.uint64(t - m)
            c[X0 + i], c[Y0 + i], c[Z0 + i] = _I(clipped_screen[k, 0, 0] - ox), _I(clipped_screen[k, 0, 1] - oy), clipped_screen[k, 0, 2]
            c[X1 + i], c[Y1 + i], c[Z1 + i] = _I(clipped_screen[k, 1, 0] - ox), _I(clipped_screen[k, 1, 1] - oy), clipped_screen[k, 1, 2]
            c[X2 + i], c[Y2 + i], c[Z2 + i] = _I(clipped_screen[k, 2, 0] - ox), _I(clipped_screen[k, 2, 1] - oy), clipped_screen[k, 2, 2]


@jit.inlined
def small_edge(x0, y0, x1, y1):
    """a, b, c of the edge function from corner 0 to corner 1, as in `edges`, in int32."""
    a, b = _I(y1 - y0), _I(x0 - x1)
    return a, b, _I(_I(edge_bias(a, b)) - _I(_I(a * x0) + _I(b * y0)))


@jit.part
def set_up_batch(n, c, small=_SMALL):
    """Set up the `n` triangles that are loaded; those up to `small` (fixed point) wide and high are small."""
    for i in range(np.uint64(0), np.uint64(n)):
        x0, y0, z0, z1, z2 = c[X0 + i], c[Y0 + i], bits_float(c[Z0 + i]), bits_float(c[Z1 + i]), bits_float(c[Z2 + i])
        z, zx, zy = depth_plane(x0, y0, z0, c[X1 + i], c[Y1 + i], z1, c[X2 + i], c[Y2 + i], z2)
        c[DEPTH + i], c[STEP_X + i], c[STEP_Y + i] = float_bits(z), float_bits(zx), float_bits(zy)
        c[LOW + i], c[HIGH + i] = float_bits(min(z0, min(z1, z2))), float_bits(max(z0, max(z1, z2)))
        c[FROM_X + i], c[FROM_Y + i] = float_bits(_F(-_I(x0 >> _EIGHT))), float_bits(_F(-_I(y0 >> _EIGHT)))
    for i in range(np.uint64(0), np.uint64(n)):
        x0, y0, x1, y1, x2, y2 = c[X0 + i], c[Y0 + i], c[X1 + i], c[Y1 + i], c[X2 + i], c[Y2 + i]
        left, right, top, bottom = min(x0, min(x1, x2)), max(x0, max(x1, x2)), min(y0, min(y1, y2)), max(y0, max(y1, y2))
        c[LEFT + i], c[RIGHT + i], c[TOP + i], c[BOTTOM + i] = left, right, top, bottom
        few = (_I(right - left) <= small) & (_I(bottom - top) <= small)
        c[FEW + i] = _I(few)
        x0, y0, x1, y1, x2, y2 = (  # nothing overflows
            x0 if few else _ZERO, y0 if few else _ZERO, x1 if few else _ZERO, y1 if few else _ZERO, x2 if few else _ZERO, y2 if few else _ZERO,
        )
        back = _I(_I(_I(x2 - x0) * _I(y1 - y0)) - _I(_I(x1 - x0) * _I(y2 - y0))) < 0
        bx, by = (x2, y2) if back else (x1, y1)
        cx, cy = (x1, y1) if back else (x2, y2)
        c[A0 + i], c[B0 + i], c[C0 + i] = small_edge(bx, by, cx, cy)
        c[A1 + i], c[B1 + i], c[C1 + i] = small_edge(cx, cy, x0, y0)
        c[A2 + i], c[B2 + i], c[C2 + i] = small_edge(x0, y0, bx, by)


@jit.inlined
def place(i, sx, sy, pitch, last_x, last_y, c):
    """Place triangle `i` for the samples at (sx, sy) of the tile's pixels; see `place_batch`."""
    lx, hx = max(_I(_I(c[LEFT + i] - sx + _ROUND) >> _EIGHT), _ZERO), min(_I(_I(c[RIGHT + i] - sx) >> _EIGHT), last_x)
    ly, hy = max(_I(_I(c[TOP + i] - sy + _ROUND) >> _EIGHT), _ZERO), min(_I(_I(c[BOTTOM + i] - sy) >> _EIGHT), last_y)
    # The samples of one kind lie 256 units apart: the low 8 bits never change, so they may go.
    e0 = _I(_I(_I(c[C0 + i] + _I(c[A0 + i] * sx) + _I(c[B0 + i] * sy)) >> _EIGHT) + _I(c[A0 + i] * lx) + _I(c[B0 + i] * ly))
    e1 = _I(_I(_I(c[C1 + i] + _I(c[A1 + i] * sx) + _I(c[B1 + i] * sy)) >> _EIGHT) + _I(c[A1 + i] * lx) + _I(c[B1 + i] * ly))
    e2 = _I(_I(_I(c[C2 + i] + _I(c[A2 + i] * sx) + _I(c[B2 + i] * sy)) >> _EIGHT) + _I(c[A2 + i] * lx) + _I(c[B2 + i] * ly))
    few, one, empty = c[FEW + i] != 0, (lx == hx) & (ly == hy), (lx > hx) | (ly > hy)
    at_x, at_y = bits_float(c[FROM_X + i]) + _F(sx) * _F(1 / 256) + _F(lx), bits_float(c[FROM_Y + i]) + _F(sy) * _F(1 / 256) + _F(ly)
    z, zx, zy = bits_float(c[DEPTH + i]), bits_float(c[STEP_X + i]), bits_float(c[STEP_Y + i])
    c[POINT_DEPTH + i] = float_bits(depth_from(z, zx, zy, bits_float(c[LOW + i]), bits_float(c[HIGH + i]), at_x, at_y))
    point = few & one
    missed = empty | (point & (_I(_I(e0 | e1) | e2) < 0))
    kind = _POINT if point else (_FEW if few else _MANY)
    c[KIND + i] = _NONE if missed else kind
    group = _ZERO if point else _I(lx - _I(lx & _GROUP))
    c[AT + i], c[ACROSS + i], c[DOWN + i] = _I(_I(ly * pitch) + _I(lx - group)), _I(_I(hx - lx) + group), _I(hy - ly)
    c[AT_X + i], c[AT_Y + i] = float_bits(at_x - _F(group)), float_bits(at_y)
    c[E0 + i], c[E1 + i], c[E2 + i] = _I(e0 - _I(c[A0 + i] * group)), _I(e1 - _I(c[A1 + i] * group)), _I(e2 - _I(c[A2 + i] * group))


@jit.part
def place_batch(n, sx, sy, tile, wide, high, c):
    """Place the `n` triangles that are set up for the samples at (sx, sy) of the tile's pixels; of a triangle that may be at one of them only,
    find out whether it is, and its depth there."""
    sx, sy, pitch, last_x, last_y = _I(sx), _I(sy), _I(tile), _I(wide - 1), _I(high - 1)
    for i in range(np.uint64(0), np.uint64(n)):
        place(i, sx, sy, pitch, last_x, last_y, c)


@jit.inlined
def most(c, at, a):
    """The greatest that an edge function of four samples, from `at` on, has at eight pixels."""
    pitch = np.uint64(3 * BATCH)
    first, last = max(c[at], c[at + pitch]), max(c[at + pitch + pitch], c[at + pitch + pitch + pitch])
    return _I(max(first, last) + max(_I(_SEVEN * a), _ZERO))


@jit.inlined
def rows_by(b):
    """Rows by which an edge function that changes by `b` a row comes to 0, for each unit of its value."""
    return _F(-1.0) / _F(b) if b != 0 else _F(0.0)


@jit.part
def place_four(n, pattern, s, tile, wide, high, c):
    """Place the `n` triangles that are set up for samples `s` .. `s` + 3 of the tile's pixels: where the first of the samples' boxes
    begins and the last ends, and for each sample the edge functions there."""
    pitch, last_x, last_y = _I(tile), _I(wide - 1), _I(high - 1)
    least_x, most_x, least_y, most_y = pattern[s, 0], pattern[s, 0], pattern[s, 1], pattern[s, 1]
    for k in range(np.uint64(4)):
        x, y = pattern[np.uint64(s) + k, 0], pattern[np.uint64(s) + k, 1]
        least_x, most_x, least_y, most_y = min(least_x, x), max(most_x, x), min(least_y, y), max(most_y, y)
        c[OFFSETS + k], c[OFFSETS + np.uint64(4) + k] = float_bits(_F(x) * _F(1 / 256)), float_bits(_F(y) * _F(1 / 256))
    for i in range(np.uint64(0), np.uint64(n)):
        lx, hx = max(_I(_I(c[LEFT + i] - most_x + _ROUND) >> _EIGHT), _ZERO), min(_I(_I(c[RIGHT + i] - least_x) >> _EIGHT), last_x)
        ly, hy = max(_I(_I(c[TOP + i] - most_y + _ROUND) >> _EIGHT), _ZERO), min(_I(_I(c[BOTTOM + i] - least_y) >> _EIGHT), last_y)
        begin = _I(lx & _GROUP)
        kind = _FEW if c[FEW + i] != 0 else _MANY
        c[KIND + i] = _NONE if (lx > hx) | (ly > hy) else kind
        c[AT + i], c[ACROSS + i], c[DOWN + i] = _I(_I(ly * pitch) + begin), _I(hx - begin), _I(hy - ly)
        c[AT_X + i], c[AT_Y + i] = float_bits(bits_float(c[FROM_X + i]) + _F(begin)), float_bits(bits_float(c[FROM_Y + i]) + _F(ly))
        c[E0 + i] = _I(_I(c[A0 + i] * begin) + _I(c[B0 + i] * ly))
        c[E1 + i] = _I(_I(c[A1 + i] * begin) + _I(c[B1 + i] * ly))
        c[E2 + i] = _I(_I(c[A2 + i] * begin) + _I(c[B2 + i] * ly))
    for k in range(np.uint64(4)):
        x, y, row = pattern[np.uint64(s) + k, 0], pattern[np.uint64(s) + k, 1], EDGES + np.uint64(3 * BATCH) * k
        for i in range(np.uint64(0), np.uint64(n)):
            c[row + i] = _I(_I(_I(c[C0 + i] + _I(c[A0 + i] * x) + _I(c[B0 + i] * y)) >> _EIGHT) + c[E0 + i])
            c[row + np.uint64(BATCH) + i] = _I(_I(_I(c[C1 + i] + _I(c[A1 + i] * x) + _I(c[B1 + i] * y)) >> _EIGHT) + c[E1 + i])
            c[row + np.uint64(2 * BATCH) + i] = _I(_I(_I(c[C2 + i] + _I(c[A2 + i] * x) + _I(c[B2 + i] * y)) >> _EIGHT) + c[E2 + i])
    for i in range(np.uint64(0), np.uint64(n)):
        c[MOST0 + i], c[ROW0 + i] = most(c, EDGES + i, c[A0 + i]), float_bits(rows_by(c[B0 + i]))
        c[MOST1 + i], c[ROW1 + i] = most(c, EDGES + np.uint64(BATCH) + i, c[A1 + i]), float_bits(rows_by(c[B1 + i]))
        c[MOST2 + i], c[ROW2 + i] = most(c, EDGES + np.uint64(2 * BATCH) + i, c[A2 + i]), float_bits(rows_by(c[B2 + i]))


@jit.part
def find_spans(i, c, sx, sy, tile):
    """Find the first and last pixel, from the tile's edge, of the rows of triangle `i` of the batch at the samples (sx, sy)."""
    x0, y0, x1, y1 = np.int64(c[X0 + i]), np.int64(c[Y0 + i]), np.int64(c[X1 + i]), np.int64(c[Y1 + i])
    a0, b0, c0, a1, b1, c1, a2, b2, c2 = edges(x0, y0, x1, y1, np.int64(c[X2 + i]), np.int64(c[Y2 + i]), 0, 0)
    # The edge functions are below 2^53, so these sums are exact.
    e0 = np.float64((c0 + a0 * sx + b0 * sy) >> 8) + 0.5
    e1 = np.float64((c1 + a1 * sx + b1 * sy) >> 8) + 0.5
    e2 = np.float64((c2 + a2 * sx + b2 * sy) >> 8) + 0.5
    b0, b1, b2 = np.float64(b0), np.float64(b1), np.float64(b2)
    # For a = 0 the row is all in or all out: a huge factor sends the right end beyond either side of the tile.
    f0 = -1.0 / np.float64(a0) if a0 != 0 else 1e12
    f1 = -1.0 / np.float64(a1) if a1 != 0 else 1e12
    f2 = -1.0 / np.float64(a2) if a2 != 0 else 1e12
    begins0, begins1, begins2 = a0 > 0, a1 > 0, a2 > 0
    top, begin = _I(c[AT + i] // tile), _I(c[AT + i] % tile)
    first, last = np.float64(begin), np.float64(_I(begin + c[ACROSS + i]))
    for k in range(np.uint64(0), np.uint64(c[DOWN + i] + 1)):
        y = np.float64(_I(top + _I(k)))
        q0, q1, q2 = (e0 + b0 * y) * f0, (e1 + b1 * y) * f1, (e2 + b2 * y) * f2
        left = max(first, max(np.ceil(q0) if begins0 else first, max(np.ceil(q1) if begins1 else first, np.ceil(q2) if begins2 else first)))
        right = min(last, min(last if begins0 else np.floor(q0), min(last if begins1 else np.floor(q1), last if begins2 else np.floor(q2))))
        c[SPAN_LEFT + k], c[SPAN_RIGHT + k] = _I(min(left, _BEYOND)), _I(max(right, -1.0))


@jit.inlined
def depth_at(i, c, across, down):
    """Depth of triangle `i` so many pixels right of and below where it is placed: float32, in `cover`'s order of operations."""
    z, zx, zy = bits_float(c[DEPTH + i]), bits_float(c[STEP_X + i]), bits_float(c[STEP_Y + i])
    at_x, at_y = bits_float(c[AT_X + i]) + _F(_I(across)), bits_float(c[AT_Y + i]) + _F(_I(down))
    return depth_from(z, zx, zy, bits_float(c[LOW + i]), bits_float(c[HIGH + i]), at_x, at_y)
