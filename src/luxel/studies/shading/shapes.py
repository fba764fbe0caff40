"""Triangles to measure with, of a given area and shape, anywhere between pixels."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.raster.constants import SUBPIXEL
from luxel.studies.shading.fill import Triangle, triangle
from luxel.studies.shading.fixed import VALUE_BITS

SHAPES = ("any", "even", "thin")
"""Three points of a square, at random; corners an even number of pixels apart, as midlines ask for; two pixels wide, in any direction."""


def corners_of(rng: np.random.Generator, area: float, shape: str = "any") -> Array:
    """(3, 2) int64 corners in 1/256 pixel of a triangle of about `area` pixels; all coordinates are positive."""
    while True:
        if shape == "thin":
            length, angle = area, rng.uniform(0, 2 * np.pi)  # two pixels wide at its base
            along = np.array([np.cos(angle), np.sin(angle)])
            across = np.array([-along[1], along[0]])
            points = np.stack([0 * along, length * along + across, length * along - across])
        else:
            points = rng.random((3, 2))
            (ux, uy), (vx, vy) = points[1:] - points[0]
            size = abs(ux * vy - uy * vx) / 2
            if size < 0.02:  # a needle, which would be larger than the screen
                continue
            points = points * np.sqrt(area / size)
        points = points - points.min(0) + rng.random(2)
        whole = np.round(points / 2) * 2 if shape == "even" else points
        corners = np.round(whole * SUBPIXEL).astype(np.int64)
        (ux, uy), (vx, vy) = (corners[1:] - corners[0]).tolist()
        if ux * vy != uy * vx:
            return corners


def random_triangle(rng: np.random.Generator, area: float, shape: str = "any") -> Triangle:
    """One of `corners_of`, with an intensity of 0 to 255 at each corner."""
    return triangle(corners_of(rng, area, shape), rng.integers(0, 255 << VALUE_BITS, (3, 1), endpoint=True))


def span(length: int) -> Triangle:
    """A triangle that covers so many pixels, all in one row; from black to white."""
    return triangle([[0, 0], [SUBPIXEL * length, SUBPIXEL // 2], [0, SUBPIXEL - 1]], [[0], [255 << VALUE_BITS], [0]])


def flat_triangle(rng: np.random.Generator, length: int, rows: int = 6) -> Triangle:
    """A triangle some rows high whose longest row has about `length` pixels."""
    height = rows * SUBPIXEL
    corners = [[0, 0], [length * SUBPIXEL + int(rng.integers(SUBPIXEL)), height // 2], [int(rng.integers(SUBPIXEL)), height]]
    return triangle(corners, rng.integers(0, 255 << VALUE_BITS, (3, 1), endpoint=True))


def glossy_triangle(rng: np.random.Generator, area: float) -> Triangle:
    """One with a unit normal at each corner, up to 40 degrees from the viewer's direction."""
    tilt, around = rng.uniform(0, np.radians(40), 3), rng.uniform(0, 2 * np.pi, 3)
    normals = np.stack([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)], 1)
    return triangle(corners_of(rng, area), np.round(normals * 2**VALUE_BITS).astype(np.int64))
