"""Shading "hardware": visible samples get their Gouraud colours from the model of the hardware interpolator, bit for bit (`luxel.hardware`).

What is seen, and in which order it is composited, is the rasteriser's; the interpolator takes the place of fragments, textures and light. It has
no perspective: colours are linear on the screen. Alpha takes a fourth channel like the others.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from luxel.arrays import Array
from luxel.errors import LuxelWarning
from luxel.hardware import float24
from luxel.hardware.scan import CENTRE
from luxel.raster.bin import Bins, Clipped
from luxel.raster.constants import SUBPIXEL
from luxel.raster.geometry import Geometry
from luxel.scene.scene import Scene

Interpolate = Callable[[Array, Array, Array, Array, Array], Array]
"""Of corners, colors, x, y and triangle the words of fragments, as `luxel.hardware.interpolator.shade`."""


def check(scene: Scene) -> None:
    """Tell of what the interpolator leaves out."""
    used = {mesh.material for mesh in scene.meshes}
    textured = [m.name or f"material {i}" for i, m in enumerate(scene.materials) if i in used and m.base_color_texture is not None]
    if textured:
        names = ", ".join(textured[:3]) + (" ..." if len(textured) > 3 else "")
        warnings.warn(f"shading hardware: the interpolator has no textures; left out: those of {names}", LuxelWarning, stacklevel=4)


def shade(interpolate: Interpolate, bins: Bins, occupied: Array, first_tile: int, last_tile: int, width: int, height: int, ids: Array,
          pattern: Array, every_sample: bool, geometry: Geometry, screen: Array, clipped: Clipped, blend: bool, samples: Array, threads: int) -> None:
    """Lay the visible triangles of tiles first_tile .. last_tile - 1 over what their samples hold.

    A pixel whose samples are all one triangle's is shaded once, at its centre, unless `every_sample`; others at every sample.

    Args:
        interpolate: Colours of fragments; `luxel.hardware.interpolator.shade`, or what stands for it.
        bins, occupied, width, height: The tiles of the window, which of them may hold something, and the pixels of the window.
        ids, pattern, every_sample, geometry, screen, clipped: What is visible, as in `luxel.raster.shade.shade` (`Samples`, `Drawn`).
        blend: Alpha counts; else what is drawn is opaque.
        samples: (tiles, 4 * s * tile * tile) float32, premultiplied, planar: `Target.samples`.
        threads: How many to use; NumPy lets go of the interpreter's lock.
    """
    tile, count = bins.tile, len(pattern)
    row, column = np.divmod(np.arange(tile * tile), tile)

    def shade_tile(number: int) -> None:
        down, across = divmod(number, bins.across)
        x, y = across * tile + column, down * tile + row
        seen = ids[number - first_tile, : count * tile * tile].reshape(count, -1)
        held = samples[number - first_tile].reshape(4, count, -1)
        there = (seen >= 0) & (x < width) & (y < height)
        if count > 1 and not every_sample:
            whole = there.all(0) & (seen == seen[0]).all(0)
            pixel = np.flatnonzero(whole)
            colors = _colors(interpolate, seen[0, pixel], x[pixel] * SUBPIXEL + CENTRE, y[pixel] * SUBPIXEL + CENTRE, geometry, screen, clipped)
            for each in range(count):
                _lay_over(held, each, pixel, colors, blend)
            there &= ~whole
        sample, pixel = np.nonzero(there)
        place = x[pixel] * SUBPIXEL + pattern[sample, 0], y[pixel] * SUBPIXEL + pattern[sample, 1]
        _lay_over(held, sample, pixel, _colors(interpolate, seen[sample, pixel], *place, geometry, screen, clipped), blend)

    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(shade_tile, np.flatnonzero(occupied[first_tile:last_tile]) + first_tile):
            pass  # what a thread raises is raised here


def _colors(interpolate: Interpolate, ids: Array, x: Array, y: Array, geometry: Geometry, screen: Array, clipped: Clipped) -> Array:
    """(n, 4) float32: straight colours of the triangles `ids` at fixed-point positions."""
    known, triangle = np.unique(ids, return_inverse=True)
    m = len(geometry.triangles)
    cut = known >= m
    source = np.where(cut, 0, known)
    source[cut] = clipped.source[known[cut] - m]
    vertices = geometry.triangles[source]
    corners, colors = screen[vertices, :2].astype(np.int64), geometry.colors[vertices].astype(np.float64)
    corners[cut] = clipped.screen[known[cut] - m, :, :2]
    colors[cut] = clipped.corners[known[cut] - m].astype(np.float64) @ colors[cut]
    words = interpolate(corners, float24.from_float(colors), x, y, triangle)
    return float24.to_float(words).astype(np.float32)


def _lay_over(held: Array, sample: Array | int, pixel: Array, colors: Array, blend: bool) -> None:
    """Composite colours (n, 4) over samples of `held` (4, s, pixels); light below zero, which alpha below zero can make, is none."""
    alpha = np.clip(colors[:, 3], 0, 1) if blend else np.ones(len(colors), np.float32)
    for channel in range(4):
        value = alpha if channel == 3 else np.maximum(colors[:, channel], 0) * alpha
        held[channel, sample, pixel] = value + held[channel, sample, pixel] * (1 - alpha)
