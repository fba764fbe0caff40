"""Overlap: whether parts of a lightmap page are covered twice. The rasteriser counts."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.raster.bin import NO_CLIPPED, OPAQUE, Parts, bin_triangles
from luxel.raster.constants import sample_pattern
from luxel.raster.cover import cover
from luxel.raster.lanes import LANES
from luxel.raster.project import Window

_TILE, _SAMPLES = 64, 16


def overlap(triangles: Array, screen: Array, size: tuple[int, int], threads: int) -> tuple[int, int]:
    """How many samples, 16 a texel, the triangles of a page cover, and how many of them twice or more often.

    Triangles that share an edge share no sample, so what is counted twice does overlap.

    Args:
        triangles: (m, 3) int32.
        screen: (n, 4) int32, from `place_vertices`.
        size: Width and height of the page, texels.
    """
    if not len(triangles):
        return 0, 0
    window, pattern = Window(0, 0, *size, *size), sample_pattern(_SAMPLES)
    parts = Parts(np.array([0, len(triangles)], np.int32), np.array([OPAQUE], np.int32), np.zeros(1, np.int32))
    bins = bin_triangles(triangles, screen, NO_CLIPPED, parts, OPAQUE, pattern, window, _TILE, threads)
    counts = np.empty((bins.across, _SAMPLES * _TILE * _TILE + LANES), np.int32)
    no_depths = np.empty((0, counts.shape[1]), np.float32)
    covered = twice = 0
    rows = np.arange(_TILE)
    for down in range(bins.down):  # a row of tiles at a time: a page of samples is large
        first = down * bins.across
        cover(bins, triangles, screen, NO_CLIPPED, pattern, *size, first, first + bins.across, counts, no_depths, threads, True, True)
        picture = counts[:, :-LANES].reshape(bins.across, _SAMPLES, _TILE, _TILE)[:, :, rows + down * _TILE < size[1]]
        beyond = bins.across * _TILE - size[0]
        for tile in (picture[:-1], picture[-1:, :, :, : _TILE - beyond]):  # beyond the page's right border nothing is defined
            covered, twice = covered + int(np.count_nonzero(tile)), twice + int(np.count_nonzero(tile > 1))
    return covered, twice
