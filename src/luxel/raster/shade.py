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
from luxel.jit import count_bits, lowest_bit
from luxel.raster.bin import Bins
from luxel.raster.channels import CR, EB, EG, ER, FRAGMENTS, FRONT, LE, NX, OA, OB, OG, OR, PITCH, PX, TX
from luxel.raster.cover import cover_tile
from luxel.raster.encode import encode, pack, srgb_code, unit_code
from luxel.raster.fragments import SIZE, STORED, Drawn, Eye, attributes, set_up, view_vectors
from luxel.raster.geometry import Geometry
from luxel.raster.lanes import LANES, prefetch_to_write
from luxel.raster.lighting import LightTable, light
from luxel.raster.materials import MaterialTable
from luxel.raster.plain import fill_normals, is_plain, shade_plainly
from luxel.raster.rows import copy
from luxel.raster.runs import SETUPS, Cursor, Samples, append, gather, mean_places, scratch
from luxel.raster.setup import SIZE as COVER_SIZE
from luxel.raster.surface import surface

_F = np.float32
_LINE = 16  # pixels of a cache line

_ER, _EG, _EB, _LE, _OR, _OG, _OB, _OA = (np.uint64(row) for row in (ER, EG, EB, LE, OR, OG, OB, OA))


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


class Tiles(NamedTuple):
    """Tiles `first` .. `last` - 1 of a window.

    Attributes:
        across: Tiles in a row of the window.
        side: Of a tile, in pixels.
        width, height: Of the window.
        left, top: Where the window lies in the target.
    """

    first: int
    last: int
    across: int
    side: int
    width: int
    height: int
    left: int
    top: int


class Look(NamedTuple):
    """How fragments get their colours.

    Attributes:
        features: The rows of a batch to fill: NEEDS_* of `materials`, and NEEDS_POSITION.
        exposure: float32, factor of the light.
        background: (4,) float32, linear and premultiplied.
    """

    materials: MaterialTable
    lights: LightTable
    eye: Eye
    features: int
    exposure: np.float32
    background: Array


@jit.part
def write_opaque(g, r, shared, batch, tile, exposure, background, codes, color, top, left):
    """Write opaque fragments straight to the picture, over the background where they have not all samples of their pixel; `codes`
    (FRAGMENTS + LANES,) uint32: the fragments encoded, and then scratch."""
    log2, run, last = lowest_bit(np.uint64(tile)), np.uint64(0), np.uint64(batch.whole_runs)
    while run < last:
        first, pixel = np.int64(r.head[run]), np.int64(r.pixel[run])
        run += np.uint64(1)
        following = pixel + np.int64(r.head[run]) - first
        while run < last and np.int64(r.pixel[run]) == following and following & (tile - 1) != 0:  # the next goes on in this row
            run += np.uint64(1)
            following = pixel + np.int64(r.head[run]) - first
        copy(color[np.uint64(top + (pixel >> log2))], left + (pixel & (tile - 1)), codes, first, following - pixel)
    if batch.edges > 0:
        sum_edges(g, shared, batch)
        lay_over(g, batch.edges, exposure, background, codes)
        for k in range(np.uint64(0), np.uint64(batch.edges)):
            pixel = np.int64(shared.edge[k])
            color[np.uint64(top + (pixel >> log2)), np.uint64(left + (pixel & (tile - 1)))] = codes[k]


@jit.part
def sum_edges(g, shared, batch):
    """Sum the fragments of pixels that triangles share, by their shares, in place of light's scratch."""
    for k in range(np.uint64(0), np.uint64(batch.edges)):
        red, green, blue, alpha = _F(0.0), _F(0.0), _F(0.0), _F(0.0)
        for j in range(np.uint64(shared.first[k]), np.uint64(shared.first[k + np.uint64(1)])):
            share, i = shared.share[j], np.uint64(batch.whole_fragments) + j
            red = g[_OR + i] * share + red
            green = g[_OG + i] * share + green
            blue = g[_OB + i] * share + blue
            alpha = share + alpha
        g[_ER + k], g[_EG + k], g[_EB + k], g[_LE + k] = red, green, blue, alpha


