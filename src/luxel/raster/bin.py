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
from luxel.memory import reusable
from luxel.raster.constants import GUARD_LOW, UNSAFE
from luxel.raster.edge import area2, edges
from luxel.raster.project import Window

OPAQUE, MASK, BLEND = 0, 1, 2

CHUNK_LOG2 = 7
"""Of the number of triangles that are left out together."""
ALL = np.empty(0, np.uint8)
"""Of chunks: none is left out."""


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


_CHUNK = 8192  # triangles: fewer are sorted before a second thread has begun
# A block of triangles is judged at once. Rows of its scratch: corners; the box of tiles; what is to be done.
_BLOCK = 64
_X0, _Y0, _X1, _Y1, _X2, _Y2, _LEFT, _TOP, _RIGHT, _BOTTOM, _KIND = (np.uint64(_BLOCK * row) for row in range(11))
BOX, KIND, _ROWS = int(_LEFT), int(_KIND), 11
OTHER = 2
_OTHER, _LEAST, _ZERO, _EIGHT, _ROUND = (np.int32(number) for number in (OTHER, GUARD_LOW, 0, 8, 255))
_SMALL = np.int32(1 << 14)  # fixed point; the edge functions of triangles up to this wide and high fit int32

NO_CLIPPED = Clipped(np.zeros(0, np.int32), np.zeros((0, 3, 4), np.int32), np.zeros((0, 3, 3), np.float32))


@jit.inlined
def tile_box(x0, y0, x1, y1, x2, y2, cull, low, high, bounds, tile_log2):
    """First and last tile, across and down, with a pixel of `bounds` whose samples (`low` .. `high` in the pixel) may lie inside; (1, 1, 0, 0) if
    none. Bounds: left and top pixel, and the successors of right and bottom."""
    area = area2(x0, y0, x1, y1, x2, y2)
    if area == 0 or (cull and area < 0):
        return 1, 1, 0, 0
    left, top, right, bottom = bounds
    lx = max((min(x0, min(x1, x2)) - high + 255) >> 8, left)
    hx = min((max(x0, max(x1, x2)) - low) >> 8, right - 1)
    ly = max((min(y0, min(y1, y2)) - high + 255) >> 8, top)
    hy = min((max(y0, max(y1, y2)) - low) >> 8, bottom - 1)
    if lx > hx or ly > hy:
        return 1, 1, 0, 0
    if lx == hx and ly == hy and low == high:  # a single sample, and half of those of a fine mesh miss it
        _, _, e0, _, _, e1, _, _, e2 = edges(x0, y0, x1, y1, x2, y2, (lx << 8) + low, (ly << 8) + low)
        if (e0 | e1 | e2) < 0:
            return 1, 1, 0, 0
    return lx >> tile_log2, ly >> tile_log2, hx >> tile_log2, hy >> tile_log2


@jit.part
def load_block(t, count, triangles, screen, c):
    """Load the corners of `count` triangles from `t` on into the rows of `c`."""
    for i in range(np.uint64(0), np.uint64(count)):
        k = np.uint64(t) + i
        v0, v1, v2 = np.uint64(triangles[k, 0]), np.uint64(triangles[k, 1]), np.uint64(triangles[k, 2])
        c[_X0 + i], c[_Y0 + i] = screen[v0, 0], screen[v0, 1]
        c[_X1 + i], c[_Y1 + i] = screen[v1, 0], screen[v1, 1]
        c[_X2 + i], c[_Y2 + i] = screen[v2, 0], screen[v2, 1]


