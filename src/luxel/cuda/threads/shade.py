"""Shade: a pixel's fragments, one after the other, each a batch of one. What is a fragment, and where it lies, is as in `luxel.raster.runs`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.cuda.threads.draw import EMPTY, depth_in, drawn_at
from luxel.cuda.threads.views import FAR, NEAR, PARALLEL, eye_of, lights_of, seen_by
from luxel.jit import count_bits, lowest_bit, part
from luxel.raster.channels import CR, FRONT, NX, OA, OB, OG, OR, PITCH, PX, TX
from luxel.raster.constants import NOTHING
from luxel.raster.fragments import SIZE, STORED, attributes, set_up, view_vectors
from luxel.raster.lighting import light
from luxel.raster.outputs import Outputs, write_pixel
from luxel.raster.resolve import filtered
from luxel.raster.runs import Runs, Setups, mean_place
from luxel.raster.shade import lay_over_sample, write_row
from luxel.raster.surface import surface

_F = np.float32
MOST = 64
"""Samples of a pixel."""

__all__ = ["MOST", "SIZE", "STORED", "Own", "Picture", "Shading", "light_vertex", "resolve_pixel", "shade_pixel", "write_outputs_of"]


class Own(NamedTuple):
    """A thread's own memory.

    Attributes:
        g: (SIZE,) float32, a batch of one fragment.
        stored: (1, STORED) float32, its triangle set up.
        sources: (1, 4) int32.
        numbers: (4,) int32: drawn triangle; material; 0; number of fragments.
        place: (2,) float32: x and y in pixels from the tile's corner.
        ids: (MOST,) int32: drawn triangles at the pixel's samples.
        sums: (4,) float32.
    """

    g: Array
    stored: Array
    sources: Array
    numbers: Array
    place: Array
    ids: Array
    sums: Array


class Shading(NamedTuple):
    """How fragments get their colours.

    Attributes:
        features: As in `luxel.raster.shade.Look`.
        every: Samples are shaded one by one.
        exposure, footprint: float32.
        background: (4,) float32, premultiplied.
        pattern: (s, 2) int32; mean: (256, 2) float32, see `Setups.mean`.
        tile: Side of the tiles that attributes are counted from, in pixels.
    """

    features: int
    every: bool
    exposure: np.float32
    footprint: np.float32
    background: Array
    pattern: Array
    mean: Array
    tile: int


class Picture(NamedTuple):
    """What is written; what is not wanted has no rows in any view.

    Attributes:
        color: (v, h, w) uint32.
        linear: (v, h, w, 4) float32.
        samples: (v, tiles, 4 * s * tile * tile) float32, planar: premultiplied colours of samples; where there are any, pixels are not written.
        left, top: Where the window's pixel (0, 0) lies in `color` and `linear`.
        first_x, first_y, last_x, last_y: The pixels of the window that are written.
    """

    color: Array
    linear: Array
    samples: Array
    left: int
    top: int
    first_x: int
    first_y: int
    last_x: int
    last_y: int


@part
def find_ids(v, x, y, keys, nothing, drawn, pattern, own):
    """The drawn triangles at the samples of pixel (x, y), `NOTHING` where the key is `nothing`. Returns whether all are the same."""
    same = True
    for s in range(len(pattern)):
        key = keys[v, s, y, x]
        t = np.int64(NOTHING)
        if key != nothing:
            t = drawn_at(key, (x << 8) + np.int64(pattern[s, 0]), (y << 8) + np.int64(pattern[s, 1]), drawn)
        own.ids[s] = t
        same = same and own.ids[s] == own.ids[0]
    return same


@part
def shade_fragment(v, t, x, y, px, py, everything, drawn, views, materials, shading, own, rich):
    """Outgoing radiance and alpha of drawn triangle `t` at (x, y), in pixels from the corner (px, py) of the tile."""
    parts = len(drawn.geometry.part_material)
    own.numbers[0], own.numbers[2] = t, 0
    own.numbers[1] = drawn.geometry.part_material[0]
    own.place[0], own.place[1] = x, y
    if len(drawn.geometry.tangents) == 0:
        for k in range(4):
            own.g[TX + k * PITCH] = _F(0.0)
    triangle, material, zero, head = own.numbers[0:1], own.numbers[1:2], own.numbers[2:3], own.numbers[2:4]
    setups = Setups(triangle, material, own.stored, triangle, own.sources, triangle, shading.mean)
    set_up(own.g, 0, 1, setups, px, py, shading.tile, drawn, shading.features, rich)
    runs = Runs(head, zero, zero, zero, own.place[0:1], own.place[1:2])
    eye = eye_of(v, views)
    has_tangents = len(drawn.geometry.tangents) > 0
    attributes(own.g, runs, 1, 1, material, setups, parts, has_tangents, shading.features, shading.footprint, eye, rich)
    surface(own.g, material, 1, materials, rich)
    light(own.g, 1, lights_of(v, views), rich)


@part
def fragment_samples(s, samples, every, same, own):
    """The samples, as bits, of the fragment that sample `s` belongs to, if it is its first."""
    bits = np.uint64(1) << np.uint64(s)
    if same and not every:
        bits = ~np.uint64(0) >> np.uint64(64 - samples)
    elif not every:
        for other in range(s + 1, samples):
            if own.ids[other] == own.ids[s]:
                bits |= np.uint64(1) << np.uint64(other)
    return bits


@part
def fragment_place(s, bits, shading):
    """Where in its pixel the fragment with the samples `bits` lies, in pixels."""
    if shading.every:
        return _F(shading.pattern[s, 0]) * _F(1 / 256), _F(shading.pattern[s, 1]) * _F(1 / 256)
    if bits == ~np.uint64(0) >> np.uint64(64 - len(shading.pattern)):
        return _F(0.5), _F(0.5)
    return mean_place(bits, shading.mean, shading.pattern)


@part
def shade_pixel(p, v, window, everything, views, materials, shading, keys, nothing,
                picture, own, rich):  # fmt: skip
    """Shade pixel `p` of the window, row by row, in view `v`: into the picture, or over what its samples hold.

    Args:
        keys: (v, s, h, w) uint64.
        nothing: The key of samples where there is nothing to shade.
        rich: As in `luxel.raster.surface.surface`.
    """
    x, y = p % window.width, p // window.width
    to_samples = picture.samples.shape[1] > 0
    if not to_samples and not (picture.first_x <= x < picture.last_x and picture.first_y <= y < picture.last_y):
        return
    drawn, samples, tile = seen_by(v, everything), len(shading.pattern), shading.tile
    across, down, pixels = x // tile, y // tile, tile * tile
    px, py, slot = across * tile, down * tile, down * (-(-window.width // tile)) + across
    same = find_ids(v, x, y, keys, nothing, drawn, shading.pattern, own)
    one, left = _F(1.0) / _F(samples), ~np.uint64(0) >> np.uint64(64 - samples)
    for k in range(4):
        own.sums[k] = _F(0.0)
    while left != np.uint64(0):
        s = lowest_bit(left)
        bits = fragment_samples(s, samples, shading.every, same, own)
        left &= ~bits
        t = np.int64(own.ids[s])
        if t == NOTHING:
            continue
        dx, dy = fragment_place(s, bits, shading)
        shade_fragment(v, t, _F(x - px) + dx, _F(y - py) + dy, px, py, everything, drawn, views, materials, shading, own, rich)
        if to_samples:
            colors = picture.samples[v, slot]
            while bits != np.uint64(0):
                lay_over_sample(own.g, 0, colors, samples * pixels, lowest_bit(bits) * pixels + (y - py) * tile + x - px)
                bits &= bits - np.uint64(1)
        else:
            alpha = own.g[OA] * (_F(count_bits(bits)) * one)
            own.sums[0] += own.g[OR] * alpha
            own.sums[1] += own.g[OG] * alpha
            own.sums[2] += own.g[OB] * alpha
            own.sums[3] += alpha
    if not to_samples:
        x, y = picture.left + x, picture.top + y
        write_row(own.sums, 0, 1, y, x, 1, shading.exposure, shading.background, picture.color[v], picture.linear[v])


@part
def resolve_pixel(p, v, window, samples, tile, taps, weights, exposure, background, picture,
                  sums):  # fmt: skip
    """Filter pixel `p` of those that are written, row by row, from the colours of samples. `sums` (4,) float32 is scratch."""
    wide = picture.last_x - picture.first_x
    x, y = picture.first_x + p % wide, picture.first_y + p // wide
    main = np.int64(0)
    for k in range(len(taps)):
        main += np.int64(taps[k, 3])
    across = -(-window.width // tile)
    red, green, blue, alpha = filtered(
        x, y, window.width, window.height, 0, window.height, across, tile, samples, picture.samples[v], taps, weights, main, _F(1.0) / exposure
    )
    sums[0], sums[1], sums[2], sums[3] = red, green, blue, alpha
    write_row(sums, 0, 1, picture.top + y, picture.left + x, 1, exposure, background, picture.color[v], picture.linear[v])


@part
def write_outputs_of(p, v, window, everything, views, pattern, keys, left, top, outputs, motion_from):
    """Write what is asked for beside colour, from the first sample of pixel `p` of the window; (left, top) is the window's place in the outputs."""
    x, y = p % window.width, p // window.width
    drawn, key, sx, sy = seen_by(v, everything), keys[v, 0, y, x], np.int64(pattern[0, 0]), np.int64(pattern[0, 1])
    out = Outputs(
        outputs.depth[v], outputs.triangle[v], outputs.object[v], outputs.material[v], outputs.normal[v], outputs.position[v],
        outputs.barycentric[v], outputs.texcoord[v], outputs.motion[v],
    )  # fmt: skip
    t = drawn_at(key, (x << 8) + sx, (y << 8) + sy, drawn)
    if key == EMPTY:
        return
    full = np.float64(window.full_width), np.float64(window.full_height)
    near, far, parallel = _F(views.numbers[v, NEAR]), _F(views.numbers[v, FAR]), views.numbers[v, PARALLEL] != 0.0
    write_pixel(t, depth_in(key), x, y, left + x, top + y, drawn.geometry, drawn.screen, drawn.screen_f, drawn.clipped, drawn.clipped_f, sx, sy,
                full, near, far, parallel, motion_from, views.previous[v], out)  # fmt: skip


@part
def light_vertex(i, v, geometry, vertex_material, chosen, views, materials, lit, own):
    """Light vertex `i` for view `v` (Gouraud), as `luxel.raster.shade.light_vertices`; vertices of other materials keep their colour."""
    g, colors, row = own.g, geometry.colors, vertex_material[i]
    for k in range(4):
        g[CR + k * PITCH] = colors[i, k] if len(colors) > 0 else _F(1.0)
    if not chosen[row]:
        for k in range(4):
            lit[v, i, k] = g[CR + k * PITCH]
        return
    g[FRONT] = _F(1.0)
    for k in range(3):
        g[NX + k * PITCH] = geometry.normals[i, k]
        g[PX + k * PITCH] = geometry.positions[i, k]
    view_vectors(g, 1, eye_of(v, views))
    surface(g, vertex_material[i : i + 1], 1, materials, None)
    light(g, 1, lights_of(v, views), None)
    lit[v, i, 0], lit[v, i, 1], lit[v, i, 2], lit[v, i, 3] = g[OR], g[OG], g[OB], g[OA]
