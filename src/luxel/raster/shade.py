"""Shade: light at what is visible, and into the picture.

Batches of fragments (see `fragments`) pass through `surface` and `light`, and their colours go straight to the picture where a pixel has
one opaque fragment, are summed by their share of its samples (the box filter), or are laid over what the samples hold, for `resolve`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.bin import Bins, Clipped
from luxel.raster.channels import CR, FRAGMENTS, FRONT, NX, OA, OB, OG, OR, PITCH, PX
from luxel.raster.encode import encode, srgb_code, unit_code
from luxel.raster.fragments import SIZE, Eye, Fragments, attributes, gather_pixels, gather_samples, view_vectors
from luxel.raster.geometry import Geometry
from luxel.raster.lighting import LightTable, light
from luxel.raster.materials import MaterialTable
from luxel.raster.surface import surface

_F = np.float32
_GREEN, _BLUE, _ALPHA = np.int32(8), np.int32(16), np.int32(24)


class Target(NamedTuple):
    """Where shaded pixels go; arrays that are not wanted have no rows.

    Attributes:
        color: (h, w) uint32, sRGB and straight alpha, bytes R G B A.
        linear: (h, w, 4) float32, premultiplied.
        samples: (tiles, 4 * s * tile * tile) float32, premultiplied colour of every sample, planar; when it has rows, pixels are not written.
    """

    color: Array
    linear: Array
    samples: Array


@jit.part
def write_opaque(g, pixel, n, tile, exposure, codes, color, top, left):
    """Write the fragments, one a pixel and opaque, straight to the picture; `codes` (FRAGMENTS,) uint32 is scratch."""
    encode(g, n, exposure, codes)
    log2 = 0
    while tile >> (log2 + 1):
        log2 += 1
    for i in range(np.uint64(0), np.uint64(n)):
        y = np.int64(pixel[i]) >> log2
        color[np.uint64(top + y), np.uint64(left + (np.int64(pixel[i]) & (tile - 1)))] = codes[i]


@jit.part
def set_pixels(g, pixel, n, pixels, sums):
    """Put the fragments, one a pixel, into `sums` (4 * pixels,), premultiplied."""
    for i in range(n):
        p, alpha = pixel[i], g[OA + i]
        sums[p], sums[pixels + p] = g[OR + i] * alpha, g[OG + i] * alpha
        sums[2 * pixels + p], sums[3 * pixels + p] = g[OB + i] * alpha, alpha


@jit.part
def add_to_pixels(g, f, n, samples, pixels, sums):
    """Add the fragments to `sums` (4 * pixels,), each by its share of the pixel's samples, premultiplied."""
    pixel, mask = f.pixel, f.mask
    everything = ~np.uint64(0) >> np.uint64(64 - samples)
    for i in range(n):
        share, rest = 0, mask[i]
        if rest == everything:
            share = samples
        else:
            while rest != np.uint64(0):
                rest &= rest - np.uint64(1)
                share += 1
        p, alpha = pixel[i], g[OA + i] * (_F(share) / _F(samples))
        sums[p] += g[OR + i] * alpha
        sums[pixels + p] += g[OG + i] * alpha
        sums[2 * pixels + p] += g[OB + i] * alpha
        sums[3 * pixels + p] += alpha


@jit.part
def lay_over_samples(g, f, n, samples, pixels, colors):
    """Composite the fragments over what their samples hold, premultiplied; `colors` (4 * samples * pixels,)."""
    plane = samples * pixels
    for i in range(n):
        alpha = g[OA + i]
        under = _F(1.0) - alpha
        for s in range(samples):
            if f.mask[i] >> np.uint64(s) & np.uint64(1) != np.uint64(0):
                p = s * pixels + f.pixel[i]
                colors[p] = g[OR + i] * alpha + colors[p] * under
                colors[plane + p] = g[OG + i] * alpha + colors[plane + p] * under
                colors[2 * plane + p] = g[OB + i] * alpha + colors[2 * plane + p] * under
                colors[3 * plane + p] = alpha + colors[3 * plane + p] * under


