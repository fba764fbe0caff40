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
from luxel.raster.joint import COLUMNS, TOGETHER, WIDEST, draw_four
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
    NONE,
    POINT,
    POINT_DEPTH,
    SIZE,
    SMALL,
    SPAN_LEFT,
    SPAN_RIGHT,
    STEP_X,
    STEP_Y,
    T,
    find_spans,
    load_batch,
    place,
    place_batch,
    place_four,
    set_up_batch,
)  # fmt: skip

_I, _F = np.int32, np.float32

BEHIND = np.float32(-1.0)
"""Depth where there is nothing: farther than 0, which is the far plane of an orthographic camera, and drawn."""


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


@jit.part
def draw_jointly(n, c, pattern, s, first, pixels, tile, wide, high, depth, ids):
    """Draw the `n` triangles that are placed for samples `s` .. `s` + 3, the first of which begin at element `first`."""
    for i in range(np.uint64(0), np.uint64(n)):
        kind = c[KIND + i]
        if kind == FEW_PIXELS:
            draw_four(depth, ids, c, np.int64(i), first, pixels, tile)
        elif kind == MANY:
            for k in range(TOGETHER):
                sx, sy = pattern[s + k, 0], pattern[s + k, 1]
                place(i, sx, sy, _I(tile), _I(wide - 1), _I(high - 1), c)
                if c[KIND + i] != NONE:
                    draw_many(i, c, np.int64(sx), np.int64(sy), first + k * pixels, tile, depth, ids, None)


@jit.device
def cover_tile(number, start, bin_ids, across, tile, width, height, triangles, screen, clipped_screen, pattern, depth, ids, c, counting):
    """Find what is nearest at each sample of tile `number` of a window, into `depth` and `ids`; `c` (SIZE,) int32 is scratch."""
    begin, end, samples, pixels = np.int64(start[number]), np.int64(start[number + 1]), len(pattern), tile * tile
    depth[:] = BEHIND
    ids[:] = NOTHING if counting is None else 0
    px, py = (number % across) * tile, (number // across) * tile
    wide, high = min(tile, width - px), min(tile, height - py)
    while begin < end:
        n = min(BATCH, end - begin)
        load_batch(begin, begin + n, px, py, bin_ids, triangles, screen, clipped_screen, c)
        joint = samples - samples % TOGETHER if counting is None and tile <= COLUMNS * LANES else 0
        set_up_batch(n, c, _I(WIDEST << 8) if joint > 0 else _I(SMALL << 8))
        for s in range(0, joint, TOGETHER):
            place_four(n, pattern, s, tile, wide, high, c)
            draw_jointly(n, c, pattern, s, s * pixels, pixels, tile, wide, high, depth, ids)
        for s in range(joint, samples):
            sx, sy = np.int64(pattern[s, 0]), np.int64(pattern[s, 1])
            place_batch(n, sx, sy, tile, wide, high, c)
            draw_batch(n, c, sx, sy, s * pixels, tile, depth, ids, counting)
        begin += n


@jit.parallel_kernel
def _cover(queue, first_tile, last_tile, across, tile, width, height, start, bin_ids, triangles, screen,
           clipped_screen, pattern, clear_all, depths, ids_out, counting):  # fmt: skip
    bin_ids, triangles, screen, clipped_screen = jit.borrow(bin_ids), jit.borrow(triangles), jit.borrow(screen), jit.borrow(clipped_screen)
    start, pattern, ids_out = jit.borrow(start), jit.borrow(pattern), jit.borrow(ids_out)
    keep_depth = len(depths) > 0
    own_depth, own = np.empty(1 if keep_depth else ids_out.shape[1], np.float32), np.zeros(SIZE, np.int32)
    c, all_depths = jit.borrow(own), jit.borrow(depths)
    number = first_tile + jit.take(queue)
    while number < last_tile:
        if start[number] < start[number + 1] or clear_all:
            slot = number - first_tile
            depth = all_depths[slot] if keep_depth else jit.borrow(own_depth)
            cover_tile(
                number, start, bin_ids, across, tile, width, height, triangles, screen, clipped_screen, pattern, depth, ids_out[slot], c, counting,
            )  # fmt: skip
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
