"""Clip: triangles with an unsafe vertex are cut at the near and far planes and at the guard band (Sutherland and Hodgman 1974).

They are few: everything that fits between the guard band's borders is left to the exact edge functions. New corners are snapped like all
others, and an edge is cut from its inner end towards its outer end whichever triangle asks, so neighbours stay watertight. Each piece knows
its source and where its corners lie in it, so that shading never sees clipped attributes.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.bin import ALL, CHUNK_LOG2, NO_CLIPPED, Clipped
from luxel.raster.constants import OUT_NAN, UNSAFE
from luxel.raster.project import View, Window

_MOST = 9  # corners of a triangle cut by six planes
_CHUNK = 65536


@jit.inlined
def plane_distance(plane, p, i, least_depth, guard):
    """Of corner `i` of polygon `p` (columns x y z w): at least 0 inside near, far, left, right, bottom, top."""
    if plane == 0:
        return p[i, 3] - p[i, 2]
    if plane == 1:
        return p[i, 2] - least_depth * p[i, 3]
    if plane == 2:
        return p[i, 0] - guard[0] * p[i, 3]
    if plane == 3:
        return guard[1] * p[i, 3] - p[i, 0]
    if plane == 4:
        return p[i, 1] - guard[2] * p[i, 3]
    return guard[3] * p[i, 3] - p[i, 1]


@jit.device
def clip_polygon(p, q, n, least_depth, guard):
    """Cut the polygon in rows 0 .. n of `p` (clip-space x y z w, then 3 barycentric coordinates); `q` is scratch. Returns the rows left in `p`."""
    for plane in range(6):
        kept = 0
        for i in range(n):
            j = i + 1 if i + 1 < n else 0
            di = plane_distance(plane, p, i, least_depth, guard)
            dj = plane_distance(plane, p, j, least_depth, guard)
            if di >= 0.0:
                for k in range(7):
                    q[kept, k] = p[i, k]
                kept += 1
            if (di >= 0.0) != (dj >= 0.0):
                inner, outer = (i, j) if di >= 0.0 else (j, i)
                inside, outside = max(di, dj), min(di, dj)
                f = inside / (inside - outside)
                for k in range(7):
                    q[kept, k] = p[inner, k] + f * (p[outer, k] - p[inner, k])
                kept += 1
        n = min(kept, _MOST)
        for i in range(n):
            for k in range(7):
                p[i, k] = q[i, k]
        if n < 3:
            return 0
    return n


@jit.device
def cut(p, q, t, positions, triangles, m, least_depth, guard):
    """Cut triangle `t` into the polygon in `p`; returns its corners, 0 if nothing is left. `q` is scratch."""
    for i in range(3):
        v = triangles[t, i]
        x, y, z = np.float64(positions[v, 0]), np.float64(positions[v, 1]), np.float64(positions[v, 2])
        for k in range(4):
            p[i, k] = m[k, 0] * x + m[k, 1] * y + m[k, 2] * z + m[k, 3]
        for k in range(3):
            p[i, 4 + k] = 1.0 if i == k else 0.0
    return clip_polygon(p, q, 3, least_depth, guard)


@jit.device
def write_piece(p, piece, row, half_w, half_h, left, top, screen, screen_f, corners):
    """Write the triangle `piece` of the fan of the polygon `p` in row `row`; (left, top) is the window's corner in fixed point, float64."""
    for k in range(3):
        i = 0 if k == 0 else piece + k
        iw = 1.0 / p[i, 3]
        screen[row, k, 0] = np.int32(math.floor(p[i, 0] * iw * half_w + half_w + 0.5) - left)
        screen[row, k, 1] = np.int32(math.floor(half_h - p[i, 1] * iw * half_h + 0.5) - top)
        screen_f[row, k, 2] = np.float32(max(min(p[i, 2] * iw, 1.0), 0.0))
        screen_f[row, k, 3] = np.float32(iw)
        for corner in range(3):
            corners[row, k, corner] = np.float32(p[i, 4 + corner])


