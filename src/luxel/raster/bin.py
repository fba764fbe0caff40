"""Bin: which triangles touch which tile, in ascending order of id.

Count, prefix sum, fill: the triangles are cut into chunks; each chunk keeps its survivors (front-facing, not empty, on the screen) and
counts them per tile; a scan over tiles and then chunks gives every chunk its places; and each chunk writes its ids there. So the lists
are the same for any number of chunks and threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.raster.constants import UNSAFE
from luxel.raster.edge import area2, edges
from luxel.raster.project import Window

OPAQUE, MASK, BLEND = 0, 1, 2


class Parts(NamedTuple):
    """Ranges of triangles that share a material: (p + 1,) int32 first triangles, and (p,) int32 alpha mode and whether back faces go."""

    start: Array
    alpha_mode: Array
    cull_back: Array


class Clipped(NamedTuple):
    """Triangles made by clipping, in ascending order of their source: drawn under the ids m, m + 1, ... after the m of the mesh.

    Attributes:
        source: (k,) int32, the triangle each was cut from.
        screen: (k, 3, 4) int32, its projected vertices, like `project`'s.
        corners: (k, 3, 3) float32, the barycentric coordinates of its corners in the source.
    """

    source: Array
    screen: Array
    corners: Array


class Bins(NamedTuple):
    """Triangle lists of tiles: those of tile k (row by row) are `triangles[start[k]:start[k + 1]]`, ascending."""

    start: Array
    triangles: Array
    across: int
    down: int
    tile: int


NO_CLIPPED = Clipped(np.zeros(0, np.int32), np.zeros((0, 3, 4), np.int32), np.zeros((0, 3, 3), np.float32))


@jit.inlined
def tile_box(x0, y0, x1, y1, x2, y2, cull, low, high, width, height, tile_log2):
    """First and last tile, across and down, with a pixel whose samples (`low` .. `high` in the pixel) may lie inside; (1, 1, 0, 0) if none."""
    area = area2(x0, y0, x1, y1, x2, y2)
    if area == 0 or (cull and area < 0):
        return 1, 1, 0, 0
    lx = max((min(x0, min(x1, x2)) - high + 255) >> 8, 0)
    hx = min((max(x0, max(x1, x2)) - low) >> 8, width - 1)
    ly = max((min(y0, min(y1, y2)) - high + 255) >> 8, 0)
    hy = min((max(y0, max(y1, y2)) - low) >> 8, height - 1)
    if lx > hx or ly > hy:
        return 1, 1, 0, 0
    if lx == hx and ly == hy and low == high:  # a single sample, and half of those of a fine mesh miss it
        _, _, e0, _, _, e1, _, _, e2 = edges(x0, y0, x1, y1, x2, y2, (lx << 8) + low, (ly << 8) + low)
        if (e0 | e1 | e2) < 0:
            return 1, 1, 0, 0
    return lx >> tile_log2, ly >> tile_log2, hx >> tile_log2, hy >> tile_log2


@jit.parallel_kernel
def _count(queue, triangles, screen, clipped_source, clipped_screen, part_start, part_mode, part_cull, mode,
           low, high, width, height, tile_log2, across, kept, boxes, kept_count, counts):  # fmt: skip
    """Pass one: the survivors of each chunk, the box of tiles each touches, and how many fall in each tile."""
    m, chunks = len(triangles), len(counts)
    size = (m + chunks - 1) // chunks
    chunk = jit.take(queue)
    while chunk < chunks:
        first, last = chunk * size, min(m, (chunk + 1) * size)
        part = np.searchsorted(part_start, first, side="right") - 1
        extra = np.searchsorted(clipped_source, first)
        place = first + extra
        count = counts[chunk]
        for t in range(first, last):
            while t >= part_start[part + 1]:
                part += 1
            if part_mode[part] != mode:
                continue
            begin, end = t, t + 1
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            if screen[a, 0] == UNSAFE or screen[b, 0] == UNSAFE or screen[c, 0] == UNSAFE:
                while extra < len(clipped_source) and clipped_source[extra] < t:
                    extra += 1
                begin = end = m + extra
                while end - m < len(clipped_source) and clipped_source[end - m] == t:
                    end += 1
            for drawn in range(begin, end):
                if drawn < m:
                    x0, y0 = np.int64(screen[a, 0]), np.int64(screen[a, 1])
                    x1, y1 = np.int64(screen[b, 0]), np.int64(screen[b, 1])
                    x2, y2 = np.int64(screen[c, 0]), np.int64(screen[c, 1])
                else:
                    k = drawn - m
                    x0, y0 = np.int64(clipped_screen[k, 0, 0]), np.int64(clipped_screen[k, 0, 1])
                    x1, y1 = np.int64(clipped_screen[k, 1, 0]), np.int64(clipped_screen[k, 1, 1])
                    x2, y2 = np.int64(clipped_screen[k, 2, 0]), np.int64(clipped_screen[k, 2, 1])
                lx, ly, hx, hy = tile_box(x0, y0, x1, y1, x2, y2, part_cull[part], low, high, width, height, tile_log2)
                if lx > hx:
                    continue
                kept[place] = drawn
                boxes[place, 0], boxes[place, 1], boxes[place, 2], boxes[place, 3] = lx, ly, hx, hy
                place += 1
                for ty in range(ly, hy + 1):
                    for tx in range(lx, hx + 1):
                        count[ty * across + tx] += 1
        kept_count[chunk] = place - first - np.searchsorted(clipped_source, first)
        chunk = jit.take(queue)


@jit.kernel
def _scan(counts, start):
    """Turn counts (chunk, tile) into the place where each chunk's ids of each tile begin; fill `start`; return the total."""
    total = 0
    for tile in range(counts.shape[1]):
        start[tile] = total
        for chunk in range(counts.shape[0]):
            number = counts[chunk, tile]
            counts[chunk, tile] = total
            total += number
    start[counts.shape[1]] = total
    return total


