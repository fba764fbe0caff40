"""Shoot: what lights see through their hemicubes, and what they give to every element, as `luxel.radiosity.hemicube` and `transport`.

All hemicubes of a batch are drawn at once, as pictures are (`threads.draw`): the least 64-bit key of (depth, triangle) stays at every pixel. A
triangle is drawn by one thread, or by the threads of a warp where triangles are few and large. Then a thread an element and shooter finds that
element's entry of the shooter's row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.cuda.machine import add, keep_least
from luxel.cuda.threads.draw import EMPTY, depth_in, key_of
from luxel.jit import float_bits, part
from luxel.radiosity.batch import ELEMENTS
from luxel.radiosity.element import AREA
from luxel.radiosity.hemicube import DOWN, FACES, MOST, OUT, in_frame, is_within, side_bits, snapped, turned
from luxel.radiosity.occlusion import Occlusion
from luxel.radiosity.share import CORNER, DEEPEST, IN_FRONT, SCRATCH, aim, share_of
from luxel.radiosity.transport import BLOCK, MEETS, all_averted, decoded, fate
from luxel.raster.bin import tile_box
from luxel.raster.clip import clip_polygon
from luxel.raster.constants import NOTHING
from luxel.raster.cover import BEHIND
from luxel.raster.edge import edges
from luxel.raster.setup import depth_from, depth_plane

__all__ = ["BLOCK", "DEEPEST", "ELEMENTS", "FACES", "MOST", "SCRATCH", "Cubes", "Receivers", "Shots", "draw_triangle", "fill_entry", "find_escape",
           "read_pixel", "receive", "sum_block"]  # fmt: skip

_F = np.float32
_CENTRE, _FIRST = 128, np.uint64(0)
_ACROSS, _DOWN = 8, 4  # threads of a warp, in pixels
_LOW_HALF = np.uint64(0xFFFFFFFF)


class Cubes(NamedTuple):
    """Hemicubes of s shooters, resolution r.

    Attributes:
        positions: (3, v) float32; triangles: (m, 3) int32: what is drawn.
        planes: (m, 4) float32, two_sided: (m,) bool, of the triangles; see `luxel.radiosity.transport.Occluders`.
        centers, frames: (s, 3), (s, 3, 3) float32.
        guard: (4,) float64: where a face is cut, in half widths.
        resolution: Pixels along a face; near: float32, metres.
        wanted: (s,) bool: who looks; the others' places are left alone.
        keys: (s, 5 r r) uint64.
        depth, ids: (s 5 r r,) float32 and int32, as in `luxel.radiosity.hemicube.ItemBuffers`.
    """

    positions: Array
    triangles: Array
    planes: Array
    two_sided: Array
    centers: Array
    frames: Array
    guard: Array
    resolution: int
    near: np.float32
    wanted: Array
    keys: Array
    depth: Array
    ids: Array


class Receivers(NamedTuple):
    """Who receives: numbers (17, n) and bounds of `Elements`; all that hides, and what of it is masked; rays and for which pairs (`Visibility`)."""

    numbers: Array
    bounds: Array
    scene: Occlusion
    masked: Occlusion
    rays: int
    always: bool


class Shots(NamedTuple):
    """Who shoots: the arrays of a `Tree`, the numbers (17, k) of its elements, (s,) nodes, and (s,) int64 where their rows are kept."""

    span: Array
    child: Array
    place: Array
    source: Array
    node: Array
    slots: Array


@part
def frame_rows(frame):
    """A frame as nine numbers."""
    return frame[0, 0], frame[0, 1], frame[0, 2], frame[1, 0], frame[1, 1], frame[1, 2], frame[2, 0], frame[2, 1], frame[2, 2]


@part
def corner(v, s, rows, cubes):
    """Vertex `v` in the frame of shooter `s`."""
    x, y, z = cubes.positions[0, v] - cubes.centers[s, 0], cubes.positions[1, v] - cubes.centers[s, 1], cubes.positions[2, v] - cubes.centers[s, 2]
    return in_frame(rows, x, y, z)


@part
def cover_piece(s, face, t, a, b, d, half, lane, lanes, cubes):
    """Draw a triangle of three corners (right, up, axis) that are within a face; the lanes share its pixels."""
    size, (x0, y0, z0) = cubes.resolution, snapped(a[0], a[1], a[2], half, cubes.near)
    x1, y1, z1 = snapped(b[0], b[1], b[2], half, cubes.near)
    x2, y2, z2 = snapped(d[0], d[1], d[2], half, cubes.near)
    x0, y0, x1, y1, x2, y2 = np.int64(x0), np.int64(y0), np.int64(x1), np.int64(y1), np.int64(x2), np.int64(y2)
    bounds = 0, 0, size, size if face == 0 else size // 2
    left, top, right, bottom = tile_box(x0, y0, x1, y1, x2, y2, False, _CENTRE, _CENTRE, bounds, 0)
    if left > right:
        return
    a0, b0, c0, a1, b1, c1, a2, b2, c2 = edges(x0, y0, x1, y1, x2, y2, _CENTRE, _CENTRE)
    z, zx, zy = depth_plane(x0, y0, z0, x1, y1, z1, x2, y2, z2)
    low, high = min(z0, min(z1, z2)), max(z0, max(z1, z2))
    wide, tall = (_ACROSS, _DOWN) if lanes > 1 else (1, 1)
    for y in range(top + lane // wide, bottom + 1, tall):
        for x in range(left + lane % wide, right + 1, wide):
            px, py = x << 8, y << 8
            if ((c0 + a0 * px + b0 * py) | (c1 + a1 * px + b1 * py) | (c2 + a2 * px + b2 * py)) >= 0:
                across, down = _F(x - (x0 >> 8)) + _F(0.5), _F(y - (y0 >> 8)) + _F(0.5)
                key, at = key_of(depth_from(z, zx, zy, low, high, across, down), t), (face * size + y) * size + x
                if key < cubes.keys[s, at]:  # what is there only gets less: nothing is missed
                    keep_least(cubes.keys, (s, at), key)


@part
def draw_triangle(i, s, lanes, cubes, p, q):
    """Draw triangle i // lanes into the hemicube of shooter `s`, as lane i % lanes of as many. p (MOST + 1, 7), q (2 MOST, 7) float64 are scratch."""
    if not cubes.wanted[s]:
        return
    t, lane, near = i // lanes, i % lanes, cubes.near
    rows, half = frame_rows(cubes.frames[s]), _F(cubes.resolution * 128)
    a, b, d = (
        corner(cubes.triangles[t, 0], s, rows, cubes), corner(cubes.triangles[t, 1], s, rows, cubes), corner(cubes.triangles[t, 2], s, rows, cubes),
    )  # fmt: skip
    shared = side_bits(a[0], a[1], a[2], near) & side_bits(b[0], b[1], b[2], near) & side_bits(d[0], d[1], d[2], near)
    if shared & DOWN != 0:
        return
    for face in range(FACES):
        if shared & OUT[face] != 0:
            continue
        e, f, g = turned(face, a[0], a[1], a[2]), turned(face, b[0], b[1], b[2]), turned(face, d[0], d[1], d[2])
        if is_within(e[0], e[1], e[2], near) & is_within(f[0], f[1], f[2], near) & is_within(g[0], g[1], g[2], near):
            cover_piece(s, face, t, e, f, g, half, lane, lanes, cubes)
            continue
        for k in range(3):
            v = e if k == 0 else (f if k == 1 else g)
            p[k, 0], p[k, 1], p[k, 2], p[k, 3] = v[0], v[1], near, v[2]
        corners = clip_polygon(p, q, 3, 0.0, cubes.guard)
        for k in range(1, corners - 1):
            cover_piece(s, face, t, clipped(p, 0), clipped(p, k), clipped(p, k + 1), half, lane, lanes, cubes)