@jit.inlined
def needs_clipping(screen, a, b, c):
    """Whether the triangle of these vertices has an unsafe one, and may be seen."""
    if screen[a, 0] != UNSAFE and screen[b, 0] != UNSAFE and screen[c, 0] != UNSAFE:
        return False
    code_a = screen[a, 1] if screen[a, 0] == UNSAFE else 0
    code_b = screen[b, 1] if screen[b, 0] == UNSAFE else 0
    code_c = screen[c, 1] if screen[c, 0] == UNSAFE else 0
    return code_a & code_b & code_c == 0 and (code_a | code_b | code_c) & OUT_NAN == 0


@jit.parallel_kernel
def _find(queue, triangles, screen, wanted, found, count):
    """Triangles of each chunk that have an unsafe vertex and may be seen, in order, from found[chunk * _CHUNK] on."""
    m = len(triangles)
    chunk = jit.take(queue)
    while chunk * _CHUNK < m:
        place = chunk * _CHUNK
        for t in range(chunk * _CHUNK, min(m, (chunk + 1) * _CHUNK)):
            if len(wanted) > 0 and wanted[t >> CHUNK_LOG2] == 0:
                continue
            if needs_clipping(screen, triangles[t, 0], triangles[t, 1], triangles[t, 2]):
                found[place] = t
                place += 1
        count[chunk] = place - chunk * _CHUNK
        chunk = jit.take(queue)


@jit.parallel_kernel
def _clip(queue, candidates, positions, triangles, m, least_depth, guard, window, pieces, start, source, screen, screen_f, corners):
    """Without `start`: count the pieces of each candidate. With it: write them there."""
    wx, wy = np.float64(window[0]) * 256.0, np.float64(window[1]) * 256.0
    half_w, half_h = np.float64(window[4]) * 128.0, np.float64(window[5]) * 128.0
    p, q = np.empty((_MOST + 1, 7)), np.empty((2 * _MOST, 7))
    c = jit.take(queue)
    while c < len(candidates):
        t = candidates[c]
        n = cut(p, q, t, positions, triangles, m, least_depth, guard)
        pieces[c] = max(n - 2, 0)
        if len(start) > 0:
            for piece in range(n - 2):
                source[start[c] + piece] = t
                write_piece(p, piece, start[c] + piece, half_w, half_h, wx, wy, screen, screen_f, corners)
        c = jit.take(queue)


def clip(positions: Array, triangles: Array, screen: Array, view: View, window: Window, threads: int, wanted: Array = ALL) -> Clipped:
    """Cut the triangles that have unsafe vertices.

    Args:
        positions: (n, 3) float32 world positions.
        triangles: (m, 3) int32.
        screen: (n, 4) int32, from `project`.
        wanted: As of `bin_triangles`.
    """
    chunks = -(-len(triangles) // _CHUNK)
    found, count = np.empty(len(triangles), np.int32), np.zeros(chunks, np.int64)
    jit.run(_find, min(threads, chunks), triangles, screen, wanted, found, count)
    candidates = np.concatenate([found[i * _CHUNK : i * _CHUNK + n] for i, n in enumerate(count)] + [found[:0]])
    if not len(candidates):
        return NO_CLIPPED
    threads = min(threads, 1 + len(candidates) // 256)
    pieces = np.zeros(len(candidates), np.int64)
    fixed = candidates, positions, triangles, view.clip_from_world, view.least_depth, window.guard(), np.array(window, np.int64), pieces
    nothing = NO_CLIPPED.screen
    jit.run(_clip, threads, *fixed, pieces[:0], NO_CLIPPED.source, nothing, nothing.view(np.float32), NO_CLIPPED.corners)
    total = int(pieces.sum())
    start = np.cumsum(pieces) - pieces
    clipped = Clipped(np.empty(total, np.int32), np.empty((total, 3, 4), np.int32), np.empty((total, 3, 3), np.float32))
    jit.run(_clip, threads, *fixed, start, clipped.source, clipped.screen, clipped.screen.view(np.float32), clipped.corners)
    return clipped
