"""Triangles given by fixed-point corners, drawn by `bin_triangles` and `cover`, for comparison with the slow oracle."""

import numpy as np

from luxel.raster.bin import NO_CLIPPED, OPAQUE, Parts, bin_triangles
from luxel.raster.constants import sample_pattern
from luxel.raster.cover import cover
from luxel.raster.lanes import LANES
from luxel.raster.project import Window
from luxel.raster.render import Options

PATTERNS = {f"standard-{n}": sample_pattern(n) for n in (1, 2, 4, 8, 16)} | {"grid-4": sample_pattern(4, "grid")}
PATTERNS |= {f"ssaa-{n}": Options(ssaa=n).positions for n in (2, 3, 4, 8)}


def screen_of(corners, depths):
    """What `project` would give for the corners (n, 3, 2) and depths (n, 3): triangles and screen."""
    screen = np.zeros((3 * len(corners), 4), np.int32)
    screen[:, :2] = np.reshape(corners, (-1, 2))
    screen.view(np.float32)[:, 2] = np.reshape(depths, -1)
    screen.view(np.float32)[:, 3] = 1
    return np.arange(len(screen), dtype=np.int32).reshape(-1, 3), screen


def draw(corners, depths, pattern, width, height, tile=64, threads=1, cull=False):
    """ids (s, height, width) and depths of the nearest triangles, as `reference_cover` gives them."""
    triangles, screen = screen_of(corners, depths)
    parts = Parts(np.array([0, len(triangles)], np.int32), np.array([OPAQUE], np.int32), np.array([cull], np.int32))
    bins = bin_triangles(triangles, screen, NO_CLIPPED, parts, OPAQUE, pattern, Window(0, 0, width, height, width, height), tile, threads)
    return draw_bins(bins, triangles, screen, NO_CLIPPED, pattern, width, height, threads)


def draw_bins(bins, triangles, screen, clipped, pattern, width, height, threads=1):
    tiles, size = bins.across * bins.down, len(pattern) * bins.tile**2 + LANES
    ids, depths = np.empty((tiles, size), np.int32), np.empty((tiles, size), np.float32)
    cover(bins, triangles, screen, clipped, pattern, width, height, 0, tiles, ids, depths, threads, True)
    return untile(ids, bins, len(pattern), width, height), untile(depths, bins, len(pattern), width, height)


def untile(values, bins, samples, width, height):
    """From (tiles, samples * tile * tile + spare) to (samples, height, width)."""
    tile = bins.tile
    values = values[:, : samples * tile * tile].reshape(bins.down, bins.across, samples, tile, tile)
    return values.transpose(2, 0, 3, 1, 4).reshape(samples, bins.down * tile, bins.across * tile)[:, :height, :width].copy()


def random_triangles(rng, count, low, high):
    """corners (count, 3, 2) with coordinates low .. high (scalars or (2,), 1/256 pixel) and depths (count, 3) between 0 and 1."""
    return rng.integers(low, high, (count, 3, 2), endpoint=True), rng.random((count, 3), np.float32)
