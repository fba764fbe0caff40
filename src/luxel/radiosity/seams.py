"""Stitching: what lies on both sides of a seam shows the same light there.

Along each seam, points are sampled on both sides as a renderer does, bilinearly; the difference is to vanish, with the least change of the
texels that take part (Iwanicki 2013, "Lighting technology of The Last of Us", SIGGRAPH; least squares over all seams at once). Texels of
the gutter, which nothing but such samples shows, may change more than luxels. Texels that no seam's sample touches stay as they are.

A sample counts only where its two sides see each other: a wall that stands on a seam keeps light and shadow apart, however it is modelled.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from luxel.arrays import Array, checked
from luxel.radiosity.edges import ANGLE, Seams, find_seams
from luxel.radiosity.rays import obstacles, scene_masks, visible
from luxel.raster.geometry import flatten

if TYPE_CHECKING:
    from luxel.radiosity.luxels import Luxels
    from luxel.radiosity.unwrap import Atlas

_A_TEXEL = 4  # samples along a seam for each texel of its finer side
_MOST = 8192  # samples along one piece
_BEYOND = 1.1  # of the way to a luxel's middle: walls often have their faces just there, and what an end lies on does not hide it
_LIFT = 0.25  # of the way from side to side: what a bent surface may rise between a seam and its luxels
_KEEP, _KEEP_GUTTER = 1e-3, 1e-4  # weight of a texel's change, squared, beside that of a sample's difference


def stitch(atlas: Atlas, luxels: Luxels, pages: Array, angle: float = ANGLE, valid: Array | None = None) -> Array:
    """Let the light agree along all seams: of charts that share an edge, and of objects that touch.

    Args:
        atlas: Scene and pages.
        luxels: Which texels are luxels.
        pages: (p, h, w, c) float32, not negative, with a value in at least one texel around the charts (`lightmap.dilate`); not changed.
        angle: Degrees between shading normals up to which two sides are one surface.
        valid: (n,) bool: luxels that are not inside solids; None: all.

    Returns:
        (p, h, w, c) float32, not negative.
    """
    pages = checked(pages, (*luxels.shape, "c"), np.float32, "pages").copy()
    seams = find_seams(atlas, angle)
    if not len(seams.page):
        return pages
    piece, t = _samples(seams, luxels.shape)
    points = _between(seams.start[piece], seams.end[piece], t[:, :, None]) * np.array(atlas.size, np.float64)
    sides = [_bilinear(seams.page[piece, side], points[:, side], luxels.shape) for side in (0, 1)]
    page, row, column = luxels.texel.T.astype(np.int64)
    number = np.full(pages[..., 0].size, -1, np.int32)
    number[(page * luxels.shape[1] + row) * luxels.shape[2] + column] = np.arange(len(row))
    joined = _joined(atlas, luxels, seams, piece, t, [number[side[0]] for side in sides], valid)
    sides = [(texels[joined], weights[joined]) for texels, weights in sides]
    if not len(sides[0][0]):
        return pages
    texels, columns = np.unique(np.concatenate([side[0] for side in sides], 1), return_inverse=True)
    columns = columns.reshape(len(sides[0][0]), 2, 4)
    weights = np.stack([sides[0][1], -sides[1][1]], 1)
    flat = pages.reshape(-1, pages.shape[-1])
    keep = np.where(number[texels] >= 0, _KEEP, _KEEP_GUTTER)
    flat[texels] = np.maximum(_agree(columns.reshape(-1, 8), weights.reshape(-1, 8), flat[texels].astype(np.float64), keep), 0)
    return pages


def _samples(seams: Seams, shape: tuple[int, int, int]) -> tuple[Array, Array]:
    """For k points along the seams: (k,) int64 their pieces, and (k, 1) float64 where on them they are, 0..1."""
    size = np.array([shape[2], shape[1]], np.float64)
    length = np.linalg.norm((seams.end - seams.start) * size, axis=2).max(1)
    count = np.clip(np.ceil(length * _A_TEXEL) + 1, 2, _MOST).astype(np.int64)
    piece = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    return piece, (step / (count[piece] - 1))[:, None]


def _between(start: Array, end: Array, t: Array) -> Array:
    return start * (1 - t) + end * t


def _joined(atlas: Atlas, luxels: Luxels, seams: Seams, piece: Array, t: Array, rows: list[Array], valid: Array | None) -> Array:
    """(k,) bool: samples whose two sides see each other, just above the surface and from the luxels that they would change.

    A sample with luxels inside solids on both sides does not count: nobody sees the seam there, and through the solid's inside its sides would.

    Args:
        piece, t: Of `_samples`.
        rows: Of both sides, (k, 4) int32: the luxels that the samples read, -1 where they read another texel.
    """
    place = _between(seams.place[piece, 0], seams.place[piece, 1], t)
    ways, solid = [], np.full(len(piece), valid is not None)
    for side, row in enumerate(rows):
        own = (row >= 0) & (luxels.chart[row] == seams.chart[piece, side, None])
        ways.append(_BEYOND * _deepest(luxels.position, np.where(own, row, -1), place, seams.inward[piece, side]))
        if valid is not None:
            solid &= own.any(1) & ~(own & valid[row]).any(1)
    normal = _between(seams.normal[piece, 0], seams.normal[piece, 1], t)
    lift = _LIFT * np.linalg.norm(ways[1] - ways[0], axis=1)
    ends = [place + way + (lift + np.maximum(-(way * normal).sum(1), 0))[:, None] * normal for way in ways]  # no lower than the ridge of a bend
    geometry = flatten(atlas.scene, "none")
    return ~solid & visible(obstacles(geometry, scene_masks(atlas.scene, geometry)), ends[0], ends[1], 1)


def _deepest(position: Array, rows: Array, place: Array, inward: Array) -> Array:
    """(k, 3) float64, metres: from samples at `place` to the one of their luxels, `rows` (k, 4), that is deepest in their side; 0 if none is."""
    way, most = np.zeros(place.shape), np.zeros(len(place))
    for row in rows.T:
        to = position[row] - place
        depth = (to * inward).sum(1)
        better = (row >= 0) & (depth > most)
        way[better], most[better] = to[better], depth[better]
    return way


def _bilinear(page: Array, point: Array, shape: tuple[int, int, int]) -> tuple[Array, Array]:
    """The four texels around points (k, 2), in texels of their page, and how much each counts; clamped at the border."""
    corner = np.floor(point - 0.5)
    part = point - 0.5 - corner
    columns = np.clip(corner[:, :1] + [0, 1, 0, 1], 0, shape[2] - 1).astype(np.int64)
    rows = np.clip(corner[:, 1:] + [0, 0, 1, 1], 0, shape[1] - 1).astype(np.int64)
    x = np.stack([1 - part[:, 0], part[:, 0]], 1)[:, [0, 1, 0, 1]]
    y = np.stack([1 - part[:, 1], part[:, 1]], 1)[:, [0, 0, 1, 1]]
    return (page[:, None].astype(np.int64) * shape[1] + rows) * shape[2] + columns, x * y


def _agree(columns: Array, weights: Array, values: Array, keep: Array) -> Array:
    """`values` (m, c) with the least change, weighted by `keep` (m,), such that every row of `weights` (k, 8) sums to nearly nothing.

    Least |S (x + d)|^2 + sum(keep d^2): (S'S + keep) d = -S'S x. The unknowns form chains along the seams, so a factorisation stays sparse.
    """
    from scipy.sparse import csr_array, diags_array
    from scipy.sparse.linalg import splu

    k, m = len(columns), len(values)
    matrix = csr_array((weights.reshape(-1), columns.reshape(-1), np.arange(0, 8 * k + 1, 8)), (k, m))
    matrix.sum_duplicates()
    square = (matrix.T @ matrix).tocsr()
    factors = splu((square + diags_array(keep)).tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return values - factors.solve(square @ values)
