"""Exact, analytic area coverage: what a pixel of a picture of flat triangles ought to show, without any sampling.

A pixel's square is cut along the edges of the triangles, front to back; what lies inside is the triangle's, what lies outside goes on to
those behind it (Catmull, "A hidden-surface algorithm with anti-aliasing", 1978). Pixels that no edge crosses are found first, all at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError

if TYPE_CHECKING:
    from luxel.scene.camera import Camera

Polygon = list[tuple[float, float]]


def visible_areas(triangles: object, size: tuple[int, int]) -> tuple[Array, Array]:
    """How much of each pixel each triangle shows.

    Args:
        triangles: (m, 3, 2) corners in pixels, x to the right and y down, the nearest first: none may cut through another.
        size: Width and height of the picture.

    Returns:
        (h, w, m) float64 areas, and (h, w) bool: the edge pixels, in which they are neither 0 nor 1.
    """
    corners = checked(triangles, ("m", 3, 2), np.float64, "triangles")
    if not np.isfinite(corners).all():
        raise InputError("triangles: expected finite corners, got some that are not")
    width, height = size
    areas = np.zeros((height, width, len(corners)))
    crossed = np.zeros((height, width), bool)
    hidden = np.zeros((height, width), bool)  # by a triangle that covers the whole pixel, with nothing partial before it
    turned = [_positive(triangle) for triangle in corners]
    for k, triangle in enumerate(turned):
        if _doubled(triangle) == 0:
            continue
        whole, part = _whole_and_part(triangle, width, height)
        areas[..., k] = whole & ~hidden & ~crossed
        crossed |= part & ~hidden
        hidden |= whole & ~crossed
    for y, x in np.argwhere(crossed):
        areas[y, x] = _pixel(turned, int(x), int(y))
    return areas, np.logical_and((areas > 0).any(-1), (areas < 1 - 1e-12).all(-1))


def exact_picture(triangles: object, colors: object, background: object, size: tuple[int, int]) -> tuple[Array, Array]:
    """(h, w, c) linear light of flat triangles, and the edge pixels; `colors` is (m, c) and `background` (c,), the rest as of `visible_areas`."""
    areas, edges = visible_areas(triangles, size)
    shade, behind = np.asarray(colors, np.float64), np.asarray(background, np.float64)
    return areas @ shade + (1 - areas.sum(-1, keepdims=True)) * behind, edges


def on_screen(positions: object, camera: Camera, size: tuple[int, int]) -> tuple[Array, Array]:
    """Where points (..., 3) stand in the picture, (..., 2) pixels, and how far they are (...,), along the view axis."""
    points = np.asarray(positions, np.float64)
    clip = np.concatenate([points, np.ones((*points.shape[:-1], 1))], -1) @ camera.clip_from_world(size).T
    w = clip[..., 3]
    if not (w > 0).all():
        raise InputError("on_screen: expected points before the camera, got some behind it")
    place = clip[..., :2] / w[..., None]
    return np.stack([(place[..., 0] + 1) * size[0] / 2, (1 - place[..., 1]) * size[1] / 2], -1), w


def _positive(triangle: Array) -> Array:
    return triangle if _doubled(triangle) >= 0 else triangle[::-1]


def _doubled(triangle: Array) -> float:
    """Twice the area, positive where the corners go round one way."""
    (ax, ay), (bx, by), (cx, cy) = triangle
    return float((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


def _whole_and_part(triangle: Array, width: int, height: int) -> tuple[Array, Array]:
    """Pixels wholly inside a triangle, and those that it may cover in part."""
    y, x = np.mgrid[: height + 1, : width + 1].astype(np.float64)
    whole = np.ones((height, width), bool)
    outside = np.zeros((height, width), bool)
    for (ax, ay), (bx, by) in zip(triangle, np.roll(triangle, -1, 0), strict=True):
        side = (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0
        at_corners = side[:-1, :-1].astype(int) + side[1:, :-1] + side[:-1, 1:] + side[1:, 1:]
        whole &= at_corners == 4
        outside |= at_corners == 0
    low, high = np.floor(triangle.min(0)), np.ceil(triangle.max(0))
    outside |= (x[:-1, :-1] >= high[0]) | (x[:-1, :-1] + 1 <= low[0]) | (y[:-1, :-1] >= high[1]) | (y[:-1, :-1] + 1 <= low[1])
    return whole, ~whole & ~outside


def _pixel(triangles: list[Array], x: int, y: int) -> Array:
    """The visible area of each triangle in one pixel."""
    left: list[Polygon] = [[(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)]]
    areas = np.zeros(len(triangles))
    for k, triangle in enumerate(triangles):
        if _doubled(triangle) == 0:
            continue
        rest: list[Polygon] = []
        for polygon in left:
            inside = polygon
            for a, b in zip(triangle, np.roll(triangle, -1, 0), strict=True):
                outside = _cut(inside, b, a)
                inside = _cut(inside, a, b)
                if len(outside) > 2:
                    rest.append(outside)
                if len(inside) < 3:
                    break
            else:
                areas[k] += _area(inside)
        left = rest
    return areas


def _cut(polygon: Polygon, a: Array, b: Array) -> Polygon:
    """What of a convex polygon lies on the inner side of the line from a to b (Sutherland and Hodgman 1974)."""
    dx, dy = float(b[0] - a[0]), float(b[1] - a[1])
    sides = [dx * (y - a[1]) - dy * (x - a[0]) for x, y in polygon]
    out: Polygon = []
    for i, (x, y) in enumerate(polygon):
        j = i - 1
        if (sides[i] > 0) != (sides[j] > 0) and sides[i] != sides[j]:
            t = sides[j] / (sides[j] - sides[i])
            out.append((polygon[j][0] + t * (x - polygon[j][0]), polygon[j][1] + t * (y - polygon[j][1])))
        if sides[i] > 0:
            out.append((x, y))
    return out


def _area(polygon: Polygon) -> float:
    x0, y0 = polygon[0]  # relative to a corner, where digits are not lost
    points = [(x - x0, y - y0) for x, y in polygon]
    return abs(sum(points[i - 1][0] * y - x * points[i - 1][1] for i, (x, y) in enumerate(points))) / 2
