"""Glow: what a surface emits whose textures change within a luxel.

A lamp may be a luxel or less, and its texture say that a quarter of it shines, or is there at all. What a luxel emits, and how much of it is there,
are means over what of its triangles is in it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.appearance import appearance
from luxel.radiosity.cuttings import Cuttings, cuttings_of
from luxel.radiosity.texture_space import corners_at, cut_line, place_vertices
from luxel.raster.constants import SUBPIXEL
from luxel.raster.geometry import Geometry
from luxel.raster.materials import ALPHA_MASK, EMISSIVE_SLOT, TEXTURE, MaterialTable, pack_materials
from luxel.scene.material import Material, Texture
from luxel.scene.scene import Scene

if TYPE_CHECKING:
    from luxel.radiosity.luxels import Luxels

_CORNERS, _FAN = 8, 6  # at most: corners of a triangle that is cut by four lines, and triangles of the fan that it is
_MOST_SIDE, _FEW_TEXELS = 128, 22  # a triangle is looked up at so many squared places, at most; so many texels are surely seen
_SAMPLES = 1 << 21  # of all cuttings, about
_AT_ONCE = 1 << 18
_WIDE = 0.7  # of a parallelogram's sides, of which a triangle is half: what a sample is smoothed over


def glowing_table(scene: Scene) -> MaterialTable | None:
    """What materials emit, and where they are holes; None if none has a texture for what it emits, or holes."""
    bare = [_bare(material) for material in scene.materials]
    if not any(material.emissive_texture or material.alpha_mode == "MASK" for material in bare):
        return None
    masks = {material.base_color_texture.texture for material in bare if material.base_color_texture}
    emissive = {material.emissive_texture.texture for material in bare if material.emissive_texture}
    blank = Texture(np.zeros((1, 1, 4), np.uint8))
    kept = {number: scene.textures[number] for number in masks} | {number: _smooth(scene.textures[number]) for number in emissive - masks}
    textures = [kept.get(number, blank) for number in range(len(scene.textures))]
    return pack_materials(replace(scene, materials=bare, textures=textures))


def _smooth(texture: Texture) -> Texture:
    """With mipmaps, unless its texels are to be seen and are so few that none is missed."""
    return texture if texture.filter == "nearest" and max(texture.image.shape[:2]) <= _FEW_TEXELS else replace(texture, filter="trilinear")


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
    """(m,) bool: which triangles glow and have an emissive texture, or holes."""
    has = (table.ints[:, TEXTURE + EMISSIVE_SLOT] >= 0) | (table.flags & ALPHA_MASK != 0)
    return np.repeat(has[geometry.part_material], np.diff(geometry.part_start))


def glow_of(luxels: Luxels, geometry: Geometry, charts: Array, table: MaterialTable, threads: int) -> tuple[Array, Array, Array]:
    """Luxels that textures tell the light of, (k,) int32, their mean emission, (k, 3) float32, W/m2, and how much of each holes leave, (k,) float32.

    Args:
        geometry: m triangles, with lightmap coordinates.
        charts: (m,) int32, of each triangle.
        table: Of `glowing_table`.
    """
    candidates = np.flatnonzero(textured(table, geometry) & (charts >= 0))
    glowing = np.zeros(int(charts.max(initial=-1)) + 1, np.bool_)
    glowing[charts[candidates]] = True
    chosen = np.flatnonzero(glowing[luxels.chart]).astype(np.int32)
    if not len(chosen):
        return chosen, np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    parts = cuttings_of(luxels, chosen, geometry, charts, candidates, threads)
    emission, solid = emission_of(parts, luxels, chosen, geometry, table, threads)
    whole, left = (np.bincount(parts.luxel, area, len(chosen)) for area in (parts.area, solid))
    share = np.divide(left, whole, out=np.zeros(len(chosen)), where=whole > 0).astype(np.float32)
    return chosen, means(emission, solid, parts.luxel, len(chosen)), share


def means(values: Array, weight: Array, group: Array, count: int) -> Array:
    """(count, 3) float32: weighted means of values (p, 3) over groups (p,), 0 where there is no weight."""
    whole = np.bincount(group, weight, count)
    sums = np.stack([np.bincount(group, weight * column, count) for column in values.T], 1)
    return (sums / np.where(whole > 0, whole, 1.0)[:, None]).astype(np.float32)


def emission_of(parts: Cuttings, luxels: Luxels, chosen: Array, geometry: Geometry, table: MaterialTable, threads: int) -> tuple[Array, Array]:
    """(p, 3) float32, W/m2: mean radiant exitance of each cutting of the chosen luxels, and (p,) float64, m2: its area without holes."""
    count = len(parts.luxel)
    most = int(np.clip(math.isqrt(_SAMPLES // max(2 * count, 1)), 1, _MOST_SIDE))
    side = np.where(textured(table, geometry), most, 1)[parts.triangle]
    left, top = luxels.texel[chosen[parts.luxel]][:, 2:0:-1].T * np.int64(SUBPIXEL)
    screen = place_vertices(geometry.texcoords1, luxels.shape[:0:-1], threads)
    emission, share = np.zeros((count, 3)), np.zeros(count)
    step = max(_AT_ONCE // (_FAN * most**2), 1)
    for first in range(0, count, step):
        last = min(first + step, count)
        samples = _Samples.room_for(_FAN * int((side[first:last] ** 2).sum()))
        n = _sample(geometry.triangles[parts.triangle[first:last]], left[first:last], top[first:last], side[first:last], screen, *samples)
        owner, s1, s2, around, weight = (array[:n] for array in samples)
        seen = appearance(geometry, table, parts.triangle[first + owner], (s1, s2), np.ones(n, np.float32), around, threads)
        solid = weight * seen.share
        share[first:last] = np.bincount(owner, solid, last - first)
        emission[first:last] = means(seen.emission, solid, owner, last - first)
    return emission.astype(np.float32), parts.area * share


class _Samples(NamedTuple):
    """Places of cuttings: whose each is (n,) int64, barycentric coordinates (n,) float32, those of the sides of what is around it (n, 4) float32, and
    its share of the cutting (n,) float64."""

    owner: Array
    corner1: Array
    corner2: Array
    around: Array
    weight: Array

    @classmethod
    def room_for(cls, n: int) -> _Samples:
        return cls(np.empty(n, np.int64), np.empty(n, np.float32), np.empty(n, np.float32), np.empty((n, 4), np.float32), np.empty(n))


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


@jit.kernel
def _sample(triangles, left, top, sides, screen, owner, corner1, corner2, around, weight):
    """Fill `_Samples`; how many there are. A cutting is a fan of triangles, and each of these is cut to side x side alike, with a sample in each."""
    xs, ys, ox, oy = np.empty(_CORNERS), np.empty(_CORNERS), np.empty(_CORNERS), np.empty(_CORNERS)
    n = 0
    for k in range(len(triangles)):
        a, b, c = triangles[k, 0], triangles[k, 1], triangles[k, 2]
        side, begin, whole = sides[k], n, 0.0
        corners = _outline(screen, a, b, c, left[k], top[k], xs, ys, ox, oy)
        for f in range(1, corners - 1):
            u1, u2, v1, v2 = (xs[f] - xs[0]) / side, (ys[f] - ys[0]) / side, (xs[f + 1] - xs[0]) / side, (ys[f + 1] - ys[0]) / side
            for i in range(side):
                for j in range(2 * (side - i) - 1):  # one that stands, one upside down, and so on
                    middle = (1.0 if j % 2 == 0 else 2.0) / 3.0
                    along, down = i + middle, j // 2 + middle
                    corner1[n], corner2[n] = xs[0] + along * u1 + down * v1, ys[0] + along * u2 + down * v2
                    around[n, 0], around[n, 1], around[n, 2], around[n, 3] = _WIDE * u1, _WIDE * u2, _WIDE * v1, _WIDE * v2
                    owner[n], weight[n] = k, abs(u1 * v2 - u2 * v1)
                    whole += weight[n]
                    n += 1
        for i in range(begin, n):
            weight[i] /= whole if whole > 0.0 else 1.0
    return n
