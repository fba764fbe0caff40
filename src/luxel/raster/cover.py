"""Cover: which triangle is nearest at every sample. Integers decide.

Edge functions are exact (int64 set-up, then float64 below 2^53), the top-left rule breaks ties on edges, the nearest sample wins and of
equally near ones the lower triangle id. A tile's depth and ids stay in the core's cache while all triangles of its bin are drawn.

Per row, the covered pixels are one span, whose ends come from three multiplications: the pixel x is inside an edge when
e + a x >= 0, with integers e and a, that is when (e + 1/2) + a x > 0; and (e + 1/2) / a is at least 1 / (2 |a|) away from every integer,
far more than the rounding of a float64 product, so rounding it up or down gives the exact end. Triangles a few pixels wide test
the edge functions of a row's pixels instead.

Depth at a sample is z + dz/dy (y - y0) + dz/dx (x - x0) in float32 from a pixel of the triangle's own, clamped to the depths of its
corners: it depends on nothing but the triangle and the sample.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.bin import Bins, Clipped
from luxel.raster.constants import NOTHING
from luxel.raster.edge import edges
from luxel.raster.lanes import LANES, draw_inside, draw_span, prefetch

NARROW = 32
"""Pixels; triangles no wider test the edge functions at every pixel of their box, which costs less than finding the span."""

MAX_STEP = 1 << 22
"""Fixed point; the largest |a| of which `draw_inside` is exact."""

AHEAD = 6
"""Triangles; so far ahead are vertices asked for, twice as far their indices: large meshes do not fit in the core's cache."""

BEHIND = np.float32(-1.0)
"""Depth where there is nothing: farther than 0, which is the far plane of an orthographic camera, and drawn."""


@jit.inlined
def depth_plane(x0, y0, z0, x1, y1, z1, x2, y2, z2):
    """Depth per pixel along x and y, and at the corner of the pixel that holds corner 0; float64 arithmetic, float32 results."""
    ux, uy, vx, vy = np.float64(x1 - x0), np.float64(y1 - y0), np.float64(x2 - x0), np.float64(y2 - y0)
    uz, vz = np.float64(z1) - np.float64(z0), np.float64(z2) - np.float64(z0)
    scale = 1.0 / (ux * vy - vx * uy)
    dx, dy = (uz * vy - vz * uy) * scale, (ux * vz - vx * uz) * scale
    base = np.float64(z0) - dx * np.float64(x0 & 255) - dy * np.float64(y0 & 255)
    return np.float32(base), np.float32(dx * 256.0), np.float32(dy * 256.0)


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
def ask_ahead(q, end, bin_ids, triangles, screen):
    """Prefetch what the triangles after entry `q` of a bin will need."""
    m = len(triangles)
    if q + 2 * AHEAD < end and bin_ids[q + 2 * AHEAD] < m:
        prefetch(triangles, np.int64(bin_ids[q + 2 * AHEAD]) * 3)
        ahead = bin_ids[q + AHEAD]
        if ahead < m:
            prefetch(screen, np.int64(triangles[ahead, 0]) * 4)
            prefetch(screen, np.int64(triangles[ahead, 1]) * 4)
            prefetch(screen, np.int64(triangles[ahead, 2]) * 4)


