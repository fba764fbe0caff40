"""Stitching: what lies on both sides of a seam shows the same light there.

Along each seam, points are sampled on both sides as a renderer does, bilinearly; the difference is to vanish, with the least change of the
texels that take part (Iwanicki 2013, "Lighting technology of The Last of Us", SIGGRAPH; least squares over all seams at once). Texels of
the gutter, which nothing but such samples shows, may change more than luxels. Texels that no seam's sample touches stay as they are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from luxel.arrays import Array, checked
from luxel.radiosity.edges import ANGLE, Seams, find_seams

if TYPE_CHECKING:
    from luxel.radiosity.luxels import Luxels
    from luxel.radiosity.unwrap import Atlas

_A_TEXEL = 4  # samples along a seam for each texel of its finer side
_MOST = 8192  # samples along one piece
_KEEP, _KEEP_GUTTER = 1e-3, 1e-4  # weight of a texel's change, squared, beside that of a sample's difference


def stitch(atlas: Atlas, luxels: Luxels, pages: Array, angle: float = ANGLE) -> Array:
    """Let the light agree along all seams: of charts that share an edge, and of objects that touch.

    Args:
        atlas: Scene and pages.
        luxels: Which texels are luxels.
        pages: (p, h, w, c) float32, not negative, with a value in at least one texel around the charts (`lightmap.dilate`); not changed.
        angle: Degrees between shading normals up to which two sides are one surface.

    Returns:
        (p, h, w, c) float32, not negative.
    """
    pages = checked(pages, (*luxels.shape, "c"), np.float32, "pages").copy()
    seams = find_seams(atlas, angle)
    if not len(seams.page):
        return pages
    sides = _samples(seams, luxels.shape)
    texels, columns = np.unique(np.concatenate([side[0] for side in sides], 1), return_inverse=True)
    columns = columns.reshape(len(sides[0][0]), 2, 4)
    weights = np.stack([sides[0][1], -sides[1][1]], 1)
    flat = pages.reshape(-1, pages.shape[-1])
    page, row, column = luxels.texel.T.astype(np.int64)
    inside = np.zeros(len(flat), bool)
    inside[(page * luxels.shape[1] + row) * luxels.shape[2] + column] = True
    keep = np.where(inside[texels], _KEEP, _KEEP_GUTTER)
    flat[texels] = np.maximum(_agree(columns.reshape(-1, 8), weights.reshape(-1, 8), flat[texels].astype(np.float64), keep), 0)
    return pages


def _samples(seams: Seams, shape: tuple[int, int, int]) -> list[tuple[Array, Array]]:
    """Of both sides, for k points along the seams: (k, 4) int64 texels, numbered over all pages, and (k, 4) float64 weights."""
    size = np.array([shape[2], shape[1]], np.float64)
    length = np.linalg.norm((seams.end - seams.start) * size, axis=2).max(1)
    count = np.clip(np.ceil(length * _A_TEXEL) + 1, 2, _MOST).astype(np.int64)
    piece = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    t = (step / (count[piece] - 1))[:, None]
    return [
        _bilinear(seams.page[piece, side], (seams.start[piece, side] * (1 - t) + seams.end[piece, side] * t) * size, shape)
        for side in (0, 1)
    ]


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
