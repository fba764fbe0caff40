"""Draw: which triangle is nearest at every sample, by one 64-bit minimum a sample.

A sample's key has the depth in its high half, nearer being less, and the source triangle in its low half: the least key is the nearest triangle,
and of equally near ones the lower, in whatever order they are drawn. Coverage and depth are `luxel.raster.cover`'s: exact edge functions, and
the same float operations in the same order.

A thread draws a small triangle. Of a larger one it puts the tiles of its box into a queue, and a warp draws each. Masked triangles look up
their alpha where they would be nearest. Blended ones are peeled as in docs/decisions/0004: a pass finds at each sample the greatest key that is
less than the layer's before it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.cuda.machine import add, keep_least, keep_most
from luxel.cuda.threads.views import seen_by
from luxel.jit import bits_float, float_bits, part
from luxel.raster.bin import OPAQUE, tile_box
from luxel.raster.clip import needs_clipping
from luxel.raster.constants import NOTHING, UNSAFE
from luxel.raster.edge import edges
from luxel.raster.fragments import find_part
from luxel.raster.layer import opaque_at
from luxel.raster.materials import CUTOFF
from luxel.raster.setup import depth_from, depth_plane

_F = np.float32

EMPTY = np.uint64(0xFFFFFFFFFFFFFFFF)
"""The key of a sample where there is nothing; greater than all others."""

NO_LAYER = np.uint64(0)
"""The key that stands for no layer; less than all others."""

LANES_ACROSS, LANES_DOWN = 8, 4
"""The threads of a warp draw pixels so: what they write lies together."""

ITEMS, CANDIDATES, COUNTS = 0, 1, 2
"""Places in `Queue.counts`."""

_SHIFT, _LOW_HALF, _DEEPEST = np.uint64(32), np.uint64(0xFFFFFFFF), np.int64(0x7FFFFFFF)


class Raster(NamedTuple):
    """How to draw.

    Attributes:
        width, height: Of the window, in pixels.
        low, high: Least and greatest place of a sample in its pixel, 1/256 pixel.
        mode: The alpha mode whose triangles are drawn.
        split: Pixels; a triangle whose box has more is drawn by warps.
        side: Of a tile that a warp draws, in pixels.
    """

    width: int
    height: int
    low: int
    high: int
    mode: int
    split: int
    side: int


class Queue(NamedTuple):
    """What a pass leaves to the next ones. What does not fit is counted and not written.

    Attributes:
        counts: (COUNTS,) int64: rows wanted of `items` and of `candidates`.
        items: (i, 4) int32: view, drawn triangle, tile across and down.
        candidates: (c, 2) int32: view and triangle that needs clipping.
    """

    counts: Array
    items: Array
    candidates: Array


@part
def key_of(depth, source):
    """The key of a triangle at a depth of at least 0; -0 counts as 0."""
    far = np.uint64(_DEEPEST - np.int64(float_bits(depth + _F(0.0))))
    return (far << _SHIFT) | np.uint64(source)


@part
def depth_in(key):
    """The depth in a key."""
    return bits_float(np.int32(_DEEPEST - np.int64(key >> _SHIFT)))


@part
def corners_of(t, drawn):
    """x y z of the three corners of drawn triangle `t`: fixed point int64, and float32 depth."""
    m, screen, screen_f = len(drawn.geometry.triangles), drawn.screen, drawn.screen_f
    if t < m:
        a, b, c = drawn.geometry.triangles[t, 0], drawn.geometry.triangles[t, 1], drawn.geometry.triangles[t, 2]
        return (
            np.int64(screen[a, 0]), np.int64(screen[a, 1]), screen_f[a, 2], np.int64(screen[b, 0]), np.int64(screen[b, 1]), screen_f[b, 2],
            np.int64(screen[c, 0]), np.int64(screen[c, 1]), screen_f[c, 2],
        )  # fmt: skip
    k, cut, cut_f = t - m, drawn.clipped.screen, drawn.clipped_f
    return (
        np.int64(cut[k, 0, 0]), np.int64(cut[k, 0, 1]), cut_f[k, 0, 2], np.int64(cut[k, 1, 0]), np.int64(cut[k, 1, 1]), cut_f[k, 1, 2],
        np.int64(cut[k, 2, 0]), np.int64(cut[k, 2, 1]), cut_f[k, 2, 2],
    )  # fmt: skip


@part
def cover_box(v, t, source, box, step_x, step_y, drawn, pattern, keys, materials, nearer_than):
    """Draw triangle `t` at the samples of every `step_x`-th pixel across and every `step_y`-th down of `box` (left, top, right, bottom).

    Args:
        keys: (v, s, h, w) uint64. Where `nearer_than` is None the least keys, else the greatest of those less than `nearer_than`'s, from 0 up.
        materials: None, or those of masked triangles.
    """
    x0, y0, z0, x1, y1, z1, x2, y2, z2 = corners_of(t, drawn)
    a0, b0, c0, a1, b1, c1, a2, b2, c2 = edges(x0, y0, x1, y1, x2, y2, 0, 0)
    z, zx, zy = depth_plane(x0, y0, z0, x1, y1, z1, x2, y2, z2)
    low, high = min(z0, min(z1, z2)), max(z0, max(z1, z2))
    for y in range(box[1], box[3] + 1, step_y):
        for x in range(box[0], box[2] + 1, step_x):
            for s in range(len(pattern)):
                sx, sy = np.int64(pattern[s, 0]), np.int64(pattern[s, 1])
                px, py = (x << 8) + sx, (y << 8) + sy
                if ((c0 + a0 * px + b0 * py) | (c1 + a1 * px + b1 * py) | (c2 + a2 * px + b2 * py)) < 0:
                    continue
                across, down = _F(x - (x0 >> 8)) + _F(sx) * _F(1 / 256), _F(y - (y0 >> 8)) + _F(sy) * _F(1 / 256)
                key = key_of(depth_from(z, zx, zy, low, high, across, down), source)
                if nearer_than is not None:
                    if key < nearer_than[v, s, y, x] and key > keys[v, s, y, x]:
                        keep_most(keys, (v, s, y, x), key)
                elif key < keys[v, s, y, x]:  # what is there only gets less: nothing is missed
                    if materials is not None:
                        if opaque_at(t, px, py, drawn.geometry, drawn.screen, drawn.screen_f, drawn.clipped, drawn.clipped_f, materials, CUTOFF):
                            keep_least(keys, (v, s, y, x), key)
                    else:
                        keep_least(keys, (v, s, y, x), key)


@part
def draw_drawn(v, t, source, cull, drawn, pattern, raster, queue, keys, materials, nearer_than):
    """Draw triangle `t`, or leave it to warps."""
    x0, y0, _, x1, y1, _, x2, y2, _ = corners_of(t, drawn)
    box = tile_box(x0, y0, x1, y1, x2, y2, cull, raster.low, raster.high, (0, 0, raster.width, raster.height), 0)
    left, top, right, bottom = box
    if left > right:
        return
    if (right - left + 1) * (bottom - top + 1) <= raster.split:
        cover_box(v, t, source, box, 1, 1, drawn, pattern, keys, materials, nearer_than)
        return
    side = raster.side
    left, top, right, bottom = left // side, top // side, right // side, bottom // side
    row = add(queue.counts, ITEMS, (right - left + 1) * (bottom - top + 1))
    for down in range(top, bottom + 1):
        for across in range(left, right + 1):
            if 0 <= row < len(queue.items):
                queue.items[row, 0], queue.items[row, 1], queue.items[row, 2], queue.items[row, 3] = v, t, across, down
            row += 1


@part
def draw_triangle(i, v, everything, pattern, raster, queue, keys, materials, nearer_than):
    """Draw triangle `i` of the scene into view `v`, if it is of the mode and needs no clipping; else the opaque pass puts it in the queue."""
    parts, drawn = everything.geometry.parts, seen_by(v, everything)
    triangles, screen = everything.geometry.triangles, drawn.screen
    a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
    if screen[a, 0] == UNSAFE or screen[b, 0] == UNSAFE or screen[c, 0] == UNSAFE:
        if raster.mode == OPAQUE and needs_clipping(screen, a, b, c):
            row = add(queue.counts, CANDIDATES, 1)
            if row < len(queue.candidates):
                queue.candidates[row, 0], queue.candidates[row, 1] = v, i
        return
    part_of = find_part(parts.start, i)
    if parts.alpha_mode[part_of] == raster.mode:
        draw_drawn(v, i, i, parts.cull_back[part_of] != 0, drawn, pattern, raster, queue, keys, materials, nearer_than)


@part
def draw_piece(i, v, everything, pattern, raster, queue, keys, materials, nearer_than):
    """Draw piece `i` that clipping made for view `v`, if it has so many and if it is of the mode."""
    parts, drawn = everything.geometry.parts, seen_by(v, everything)
    if i >= len(drawn.clipped.source):
        return
    source = drawn.clipped.source[i]
    part_of = find_part(parts.start, source)
    if parts.alpha_mode[part_of] == raster.mode:
        t = len(everything.geometry.triangles) + i
        draw_drawn(v, t, source, parts.cull_back[part_of] != 0, drawn, pattern, raster, queue, keys, materials, nearer_than)


@part
def draw_item(item, lane, everything, pattern, raster, queue, keys, materials, nearer_than):
    """Lane `lane` of the warp that draws row `item` of the queue."""
    v, t = np.int64(queue.items[item, 0]), np.int64(queue.items[item, 1])
    drawn, m = seen_by(v, everything), len(everything.geometry.triangles)
    x0, y0, _, x1, y1, _, x2, y2, _ = corners_of(t, drawn)
    left, top = np.int64(queue.items[item, 2]) * raster.side, np.int64(queue.items[item, 3]) * raster.side
    bounds = left, top, min(left + raster.side, raster.width), min(top + raster.side, raster.height)
    left, top, right, bottom = tile_box(x0, y0, x1, y1, x2, y2, False, raster.low, raster.high, bounds, 0)
    source = t if t < m else np.int64(drawn.clipped.source[t - m])
    box = left + lane % LANES_ACROSS, top + lane // LANES_ACROSS, right, bottom
    cover_box(v, t, source, box, LANES_ACROSS, LANES_DOWN, drawn, pattern, keys, materials, nearer_than)


@part
def drawn_at(key, px, py, drawn):
    """The drawn triangle in a key, at the fixed-point position (px, py); `NOTHING` if it is `EMPTY`."""
    if key == EMPTY:
        return np.int64(NOTHING)
    t, sources = np.int64(key & _LOW_HALF), drawn.clipped.source
    if len(sources) == 0:
        return t
    first, last = 0, len(sources)
    while first < last:
        middle = (first + last) >> 1
        if sources[middle] < t:
            first = middle + 1
        else:
            last = middle
    while first < len(sources) and sources[first] == t:
        piece = len(drawn.geometry.triangles) + first
        if key_at(piece, t, px, py, drawn) == key:
            return np.int64(piece)
        first += 1
    return t


@part
def key_at(t, source, px, py, drawn):
    """The key of drawn triangle `t` at one sample, `EMPTY` if it is not there."""
    x0, y0, z0, x1, y1, z1, x2, y2, z2 = corners_of(t, drawn)
    _, _, e0, _, _, e1, _, _, e2 = edges(x0, y0, x1, y1, x2, y2, px, py)
    if (e0 | e1 | e2) < 0:
        return EMPTY
    z, zx, zy = depth_plane(x0, y0, z0, x1, y1, z1, x2, y2, z2)
    across = _F((px >> 8) - (x0 >> 8)) + _F(px & 255) * _F(1 / 256)
    down = _F((py >> 8) - (y0 >> 8)) + _F(py & 255) * _F(1 / 256)
    return key_of(depth_from(z, zx, zy, min(z0, min(z1, z2)), max(z0, max(z1, z2)), across, down), source)