@jit.parallel_kernel
def _fill(queue, m, clipped_source, across, kept, boxes, kept_count, counts, ids):
    """Pass two: every chunk writes its ids at its places."""
    chunks = len(counts)
    size = (m + chunks - 1) // chunks
    chunk = jit.take(queue)
    while chunk < chunks:
        first = chunk * size
        first += np.searchsorted(clipped_source, first)
        place = counts[chunk]
        for i in range(first, first + kept_count[chunk]):
            for ty in range(boxes[i, 1], boxes[i, 3] + 1):
                for tx in range(boxes[i, 0], boxes[i, 2] + 1):
                    tile = ty * across + tx
                    ids[place[tile]] = kept[i]
                    place[tile] += 1
        chunk = jit.take(queue)


def bin_triangles(triangles: Array, screen: Array, clipped: Clipped, parts: Parts, mode: int, pattern: Array, window: Window,
                  tile: int, threads: int) -> Bins:  # fmt: skip
    """Sort the triangles of the parts whose alpha mode is `mode` into tiles of `tile` (a power of two) pixels.

    Args:
        triangles: (m, 3) int32.
        screen: (n, 4) int32, from `project`.
        clipped: What clipping made of the triangles with unsafe vertices.
        pattern: (s, 2) int32 sample positions in 1/256 pixel.
        window: Its width and height are binned.
    """
    across, down = -(-window.width // tile), -(-window.height // tile)
    m, places = len(triangles), len(triangles) + len(clipped.source)
    chunks = max(1, min(4 * threads if threads > 1 else 1, m // 1024))
    kept, boxes = np.empty(places, np.int32), np.empty((places, 4), np.int16)
    kept_count, counts = np.zeros(chunks, np.int64), np.zeros((chunks, across * down), np.int32)
    threads = min(threads, chunks)
    jit.run(
        _count, threads, triangles, screen, clipped.source, clipped.screen, *parts, mode, int(pattern.min()), int(pattern.max()),
        window.width, window.height, tile.bit_length() - 1, across, kept, boxes, kept_count, counts,
    )  # fmt: skip
    start = np.empty(across * down + 1, np.int32)
    total = _scan(counts, start)
    if total >= 1 << 31:
        raise InputError(f"{total} entries in the tiles' triangle lists: expected fewer than 2^31; draw in windows or with larger tiles")
    ids = np.empty(total, np.int32)
    jit.run(_fill, threads, m, clipped.source, across, kept, boxes, kept_count, counts, ids)
    return Bins(start, ids, across, down, tile)