@jit.part
def lay_over(g, n, exposure, background, codes):
    """Encode `n` pixels, premultiplied in ER EG EB and LE (alpha), over the background."""
    br, bg, bb, ba = background[0], background[1], background[2], background[3]
    for k in range(np.uint64(0), np.uint64(n)):
        alpha = g[_LE + k]
        under = _F(1.0) - alpha
        alpha = alpha + under * ba
        inverse = _F(1.0) / max(alpha, _F(1e-30))
        red = srgb_code((g[_ER + k] * exposure + under * br) * inverse)
        green = srgb_code((g[_EG + k] * exposure + under * bg) * inverse)
        blue = srgb_code((g[_EB + k] * exposure + under * bb) * inverse)
        codes[k] = pack(red, green, blue, unit_code(alpha))


@jit.part
def add_to_pixels(g, r, runs, samples, pixels, sums):
    """Add the fragments to `sums` (4 * pixels,), each by its share of the pixel's samples, premultiplied."""
    for run in range(runs):
        share = _F(count_bits(r.mask[run])) * (_F(1.0) / _F(samples))
        first, count, pixel = np.uint64(r.head[run]), np.uint64(r.head[run + 1] - r.head[run]), np.uint64(r.pixel[run])
        for k in range(np.uint64(0), count):
            i, p = first + k, pixel + k
            alpha = g[_OA + i] * share
            sums[p] += g[_OR + i] * alpha
            sums[np.uint64(pixels) + p] += g[_OG + i] * alpha
            sums[np.uint64(2 * pixels) + p] += g[_OB + i] * alpha
            sums[np.uint64(3 * pixels) + p] += alpha


@jit.inlined
def lay_over_sample(g, i, colors, plane, p):
    """Composite fragment `i` over the sample whose premultiplied colour is at `p`; the channels lie `plane` apart."""
    alpha = g[_OA + i]
    under = _F(1.0) - alpha
    colors[p] = g[_OR + i] * alpha + colors[p] * under
    colors[plane + p] = g[_OG + i] * alpha + colors[plane + p] * under
    colors[plane + plane + p] = g[_OB + i] * alpha + colors[plane + plane + p] * under
    colors[plane + plane + plane + p] = alpha + colors[plane + plane + plane + p] * under


@jit.part
def lay_over_samples(g, r, runs, samples, pixels, colors):
    """Composite the fragments over what their samples hold, premultiplied; `colors` (4 * samples * pixels,)."""
    plane = np.uint64(samples * pixels)
    for run in range(runs):
        first, count, rest = np.uint64(r.head[run]), np.uint64(r.head[run + 1] - r.head[run]), r.mask[run]
        while rest != np.uint64(0):
            start = np.uint64(lowest_bit(rest) * pixels + r.pixel[run])
            rest &= rest - np.uint64(1)
            for k in range(np.uint64(0), count):
                lay_over_sample(g, first + k, colors, plane, start + k)


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
            row[np.uint64(left + x)] = pack(red, green, blue, unit_code(alpha))


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


@jit.part
def background_code(background):
    """A pixel of nothing but the background."""
    alpha = background[3]
    inverse = _F(1.0) / max(alpha, _F(1e-30))
    red, green, blue = srgb_code(background[0] * inverse), srgb_code(background[1] * inverse), srgb_code(background[2] * inverse)
    return pack(red, green, blue, unit_code(alpha))


@jit.part
def clear_tile(color, top, left, wide, high, code):
    """Write `code` to the pixels of a tile."""
    for y in range(np.uint64(top), np.uint64(top + high)):
        row = color[y]
        for x in range(np.uint64(left), np.uint64(left + wide)):
            row[x] = code


@jit.part
def ask_for(color, first, wide, high):
    """Ask for the pixels of a tile, from element `first` of the picture on, ahead of writing them."""
    for y in range(high):
        for x in range(0, wide, _LINE):
            prefetch_to_write(color, first + y * color.shape[1] + x)


class Ends(NamedTuple):
    """Counters (1,) int64 each: threads that have come; tiles taken from the front and from the back."""

    threads: Array
    front: Array
    back: Array


