"""Layer: coverage of alpha-masked and of blended triangles, sample by sample, on top of what `cover` found.

Masked triangles (glTF's MASK) take part in the nearest-wins decision at the samples where their alpha reaches the cut-off. Blended ones
(BLEND) are peeled back to front: each pass finds, at every sample, the farthest blended triangle that is nearer than the layer before it,
the first layer being the opaque picture. So they composite in exact depth order per sample, by as many passes as there are layers, and of
equally near ones the lower id lies on top. Set-up, spans and depth are `cover`'s.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.memory import reusable
from luxel.raster.bin import Bins, Clipped
from luxel.raster.constants import NOTHING
from luxel.raster.fragments import find_part, planes, source_planes
from luxel.raster.geometry import Geometry
from luxel.raster.materials import MaterialTable
from luxel.raster.setup import (
    AT,
    BATCH,
    DOWN,
    KIND,
    NONE,
    SIZE,
    SPAN_LEFT,
    SPAN_RIGHT,
    T,
    depth_at,
    find_spans,
    load_batch,
    place_batch,
    set_up_batch,
)
from luxel.raster.surface import mask_alpha

_F = np.float32
_ROUNDING = _F(1e-6)  # of filtered and interpolated alpha, which must not open holes in what is wholly there


@jit.part
def opaque_at(t, x, y, geometry, screen, screen_f, clipped, clipped_f, materials, cutoff_column):
    """Whether masked triangle `t` is there at the fixed-point position (x, y): its alpha reaches the cut-off."""
    triangles, m = geometry.triangles, len(geometry.triangles)
    ox, oy = np.float64(x), np.float64(y)
    source = t
    if t < m:
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        p, _, _, _ = planes(
            screen[a, 0] - ox, screen[a, 1] - oy, np.float64(screen_f[a, 3]), screen[b, 0] - ox, screen[b, 1] - oy,
            np.float64(screen_f[b, 3]), screen[c, 0] - ox, screen[c, 1] - oy, np.float64(screen_f[c, 3]), 0.0,
        )  # fmt: skip
    else:
        k = t - m
        source = clipped.source[k]
        a, b, c = triangles[source, 0], triangles[source, 1], triangles[source, 2]
        p, _, _, _ = planes(
            clipped.screen[k, 0, 0] - ox, clipped.screen[k, 0, 1] - oy, np.float64(clipped_f[k, 0, 3]),
            clipped.screen[k, 1, 0] - ox, clipped.screen[k, 1, 1] - oy, np.float64(clipped_f[k, 1, 3]),
            clipped.screen[k, 2, 0] - ox, clipped.screen[k, 2, 1] - oy, np.float64(clipped_f[k, 2, 3]), 0.0,
        )  # fmt: skip
        p = source_planes(p, clipped.corners[k])
    inverse = _F(1.0) / (p[6] + p[7] + p[8])
    b0, b1, b2 = p[6] * inverse, p[7] * inverse, p[8] * inverse
    u0 = v0 = u1 = v1 = _F(0.0)
    uv, uv1, colors = geometry.texcoords, geometry.texcoords1, geometry.colors
    if len(uv) > 0:
        u0, v0 = b0 * uv[a, 0] + b1 * uv[b, 0] + b2 * uv[c, 0], b0 * uv[a, 1] + b1 * uv[b, 1] + b2 * uv[c, 1]
    if len(uv1) > 0:
        u1, v1 = b0 * uv1[a, 0] + b1 * uv1[b, 0] + b2 * uv1[c, 0], b0 * uv1[a, 1] + b1 * uv1[b, 1] + b2 * uv1[c, 1]
    row = geometry.part_material[find_part(geometry.part_start, source)]
    alpha = mask_alpha(materials, row, u0, v0, u1, v1)
    if len(colors) > 0:
        alpha *= b0 * colors[a, 3] + b1 * colors[b, 3] + b2 * colors[c, 3]
    return alpha + _ROUNDING >= materials.floats[row, cutoff_column]


@jit.inlined
def source_of(t, clipped_source, m):
    """The triangle that drawn triangle `t` is, or was cut from."""
    return t if t < m else clipped_source[t - m]


@jit.parallel_kernel
def _layer(queue, first_tile, last_tile, across, tile, width, height, start, bin_ids, geometry, screen, screen_f, clipped, clipped_f,
           materials, cutoff_column, pattern, peel, depths, all_ids, next_depths, next_ids, found):  # fmt: skip
    geometry, clipped, materials = jit.borrow(geometry), jit.borrow(clipped), jit.borrow(materials)
    bin_ids, screen, pattern = jit.borrow(bin_ids), jit.borrow(screen), jit.borrow(pattern)
    own = np.zeros(SIZE, np.int32)
    c = jit.borrow(own)
    sources, m, samples, pixels = clipped.source, len(geometry.triangles), len(pattern), tile * tile
    number = first_tile + jit.take(queue)
    while number < last_tile:
        slot = number - first_tile
        px, py = (number % across) * tile, (number // across) * tile
        wide, high = min(tile, width - px), min(tile, height - py)
        if peel:
            next_ids[slot, :] = NOTHING
            next_depths[slot, :] = _F(np.inf)
        for begin in range(start[number], start[number + 1], BATCH):
            n = min(BATCH, start[number + 1] - begin)
            load_batch(begin, begin + n, px, py, bin_ids, geometry.triangles, screen, clipped.screen, c)
            set_up_batch(n, c)
            for s in range(samples):
                sx, sy = np.int64(pattern[s, 0]), np.int64(pattern[s, 1])
                place_batch(n, sx, sy, tile, wide, high, c)
                for i in range(np.uint64(0), np.uint64(n)):
                    if c[KIND + i] == NONE:
                        continue
                    find_spans(i, c, sx, sy, tile)
                    t, first, left = c[T + i], np.int64(c[AT + i]) // tile, np.int64(c[AT + i]) % tile
                    source = source_of(t, sources, m)
                    for row in range(np.uint64(0), np.uint64(c[DOWN + i] + 1)):
                        y = first + np.int64(row)
                        for x in range(np.int64(c[SPAN_LEFT + row]), np.int64(c[SPAN_RIGHT + row]) + 1):
                            d = depth_at(i, c, x - left, row)
                            k = s * pixels + y * tile + x
                            now, here = source_of(all_ids[slot, k], sources, m), depths[slot, k]
                            if not (d > here or (d == here and source < now)):
                                continue
                            if not peel:
                                at_x, at_y = ((px + x) << 8) + sx, ((py + y) << 8) + sy
                                if opaque_at(t, at_x, at_y, geometry, screen, screen_f, clipped, clipped_f, materials, cutoff_column):
                                    all_ids[slot, k], depths[slot, k] = t, d
                                continue
                            best, far = source_of(next_ids[slot, k], sources, m), next_depths[slot, k]
                            if d < far or (d == far and source > best):
                                next_ids[slot, k], next_depths[slot, k] = t, d
                                found[slot] = 1
        if peel:  # what this pass found is what the next must be nearer than
            for i in range(samples * pixels):
                if next_ids[slot, i] >= 0:
                    all_ids[slot, i], depths[slot, i] = next_ids[slot, i], next_depths[slot, i]
        number = first_tile + jit.take(queue)
    own[0] = 0  # the scratch must live until here: borrowing does not keep it


def layer(bins: Bins, geometry: Geometry, screen: Array, clipped: Clipped, materials: MaterialTable, pattern: Array, width: int, height: int,
          first_tile: int, last_tile: int, ids: Array, depths: Array, threads: int, peeled: Array | None = None) -> bool:  # fmt: skip
    """Draw the masked triangles of `bins`, or peel one layer of blended ones.

    Args:
        ids, depths: (tiles, ...), from `cover` with all tiles cleared; updated. When peeling they keep the nearest layer found so far.
        peeled: (tiles, ...) int32 to peel: gets the ids of the next layer, `NOTHING` where there is none.

    Returns:
        Whether peeling found anything; False for masked triangles.
    """
    from luxel.raster.materials import CUTOFF

    peel = peeled is not None
    nothing = np.empty((0, ids.shape[1]), np.int32)
    found = np.zeros(last_tile - first_tile, np.int32)
    jit.run(
        _layer, min(threads, last_tile - first_tile), first_tile, last_tile, bins.across, bins.tile, width, height, bins.start, bins.triangles,
        geometry, screen, screen.view(np.float32), clipped, clipped.screen.view(np.float32), materials, CUTOFF, pattern, peel, depths, ids,
        reusable(ids.shape if peel else (0, ids.shape[1]), np.float32), peeled if peel else nothing, found,
    )  # fmt: skip
    return bool(found.any())
