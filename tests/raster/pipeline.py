"""The stages of the rasteriser one by one, for tests that count how often samples are hit."""

from typing import NamedTuple

import numpy as np
from covering import draw

from luxel.raster.bin import NO_CLIPPED, Clipped
from luxel.raster.clip import clip
from luxel.raster.constants import UNSAFE
from luxel.raster.project import View, Window, project
from luxel.scene.camera import Camera


def view_of(camera, size):
    return View(camera.clip_from_world(size), camera.near / camera.far if camera.yfov is not None else 0.0)


def pixel_camera(size, near=-1.0, far=1.0):
    """Orthographic: world x, y are pixels of the picture, y up from its lower border; z = 1 is nearest."""
    width, height = size
    return Camera(np.array([[1.0, 0, 0, width / 2], [0, 1, 0, height / 2], [0, 0, 1, 0], [0, 0, 0, 1]]), yfov=None, height=height, near=near, far=far)


class Drawn(NamedTuple):
    """What is drawn after clipping: fixed-point corners (k, 3, 2), depths and weights (k, 3), source triangles (k,), and clip's result."""

    corners: np.ndarray
    depths: np.ndarray
    weights: np.ndarray
    source: np.ndarray
    clipped: Clipped
    unsafe: int


def drawn(positions, triangles, camera, size, window=None, threads=1):
    positions, triangles = np.ascontiguousarray(positions, np.float32), np.ascontiguousarray(triangles, np.int32)
    view, window = view_of(camera, size), window or Window(0, 0, *size, *size)
    screen, unsafe = project(positions, view, window, threads)
    clipped = clip(positions, triangles, screen, view, window, threads) if unsafe else NO_CLIPPED
    safe = np.nonzero((screen[triangles, 0] != UNSAFE).all(1))[0]
    everything = np.concatenate([screen[triangles[safe]], clipped.screen])
    floats = everything.view(np.float32)
    return Drawn(everything[..., :2].astype(np.int64), floats[..., 2].copy(), floats[..., 3].copy(), np.append(safe, clipped.source), clipped, unsafe)


def signed_hits(corners, pattern, size):
    """(s, height, width): at each sample, the number of triangles seen from the front less that of those seen from behind."""
    (width, height), hits = size, 0
    low, high = corners.min(1), corners.max(1)
    seen = ((high >= 0) & (low <= np.array(size) * 256)).all(1)
    hits = np.zeros((len(pattern), height, width), np.int64)
    for triangle in corners[seen]:
        hits += front(triangle) * (draw(triangle[None], np.ones((1, 3), np.float32), pattern, width, height)[0] >= 0)
    return hits


def front(corners):
    (x0, y0), (x1, y1), (x2, y2) = corners.tolist()
    area = (x2 - x0) * (y1 - y0) - (x1 - x0) * (y2 - y0)
    return (area > 0) - (area < 0)


def jittered_grid(rng, columns, rows, jitter=0.45):
    """A triangulation of the unit square with corners moved by up to `jitter` of a cell and random diagonals: points (n, 2), triangles (m, 3)
    counter-clockwise."""
    x, y = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    points = np.stack([x, y], -1)
    move = rng.uniform(-jitter / 2, jitter / 2, points.shape) / [columns, rows]
    move[:, [0, -1], 0] = 0
    move[[0, -1], :, 1] = 0
    number = np.arange(points[..., 0].size).reshape(rows + 1, columns + 1)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    one = rng.random(len(a)) < 0.5
    first = np.where(one, [a, b, c], [a, b, d]).T
    second = np.where(one, [a, c, d], [b, c, d]).T
    return (points + move).reshape(-1, 2), np.concatenate([first, second]).astype(np.int32)