@jit.part
def judge_block(count, cull, low, high, bounds, tile_log2, c):
    """Judge the loaded triangles as `tile_box` does, but in int32 and so in vector registers. _KIND gets 1 if a triangle is to be drawn, in
    the tiles _LEFT, _TOP .. _RIGHT, _BOTTOM, and 0 if not; and `_OTHER` if it is large or has an unsafe vertex. Returns whether any is."""
    low, high, shift = np.int32(low), np.int32(high), np.int32(tile_log2)
    first_x, first_y, last_x, last_y = np.int32(bounds[0]), np.int32(bounds[1]), np.int32(bounds[2] - 1), np.int32(bounds[3] - 1)
    one_sample, others = low == high, np.int32(0)
    for i in range(np.uint64(0), np.uint64(count)):
        x0, y0, x1, y1, x2, y2 = c[_X0 + i], c[_Y0 + i], c[_X1 + i], c[_Y1 + i], c[_X2 + i], c[_Y2 + i]
        left, right = max(min(x0, min(x1, x2)), _LEAST), max(max(x0, max(x1, x2)), _LEAST)
        top, bottom = min(y0, min(y1, y2)), max(y0, max(y1, y2))
        other = (left == _LEAST) | (np.int32(right - left) > _SMALL) | (np.int32(bottom - top) > _SMALL)
        x0, y0, x1, y1, x2, y2 = (
            _ZERO if other else x0, _ZERO if other else y0, _ZERO if other else x1, _ZERO if other else y1,
            _ZERO if other else x2, _ZERO if other else y2,
        )   # nothing overflows
        area = np.int32(np.int32(np.int32(x2 - x0) * np.int32(y1 - y0)) - np.int32(np.int32(x1 - x0) * np.int32(y2 - y0)))
        lx, hx = max(np.int32(np.int32(left - high + _ROUND) >> _EIGHT), first_x), min(np.int32(np.int32(right - low) >> _EIGHT), last_x)
        ly, hy = max(np.int32(np.int32(top - high + _ROUND) >> _EIGHT), first_y), min(np.int32(np.int32(bottom - low) >> _EIGHT), last_y)
        keep = ((area > 0) | ((area < 0) & (not cull))) & (lx <= hx) & (ly <= hy)
        # A single sample, and half of those triangles of a fine mesh miss it. Edges as in `edges`, of the triangle turned to the front.
        px, py = np.int32(np.int32(lx << _EIGHT) + low), np.int32(np.int32(ly << _EIGHT) + low)
        bx, by = (x1, y1) if area > 0 else (x2, y2)
        cx, cy = (x2, y2) if area > 0 else (x1, y1)
        e0, e1, e2 = small_edge(bx, by, cx, cy, px, py), small_edge(cx, cy, x0, y0, px, py), small_edge(x0, y0, bx, by, px, py)
        keep &= (not one_sample) | (lx != hx) | (ly != hy) | (np.int32(np.int32(e0 | e1) | e2) >= 0)
        c[_LEFT + i], c[_TOP + i] = np.int32(lx >> shift), np.int32(ly >> shift)
        c[_RIGHT + i], c[_BOTTOM + i] = np.int32(hx >> shift), np.int32(hy >> shift)
        c[_KIND + i] = _OTHER if other else np.int32(keep)
        others = np.int32(others | np.int32(other))
    return others != 0


@jit.inlined
def small_edge(x0, y0, x1, y1, x, y):
    """The edge function from corner 0 to corner 1 at (x, y), with `edge_bias`, in int32."""
    a, b = np.int32(y1 - y0), np.int32(x0 - x1)
    bias = np.int32(0) if (a > 0) | ((a == 0) & (b > 0)) else np.int32(-1)
    return np.int32(np.int32(np.int32(a * np.int32(x - x0)) + np.int32(b * np.int32(y - y0))) + bias)


@jit.part
def count_tiles(boxes, first, last, across, count):
    """Add the boxes of tiles first .. last - 1 to the tiles' counts."""
    for k in range(np.uint64(first), np.uint64(last)):
        lx, ly, hx, hy = boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3]
        for ty in range(ly, hy + 1):
            for tx in range(lx, hx + 1):
                count[np.uint64(ty * across + tx)] += 1


@jit.part
def keep_other(t, extra, place, triangles, screen, clipped_source, clipped_screen, cull, low, high, bounds, tile_log2, kept, boxes):
    """Keep triangle `t`, or what clipping made of it, from `place` on; returns the next place."""
    m = len(triangles)
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    begin, end = t, t + 1
    if screen[a, 0] == UNSAFE or screen[b, 0] == UNSAFE or screen[c, 0] == UNSAFE:
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
        lx, ly, hx, hy = tile_box(x0, y0, x1, y1, x2, y2, cull, low, high, bounds, tile_log2)
        if lx <= hx:
            kept[place] = drawn
            boxes[place, 0], boxes[place, 1], boxes[place, 2], boxes[place, 3] = lx, ly, hx, hy
            place += 1
    return place


