"""Which pixels a triangle has: asked of luxel's rasteriser, whose rules are the only ones here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.raster.bin import NO_CLIPPED, OPAQUE, Bins, Parts, bin_triangles
from luxel.raster.constants import NOTHING, SUBPIXEL, sample_pattern
from luxel.raster.cover import cover
from luxel.raster.lanes import LANES
from luxel.raster.project import Window

_TILE = 64
_MOST = 4096  # pixels a side


class Binned(NamedTuple):
    """Triangles ready for `cover`."""

    bins: Bins
    triangles: Array
    screen: Array
    width: int
    height: int


def binned(corners: Array, width: int, height: int) -> Binned:
    """Triangles given by (n, 3, 2) integer corners in 1/256 pixel, sorted into the tiles of a picture; depths are all the same."""
    n = len(corners)
    screen = np.zeros((3 * n, 4), np.int32)
    screen[:, :2] = np.reshape(corners, (-1, 2))
    screen.view(np.float32)[:, 2:] = 1
    triangles = np.arange(3 * n, dtype=np.int32).reshape(-1, 3)
    parts = Parts(np.array([0, n], np.int32), np.array([OPAQUE], np.int32), np.zeros(1, np.int32))
    window = Window(0, 0, width, height, width, height)
    return Binned(bin_triangles(triangles, screen, NO_CLIPPED, parts, OPAQUE, sample_pattern(1), window, _TILE, 1), triangles, screen, width, height)


def tile_buffers(ready: Binned) -> tuple[Array, Array]:
    """What `cover` writes: ids of the tiles, and no depths."""
    return np.empty((ready.bins.across * ready.bins.down, _TILE * _TILE + LANES), np.int32), np.empty((0, 0), np.float32)


def cover_tiles(ready: Binned, ids: Array, depths: Array) -> None:
    """Run luxel's tile kernel, on one thread."""
    tiles = ready.bins.across * ready.bins.down
    cover(ready.bins, ready.triangles, ready.screen, NO_CLIPPED, sample_pattern(1), ready.width, ready.height, 0, tiles, ids, depths, 1, True)


def ids_of(corners: Array, width: int, height: int) -> Array:
    """(height, width) int32: which of the triangles, (n, 3, 2) integers in 1/256 pixel, covers a pixel's centre; -1 for none, the first of many."""
    ready = binned(corners, width, height)
    ids, depths = tile_buffers(ready)
    cover_tiles(ready, ids, depths)
    across, down = ready.bins.across, ready.bins.down
    tiles = ids[:, : _TILE * _TILE].reshape(down, across, _TILE, _TILE).transpose(0, 2, 1, 3)
    return np.ascontiguousarray(tiles.reshape(down * _TILE, across * _TILE)[:height, :width])


class Coverage(NamedTuple):
    """Pixels of a triangle: `mask` (h, w) bool begins at pixel (x, y)."""

    x: int
    y: int
    mask: Array

    @property
    def pixels(self) -> int:
        """How many there are."""
        return int(self.mask.sum())


def coverage(corners: Array, screen: tuple[int, int, int, int] | None = None) -> Coverage:
    """The pixels whose centres a triangle covers.

    Args:
        corners: (3, 2) integers, 1/256 pixel.
        screen: x0, y0, x1, y1: the pixels there are, to which the triangle is clipped; None, as many as it needs.

    Raises:
        InputError: The triangle is too large to be covered in one piece.
    """
    corners = np.asarray(corners, np.int64)
    low, high = corners.min(0) // SUBPIXEL, corners.max(0) // SUBPIXEL + 1
    if screen is not None:
        low, high = np.maximum(low, screen[:2]), np.minimum(high, screen[2:])
    width, height = (int(n) for n in high - low)
    if width <= 0 or height <= 0:
        return Coverage(int(low[0]), int(low[1]), np.zeros((0, 0), bool))
    if max(width, height) > _MOST:
        raise InputError(f"corners: expected a triangle of at most {_MOST} pixels a side, or a screen to clip it to; got {width} x {height}")
    mask = ids_of((corners - low * SUBPIXEL)[None], width, height) != NOTHING  # moved by whole pixels, which covers the same
    return Coverage(int(low[0]), int(low[1]), mask)


def spans_of(mask: Array) -> Array:
    """(rows, 3) int64: row, first and last pixel of the rows of a mask that have any; each is one run, as a triangle's are."""
    rows = np.nonzero(mask.any(1))[0]
    if not len(rows):
        return np.zeros((0, 3), np.int64)
    first = mask[rows].argmax(1)
    last = mask.shape[1] - 1 - mask[rows, ::-1].argmax(1)
    return np.stack([rows, first, last], 1).astype(np.int64)