@jit.inlined
def next_tile(queue, ends, from_front, first, last):
    """The next tile for a thread, of first .. last - 1; `last` if there is none left.

    Half of the threads begin at one end and half at the other, and they meet in the middle: so the tiles of a thread are neighbours, which share
    triangles, and in the next frame the same memory is written by the same core, whose cache has it.
    """
    if first + jit.take(queue) >= last:
        return last
    return first + jit.take(ends.front) if from_front else last - 1 - jit.take(ends.back)


@jit.parallel_kernel
def _shade(queue, ends, tiles, occupied, all_ids, bins, all_samples, mean, all_drawn, look, rich, footprint, target, direct, plain):
    ids, samples_at, drawn, target = jit.borrow(all_ids), jit.borrow(all_samples), jit.borrow(all_drawn), jit.borrow(target)
    start, bin_ids = jit.borrow(bins)
    materials, lights, eye, features, exposure, background = jit.borrow(look)
    geometry, (pattern, every_sample) = drawn.geometry, samples_at
    first_tile, last_tile, across, tile, width, height, left, top = tiles
    samples, pixels, cover = len(pattern), tile * tile, len(start) > 0
    own_visible = samples * pixels + LANES if cover else 0
    own_ids, own_depth, own_c = np.empty(own_visible, np.int32), np.empty(own_visible, np.float32), np.zeros(COVER_SIZE, np.int32)
    own_g, own_sums, own_codes = np.empty(SIZE, np.float32), np.zeros(4 * pixels, np.float32), np.empty(FRAGMENTS + LANES, np.uint32)
    own_g[TX : TX + 4 * PITCH] = _F(0.0)  # where meshes have no tangents
    own_runs, own_shared, own_setups = scratch(mean, STORED)
    own_material = np.full(FRAGMENTS, geometry.part_material[0] if len(geometry.part_material) > 0 else 0, np.int32)
    g, sums, codes, r, setups = jit.borrow(own_g), jit.borrow(own_sums), jit.borrow(own_codes), jit.borrow(own_runs), jit.borrow(own_setups)
    here, depth, c = jit.borrow(own_ids), jit.borrow(own_depth), jit.borrow(own_c)
    shared, material, parts, tangents = jit.borrow(own_shared), jit.borrow(own_material), len(geometry.part_material), len(geometry.tangents) > 0
    planes, nothing = samples if every_sample else 1, background_code(background)
    to_samples = len(target.samples) > 0
    from_front = jit.take(ends.threads) % 2 == 0
    number, covered = next_tile(queue, ends, from_front, first_tile, last_tile), not cover
    while number < last_tile:
        slot = number - first_tile
        px, py = (number % across) * tile, (number // across) * tile
        wide, high = min(tile, width - px), min(tile, height - py)
        empty = occupied[number] == 0
        if covered or empty:
            seen = here if cover else ids[slot]
            if direct:
                clear_tile(target.color, top + py, left + px, wide, high, nothing)
            elif empty:
                for plane in range(4):
                    sums[plane * pixels : plane * pixels + wide] = _F(0.0)
            else:
                sums[:] = _F(0.0)
            at = Cursor(0, planes if empty else 0, 0)
            while at.plane < planes:
                known = at.setups if at.setups + FRAGMENTS <= SETUPS else 0
                batch, at = gather(r, shared, setups, Cursor(known, at.plane, at.pixel), seen, samples_at, tile, wide, high, geometry.triangles)
                n, runs = batch.fragments, batch.runs
                set_up(g, known, at.setups, setups, px, py, tile, drawn, features, rich)
                if plain is not None:
                    fill_normals(g, r, shared, batch, material, setups, parts)
                    shade_plainly(g, 0, batch.whole_fragments, material, parts, materials, lights, exposure, codes)
                    shade_plainly(g, batch.whole_fragments, n, material, parts, materials, lights, exposure, None)
                    write_opaque(g, r, shared, batch, tile, exposure, background, codes, target.color, top + py, left + px)
                else:
                    append(r, shared, batch)
                    attributes(g, r, runs, n, material, setups, parts, tangents, features, footprint, eye, rich)
                    surface(g, material, n, materials, rich)
                    light(g, n, lights, rich)
                    if to_samples:
                        lay_over_samples(g, r, runs, samples, pixels, target.samples[slot])
                    elif direct:
                        encode(g, n, exposure, codes)
                        write_opaque(g, r, shared, batch, tile, exposure, background, codes, target.color, top + py, left + px)
                    else:
                        add_to_pixels(g, r, runs, samples, pixels, sums)
            if plain is None and not to_samples and not direct:
                write_tile(sums, empty, tile, left + px, top + py, wide, high, exposure, background, target.color, target.linear)
            number, covered = next_tile(queue, ends, from_front, first_tile, last_tile), not cover
        else:  # down here, so that it is compiled last, when another process has (see `warm`)
            if direct:
                ask_for(target.color, (top + py) * target.color.shape[1] + left + px, wide, high)
            cover_tile(number, start, bin_ids, across, tile, width, height, geometry.triangles, drawn.screen, drawn.clipped.screen, pattern, depth,
                       here, c, None)  # fmt: skip
            covered = True
    # The scratch must live until here: borrowing does not keep it.
    own_g[0] = len(own_sums) + len(own_runs.head) + len(own_setups.table) + len(own_codes) + len(own_material) + len(own_ids) + len(own_depth)
    own_shared.edge[0] = 0
    own_c[0] = 0


_NO_BINS = np.zeros(0, np.int32), np.zeros(0, np.int32)


def shade(tiles: Tiles, occupied: Array, ids: Array, samples: Samples, drawn: Drawn, look: Look, target: Target, threads: int,
          bins: Bins | None = None) -> None:  # fmt: skip
    """Shade `tiles`.

    Args:
        occupied: (tiles,) uint8 of the whole window, 0 where no triangle may be and ids are not to be read.
        ids: (tiles, ...) int32 of these tiles, from `cover` or `layer`; not read if there are `bins`.
        target: What is written.
        bins: If given, each tile is covered right before it is shaded, and what is visible never leaves the core's cache.
    """
    lists = _NO_BINS if bins is None else (bins.start, bins.triangles)
    footprint = _F(1 / math.sqrt(len(samples.pattern)) if samples.every else 1)
    rich = True if look.materials.rich else None
    direct = not ((samples.every and len(samples.pattern) > 1) or target.samples.size or target.linear.size)  # all is opaque: no sums are needed
    plain = True if direct and is_plain(drawn.geometry, look.materials, look.lights, look.features) else None
    ends = Ends(*(np.zeros(1, np.int64) for _ in Ends._fields))
    jit.run(_shade, min(threads, tiles.last - tiles.first), ends, tiles, occupied, ids, lists, samples, mean_places(samples.pattern), drawn, look,
            rich, footprint, target, direct, plain)  # fmt: skip


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


def vertex_material(geometry: Geometry) -> Array:
    """(n,) int32: the row of the material table of each vertex; 0 for those that no triangle has."""
    material = np.zeros(len(geometry.positions), np.int32)
    for i, row in enumerate(geometry.part_material):
        material[geometry.triangles[geometry.part_start[i] : geometry.part_start[i + 1]]] = row
    return material


def light_vertices(geometry: Geometry, chosen: Array, materials: MaterialTable, lights: LightTable, eye: Eye, threads: int) -> Array:
    """Vertex colours for Gouraud shading.

    Args:
        chosen: (materials,) bool: the rows of `materials` that are Gouraud; other vertices keep their colour.
        materials: From `pack_materials` with vertices=True.

    Returns:
        (n, 4) float32.
    """
    count, material = len(geometry.positions), vertex_material(geometry)
    lit = np.empty((count, 4), np.float32)
    jit.run(_light_vertices, min(threads, 1 + count // FRAGMENTS), geometry.normals, geometry.positions, geometry.colors, material, materials,
            lights, eye, lit)  # fmt: skip
    rest = ~chosen[material]
    if rest.any():
        lit[rest] = geometry.colors[rest] if len(geometry.colors) else 1.0
    return lit