@jit.part
def write_row(sums, first, plane, y, left, count, exposure, background, color, linear):
    """Lay `count` summed, premultiplied pixels over the background and write them from pixel (left, y) on, to the outputs that are wanted."""
    br, bg, bb, ba = background[0], background[1], background[2], background[3]
    if len(linear) > 0:
        for x in range(count):
            p = first + x
            under = _F(1.0) - sums[3 * plane + p]
            linear[y, left + x, 0] = sums[p] * exposure + under * br
            linear[y, left + x, 1] = sums[plane + p] * exposure + under * bg
            linear[y, left + x, 2] = sums[2 * plane + p] * exposure + under * bb
            linear[y, left + x, 3] = sums[3 * plane + p] + under * ba
    if len(color) > 0:
        row = color[y]
        for x in range(count):
            p = np.uint64(first + x)
            alpha = sums[np.uint64(3 * plane) + p]
            under = _F(1.0) - alpha
            alpha = alpha + under * ba
            inverse = _F(1.0) / max(alpha, _F(1e-30))
            red = srgb_code((sums[p] * exposure + under * br) * inverse)
            green = srgb_code((sums[np.uint64(plane) + p] * exposure + under * bg) * inverse)
            blue = srgb_code((sums[np.uint64(2 * plane) + p] * exposure + under * bb) * inverse)
            row[np.uint64(left + x)] = np.uint32(
                np.int32(red | np.int32(green << _GREEN)) | np.int32(np.int32(blue << _BLUE) | np.int32(unit_code(alpha) << _ALPHA))
            )


@jit.part
def write_tile(sums, empty, tile, px, py, wide, high, exposure, background, color, linear):
    """Write a tile's summed pixels; all pixels of an empty one are the same."""
    for y in range(1 if empty else high):
        write_row(sums, y * tile, tile * tile, py + y, px, wide, exposure, background, color, linear)
    if empty and len(color) > 0:
        color[py + 1 : py + high, px : px + wide] = color[py, px]
    if empty and len(linear) > 0:
        for k in range(4):
            linear[py + 1 : py + high, px : px + wide, k] = linear[py, px, k]


