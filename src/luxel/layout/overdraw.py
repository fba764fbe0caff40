"""Overdraw: how often the pixels that a mesh covers are shaded when its triangles are drawn in their order, with a depth test.

It is counted by luxel's rasteriser: `cover`, which counts where it else would write an id (a fragment that is as near as what is there passes,
as under GL_LEQUAL). So coverage and depth are the renderer's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.layout.checks import checked_triangles, whole
from luxel.raster.bin import NO_CLIPPED, OPAQUE, Parts, bin_triangles
from luxel.raster.constants import sample_pattern
from luxel.raster.cover import cover
from luxel.raster.lanes import LANES
from luxel.raster.project import View, Window, project
from luxel.scene.camera import Camera
from luxel.scene.transforms import look_at

SIZE = 256
"""Pixels: the side of the square picture that is counted."""

VIEWS = 26
"""Directions on a Fibonacci sphere, beside those of the six axes."""

_TILE = 64


class Overdraw(NamedTuple):
    """Shaded over covered pixels.

    Attributes:
        mean: Over the views. Best: 1, every pixel is shaded once. Worst: the mesh's depth complexity, drawn back to front.
        worst: Of the views.
        shaded: Fragments that passed the depth test, in all views.
        covered: Pixels covered, in all views.
    """

    mean: float
    worst: float
    shaded: int
    covered: int


def directions(count: int = VIEWS) -> Array:
    """(6 + count, 3) float64 unit vectors: the six axes, and `count` evenly on the sphere along a Fibonacci spiral."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / max(count, 1)
    angle, radius = k * np.pi * (3 - np.sqrt(5.0)), np.sqrt(1 - z * z)
    return np.concatenate([np.eye(3), -np.eye(3), np.stack([radius * np.cos(angle), radius * np.sin(angle), z], 1)])


def overdraw(triangles: object, positions: object, views: int = VIEWS, cull: bool | Array = True, size: int = SIZE,
             threads: int | None = None) -> Overdraw:  # fmt: skip
    """Draw the triangles in their order from many sides, orthographically, and count.

    Args:
        triangles: (m, 3) int32.
        positions: (n, 3) float32.
        views: How many directions, beside the six axes.
        cull: Leave out back faces, as is usual for closed meshes; or (m,) bool, of which triangles.
        size: Pixels a side.
        threads: None: all that the process may use. The result does not depend on it.

    Raises:
        InputError: An index is out of range, there are no triangles, or a position is not finite.
    """
    points = checked(positions, ("n", 3), np.float32, "positions")
    faces, _ = checked_triangles(triangles, len(points), empty=False)
    whole(size, "size", 1), whole(views, "views", 0)
    middle, radius = _ball(faces, points)
    parts = _parts(cull, len(faces))
    threads, window = jit.checked_threads(threads), Window(0, 0, size, size, size, size)
    ratios, shaded, covered = [], 0, 0
    for direction in directions(views):
        up = (0.0, 0.0, 1.0) if abs(direction[2]) < 0.9 else (0.0, 1.0, 0.0)
        camera = Camera(look_at(middle + 2 * radius * direction, middle, up), yfov=None, height=2.02 * radius, near=radius * 0.9, far=radius * 3.1)
        screen, _ = project(points, View(camera.clip_from_world((size, size)), 0.0), window, threads)
        seen = _counted(faces, screen, parts, window, threads)
        if seen[1]:
            ratios.append(seen[0] / seen[1])
        shaded, covered = shaded + seen[0], covered + seen[1]
    return Overdraw(float(np.mean(ratios)), max(ratios), shaded, covered) if ratios else Overdraw(1.0, 1.0, 0, 0)


def _ball(faces: Array, points: Array) -> tuple[Array, float]:
    """Middle and radius of a ball around the vertices used."""
    used = np.zeros(len(points), bool)
    used[faces.ravel()] = True
    corners = points[used].astype(np.float64)
    if not np.isfinite(corners).all():
        raise InputError(f"positions: {np.count_nonzero(~np.isfinite(corners).all(1))} vertices that triangles use are not finite")
    middle = (corners.min(0) + corners.max(0)) / 2
    radius = float(np.sqrt(((corners - middle) ** 2).sum(1).max()))
    return middle, max(radius, 1e-30 + 1e-6 * float(np.abs(middle).max()))