@part
def clipped(p, row):
    """A corner (right, up, axis) of the polygon that cutting left."""
    return _F(p[row, 0]), _F(p[row, 1]), _F(p[row, 3])


@part
def clear_pixel(i, s, cubes):
    """Nothing is seen in pixel `i` of shooter `s`."""
    if cubes.wanted[s]:
        cubes.keys[s, i] = EMPTY


@part
def read_pixel(i, s, cubes):
    """Depth and id of pixel `i` of shooter `s` from its key."""
    if not cubes.wanted[s]:
        return
    key, at = cubes.keys[s, i], s * cubes.keys.shape[1] + i
    there = key != EMPTY
    cubes.depth[at] = depth_in(key) if there else BEHIND
    cubes.ids[at] = np.int32(key & _LOW_HALF) if there else np.int32(NOTHING)


@part
def find_escape(i, s, cubes, shares, escapes):
    """Add the share of the light of shooter `s` through pixel `i`, of `shares` (5 r r,) uint64, to escapes[s, 0] if it meets nothing, and to
    escapes[s, 1] if it meets a back."""
    if cubes.wanted[s] and shares[i] > 0:
        t, o = cubes.ids[s * cubes.keys.shape[1] + i], cubes.centers[s]
        what = fate(t, o[0], o[1], o[2], cubes.planes, cubes.two_sided)
        if what != MEETS:
            add(escapes, (s, what - 1), shares[i])


