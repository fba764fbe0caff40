"""Pieces: the connected parts of a surface, and which of them are too small for a chart.

A piece smaller than a texel needs no chart: it gets one texel for all of it. Where there are more pieces than can be packed in reasonable time,
the smallest of them get the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array

MOST_CHARTED = 40_000
"""Pieces of a scene that are charted; packing takes some 0.1 ms a piece and page."""

_LEAST_AREA, _LEAST_HEIGHT = 1e-6, 1e-4
"""Square texels, texels: thinner triangles cannot be charted, and get a point on the chart beside."""


class Surface(NamedTuple):
    """One mesh to be charted: positions (n, 3) float32 and normals (n, 3) float32, in texels; triangles (m, 3) int32."""

    positions: Array
    triangles: Array
    normals: Array


class Pieces(NamedTuple):
    """Connected parts of a surface.

    Attributes:
        piece: (m,) int32, of each triangle.
        extent: (k,) float64: diagonal of each piece's box, texels; 0 if none of its triangles can be charted.
        sound: (m,) bool: triangles that can be charted.
        area: (m,) float64, square texels.
    """

    piece: Array
    extent: Array
    sound: Array
    area: Array


def areas(positions: Array, triangles: Array) -> Array:
    """(m,) float64: area of each triangle; 0 where a corner is not finite."""
    with np.errstate(all="ignore"):
        a, b, c = (positions[triangles[:, k]].astype(np.float64) for k in range(3))
        return np.nan_to_num(np.sqrt((np.cross(b - a, c - a) ** 2).sum(1)) / 2, nan=0.0, posinf=0.0)


def find_pieces(surface: Surface) -> Pieces:
    """Connect triangles that share a place."""
    positions, triangles = surface.positions, surface.triangles
    piece = connected(triangles, positions)
    area, longest = areas(positions, triangles), _longest_edge(positions, triangles)
    sound = (area > _LEAST_AREA) & (2 * area > _LEAST_HEIGHT * longest)
    count = int(piece.max(initial=-1)) + 1
    extent = np.zeros(count)
    if sound.any():
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        points = positions[triangles[sound]].astype(np.float64)
        np.minimum.at(low, piece[sound], points.min(1))
        np.maximum.at(high, piece[sound], points.max(1))
        known = np.isfinite(low[:, 0])
        extent[known] = np.sqrt(((high[known] - low[known]) ** 2).sum(1))
    return Pieces(piece, extent, sound, area)


def connected(triangles: Array, *vertices: Array) -> Array:
    """(m,) int32: numbers of the connected parts; triangles touch at vertices where all of the `vertices` arrays, (n, 3) float32, agree."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    from luxel.scene.normals import weld

    n, m = len(vertices[0]), len(triangles)
    key = np.zeros(n, np.int64)
    for values in vertices:
        same = weld(values)
        same = np.arange(n) if same is None else same
        key = np.unique(key * np.int64(n) + same, return_inverse=True)[1]
    corners = key[triangles]
    links = coo_array((np.ones(2 * m, np.int8), (corners[:, :2].T.ravel(), corners[:, 1:].T.ravel())), (n, n))
    part = connected_components(links, directed=False)[1]
    return np.unique(part[corners[:, 0]], return_inverse=True)[1].astype(np.int32)


def _longest_edge(positions: Array, triangles: Array) -> Array:
    with np.errstate(all="ignore"):
        corners = positions[triangles].astype(np.float64)
        return np.sqrt(((corners - np.roll(corners, 1, 1)) ** 2).sum(2).max(1))


def least_extent(pieces: list[Pieces]) -> float:
    """Texels: smaller pieces get one texel each. 1, or more if so few could not be charted."""
    extents = np.concatenate([np.zeros(0), *(p.extent for p in pieces)])
    if np.count_nonzero(extents > 1.0) <= MOST_CHARTED:
        return 1.0
    return float(np.partition(extents, -MOST_CHARTED - 1)[-MOST_CHARTED - 1])
