"""Cuttings: what of which triangle is in which luxel, one by one.

Luxels are drawn as wholes. Where triangles within one face differently (`facets`), or emit differently (`glow`), the part of each counts for itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.pieces import areas
from luxel.radiosity.texture_space import area2, corners_at, cut_triangle, place_vertices
from luxel.raster.geometry import Geometry

if TYPE_CHECKING:
    from luxel.radiosity.luxels import Luxels


class Cuttings(NamedTuple):
    """p parts of triangles, by luxel.

    Attributes:
        luxel: (p,) int32, row of the luxels asked for.
        triangle: (p,) int32.
        area: (p,) float64, m2.
        place: (p, 2) float64: barycentric coordinates, of corners 1 and 2, of the centroid.
    """

    luxel: Array
    triangle: Array
    area: Array
    place: Array

    def only(self, which: Array) -> Cuttings:
        """Those of `which`, (p,) bool."""
        return Cuttings(*(array[which] for array in self))


def cuttings_of(luxels: Luxels, chosen: Array, geometry: Geometry, charts: Array, candidates: Array, threads: int) -> Cuttings:
    """What of the candidate triangles is in chosen luxels of their charts.

    Args:
        chosen: (k,) int32, ascending.
        charts: (m,) int32, of each triangle.
        candidates: (c,) int64, triangles.
    """
    _, height, width = luxels.shape
    screen = place_vertices(geometry.texcoords1, (width, height), threads)
    page, row, column = luxels.texel[chosen].astype(np.int64).T
    pages = np.zeros(int(charts.max()) + 1, np.int64)
    pages[luxels.chart[chosen]] = page
    triangles = geometry.triangles[candidates]
    surface, size = areas(geometry.positions, triangles), np.abs(area2(screen, triangles)) / 2
    density = np.divide(surface, size, out=np.zeros(len(size)), where=size > 0)
    given = (candidates, triangles, screen, charts[candidates], pages[charts[candidates]] * height, width, height,
             (page * height + row) * width + column, luxels.chart[chosen])  # fmt: skip
    nothing = np.empty(0, np.int32), np.empty(0, np.int32), np.empty((0, 3))
    p = _list_cuttings(*given, *nothing)
    luxel, triangle, moments = np.empty(p, np.int32), np.empty(p, np.int32), np.empty((p, 3))
    _list_cuttings(*given, luxel, triangle, moments)
    order = np.argsort(luxel, kind="stable")
    luxel, triangle, moments = luxel[order], triangle[order], moments[order]
    area = np.where(size[triangle] > 0, moments[:, 0] * density[triangle], surface[triangle])
    return Cuttings(luxel, candidates[triangle].astype(np.int32), area, moments[:, 1:])


@jit.part
def _luxel_at(texels, key):
    """The place of `key` in the ascending `texels`, or -1."""
    low, high = 0, len(texels)
    while low < high:
        middle = (low + high) // 2
        if texels[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low if low < len(texels) and texels[low] == key else -1


@jit.kernel
def _list_cuttings(number, triangles, screen, chart, top, width, height, texels, charts, luxel, triangle, moments):
    """Luxel, triangle and (area in 1/65536 texel, barycentric coordinates of the centroid) of each pair, as far as there is room; how many there
    are. A triangle without an area on the page is whole in the texel of its middle."""
    xs, ys, ox, oy = np.empty(8), np.empty(8), np.empty(8), np.empty(8)
    found = 0
    for i in range(len(number)):
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        ax, ay, bx = np.int64(screen[a, 0]), np.int64(screen[a, 1]), np.int64(screen[b, 0])
        by, cx, cy = np.int64(screen[b, 1]), np.int64(screen[c, 0]), np.int64(screen[c, 1])
        flat = (bx - ax) * (cy - ay) == (by - ay) * (cx - ax)
        left, right = max(min(ax, min(bx, cx)) >> 8, 0), min(max(ax, max(bx, cx)) >> 8, width - 1)
        first, last = max(min(ay, min(by, cy)) >> 8, 0), min(max(ay, max(by, cy)) >> 8, height - 1)
        if flat:
            left, first = max(left, (ax + bx + cx) // 768), max(first, (ay + by + cy) // 768)
            right, last = min(right, left), min(last, first)
        for row in range(first, last + 1):
            for column in range(left, right + 1):
                x, y = np.float64(column * 256), np.float64(row * 256)
                area, mx, my = 0.0, 0.0, 0.0
                if not flat:
                    area, mx, my = cut_triangle(ax - x, ay - y, bx - x, by - y, cx - x, cy - y, xs, ys, ox, oy)
                    if area <= 0.0:
                        continue
                k = _luxel_at(texels, (top[i] + row) * width + column)
                if k < 0 or charts[k] != chart[i]:
                    continue
                if found < len(luxel):
                    s1, s2 = 1.0 / 3.0, 1.0 / 3.0
                    if not flat:
                        s1, s2 = corners_at(mx / area, my / area, ax - x, ay - y, bx - x, by - y, cx - x, cy - y)
                    luxel[found], triangle[found] = k, i
                    moments[found, 0], moments[found, 1], moments[found, 2] = area, s1, s2
                found += 1
    return found


