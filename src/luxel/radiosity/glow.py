"""Glow: what a surface emits whose emissive texture changes within a luxel.

A lamp may be a luxel or less, and its texture say that a quarter of it shines. What a luxel emits is the mean over what of its triangles is in it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.appearance import mixed, texture_place
from luxel.radiosity.cuttings import Cuttings, cuttings_of
from luxel.radiosity.texture_space import corners_at, cut_line, place_vertices
from luxel.raster.channels import BATCH, EMR, FRAGMENTS, PITCH, U0, U0X, U0Y, U1, U1X, U1Y
from luxel.raster.fragments import find_part
from luxel.raster.geometry import Geometry
from luxel.raster.materials import ALPHA_MASK, CUTOFF, EMISSIVE_SLOT, NEEDS_COLOR, NEEDS_UV0, NEEDS_UV1, TEXTURE, MaterialTable, pack_materials
from luxel.raster.surface import mask_alpha, surface
from luxel.scene.material import Material, Texture
from luxel.scene.scene import Scene

if TYPE_CHECKING:
    from luxel.radiosity.luxels import Luxels

_F = np.float32
_CORNERS = 8  # of a triangle cut by four lines: at most seven
_MOST_SIDE = 22  # a triangle is looked up at so many squared places: a batch's
_SAMPLES = 1 << 21  # of all cuttings, about
_WIDE = 0.7  # of a parallelogram's sides, of which a triangle is half: what a sample is smoothed over


def glowing_table(scene: Scene) -> MaterialTable | None:
    """What materials emit, and where they are holes; None if none has a texture for what it emits."""
    bare = [_bare(material) for material in scene.materials]
    if not any(material.emissive_texture for material in bare):
        return None
    used = {ref.texture for material in bare for ref in (material.emissive_texture, material.base_color_texture) if ref}
    blank = Texture(np.zeros((1, 1, 4), np.uint8))
    textures = [_smooth(texture) if number in used else blank for number, texture in enumerate(scene.textures)]
    return pack_materials(replace(scene, materials=bare, textures=textures))


def _smooth(texture: Texture) -> Texture:
    """With mipmaps, unless its texels are to be seen."""
    return texture if texture.filter == "nearest" else replace(texture, filter="trilinear")


def _bare(material: Material) -> Material:
    """Only what tells its light."""
    if not any(material.emissive) or material.shading == "unlit":
        return Material()
    bare = Material(emissive=material.emissive, emissive_texture=material.emissive_texture)
    if material.alpha_mode != "MASK":
        return bare
    base = material.base_color, material.base_color_texture
    return replace(bare, base_color=base[0], base_color_texture=base[1], alpha_mode="MASK", alpha_cutoff=material.alpha_cutoff)


def textured(table: MaterialTable, geometry: Geometry) -> Array:
    """(m,) bool: which triangles have an emissive texture."""
    has = table.ints[:, TEXTURE + EMISSIVE_SLOT] >= 0
    return np.repeat(has[geometry.part_material], np.diff(geometry.part_start))


def mean_emission(luxels: Luxels, geometry: Geometry, charts: Array, table: MaterialTable, threads: int) -> Array:
    """(n, 3) float32, W/m2: the luxels' emission, the mean over each where a texture tells it.

    Args:
        geometry: m triangles, with lightmap coordinates.
        charts: (m,) int32, of each triangle.
        table: Of `glowing_table`.
    """
    candidates = np.flatnonzero(textured(table, geometry) & (charts >= 0))
    glowing = np.zeros(int(charts.max(initial=-1)) + 1, np.bool_)
    glowing[charts[candidates]] = True
    chosen = np.flatnonzero(glowing[luxels.chart]).astype(np.int32)
    emission = luxels.emission.copy()
    if len(chosen):
        parts = cuttings_of(luxels, chosen, geometry, charts, candidates, threads)
        emission[chosen] = means(*emission_of(parts, luxels, chosen, geometry, table, threads), parts.luxel, len(chosen))
    return emission


def means(values: Array, weight: Array, group: Array, count: int) -> Array:
    """(count, 3) float32: weighted means of values (p, 3) over groups (p,), 0 where there is no weight."""
    whole = np.bincount(group, weight, count)
    sums = np.stack([np.bincount(group, weight * column, count) for column in values.T], 1)
    return (sums / np.where(whole > 0, whole, 1.0)[:, None]).astype(np.float32)


def emission_of(parts: Cuttings, luxels: Luxels, chosen: Array, geometry: Geometry, table: MaterialTable, threads: int) -> tuple[Array, Array]:
    """(p, 3) float32, W/m2: mean radiant exitance of each cutting of the chosen luxels, and (p,) float64, m2: its area without holes."""
    _, height, width = luxels.shape
    screen = place_vertices(geometry.texcoords1, (width, height), threads)
    side = int(np.clip(math.isqrt(_SAMPLES // max(2 * len(parts.luxel), 1)), 1, _MOST_SIDE))
    emission, solid = np.zeros((len(parts.luxel), 3), np.float32), np.zeros(len(parts.luxel), np.float32)
    texel = luxels.texel[chosen[parts.luxel]]
    jit.run(_emit, threads, parts.triangle, texel, side, screen, geometry, table, True if table.rich else None, emission, solid)
    return emission, parts.area * solid


@jit.part
def _outline(screen, a, b, c, left, top, xs, ys, ox, oy):
    """Barycentric coordinates, of corners 1 and 2, of the corners of what of a triangle is in a texel, into xs and ys; how many there are. All of a
    triangle without an area on the page."""
    ax, ay, bx = np.float64(screen[a, 0]) - left, np.float64(screen[a, 1]) - top, np.float64(screen[b, 0]) - left
    by, cx, cy = np.float64(screen[b, 1]) - top, np.float64(screen[c, 0]) - left, np.float64(screen[c, 1]) - top
    if (bx - ax) * (cy - ay) == (by - ay) * (cx - ax):
        xs[0], ys[0], xs[1], ys[1], xs[2], ys[2] = 0.0, 0.0, 1.0, 0.0, 0.0, 1.0
        return 3
    xs[0], ys[0], xs[1], ys[1], xs[2], ys[2] = ax, ay, bx, by, cx, cy
    n = cut_line(xs, ys, 3, 0, 0.0, 1.0, ox, oy)
    n = cut_line(ox, oy, n, 0, 256.0, -1.0, xs, ys)
    n = cut_line(xs, ys, n, 1, 0.0, 1.0, ox, oy)
    n = cut_line(ox, oy, n, 1, 256.0, -1.0, xs, ys)
    for i in range(n):
        xs[i], ys[i] = corners_at(xs[i], ys[i], ax, ay, bx, by, cx, cy)
    return n


@jit.part
def _look_up(g, i, row, table, geometry, a, b, c, s1, s2, gradient):
    """Where sample `i` of a batch is in the textures; whether there is a surface."""
    flags = table.flags[row]
    if flags & NEEDS_UV0 and len(geometry.texcoords) > 0:
        texture_place(g, i, U0, U0X, U0Y, geometry.texcoords, a, b, c, s1, s2, gradient)
    if flags & NEEDS_UV1:
        texture_place(g, i, U1, U1X, U1Y, geometry.texcoords1, a, b, c, s1, s2, gradient)
    if flags & ALPHA_MASK == 0:
        return True
    alpha = mask_alpha(table, row, g[U0 + i], g[U0 + PITCH + i], g[U1 + i], g[U1 + PITCH + i])
    if flags & NEEDS_COLOR and len(geometry.colors) > 0:
        alpha *= mixed(geometry.colors, 3, a, b, c, s1, s2)
    return alpha >= table.floats[row, CUTOFF]


@jit.parallel_kernel
def _emit(queue, triangle, texel, most, screen, geometry, table, rich, emission, solid):
    """Each cutting is a fan of triangles, and each of these cut to side x side alike, which are looked up in their middles."""
    g, material = np.zeros(BATCH, np.float32), np.zeros(FRAGMENTS + 1, np.int32)
    xs, ys, ox, oy = np.empty(_CORNERS), np.empty(_CORNERS), np.empty(_CORNERS), np.empty(_CORNERS)
    k = jit.take(queue)
    while k < len(triangle):
        t = triangle[k]
        a, b, c = geometry.triangles[t, 0], geometry.triangles[t, 1], geometry.triangles[t, 2]
        row = geometry.part_material[find_part(geometry.part_start, t)]
        side = most if table.ints[row, TEXTURE + EMISSIVE_SLOT] >= 0 else 1
        corners = _outline(screen, a, b, c, texel[k, 2] * 256.0, texel[k, 1] * 256.0, xs, ys, ox, oy)
        whole, solids, red, green, blue = 0.0, 0.0, 0.0, 0.0, 0.0
        for f in range(1, corners - 1):
            u1, u2, v1, v2 = (xs[f] - xs[0]) / side, (ys[f] - ys[0]) / side, (xs[f + 1] - xs[0]) / side, (ys[f + 1] - ys[0]) / side
            around, weight = (_F(_WIDE * u1), _F(_WIDE * u2), _F(_WIDE * v1), _F(_WIDE * v2)), abs(u1 * v2 - u2 * v1)
            n = 0
            for i in range(side):
                for j in range(2 * (side - i) - 1):  # one that stands, one upside down, and so on
                    middle = (1.0 if j % 2 == 0 else 2.0) / 3.0
                    along, down = i + middle, j // 2 + middle
                    s1, s2 = _F(xs[0] + along * u1 + down * v1), _F(ys[0] + along * u2 + down * v2)
                    material[n] = row
                    if _look_up(g, n, row, table, geometry, a, b, c, s1, s2, around):
                        n += 1
            surface(g, material, n, table, rich)
            whole, solids = whole + weight * side * side, solids + weight * n
            for i in range(n):
                red, green, blue = red + weight * g[EMR + i], green + weight * g[EMR + PITCH + i], blue + weight * g[EMR + 2 * PITCH + i]
        if solids > 0.0:
            emission[k, 0], emission[k, 1], emission[k, 2] = math.pi * red / solids, math.pi * green / solids, math.pi * blue / solids
            solid[k] = solids / whole
        k = jit.take(queue)
