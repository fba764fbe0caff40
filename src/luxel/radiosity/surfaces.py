"""Surfaces as convex polygons: what form factors are integrated over.

Triangles of a surface that make flat convex quadrilaterals are taken together (`luxel.radiosity.merge`). Each polygon brings its quadrature points:
Gauss-Legendre of order 1, 2 and 3 over the bilinear patch of its corners (a triangle repeats its last corner).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.radiosity.merge import counts_of, merge
from luxel.scene.mesh import Mesh

RULES = (0, 1, 5, 14)
"""The points of order n are those from RULES[n - 1] to RULES[n] - 1."""


class Polygons(NamedTuple):
    """p convex polygons in space, those of a surface in a row.

    Attributes:
        corners: (p, 4, 3) float64, metres, counter-clockwise from the front; a triangle's last is there twice.
        sides: (p,) int32, 3 or 4.
        normal, centre: (p, 3) float64, of the front; centroid.
        radius, area: (p,) float64: largest distance of a corner from the centroid, metres; square metres.
        surface: (p,) int32, ascending.
        points: (p, 14, 4) float64: quadrature points and weights (square metres), see `RULES`.
        epsilon: (1,) float64, metres: what the rounding of positions can amount to.
    """

    corners: Array
    sides: Array
    normal: Array
    centre: Array
    radius: Array
    area: Array
    surface: Array
    points: Array
    epsilon: Array


def polygons_of(meshes: Sequence[Mesh]) -> Polygons:
    """The polygons of each mesh, one surface; triangles without area are left out.

    Raises:
        InputError: A vertex in use is not finite.
    """
    triangles, surfaces = [np.zeros((0, 3, 3))], [np.zeros(0, np.int32)]
    for number, mesh in enumerate(meshes):
        corners = np.asarray(mesh.positions, np.float64)[mesh.triangles]
        if not np.isfinite(corners).all():
            raise InputError(f"surface {number}: expected finite positions, got NaN or infinity")
        triangles.append(corners)
        surfaces.append(np.full(len(corners), number, np.int32))
    corners, surface = np.concatenate(triangles)[:, [0, 1, 2, 2]], np.concatenate(surfaces)
    wide = (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) != 0).any(1)
    merged = merge(corners[wide], surface[wide], rounding(corners))
    return measured(merged.corners, merged.group)


def obstacles_of(polygons: Polygons) -> tuple[Polygons, Array]:
    """The polygons merged over all surfaces, and (p,) int64: which of them each polygon is a part of."""
    merged = merge(polygons.corners.copy(), polygons.surface, float(polygons.epsilon[0]), across_groups=True)
    return measured(merged.corners, np.zeros(len(merged.corners), np.int32)), merged.owner


def rounding(corners: Array) -> float:
    """What the rounding of positions to float32 and of what is made from them can amount to, metres."""
    return float(np.abs(corners).max(initial=0.0)) * 2.0**-20


def measured(corners: Array, surface: Array) -> Polygons:
    """Polygons from their corners (p, 4, 3)."""
    cross = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    area = np.linalg.norm(cross, axis=1)
    normal = cross / np.maximum(area, 1e-300)[:, None]
    halves = [0.5 * np.linalg.norm(np.cross(corners[:, k] - corners[:, 0], corners[:, k + 1] - corners[:, 0]), axis=1) for k in (1, 2)]
    thirds = [(corners[:, 0] + corners[:, k] + corners[:, k + 1]) / 3 for k in (1, 2)]
    centre = sum(h[:, None] * t for h, t in zip(halves, thirds)) / np.maximum(area, 1e-300)[:, None]
    radius = np.linalg.norm(corners - centre[:, None], axis=2).max(1, initial=0.0)
    count = counts_of(corners)
    points = np.concatenate([np.concatenate([centre, area[:, None]], 1)[:, None], *(gauss_points(corners, n) for n in (2, 3))], 1)
    epsilon = np.array([rounding(corners)])
    return Polygons(np.ascontiguousarray(corners), count, normal, centre, radius, area, surface, np.ascontiguousarray(points), epsilon)


def gauss_points(corners: Array, order: int) -> Array:
    """(p, order^2, 4) points and weights of the Gauss-Legendre rule over the bilinear patches of (p, 4, 3) corners."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    nodes, weights = (nodes + 1) / 2, weights / 2
    u, v = (k.ravel()[None, :, None] for k in np.meshgrid(nodes, nodes, indexing="ij"))
    a, b, c, d = (corners[:, k, None] for k in range(4))
    places = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    sizes = np.linalg.norm(np.cross((1 - v) * (b - a) + v * (c - d), (1 - u) * (d - a) + u * (c - b)), axis=2)
    return np.concatenate([places, (sizes * np.outer(weights, weights).ravel())[..., None]], 2)