@jit.parallel_kernel
def _cover(queue, first_tile, last_tile, across, tile, width, height, start, bin_ids, triangles, screen, screen_f,
           clipped_screen, clipped_screen_f, pattern, clear_all, depths, ids_out):  # fmt: skip
    samples = len(pattern)
    pixels = tile * tile
    keep_depth = len(depths) > 0
    own = np.empty(1 if keep_depth else samples * pixels + LANES, np.float32)
    number = first_tile + jit.take(queue)
    while number < last_tile:
        begin, end = start[number], start[number + 1]
        if begin < end or clear_all:
            slot = number - first_tile
            ids = ids_out[slot]
            depth = depths[slot] if keep_depth else own
            depth[:] = BEHIND
            ids[:] = NOTHING
            px, py = (number % across) * tile, (number // across) * tile
            wide, high = min(tile, width - px), min(tile, height - py)
            for q in range(begin, end):
                t = bin_ids[q]
                ask_ahead(q, end, bin_ids, triangles, screen)
                x0, y0, z0, x1, y1, z1, x2, y2, z2 = load(t, triangles, screen, screen_f, clipped_screen, clipped_screen_f)
                z, zx, zy = depth_plane(x0, y0, z0, x1, y1, z1, x2, y2, z2)
                z_low, z_high = min(z0, min(z1, z2)), max(z0, max(z1, z2))
                ref_x, ref_y = x0 >> 8, y0 >> 8
                ox, oy = px << 8, py << 8
                a0, b0, c0, a1, b1, c1, a2, b2, c2 = edges(x0, y0, x1, y1, x2, y2, ox, oy)
                min_x, max_x = min(x0, min(x1, x2)) - ox, max(x0, max(x1, x2)) - ox
                min_y, max_y = min(y0, min(y1, y2)) - oy, max(y0, max(y1, y2)) - oy
                narrow = max_x - min_x <= NARROW << 8 and max_y - min_y <= MAX_STEP
                if not narrow:
                    # For a = 0 the row is all in or all out: a huge factor sends the right end beyond either side of the tile.
                    f0 = -1.0 / np.float64(a0) if a0 != 0 else 1e12
                    f1 = -1.0 / np.float64(a1) if a1 != 0 else 1e12
                    f2 = -1.0 / np.float64(a2) if a2 != 0 else 1e12
                for s in range(samples):
                    sx, sy = np.int64(pattern[s, 0]), np.int64(pattern[s, 1])
                    lx, hx = max((min_x - sx + 255) >> 8, 0), min((max_x - sx) >> 8, wide - 1)
                    ly, hy = max((min_y - sy + 255) >> 8, 0), min((max_y - sy) >> 8, high - 1)
                    if lx > hx or ly > hy:
                        continue
                    # The samples of one kind lie 256 units apart: the low 8 bits never change, so they may go.
                    e0 = (c0 + a0 * sx + b0 * sy) >> 8
                    e1 = (c1 + a1 * sx + b1 * sy) >> 8
                    e2 = (c2 + a2 * sx + b2 * sy) >> 8
                    fx = np.float32(px - ref_x) + np.float32(sx) * np.float32(1 / 256)
                    fy = np.float32(py - ref_y) + np.float32(sy) * np.float32(1 / 256)
                    plane = s * pixels
                    count = hx - lx + 1
                    fx += np.float32(lx)
                    if narrow:
                        r0, r1, r2 = e0 + a0 * lx, e1 + a1 * lx, e2 + a2 * lx
                        for y in range(ly, hy + 1):
                            draw_inside(depth, ids, plane + y * tile + lx, count, r0 + b0 * y, r1 + b1 * y, r2 + b2 * y, a0, a1, a2,
                                        fx, z + zy * (fy + np.float32(y)), zx, z_low, z_high, t)  # fmt: skip
                    else:
                        for y in range(ly, hy + 1):
                            left, right = np.float64(lx), np.float64(hx)
                            q0 = (np.float64(e0 + b0 * y) + 0.5) * f0
                            q1 = (np.float64(e1 + b1 * y) + 0.5) * f1
                            q2 = (np.float64(e2 + b2 * y) + 0.5) * f2
                            if a0 > 0:
                                left = max(left, np.ceil(q0))
                            else:
                                right = min(right, np.floor(q0))
                            if a1 > 0:
                                left = max(left, np.ceil(q1))
                            else:
                                right = min(right, np.floor(q1))
                            if a2 > 0:
                                left = max(left, np.ceil(q2))
                            else:
                                right = min(right, np.floor(q2))
                            if left <= right:
                                x = np.int64(left)
                                draw_span(depth, ids, plane + y * tile + x, np.int64(right) - x + 1, fx + np.float32(x - lx),
                                          z + zy * (fy + np.float32(y)), zx, z_low, z_high, t)  # fmt: skip
        number = first_tile + jit.take(queue)


def cover(bins: Bins, triangles: Array, screen: Array, clipped: Clipped, pattern: Array, width: int, height: int,
          first_tile: int, last_tile: int, ids: Array, depths: Array, threads: int, clear_all: bool = False) -> None:  # fmt: skip
    """Find the nearest triangle at each sample of tiles first_tile .. last_tile - 1.

    Args:
        ids: (tiles, s * tile * tile + LANES) int32, sample by sample, written; drawn ids, `NOTHING` where none. Tiles with an empty bin are
            left as they are.
        clear_all: Also clear tiles with an empty bin.
        depths: The same shape, float32, written (-1 where nothing); or (0, ...) if the depths are not wanted.
    """
    jit.run(
        _cover, min(threads, last_tile - first_tile), first_tile, last_tile, bins.across, bins.tile, width, height, bins.start,
        bins.triangles, triangles, screen, screen.view(np.float32), clipped.screen, clipped.screen.view(np.float32), pattern,
        clear_all, depths, ids,
    )  # fmt: skip
