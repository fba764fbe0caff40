"""Charts: surfaces cut open, laid flat and packed on pages by xatlas.

xatlas stretches charts to whole texels and places their vertices at the texels' centres. Here they get the density that was asked for back, and
start at a texel's corner: a rectangle of w x h texels covers w x h texels.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import LuxelWarning
from luxel.radiosity.packing import Flat, Sheet, Wishes, pack
from luxel.radiosity.pieces import MOST_CHARTED, Pieces, Surface, areas, find_pieces, least_extent

# xatlas's time grows faster than a curved chart's number of triangles: a quarter of its default cost of growing, and charts of a few thousand
# triangles, are ten times as fast on dense meshes, and distort less. Flat charts may have any number.
_COST = 0.5
_TRIANGLES, _LEAST_CHART = 3000.0, 1024.0  # triangles of the median area, square texels
_FULL = 0.75  # of a page: charts do not grow beyond its square


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


def chart_surfaces(surfaces: list[Surface], page: int, gutter: int,
                   progress: Callable[[float], None] | None = None) -> tuple[list[Charted], int]:  # fmt: skip
    """Chart and pack; returns the meshes and how many pages they take.

    Args:
        surfaces: In texels, so the density is 1.
        page: Width and height of a page, texels.
        gutter: Texels that stay free between charts, at least.
        progress: Called with the share that is probably done.

    Raises:
        ExtraMissingError: xatlas is not installed.
        LuxelError: xatlas failed.
    """
    pieces = [find_pieces(surface) for surface in surfaces]
    least = least_extent(pieces)
    _tell_of_small(pieces, least)
    charted = [p.sound & (p.extent > least)[p.piece] for p in pieces]
    flats = iter(_packed(surfaces, charted, page, gutter, progress))
    made: list[Charted] = []
    first = 0
    for surface, chosen in zip(surfaces, charted, strict=True):
        made.append(_laid(next(flats), surface, chosen, first, page) if chosen.any() else _nowhere(surface))
        first = max(first, int(made[-1].chart.max(initial=-1)) + 1)
    return _with_points(made, surfaces, pieces, least, page, gutter)


def _tell_of_small(pieces: list[Pieces], least: float) -> None:
    """Warn of very many pieces that get a luxel each."""
    count = sum(np.count_nonzero(p.extent <= least) for p in pieces)
    if least > 1.0:
        why = f"smaller than {least:.3g} texels get one luxel each: there are too many to chart; take fewer texels per metre"
    else:
        why = "are smaller than a texel: each gets one luxel, whatever the density, and so many are slow to light"
    if least > 1.0 or count > MOST_CHARTED:
        warnings.warn(f"{count:,} separate pieces {why}", LuxelWarning, stacklevel=4)


def _packed(surfaces: list[Surface], charted: list[Array], page: int, gutter: int, progress: Callable[[float], None] | None) -> list[Flat]:
    """The charted triangles of each surface as xatlas lays them; surfaces without any are left out."""
    sheets, sizes = [], [np.zeros(0)]
    for surface, chosen in zip(surfaces, charted, strict=True):
        if chosen.any():
            used, faces = np.unique(surface.triangles[chosen], return_inverse=True)
            corners = surface.positions[used].astype(np.float64)
            sheets.append(Sheet((corners - corners.mean(0)).astype(np.float32), faces.reshape(-1, 3).astype(np.uint32), surface.normals[used]))
            sizes.append(areas(surface.positions, surface.triangles[chosen]))
    typical = float(np.median(np.concatenate(sizes))) if sheets else 0.0
    padding = gutter // 2 + 1  # around each chart, so twice between two; up to two are lost when charts move to texels' corners
    return pack(sheets, Wishes(page, padding, min((_FULL * page) ** 2, max(_LEAST_CHART, _TRIANGLES * typical)), _COST), progress)


def _nowhere(surface: Surface) -> Charted:
    n, m = len(surface.positions), len(surface.triangles)
    return Charted(np.arange(n, dtype=np.int32), surface.triangles, np.zeros((n, 2)), np.full(m, -1, np.int32), np.zeros(m, np.int32))


def _laid(made: Flat, surface: Surface, chosen: Array, first: int, size: int) -> Charted:
    """What xatlas made of a mesh, with exact densities: charts from `first` on. Triangles not chosen keep vertices of their own."""
    source, triangles = np.unique(surface.triangles[chosen])[made.source].astype(np.int32), made.triangles.astype(np.int32)
    chart, page, m = made.chart, made.page, len(chosen)
    texcoords = made.texcoords.astype(np.float64) * size
    flat = exact(surface.positions[source].astype(np.float64), triangles, texcoords, chart, int(chart.max(initial=-1)) + 1)
    rest = surface.triangles[~chosen]
    every = Charted(np.concatenate([source, rest.ravel()]), np.empty((m, 3), np.int32), np.concatenate([flat, np.zeros((rest.size, 2))]),
                    np.full(m, -1, np.int32), np.zeros(m, np.int32))  # fmt: skip
    every.triangles[chosen], every.chart[chosen], every.page[chosen] = triangles, np.where(chart >= 0, chart + first, -1), page
    every.triangles[~chosen] = np.arange(rest.size).reshape(-1, 3) + len(source)
    return every


def _with_points(made: list[Charted], surfaces: list[Surface], pieces: list[Pieces], least: float, size: int,
                 gutter: int) -> tuple[list[Charted], int]:  # fmt: skip
    """Give each piece that is too small for a chart a texel, in rows below the charts or on pages of their own, and triangles without an area
    the nearest place on the charts of their surface."""
    small = [np.bincount(p.piece, p.area, len(p.extent)) * (p.extent <= least) > 0 for p in pieces]
    used, pages = _used(made)
    places = _cells(sum(map(np.count_nonzero, small)), used, pages, size, gutter)
    chart, first, moved = max((int(flat.chart.max(initial=-1)) for flat in made), default=-1) + 1, 0, []
    for flat, surface, p, chosen in zip(made, surfaces, pieces, small, strict=True):
        number = np.cumsum(chosen) - 1 + first
        point = chosen[p.piece]
        row = number[p.piece[point]]
        flat.chart[point], flat.page[point] = row + chart, places[row, 0]
        corners = flat.triangles[point]
        flat.texcoords[corners] = places[row, None, 1:] + 0.5
        first += int(np.count_nonzero(chosen))
        moved.append(_with_rest(flat, surface))
    return moved, max(pages, int(places[:, 0].max(initial=-1)) + 1, 1)


def _used(made: list[Charted]) -> tuple[tuple[int, int], int]:
    """Width and height of what is used of the last page, and the number of pages; 0 of none."""
    pages = max((int(flat.page[flat.chart >= 0].max(initial=-1)) for flat in made), default=-1) + 1
    high = np.zeros(2)
    for flat in made:
        chosen = (flat.chart >= 0) & (flat.page == pages - 1)
        if chosen.any():
            high = np.maximum(high, flat.texcoords[flat.triangles[chosen]].max((0, 1)))
    width, height = (int(np.ceil(side - 1e-3)) for side in high)
    return (width, height), pages


def _cells(count: int, used: tuple[int, int], pages: int, size: int, gutter: int) -> Array:
    """(count, 3) int: page, x and y of so many free texels."""
    pitch = 1 + gutter
    width, top = min(size, max(used[0], int(np.sqrt(count) * pitch))), used[1] + gutter if pages else 0
    across = max(1, (width + gutter) // pitch)
    room = across * max(0, (size - top + gutter) // pitch) if pages else 0  # on the last page that is there
    here = np.arange(min(count, room))
    beside = np.stack([np.full(len(here), max(pages - 1, 0)), here % across * pitch, here // across * pitch + top], 1)
    left = np.arange(count - len(here))
    across = max(1, (size if len(here) or len(left) > ((size + gutter) // pitch) ** 2 else width + gutter) // pitch)
    each = across * ((size + gutter) // pitch)
    return np.concatenate([beside, np.stack([pages + left // each, left % each % across * pitch, left % each // across * pitch], 1)])


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
    owner[triangles[chart >= 0]] = chart[chart >= 0][:, None]
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


def _with_rest(flat: Charted, surface: Surface) -> Charted:
    """Put every triangle that has no chart, because it has no area, as a point at the nearest vertex that has one."""
    rest = np.flatnonzero(flat.chart < 0)
    if not len(rest) or len(rest) == len(flat.chart):
        return flat
    from scipy.spatial import cKDTree

    with np.errstate(all="ignore"):
        middle = np.nan_to_num(surface.positions[surface.triangles[rest]].astype(np.float64).mean(1), nan=0.0, posinf=0.0, neginf=0.0)
    charted = np.flatnonzero(flat.chart >= 0)
    corners = flat.triangles[charted].ravel()
    nearest = cKDTree(np.nan_to_num(surface.positions[flat.source[corners]], nan=0.0, posinf=0.0, neginf=0.0)).query(middle)[1]
    flat.texcoords[flat.triangles[rest]] = flat.texcoords[corners[nearest]][:, None]
    owner = charted[nearest // 3]
    flat.chart[rest], flat.page[rest] = flat.chart[owner], flat.page[owner]
    return flat
