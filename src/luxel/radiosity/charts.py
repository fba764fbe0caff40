"""Charts: surfaces cut open, laid flat and packed on pages by xatlas. Nothing else imports xatlas.

xatlas stretches charts to whole texels and places their vertices at the texels' centres. Here they get the density that was asked for back, and
start at a texel's corner: a rectangle of w x h texels covers w x h texels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import ExtraMissingError

_LEAST_AREA = 1e-6
"""Square texels; what is smaller has no chart of its own."""
_FULL = 0.75  # of a page: charts do not grow beyond its square


class Surface(NamedTuple):
    """One mesh to be charted: positions (n, 3) float32 and normals (n, 3) float32, in texels; triangles (m, 3) int32."""

    positions: Array
    triangles: Array
    normals: Array


class Charted(NamedTuple):
    """A mesh laid flat.

    Attributes:
        source: (k,) int32, the vertex that each new vertex is a copy of.
        triangles: (m, 3) int32, of new vertices, in the old order.
        texcoords: (k, 2) float64, in texels.
        chart: (m,) int32, numbered over all meshes; -1 for triangles without a chart.
        page: (m,) int32.
    """

    source: Array
    triangles: Array
    texcoords: Array
    chart: Array
    page: Array


def chart_surfaces(surfaces: list[Surface], page: int, gutter: int) -> tuple[list[Charted], int]:
    """Chart and pack; returns the meshes and how many pages they take.

    Args:
        surfaces: In texels, so the density is 1.
        page: Width and height of a page, texels.
        gutter: Texels that stay free between charts, at least.

    Raises:
        ExtraMissingError: xatlas is not installed.
    """
    try:
        import xatlas
    except ImportError as error:
        raise ExtraMissingError("xatlas", "bake", "making lightmap coordinates") from error
    atlas, good = xatlas.Atlas(), [_charted_triangles(surface) for surface in surfaces]
    for surface, chosen in zip(surfaces, good, strict=True):
        if chosen.any():
            with np.errstate(all="ignore"):
                middle = surface.positions[surface.triangles[chosen]].mean((0, 1), np.float64)
            faces = surface.triangles[chosen].astype(np.uint32)
            atlas.add_mesh((surface.positions - middle).astype(np.float32), faces, surface.normals)
    made: list[Charted] = []
    pages = first = number = 0
    if any(chosen.any() for chosen in good):
        options, packing = xatlas.ChartOptions(), xatlas.PackOptions()
        options.max_chart_area = (_FULL * page) ** 2
        packing.resolution, packing.texels_per_unit = page, 1.0
        packing.padding = gutter // 2 + 1  # around each chart, so twice between two; one is lost when charts move to texels' corners
        packing.rotate_charts_to_axis = True
        atlas.generate(options, packing)
        pages = atlas.atlas_count
    for surface, chosen in zip(surfaces, good, strict=True):
        if chosen.any():
            flat = _laid(atlas, number, surface, chosen, first, page)
            first, number = max(first, int(flat.chart.max()) + 1), number + 1
        else:
            flat = _nowhere(surface)
        made.append(flat)
    return made, max(pages, 1)


def _charted_triangles(surface: Surface) -> Array:
    """(m,) bool: triangles that have an area."""
    with np.errstate(all="ignore"):
        a, b, c = (surface.positions[surface.triangles[:, k]].astype(np.float64) for k in range(3))
        area = np.sqrt((np.cross(b - a, c - a) ** 2).sum(1)) / 2
        return np.isfinite(area) & (area > _LEAST_AREA)


def _nowhere(surface: Surface) -> Charted:
    n, m = len(surface.positions), len(surface.triangles)
    return Charted(np.arange(n, dtype=np.int32), surface.triangles, np.zeros((n, 2)), np.full(m, -1, np.int32), np.zeros(m, np.int32))


def _laid(atlas: object, number: int, surface: Surface, chosen: Array, first: int, size: int) -> Charted:
    """What xatlas made of its mesh `number`: charts from `first` on, with exact densities, and the triangles without an area put beside."""
    source, triangles, texcoords = atlas.get_mesh(number)  # type: ignore[attr-defined]
    source, triangles = source.astype(np.int32), triangles.astype(np.int32)
    charts = [atlas.get_mesh_chart(number, k) for k in range(atlas.get_mesh_chart_count(number))]  # type: ignore[attr-defined]
    chart, page = np.full(len(triangles), -1, np.int32), np.zeros(len(triangles), np.int32)
    for k, found in enumerate(charts):
        faces = np.asarray(found.faces, np.int64)
        chart[faces], page[faces] = first + k, found.atlas_index
    corners = surface.positions[source].astype(np.float64)
    flat = exact(corners, triangles, texcoords.astype(np.float64) * size, chart - first, len(charts))
    return _with_rest(Charted(source, triangles, flat, chart, page), surface, chosen)


def exact(positions: Array, triangles: Array, texcoords: Array, chart: Array, count: int) -> Array:
    """Texture coordinates (k, 2) float64, in texels, with charts that start at a texel's corner and have one texel per unit of length.

    Charts narrower than a texel stay a texel wide, and those that xatlas made smaller to fit on a page stay as they are.

    Args:
        positions: (k, 3) float64, in texels.
        triangles: (m, 3) int32; charts share no vertices.
        texcoords: (k, 2) float64, from xatlas.
        chart: (m,) int32, 0 to count - 1.
    """
    density = linear_density(positions, triangles, texcoords, chart, count)
    owner = np.zeros(len(texcoords), np.int64)
    owner[triangles] = chart[:, None]
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, owner, texcoords)
    np.maximum.at(high, owner, texcoords)
    extent = np.maximum(high - low, 1e-9)
    scale = np.minimum(1.0, 1.0 / np.maximum(density, 1e-9))
    scale = np.maximum(scale, np.minimum(1.0, 1.0 / extent))
    return np.round(low - 0.5)[owner] + (texcoords - low[owner]) * scale[owner]


def linear_density(positions: Array, triangles: Array, texcoords: Array, chart: Array, count: int) -> Array:
    """(count, 2) float64: mean texels per unit of length along u and along v of each chart, weighted by area.

    Of a triangle with Jacobian J (texels by lengths), these are the square roots of the diagonal of J J^T.
    """
    a, b, c = (positions[triangles[:, k]].astype(np.float64) for k in range(3))
    d, e, f = (texcoords[triangles[:, k]].astype(np.float64) for k in range(3))
    (p, q), (s, t) = (b - a, c - a), (e - d, f - d)
    pp, pq, qq = (p * p).sum(1), (p * q).sum(1), (q * q).sum(1)
    gram = np.maximum(pp * qq - pq * pq, 0.0)
    squares = s * s * qq[:, None] - 2 * s * t * pq[:, None] + t * t * pp[:, None]
    known = (gram > 1e-12 * pp * qq) & (chart >= 0)
    linear = np.sqrt(np.maximum(squares[known], 0.0) / gram[known][:, None])
    weight = np.sqrt(gram[known])
    total = np.bincount(chart[known], weight, count)
    sums = np.stack([np.bincount(chart[known], weight * linear[:, k], count) for k in (0, 1)], 1)
    return sums / np.maximum(total, 1e-300)[:, None]


def _with_rest(flat: Charted, surface: Surface, chosen: Array) -> Charted:
    """Add the triangles that were not charted, each as a point at the nearest vertex that was."""
    m, rest = len(chosen), np.flatnonzero(~chosen)
    if not len(rest):
        return flat
    from scipy.spatial import cKDTree

    with np.errstate(all="ignore"):
        middle = np.nan_to_num(surface.positions[surface.triangles[rest]].astype(np.float64).mean(1), nan=0.0, posinf=0.0, neginf=0.0)
    owner = np.zeros(len(flat.source), np.int64)
    owner[flat.triangles] = np.arange(len(flat.triangles))[:, None]
    nearest = cKDTree(surface.positions[flat.source]).query(middle)[1]
    triangles, chart, page = np.empty((m, 3), np.int32), np.empty(m, np.int32), np.empty(m, np.int32)
    triangles[chosen], chart[chosen], page[chosen] = flat.triangles, flat.chart, flat.page
    triangles[rest] = np.arange(3 * len(rest)).reshape(-1, 3) + len(flat.source)
    chart[rest], page[rest] = flat.chart[owner[nearest]], flat.page[owner[nearest]]
    source = np.concatenate([flat.source, surface.triangles[rest].ravel()])
    return Charted(source, triangles, np.concatenate([flat.texcoords, np.repeat(flat.texcoords[nearest], 3, 0)]), chart, page)