@jit.parallel_kernel
def _count(queue, triangles, screen, clipped_source, clipped_screen, part_start, part_mode, part_cull, mode, wanted,
           low, high, bounds, tile_log2, across, kept, boxes, kept_count, counts):  # fmt: skip
    """Pass one: the survivors of each chunk, the box of tiles each touches, and how many fall in each tile."""
    triangles, screen, kept, boxes = jit.borrow(triangles), jit.borrow(screen), jit.borrow(kept), jit.borrow(boxes)
    clipped_source, clipped_screen, counts = jit.borrow(clipped_source), jit.borrow(clipped_screen), jit.borrow(counts)
    own = np.zeros(_ROWS * _BLOCK, np.int32)
    c = jit.borrow(own)
    m, chunks = len(triangles), len(counts)
    size = (m + chunks - 1) // chunks
    chunk = jit.take(queue)
    while chunk < chunks:
        t, last = chunk * size, min(m, (chunk + 1) * size)
        part = np.searchsorted(part_start, t, side="right") - 1
        extra = np.searchsorted(clipped_source, t)
        first = place = t + extra
        while t < last:
            while t >= part_start[part + 1]:
                part += 1
            stop = min(last, np.int64(part_start[part + 1]))
            if part_mode[part] != mode:
                t = stop
                continue
            if len(wanted) > 0 and wanted[t >> CHUNK_LOG2] == 0:
                t = min(stop, ((t >> CHUNK_LOG2) + 1) << CHUNK_LOG2)
                continue
            n, cull, before = min(_BLOCK, stop - t), part_cull[part] != 0, place
            load_block(t, n, triangles, screen, c)
            if judge_block(n, cull, low, high, bounds, tile_log2, c):
                for i in range(n):
                    if c[KIND + i] == OTHER:
                        while extra < len(clipped_source) and clipped_source[extra] < t + i:
                            extra += 1
                        place = keep_other(t + i, extra, place, triangles, screen, clipped_source, clipped_screen, cull, low, high, bounds,
                                           tile_log2, kept, boxes)  # fmt: skip
                    elif c[KIND + i] != 0:
                        kept[place] = t + i
                        for k in range(4):
                            boxes[place, k] = c[BOX + k * _BLOCK + i]
                        place += 1
            else:  # without branches, which would be mispredicted: what is not kept is overwritten by the next
                for i in range(np.uint64(0), np.uint64(n)):
                    k = np.uint64(place)
                    kept[k] = np.uint64(t) + i
                    boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3] = c[_LEFT + i], c[_TOP + i], c[_RIGHT + i], c[_BOTTOM + i]
                    place += np.int64(c[_KIND + i])
            count_tiles(boxes, before, place, across, counts[chunk])
            t += n
        kept_count[chunk] = place - first
        chunk = jit.take(queue)
    own[0] = 0  # the scratch must live until here: borrowing does not keep it


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
                  tile: int, threads: int, bounds: tuple[int, int, int, int] | None = None, wanted: Array = ALL) -> Bins:  # fmt: skip
    """Sort the triangles of the parts whose alpha mode is `mode` into tiles of `tile` (a power of two) pixels.

    Args:
        triangles: (m, 3) int32.
        screen: (n, 4) int32, from `project`.
        clipped: What clipping made of the triangles with unsafe vertices.
        pattern: (s, 2) int32 sample positions in 1/256 pixel.
        window: Its width and height are binned.
        bounds: Left, top, right, bottom in pixels of the window: what lies outside is left out; None for all of it.
        wanted: (chunks of 2^CHUNK_LOG2 triangles,) uint8, 0 for those that are left out; without rows: all are binned.
    """
    across, down = -(-window.width // tile), -(-window.height // tile)
    m, places = len(triangles), len(triangles) + len(clipped.source)
    chunks = max(1, min(4 * threads if threads > 1 else 1, m // _CHUNK))
    kept, boxes = reusable((places,), np.int32), reusable((places, 4), np.int16)
    kept_count, counts = np.zeros(chunks, np.int64), np.zeros((chunks, across * down), np.int32)
    threads = min(threads, chunks)
    jit.run(
        _count, threads, triangles, screen, clipped.source, clipped.screen, *parts, mode, wanted, int(pattern.min()), int(pattern.max()),
        bounds or (0, 0, window.width, window.height), tile.bit_length() - 1, across, kept, boxes, kept_count, counts,
    )  # fmt: skip
    start = np.empty(across * down + 1, np.int32)
    total = _scan(counts, start)
    if total >= 1 << 31:
        raise InputError(f"{total} entries in the tiles' triangle lists: expected fewer than 2^31; draw in windows or with larger tiles")
    ids = reusable((total,), np.int32)
    jit.run(_fill, threads, m, clipped.source, across, kept, boxes, kept_count, counts, ids)
    return Bins(start, ids, across, down, tile)