@part
def fill_entry(j, s, receivers, shots, cubes, rows, c, stack, corners):
    """rows[slots[s], j]: the entry of element `j` in the row of shooter `s`. Scratch: c (SCRATCH,) float32, stack (DEEPEST,) int32, corners (4, 3)
    float64."""
    if not cubes.wanted[s]:
        return
    node, center, numbers = shots.node[s], cubes.centers[s], receivers.numbers
    half = np.uint16(0)
    if not all_averted(receivers.bounds[j // BLOCK], center, cubes.frames[s]):
        for k in range(9):
            c[k * ELEMENTS] = numbers[k, j]
        aim(1, center, cubes.frames[s], shots.place[node], cubes.resolution, cubes.near, c)
        if float_bits(c[IN_FRONT]) != 0:
            at = np.uint64(s * cubes.keys.shape[1]) + np.uint64(float_bits(c[CORNER]))
            tree, seen = (shots.span, shots.child, shots.place), (cubes.depth, cubes.ids, cubes.planes)
            half = share_of(_FIRST, j, at, node, cubes.resolution, center, cubes.frames[s], cubes.near, c, tree, shots.source, seen, receivers.masked,
                            receivers.scene, receivers.rays, receivers.always, numbers, stack, corners)  # fmt: skip
    rows[shots.slots[s], j] = half


@part
def sum_block(b, s, numbers, wanted, slots, rows, sums):
    """sums[s, b] float64: over block `b` of the row of shooter `s`, of area times entry, in the order of the elements; if it is `wanted`."""
    if not wanted[s]:
        return
    total = 0.0
    for j in range(b * BLOCK, min((b + 1) * BLOCK, numbers.shape[1])):
        total += np.float64(decoded(rows[slots[s], j])) * np.float64(numbers[AREA, j])
    sums[s, b] = total


@part
def receive(i, slots, rows, touched, powers, gained):
    """gained[:, i]: what shooters of radiosity `powers` (s, 3) give to element `i` through their rows, in their order; -1 in `slots` is nobody's."""
    red = green = blue = _F(0.0)
    for s in range(len(slots)):
        if slots[s] >= 0 and touched[slots[s], i // BLOCK]:
            k = decoded(rows[slots[s], i])
            red += k * powers[s, 0]
            green += k * powers[s, 1]
            blue += k * powers[s, 2]
    gained[0, i], gained[1, i], gained[2, i] = red, green, blue