@jit.parallel_kernel
def _shade(queue, first_tile, last_tile, across, tile, width, height, occupied, all_ids, pattern, every_sample, geometry, screen, screen_f,
           clipped, clipped_f, materials, lights, eye, features, rich, footprint, exposure, background, left, top, target):  # fmt: skip
    geometry, clipped, materials, lights = jit.borrow(geometry), jit.borrow(clipped), jit.borrow(materials), jit.borrow(lights)
    screen, screen_f, clipped_f, pattern = jit.borrow(screen), jit.borrow(screen_f), jit.borrow(clipped_f), jit.borrow(pattern)
    ids, eye, background, target = jit.borrow(all_ids), jit.borrow(eye), jit.borrow(background), jit.borrow(target)
    samples, pixels = len(pattern), tile * tile
    own_g, own_sums = np.zeros(SIZE, np.float32), np.zeros(4 * pixels, np.float32)
    own_f = Fragments(
        np.zeros(FRAGMENTS + 8, np.int32), np.zeros(FRAGMENTS + 8, np.int32), np.zeros(FRAGMENTS + 8, np.int32), np.ones(FRAGMENTS, np.uint64),
        np.zeros(FRAGMENTS + 1, np.int32), np.zeros((FRAGMENTS, 4), np.int32),
    )
    g, sums, f = jit.borrow(own_g), jit.borrow(own_sums), jit.borrow(own_f)
    own_codes = np.zeros(FRAGMENTS, np.uint32)
    codes = jit.borrow(own_codes)
    to_samples = len(target.samples) > 0
    direct = samples == 1 and not to_samples and len(target.linear) == 0  # nothing is blended: no sums are needed
    number = first_tile + jit.take(queue)
    while number < last_tile:
        slot = number - first_tile
        px, py = (number % across) * tile, (number // across) * tile
        wide, high = min(tile, width - px), min(tile, height - py)
        empty = occupied[number] == 0
        if empty or direct:
            for plane in range(4):
                sums[plane * pixels : plane * pixels + wide] = _F(0.0)
        else:
            sums[:] = _F(0.0)
        if direct:
            write_tile(sums, True, tile, left + px, top + py, wide, high, exposure, background, target.color, target.linear)
        cursor = tile * high if empty else 0
        while cursor < tile * high:
            if samples == 1:
                n, runs, cursor = gather_pixels(g, f, cursor, ids[slot], tile, wide, high)
            else:
                n, runs, cursor = gather_samples(g, f, cursor, ids[slot], pattern, every_sample, tile, wide, high)
            attributes(g, f, n, runs, px, py, tile, geometry, screen, screen_f, clipped, clipped_f, features, footprint, eye, rich)
            surface(g, f.material, n, materials, rich)
            light(g, n, lights, rich)
            if to_samples:
                lay_over_samples(g, f, n, samples, pixels, target.samples[slot])
            elif direct:
                write_opaque(g, f.pixel, n, tile, exposure, codes, target.color, top + py, left + px)
            elif samples == 1:
                set_pixels(g, f.pixel, n, pixels, sums)
            else:
                add_to_pixels(g, f, n, samples, pixels, sums)
        if not to_samples and not direct:
            write_tile(sums, empty, tile, left + px, top + py, wide, high, exposure, background, target.color, target.linear)
        number = first_tile + jit.take(queue)
    own_g[0] = own_sums[0] + own_f.triangle[0] + own_codes[0]  # the scratch must live until here: borrowing does not keep it


def shade(bins: Bins, occupied: Array, first_tile: int, last_tile: int, width: int, height: int, ids: Array, pattern: Array,
          every_sample: bool, geometry: Geometry, screen: Array, clipped: Clipped, materials: MaterialTable, lights: LightTable, eye: Eye,
          features: int, exposure: float, background: Array, left: int, top: int, target: Target, threads: int) -> None:  # fmt: skip
    """Shade tiles first_tile .. last_tile - 1.

    Args:
        bins: Their size and number across.
        occupied: (tiles,) uint8 of the whole window, 0 where no triangle may be and ids are not to be read.
        ids: (tiles, ...) int32, from `cover` or `layer`.
        every_sample: Supersampling: every sample is shaded, as if it were a pixel of a finer picture.
        features: The rows of a batch to fill: NEEDS_* of `materials`, and NEEDS_POSITION.
        exposure: Factor of the light.
        background: (4,) float32, linear and premultiplied.
        left, top: Where the window lies in the target.
        target: What is written.
    """
    footprint = _F(1 / math.sqrt(len(pattern)) if every_sample else 1)
    jit.run(
        _shade, min(threads, last_tile - first_tile), first_tile, last_tile, bins.across, bins.tile, width, height, occupied, ids, pattern,
        every_sample, geometry, screen, screen.view(np.float32), clipped, clipped.screen.view(np.float32), materials, lights, eye, features,
        True if materials.rich else None, footprint, _F(exposure), background, left, top, target,
    )  # fmt: skip


@jit.parallel_kernel
def _light_vertices(queue, normals, positions, colors, vertex_material, materials, lights, eye, lit):
    positions, normals, colors, lit = jit.borrow(positions), jit.borrow(normals), jit.borrow(colors), jit.borrow(lit)
    materials, lights, eye, vertex_material = jit.borrow(materials), jit.borrow(lights), jit.borrow(eye), jit.borrow(vertex_material)
    own_g = np.zeros(SIZE, np.float32)
    g = jit.borrow(own_g)
    block = jit.take(queue)
    while block * FRAGMENTS < len(positions):
        first = block * FRAGMENTS
        n = min(FRAGMENTS, len(positions) - first)
        for i in range(n):
            g[FRONT + i] = _F(1.0)
            for k in range(3):
                g[NX + k * PITCH + i] = normals[first + i, k]
                g[PX + k * PITCH + i] = positions[first + i, k]
            for k in range(4):
                g[CR + k * PITCH + i] = colors[first + i, k] if len(colors) > 0 else _F(1.0)
        view_vectors(g, n, eye)
        surface(g, vertex_material[first:], n, materials, None)
        light(g, n, lights, None)
        for i in range(n):
            lit[first + i, 0], lit[first + i, 1], lit[first + i, 2] = g[OR + i], g[OG + i], g[OB + i]
            lit[first + i, 3] = g[OA + i]
        block = jit.take(queue)
    own_g[0] = 0  # the scratch must live until here: borrowing does not keep it


def light_vertices(geometry: Geometry, chosen: Array, materials: MaterialTable, lights: LightTable, eye: Eye, threads: int) -> Array:
    """Vertex colours for Gouraud shading.

    Args:
        chosen: (materials,) bool: the rows of `materials` that are Gouraud; other vertices keep their colour.
        materials: From `pack_materials` with vertices=True.

    Returns:
        (n, 4) float32.
    """
    count = len(geometry.positions)
    material = np.zeros(count, np.int32)
    for i, row in enumerate(geometry.part_material):
        material[geometry.triangles[geometry.part_start[i] : geometry.part_start[i + 1]]] = row
    lit = np.empty((count, 4), np.float32)
    jit.run(_light_vertices, min(threads, 1 + count // FRAGMENTS), geometry.normals, geometry.positions, geometry.colors, material, materials,
            lights, eye, lit)  # fmt: skip
    rest = ~chosen[material]
    if rest.any():
        lit[rest] = geometry.colors[rest] if len(geometry.colors) else 1.0
    return lit
