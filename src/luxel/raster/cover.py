"""Cover: which triangle is nearest at every sample. Integers decide.

Edge functions are exact (int64 set-up, then float64 below 2^53), the top-left rule breaks ties on edges, the nearest sample wins and of
equally near ones the lower triangle id. A tile's depth and ids stay in the core's cache while all triangles of its bin are drawn.

Small triangles test the edge functions at the pixels of their box (see `setup`). Of a larger one, the covered pixels of a row are one span,
whose ends come from three multiplications: the pixel x is inside an edge when e + a x >= 0, with integers e and a, that is when
(e + 1/2) + a x > 0; and (e + 1/2) / a is at least 1 / (2 |a|) away from every integer, far more than the rounding of a float64 product, so
rounding it up or down gives the exact end.

Depth at a sample is z + dz/dy (y - y0) + dz/dx (x - x0) in float32 from a pixel of the triangle's own, clamped to the depths of its
corners: it depends on nothing but the triangle and the sample.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import bits_float
from luxel.raster.bin import Bins, Clipped
from luxel.raster.constants import NOTHING
from luxel.raster.edge import edges
from luxel.raster.lanes import LANES, draw_inside, draw_span
from luxel.raster.setup import (
    A0,
    A1,
    A2,
    ACROSS,
    AT,
    AT_X,
    AT_Y,
    B0,
    B1,
    B2,
    BATCH,
    DEPTH,
    DOWN,
    E0,
    E1,
    E2,
    FEW_PIXELS,
    HIGH,
    KIND,
    LOW,
    MANY,
    POINT,
    POINT_DEPTH,
    SIZE,
    SPAN_LEFT,
    SPAN_RIGHT,
    STEP_X,
    STEP_Y,
    X0,
    X1,
    X2,
    Y0,
    Y1,
    Y2,
    T,
    load_batch,
    place_batch,
    set_up_batch,
)  # fmt: skip

_I, _F = np.int32, np.float32
_BEYOND = 1e6  # pixels; right of every tile

BEHIND = np.float32(-1.0)
"""Depth where there is nothing: farther than 0, which is the far plane of an orthographic camera, and drawn."""


@jit.inlined
def load(t, triangles, screen, screen_f, clipped_screen, clipped_f):
    """Corners of drawn triangle `t`: x0 y0 z0 x1 y1 z1 x2 y2 z2, fixed point int64 and float32 depths."""
    m = len(triangles)
    if t < m:
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        return (
            np.int64(screen[a, 0]), np.int64(screen[a, 1]), screen_f[a, 2], np.int64(screen[b, 0]), np.int64(screen[b, 1]), screen_f[b, 2],
            np.int64(screen[c, 0]), np.int64(screen[c, 1]), screen_f[c, 2],
        )  # fmt: skip
    k = t - m
    return (
        np.int64(clipped_screen[k, 0, 0]), np.int64(clipped_screen[k, 0, 1]), clipped_f[k, 0, 2],
        np.int64(clipped_screen[k, 1, 0]), np.int64(clipped_screen[k, 1, 1]), clipped_f[k, 1, 2],
        np.int64(clipped_screen[k, 2, 0]), np.int64(clipped_screen[k, 2, 1]), clipped_f[k, 2, 2],
    )  # fmt: skip


@jit.inlined
def draw_few(i, c, first, tile, depth, ids, counting):
    """Draw small triangle `i` of the batch at the samples that begin at element `first`."""
    at, across, t = first + np.int64(c[AT + i]), np.int64(c[ACROSS + i]) + 1, c[T + i]
    x, y, low, high = bits_float(c[AT_X + i]), bits_float(c[AT_Y + i]), bits_float(c[LOW + i]), bits_float(c[HIGH + i])
    z, zx, zy = bits_float(c[DEPTH + i]), bits_float(c[STEP_X + i]), bits_float(c[STEP_Y + i])
    e0, e1, e2 = c[E0 + i], c[E1 + i], c[E2 + i]
    for _ in range(c[DOWN + i] + 1):
        draw_inside(depth, ids, at, across, e0, e1, e2, c[A0 + i], c[A1 + i], c[A2 + i], x, z + zy * y, zx, low, high, t, counting)
        e0, e1, e2 = _I(e0 + c[B0 + i]), _I(e1 + c[B1 + i]), _I(e2 + c[B2 + i])
        at, y = at + tile, y + _F(1.0)


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


@jit.part
def draw_many(i, c, sx, sy, first, tile, depth, ids, counting):
    """Draw triangle `i` of the batch, of any size, at the samples (sx, sy), which begin at element `first`."""
    find_spans(i, c, sx, sy, tile)
    z, zx, zy, low, high, t = (
        bits_float(c[DEPTH + i]), bits_float(c[STEP_X + i]), bits_float(c[STEP_Y + i]), bits_float(c[LOW + i]), bits_float(c[HIGH + i]), c[T + i],
    )  # fmt: skip
    x, y, begin = bits_float(c[AT_X + i]), bits_float(c[AT_Y + i]), np.int64(c[AT + i]) % tile
    row = first + np.int64(c[AT + i]) - begin
    for k in range(np.uint64(0), np.uint64(c[DOWN + i] + 1)):
        left, right = np.int64(c[SPAN_LEFT + k]), np.int64(c[SPAN_RIGHT + k])
        if left <= right:
            group = left & -LANES
            draw_span(depth, ids, row + group, left - group, right - left + 1, x + _F(_I(group - begin)), z + zy * y, zx, low, high, t, counting)
        row, y = row + tile, y + _F(1.0)


@jit.part
def draw_batch(n, c, sx, sy, first, tile, depth, ids, counting):
    """Draw the `n` triangles that are placed for the samples (sx, sy), which begin at element `first`."""
    for i in range(np.uint64(0), np.uint64(n)):
        kind = c[KIND + i]
        if kind == POINT:
            at = np.uint64(first) + np.uint64(c[AT + i])
            d = bits_float(c[POINT_DEPTH + i])
            if counting is not None:
                if d >= depth[at]:
                    depth[at], ids[at] = d, ids[at] + 1
            elif d > depth[at]:
                depth[at], ids[at] = d, c[T + i]
        elif kind == FEW_PIXELS:
            draw_few(i, c, first, tile, depth, ids, counting)
        elif kind == MANY:
            draw_many(i, c, sx, sy, first, tile, depth, ids, counting)


@jit.parallel_kernel
def _cover(queue, first_tile, last_tile, across, tile, width, height, start, bin_ids, triangles, screen,
           clipped_screen, pattern, clear_all, depths, ids_out, counting):  # fmt: skip
    bin_ids, triangles, screen, clipped_screen = jit.borrow(bin_ids), jit.borrow(triangles), jit.borrow(screen), jit.borrow(clipped_screen)
    pattern, ids_out = jit.borrow(pattern), jit.borrow(ids_out)
    samples = len(pattern)
    pixels = tile * tile
    keep_depth = len(depths) > 0
    own_depth, own = np.empty(1 if keep_depth else samples * pixels + LANES, np.float32), np.zeros(SIZE, np.int32)
    c, all_depths = jit.borrow(own), jit.borrow(depths)
    number = first_tile + jit.take(queue)
    while number < last_tile:
        begin, end = np.int64(start[number]), np.int64(start[number + 1])
        if begin < end or clear_all:
            slot = number - first_tile
            ids = ids_out[slot]
            depth = all_depths[slot] if keep_depth else jit.borrow(own_depth)
            depth[:] = BEHIND
            ids[:] = NOTHING if counting is None else 0
            px, py = (number % across) * tile, (number // across) * tile
            wide, high = min(tile, width - px), min(tile, height - py)
            while begin < end:
                n = min(BATCH, end - begin)
                load_batch(begin, begin + n, px, py, bin_ids, triangles, screen, clipped_screen, c)
                set_up_batch(n, c)
                for s in range(samples):
                    sx, sy = np.int64(pattern[s, 0]), np.int64(pattern[s, 1])
                    place_batch(n, sx, sy, tile, wide, high, c)
                    draw_batch(n, c, sx, sy, s * pixels, tile, depth, ids, counting)
                begin += n
        number = first_tile + jit.take(queue)
    own[0] = len(own_depth)  # the scratch must live until here: borrowing does not keep it


def cover(bins: Bins, triangles: Array, screen: Array, clipped: Clipped, pattern: Array, width: int, height: int,
          first_tile: int, last_tile: int, ids: Array, depths: Array, threads: int, clear_all: bool = False,
          counting: bool = False) -> None:  # fmt: skip
    """Find the nearest triangle at each sample of tiles first_tile .. last_tile - 1.

    Args:
        ids: (tiles, s * tile * tile + LANES) int32, sample by sample, written; drawn ids, `NOTHING` where none. Tiles with an empty bin are
            left as they are; what is in pixels of a tile beyond the window is undefined.
        clear_all: Also clear tiles with an empty bin.
        counting: In place of ids, write how many triangles pass the depth test when it is their turn, as near as what is there included.
        depths: The same shape, float32, written (-1 where nothing); or (0, ...) if the depths are not wanted.
    """
    jit.run(
        _cover, min(threads, last_tile - first_tile), first_tile, last_tile, bins.across, bins.tile, width, height, bins.start,
        bins.triangles, triangles, screen, clipped.screen, pattern, clear_all, depths, ids, True if counting else None,
    )  # fmt: skip
