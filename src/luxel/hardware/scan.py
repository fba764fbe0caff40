"""Scan conversion over 8x8 blocks (module 3 of the hardware paper): which fragments a triangle has, in which order, and its edge functions there.

Coverage is luxel's own: corners in 1/256 pixel, y down, exact edge functions, the top-left rule (`luxel.raster.edge`), one sample at the
pixel's centre. All values are integers: with corners of c bits an edge function has 2 c + 2 at most.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.fixed import GUARD_HIGH, GUARD_LOW, SUBPIXEL, SUBPIXEL_LOG2

BLOCK = 8
CENTRE = SUBPIXEL // 2
_CHUNK = 4096  # blocks at once, so that large triangles take little memory beside their fragments


@dataclass(frozen=True)
class Edges:
    """The edge functions e = a x + b y + c of triangles, at least 0 inside, whichever side is seen: those seen from behind are negated.

    Attributes:
        a, b, c: (..., 3) int64. Edge i is opposite corner i, and takes the value `area` there.
        bias: (..., 3) int64: 0 where samples on the edge belong to the triangle (a left or a top edge), else -1.
        area: (...,) int64: twice the area, in 1/65536 square pixel, at least 0; a triangle with 0 has no fragments.
        flipped: (...,) bool: it is seen from behind.
    """

    a: Array
    b: Array
    c: Array
    bias: Array
    area: Array
    flipped: Array

    def take(self, which: Array | int) -> Edges:
        """Those of some triangles."""
        return Edges(self.a[which], self.b[which], self.c[which], self.bias[which], self.area[which], self.flipped[which])

    def at(self, x: Array, y: Array) -> Array:
        """(..., 3) int64: the edge functions at fixed-point positions, without bias."""
        return self.a * np.asarray(x, np.int64)[..., None] + self.b * np.asarray(y, np.int64)[..., None] + self.c


def edges(corners: Array) -> Edges:
    """Set up triangles.

    Args:
        corners: (..., 3, 2) integers: x and y in 1/256 pixel, within the rasteriser's guard band.

    Raises:
        InputError: Not such an array, or a corner is outside the guard band.
    """
    p = np.asarray(corners)
    p = checked(p, (*p.shape[:-2], 3, 2), np.int64, "corners")
    if p.size and (p.min() < GUARD_LOW or p.max() > GUARD_HIGH):
        raise InputError(f"corners: expected {GUARD_LOW} .. {GUARD_HIGH} (1/256 pixel), got {p.min()} .. {p.max()}")
    x, y = p[..., 0], p[..., 1]
    following, last = [1, 2, 0], [2, 0, 1]
    a, b = y[..., last] - y[..., following], x[..., following] - x[..., last]
    area = b[..., 1] * a[..., 2] - b[..., 2] * a[..., 1]
    turn = np.where(area < 0, -1, 1)[..., None]
    a, b = a * turn, b * turn
    bias = np.where((a > 0) | ((a == 0) & (b > 0)), 0, -1)
    return Edges(a, b, -(a * x[..., following] + b * y[..., following]), bias, np.abs(area), area < 0)


class Blocks(NamedTuple):
    """The blocks that one triangle's bounding box touches, row by row.

    Attributes:
        x, y: (k,) int64 of each, in blocks.
        rejected: (k,) bool: an edge function is negative at all 64 centres.
        accepted: (k,) bool: no edge function is negative at any.
    """

    x: Array
    y: Array
    rejected: Array
    accepted: Array


class Fragments(NamedTuple):
    """The fragments of one triangle in the order in which they leave: blocks row by row, and in each its pixels row by row.

    Attributes:
        x, y: (n,) int64, pixels.
        edges: (n, 3) int64: the edge functions at their centres, without bias.
    """

    x: Array
    y: Array
    edges: Array


def blocks(corners: Array, width: int, height: int) -> Blocks:
    """Try the blocks of a triangle (3, 2) in a picture of width x height pixels, at two of its centres for each edge."""
    corners = checked(corners, (3, 2), np.int64, "corners")
    e, low, high = edges(corners), corners.min(0), corners.max(0)
    first = np.maximum(low - CENTRE + SUBPIXEL - 1 >> SUBPIXEL_LOG2, 0) // BLOCK
    last = np.minimum(high - CENTRE >> SUBPIXEL_LOG2, np.array([width, height]) - 1) // BLOCK
    if e.area == 0 or (last < first).any():
        last = first - 1
    y, x = (part.ravel() for part in np.mgrid[first[1] : last[1] + 1, first[0] : last[0] + 1])
    corner = e.at(x * (BLOCK * SUBPIXEL) + CENTRE, y * (BLOCK * SUBPIXEL) + CENTRE) + e.bias
    across, down = e.a * ((BLOCK - 1) * SUBPIXEL), e.b * ((BLOCK - 1) * SUBPIXEL)
    highest = corner + np.maximum(across, 0) + np.maximum(down, 0)
    lowest = corner + np.minimum(across, 0) + np.minimum(down, 0)
    return Blocks(x, y, (highest < 0).any(-1), (lowest >= 0).all(-1))


def scan(corners: Array, width: int, height: int) -> Fragments:
    """The fragments of a triangle (3, 2), corners as in `edges`, in a picture of width x height pixels."""
    e, tried = edges(corners), blocks(corners, width, height)
    kept = np.flatnonzero(~tried.rejected)
    parts = [_covered(e, tried, kept[first : first + _CHUNK], width, height) for first in range(0, max(len(kept), 1), _CHUNK)]
    return Fragments(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _covered(e: Edges, tried: Blocks, which: Array, width: int, height: int) -> Fragments:
    """The fragments in some of the blocks."""
    row, column = np.divmod(np.arange(BLOCK * BLOCK), BLOCK)
    x, y = (tried.x[which, None] * BLOCK + column).ravel(), (tried.y[which, None] * BLOCK + row).ravel()
    values = e.at(x * SUBPIXEL + CENTRE, y * SUBPIXEL + CENTRE)
    inside = (values + e.bias >= 0).all(-1) & (x < width) & (y < height)
    return Fragments(x[inside], y[inside], values[inside])