def _parts(cull: bool | Array, m: int) -> Parts:
    """Runs of triangles whose back faces are drawn, or not."""
    culls = np.broadcast_to(np.asarray(cull, bool), m)
    start = np.flatnonzero(np.r_[True, culls[1:] != culls[:-1]])
    return Parts(np.append(start, m).astype(np.int32), np.full(len(start), OPAQUE, np.int32), culls[start].astype(np.int32))


def _counted(faces: Array, screen: Array, parts: Parts, window: Window, threads: int) -> tuple[int, int]:
    """Fragments that pass the depth test, and pixels covered, of triangles with vertices on `screen` (n, 4), from `project`."""
    pattern = sample_pattern(1)
    bins = bin_triangles(faces, screen, NO_CLIPPED, parts, OPAQUE, pattern, window, _TILE, threads)
    tiles = bins.across * bins.down
    counts = np.empty((tiles, _TILE * _TILE + LANES), np.int32)
    no_depths = np.empty((0, counts.shape[1]), np.float32)
    cover(bins, faces, screen, NO_CLIPPED, pattern, window.width, window.height, 0, tiles, counts, no_depths, threads, True, True)
    picture = counts[:, : _TILE * _TILE].reshape(bins.down, bins.across, _TILE, _TILE).swapaxes(1, 2).reshape(bins.down * _TILE, -1)
    picture = picture[: window.height, : window.width]
    return int(picture.sum(dtype=np.int64)), int(np.count_nonzero(picture))


def meshoptimizer_overdraw(triangles: object, positions: object, threads: int | None = None) -> Overdraw:
    """Overdraw in the definition of meshoptimizer's `meshopt_analyzeOverdraw`: three axes, front and back faces each in a picture of 256 x 256.

    Corners are snapped to 1/16 pixel as it does, so coverage is the same; depth is interpolated by luxel, which can decide otherwise where
    surfaces meet. (Its older releases, the Python wheel's among them, interpolate depth by a wrong gradient: they count other figures on what is
    not parallel to the axes.) `mean` is shaded over covered of all pictures together, `worst` of one of the six.

    Raises:
        InputError: As of `overdraw`.
    """
    points = checked(positions, ("n", 3), np.float32, "positions")
    faces, _ = checked_triangles(triangles, len(points), empty=False)
    _ball(faces, points)  # finite
    low = points.min(0)
    extent = np.float32((points - low).max())
    scaled = (points - low) * (np.float32(SIZE) / extent if extent > 1e-35 else np.float32(0))
    window, threads = Window(0, 0, SIZE, SIZE, SIZE, SIZE), jit.checked_threads(threads)
    shaded, covered, worst = 0, 0, 1.0
    for axes in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        x, y, z = (np.ascontiguousarray(scaled[:, axis]) for axis in axes)
        (x1, x2, x3), (y1, y2, y3) = x[faces].T, y[faces].T
        back = (x2 - x1) * (y3 - y1) - (y2 - y1) * (x3 - x1) > 0
        screen = np.zeros((len(points), 4), np.int32)
        screen[:, 0], screen[:, 1] = (np.floor(16 * c + np.float32(0.5)).astype(np.int32) * 16 for c in (x, y))
        for side, depth in ((faces[~back], z), (faces[back][:, ::-1], SIZE - z)):
            screen.view(np.float32)[:, 2] = depth
            seen = _counted(np.ascontiguousarray(side), screen, _parts(True, len(side)), window, threads) if len(side) else (0, 0)
            shaded, covered = shaded + seen[0], covered + seen[1]
            worst = max(worst, seen[0] / max(seen[1], 1))
    return Overdraw(shaded / max(covered, 1) if covered else 1.0, worst, shaded, covered)
