"""Luxels: the elements of the lightmap, found by drawing every page in texture space.

Every texel that a chart covers, however little, is a luxel. It stands at the centroid of the part of it that is covered, and has that part's area
on the surface, so the areas of a chart's luxels sum to the chart's own.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import LuxelWarning
from luxel.radiosity.appearance import LEAST_SHARE, appearance
from luxel.radiosity.glow import glow_of, glowing_table
from luxel.radiosity.pages import draw_page, triangle_pages
from luxel.radiosity.pieces import areas
from luxel.radiosity.texture_space import Texels, place_vertices
from luxel.raster.geometry import Geometry, flatten
from luxel.raster.materials import pack_materials
from luxel.scene.material import Material
from luxel.scene.scene import Scene

if TYPE_CHECKING:
    from luxel.radiosity.unwrap import Atlas

MOST_ALBEDO = 0.99
"""Surfaces that would give back more than this of the light are taken for this bright; else light would never end."""

_BLACK, _MOST_BLACK = 1e-3, 0.5  # albedo, and share of the surface
_LEAST_KEPT = 0.5  # of a chart's area: if other charts took more of its texels, what is left does not stand for all of it


class Luxels(NamedTuple):
    """n luxels, by page, row and column.

    Attributes:
        texel: (n, 3) int32: page, row, column.
        position: (n, 3) float32, metres: on the triangle, at the centroid of the part of the texel that its chart covers.
        normal: (n, 3) float32, unit: interpolated, on the front side.
        face_normal: (n, 3) float32, unit: of the triangle.
        area: (n,) float32, m2 of surface in the texel; what alpha masks cut out is no surface.
        coverage: (n,) float32: how much of the texel the chart covers.
        albedo: (n, 3) float32, linear, textured: what the renderer multiplies by E / pi.
        emission: (n, 3) float32: radiant exitance, W/m2; the mean over the luxel where a texture tells it.
        triangle: (n,) int32, row of `flatten(atlas.scene, "none").triangles`: the one with the largest part.
        chart: (n,) int32.
        two_sided: (n,) bool: its material is double-sided.
        shape: Pages, height, width.
        contested: (k, 3) int32: page, row and column of texels that more than one chart covers; the one that covers most has it.
        lost: (c,) int32: charts with a surface but without a luxel, as others have all their texels.
    """

    texel: Array
    position: Array
    normal: Array
    face_normal: Array
    area: Array
    coverage: Array
    albedo: Array
    emission: Array
    triangle: Array
    chart: Array
    two_sided: Array
    shape: tuple[int, int, int]
    contested: Array
    lost: Array


def find_luxels(atlas: Atlas, threads: int | None = None) -> Luxels:
    """The luxels of an unwrapped scene; the same for any number of threads.

    Says in a `LuxelWarning` if surfaces are too bright, most of them are metal, or charts have lost all their texels.
    """
    threads = jit.checked_threads(threads)
    geometry = flatten(atlas.scene, "none")
    texels, page, contested = _draw_pages(atlas, geometry, threads)
    shape = (atlas.pages, atlas.size[1], atlas.size[0])
    chart = atlas.chart[texels.triangle]
    area, lost = _whole_charts(texels.area, chart, atlas.chart, surface_areas(geometry))
    table = pack_materials(_plain(atlas.scene))
    gradients = texture_gradients(atlas, geometry)[texels.triangle]
    seen = appearance(geometry, table, texels.triangle, (texels.corner1, texels.corner2), texels.coverage, gradients, threads)
    place, share = texels.place, seen.share
    texel = np.stack([page, place // atlas.size[0], place % atlas.size[0]], 1).astype(np.int32)
    sided = two_sided_triangles(atlas.scene, geometry)[texels.triangle]
    luxels = Luxels(
        texel, seen.position, seen.normal, seen.face_normal, area, texels.coverage, seen.albedo, seen.emission, texels.triangle, chart, sided, shape,
        contested, lost,
    )  # fmt: skip
    glowing = glowing_table(atlas.scene)
    if glowing is not None:
        told, emission, left = glow_of(luxels, geometry, atlas.chart, glowing, threads)
        luxels.emission[told], share[told] = emission, left
    luxels = luxels._replace(area=(area * share).astype(np.float32))
    keep = (share >= LEAST_SHARE) | ((share > 0) & luxels.emission.any(1))
    if not keep.all():
        per_luxel = {name: getattr(luxels, name)[keep] for name in Luxels._fields[:11]}
        luxels = luxels._replace(**per_luxel)
    _tell(luxels, atlas.scene, geometry)
    return luxels._replace(albedo=luxels.albedo.clip(0, np.float32(MOST_ALBEDO)), emission=luxels.emission.clip(0, None))


def surface_areas(geometry: Geometry) -> Array:
    """(m,) float64: area of each triangle, m2; 0 where a corner is not finite."""
    return areas(geometry.positions, geometry.triangles)


def part_of(geometry: Geometry, triangle: Array) -> Array:
    """The part (instance) of each triangle."""
    return np.searchsorted(geometry.part_start, triangle, "right") - 1


def two_sided_triangles(scene: Scene, geometry: Geometry) -> Array:
    """(m,) bool, of each triangle."""
    sided = np.array([m.double_sided for m in [*scene.materials, Material()]])
    return np.repeat(sided[geometry.part_material], np.diff(geometry.part_start))


def texture_gradients(atlas: Atlas, geometry: Geometry) -> Array:
    """(m, 4) float32: what barycentric coordinates 1 and 2 gain by a texel to the right, and by one down."""
    u, v = (geometry.texcoords1[:, k].astype(np.float64)[geometry.triangles] * atlas.size[k] for k in (0, 1))
    ux, uy, vx, vy = u[:, 1] - u[:, 0], u[:, 2] - u[:, 0], v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]
    with np.errstate(all="ignore"):
        gradients = np.stack([vy, -vx, -uy, ux], 1) / (ux * vy - uy * vx)[:, None]
    return np.where(np.abs(gradients) < 1e6, gradients, 0.0).astype(np.float32)


def _draw_pages(atlas: Atlas, geometry: Geometry, threads: int) -> tuple[Texels, Array, Array]:
    """Texels of all pages, their pages, and (k, 3) which are contested."""
    screen, pages = place_vertices(geometry.texcoords1, atlas.size, threads), triangle_pages(atlas, geometry)
    surface = surface_areas(geometry)
    drawn, contested, number = [], [], []
    for page in range(atlas.pages):
        chosen = np.flatnonzero((pages == page) & (surface > 0) & (atlas.chart >= 0)).astype(np.int32)
        texels = draw_page(geometry.triangles[chosen], screen, atlas.chart[chosen], surface[chosen], atlas.size, threads)
        place = texels.place[texels.loser >= 0]
        contested.append(np.stack([np.full(len(place), page), place // atlas.size[0], place % atlas.size[0]], 1))
        drawn.append(texels._replace(triangle=chosen[texels.triangle]))
        number.append(np.full(len(texels.place), page))
    nothing = Texels(*(np.zeros(0, dtype) for dtype in (np.int32, np.int32, np.float32, np.float32, np.float64, np.float32, np.int32)))
    every = Texels(*(np.concatenate(arrays) for arrays in zip(nothing, *drawn, strict=True)))
    return every, np.concatenate([np.zeros(0, int), *number]), np.concatenate([np.zeros((0, 3), int), *contested]).astype(np.int32)


def _whole_charts(area: Array, chart: Array, charts: Array, surface: Array) -> tuple[Array, Array]:
    """Areas scaled so that those of a chart sum to its own, though it lost texels to others; and the charts that lost all or nearly all."""
    count = int(charts.max(initial=-1)) + 1
    known = charts >= 0
    own, kept = np.bincount(charts[known], surface[known], count), np.bincount(chart, area, count)
    scale = np.ones(count)
    np.divide(own, kept, out=scale, where=kept > _LEAST_KEPT * own)
    return area * scale[chart], np.flatnonzero((own > 0) & (kept <= 0)).astype(np.int32)


def _plain(scene: Scene) -> Scene:
    """The scene with materials that tell only what diffuse light needs: colour and emission."""
    bare: dict[str, Any] = {"normal_texture": None, "occlusion_texture": None, "lightmap_texture": None}
    materials = [replace(m, **bare, shading="phong" if m.shading in ("gouraud", "flat") else m.shading) for m in scene.materials]
    return replace(scene, materials=materials)


def _tell(luxels: Luxels, scene: Scene, geometry: Geometry) -> None:
    """Warn of what a bake cannot show as it is."""
    texts = []
    bright, black = luxels.albedo.max(1, initial=0) > MOST_ALBEDO, luxels.albedo.max(1, initial=0) < _BLACK
    if bright.any():
        who = _materials(luxels, bright, scene, geometry)
        most = luxels.albedo.max()
        texts.append(f"{bright.sum()} luxels have an albedo of up to {most:.3g}, and give back {MOST_ALBEDO:g} of the light instead: material {who}")
    if luxels.area[black].sum(dtype=np.float64) > _MOST_BLACK * luxels.area.sum(dtype=np.float64):
        who = _materials(luxels, black, scene, geometry)
        texts.append(f"most of the surface is black or metal, and gives back no diffuse light: material {who}")
    if len(luxels.lost):
        texts.append(f"{len(luxels.lost)} charts have no luxel, as larger charts have all their texels: take more texels per metre or new charts")
    for text in texts:
        warnings.warn(text, LuxelWarning, stacklevel=3)


def _materials(luxels: Luxels, chosen: Array, scene: Scene, geometry: Geometry) -> str:
    """Names of the materials of the chosen luxels."""
    rows = np.unique(geometry.part_material[part_of(geometry, luxels.triangle[chosen])])
    known = [*(repr(m.name) if m.name else f"number {row}" for row, m in enumerate(scene.materials)), "by default"]
    return ", ".join(known[row] for row in rows[:6]) + (f" and {len(rows) - 6} more" if len(rows) > 6 else "")
