"""Pages: the texels of one lightmap page, those of triangles without an area there included."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from luxel.arrays import Array
from luxel.radiosity.texture_space import Texels, area2, cut_texels
from luxel.raster.geometry import Geometry

if TYPE_CHECKING:
    from luxel.radiosity.unwrap import Atlas


def triangle_pages(atlas: Atlas, geometry: Geometry) -> Array:
    """(m,) int32: the page of each triangle."""
    drawn = [i for i, instance in enumerate(atlas.scene.instances) if len(atlas.scene.meshes[instance.mesh].triangles)]
    return np.repeat(atlas.instance_page[drawn], np.diff(geometry.part_start))


def draw_page(triangles: Array, screen: Array, chart: Array, surface: Array, size: tuple[int, int], threads: int) -> Texels:
    """The texels of a page; arguments as of `cut_texels`."""
    texels = cut_texels(triangles, screen, chart, surface, size, threads)
    return _with_points(texels, triangles, screen, chart, surface, size)


def _with_points(texels: Texels, triangles: Array, screen: Array, chart: Array, surface: Array, size: tuple[int, int]) -> Texels:
    """Add texels for triangles that have a surface but no area on the page: each stands in the texel of its middle, if that is free."""
    flat = np.flatnonzero(area2(screen, triangles) == 0)
    if not len(flat):
        return texels
    x, y = (screen[:, k].astype(np.int64)[triangles[flat]].sum(1) // (3 * 256) for k in (0, 1))
    inside = (x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1])
    flat, place = flat[inside], (y * size[0] + x)[inside]
    _, group = np.unique(place * (int(chart.max()) + 1) + chart[flat], return_inverse=True)
    whole = np.bincount(group, surface[flat])
    order = np.lexsort((flat, -surface[flat], -whole[group], place))  # the largest triangle of the largest chart
    place, first = np.unique(place[order], return_index=True)
    free = ~np.isin(place, texels.place)
    chosen = order[first[free]]
    place, flat, whole = place[free].astype(np.int32), flat[chosen].astype(np.int32), whole[group[chosen]]
    third, none = np.full(len(flat), 1 / 3, np.float32), np.full(len(flat), -1, np.int32)
    points = Texels(place, flat, third, third, whole, np.full(len(flat), 1 / 65536, np.float32), none)
    joined = Texels(*(np.concatenate(pair) for pair in zip(texels, points, strict=True)))
    order = np.argsort(joined.place, kind="stable")
    return Texels(*(array[order] for array in joined))
