"""Texture space: the triangles of one lightmap page, and what part of which texel each covers.

The rasteriser's `project` snaps the lightmap coordinates to 1/256 texel, and its `bin`, with tiles of one texel, lists the triangles that may
touch each. Here every pair of texel and triangle is cut exactly (Sutherland and Hodgman 1974), so that no sliver is missed and the parts sum
to the whole: integers decide which texels are covered, as everywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.bin import NO_CLIPPED, OPAQUE, Parts, bin_triangles
from luxel.raster.constants import SUBPIXEL
from luxel.raster.project import View, Window, project

_CORNERS = 8  # of a triangle cut by four lines: at most seven
_WHOLE = float(SUBPIXEL * SUBPIXEL)
MOST_PAIRS, MOST_TEXELS = 1 << 24, 1 << 21
"""Pairs of texel and triangle, and texels, that are listed at a time: together some 200 MiB."""

_EDGES = np.array([[0, 0], [SUBPIXEL, SUBPIXEL]], np.int32)  # a pattern for `bin` whose samples are the texel's corners: no texel touched is missed
_FROM_PAGE = np.array([[2.0, 0, 0, -1], [0, -2.0, 0, 1], [0, 0, 0, 0.5], [0, 0, 0, 1]])  # u, v in 0..1, v down


class Texels(NamedTuple):
    """The texels of a page that are covered, row by row.

    Attributes:
        place: (n,) int32, row * width + column.
        triangle: (n,) int32, of the chart that covers most: the triangle with the largest part.
        corner1, corner2: (n,) float32, barycentric coordinates in it (of its corners 1 and 2) of the centroid of the covered part.
        area: (n,) float64, of the chart's covered part on the surface, m2.
        coverage: (n,) float32, of the texel, 0 to 1.
        loser: (n,) int32, another chart in the texel, or -1.
    """

    place: Array
    triangle: Array
    corner1: Array
    corner2: Array
    area: Array
    coverage: Array
    loser: Array


def place_vertices(texcoords: Array, size: tuple[int, int], threads: int) -> Array:
    """(n, 4) int32, as `project` gives them: lightmap coordinates (n, 2) in 1/256 texel of a page of `size` (width, height)."""
    flat = np.zeros((len(texcoords), 3), np.float32)
    flat[:, :2] = texcoords
    screen, _ = project(flat, View(_FROM_PAGE, 0.0), Window(0, 0, *size, *size), threads)
    return screen


def area2(screen: Array, triangles: Array) -> Array:
    """(m,) int64: twice the signed areas of placed triangles, in 1/65536 texels."""
    (ax, bx, cx), (ay, by, cy) = (screen[:, k].astype(np.int64)[triangles].T for k in (0, 1))
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


def cut_texels(triangles: Array, screen: Array, chart: Array, surface: Array, size: tuple[int, int], threads: int) -> Texels:
    """Find the texels that the triangles of one page cover.

    Args:
        triangles: (m, 3) int32.
        screen: (n, 4) int32, from `place_vertices`.
        chart: (m,) int32.
        surface: (m,) float64, m2 of the whole triangle.
        size: Width and height of the page, texels.
    """
    width, height = size
    with np.errstate(divide="ignore", invalid="ignore"):
        density = np.nan_to_num(surface / (np.abs(area2(screen, triangles)) / 2), posinf=0.0)  # m2 per 1/65536 texel
    bands = [
        _cut_band(triangles[chosen], screen, chart[chosen], density[chosen], chosen, first, last, size, threads)
        for first, last, chosen in _bands(triangles, screen, width, height)
    ]
    return Texels(*(np.concatenate(parts) for parts in zip(*bands, strict=True)))


def _bands(triangles: Array, screen: Array, width: int, height: int) -> list[tuple[int, int, Array]]:
    """Rows first .. last - 1 and their triangles, so few rows at a time that their pairs fit in memory."""
    x, y = screen[:, 0][triangles] >> 8, screen[:, 1][triangles] >> 8
    left, right, top, bottom = x.min(1).clip(0, width), x.max(1).clip(-1, width - 1), y.min(1).clip(0, height), y.max(1).clip(-1, height - 1)
    across = np.maximum(right - left + 1, 0).astype(np.float64)
    rows = np.bincount(top, across, height + 1)[:height]  # how many pairs each row has: begin minus end, summed
    rows[1:] -= np.bincount(np.maximum(bottom, top - 1) + 1, across, height + 1)[1:height]
    pairs = np.cumsum(np.cumsum(rows))
    found, first = [], 0
    while first < height:
        before = pairs[first - 1] if first else 0.0
        last = max(first + 1, min(int(np.searchsorted(pairs, before + MOST_PAIRS, "right")), first + MOST_TEXELS // width))
        chosen = np.flatnonzero((top < last) & (bottom >= first)).astype(np.int32)
        found.append((first, last, chosen))
        first = last
    return found


def _cut_band(triangles: Array, screen: Array, chart: Array, density: Array, number: Array, first: int, last: int,
              size: tuple[int, int], threads: int) -> Texels:  # fmt: skip
    width, rows = size[0], last - first
    moved = screen.copy()
    moved[:, 1] -= first * SUBPIXEL
    window = Window(0, first, width, rows, *size)
    parts = Parts(np.array([0, len(triangles)], np.int32), np.array([OPAQUE], np.int32), np.zeros(1, np.int32))
    bins = bin_triangles(triangles, moved, NO_CLIPPED, parts, OPAQUE, _EDGES, window, 1, threads)
    texels = width * rows
    triangle, loser = np.full(texels, -1, np.int32), np.full(texels, -1, np.int32)
    corners, coverage, area = np.zeros((texels, 2), np.float32), np.zeros(texels, np.float32), np.zeros(texels)
    most = int(np.diff(bins.start).max(initial=0))
    jit.run(_cut, threads, bins.start, bins.triangles, width, triangles, moved, chart, density, most, triangle, corners, area, coverage, loser)
    found = np.flatnonzero(triangle >= 0)
    return Texels(
        (found + first * width).astype(np.int32), number[triangle[found]], corners[found, 0], corners[found, 1], area[found], coverage[found],
        loser[found],
    )  # fmt: skip


@jit.part
def cut_line(xs, ys, n, axis, at, sign, ox, oy):
    """Keep the part of a polygon (xs, ys) of `n` corners where sign * (coordinate `axis` - at) >= 0; into ox, oy. Returns its corners."""
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        di = sign * ((ys[i] if axis else xs[i]) - at)
        dj = sign * ((ys[j] if axis else xs[j]) - at)
        if di >= 0.0:
            ox[kept], oy[kept] = xs[i], ys[i]
            kept += 1
        if (di > 0.0 and dj < 0.0) or (di < 0.0 and dj > 0.0):
            f = di / (di - dj)
            ox[kept], oy[kept] = xs[i] + f * (xs[j] - xs[i]), ys[i] + f * (ys[j] - ys[i])
            if axis:
                oy[kept] = at
            else:
                ox[kept] = at
            kept += 1
    return kept


@jit.part
def cut_triangle(ax, ay, bx, by, cx, cy, xs, ys, ox, oy):
    """Area, and moments (area times centroid), of the part of a triangle in the texel 0 .. 256; corners in 1/256 texel, either winding."""
    if max(ax, max(bx, cx)) <= 0.0 or max(ay, max(by, cy)) <= 0.0 or min(ax, min(bx, cx)) >= 256.0 or min(ay, min(by, cy)) >= 256.0:
        return 0.0, 0.0, 0.0
    turn = 1.0 if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0.0 else -1.0
    least = 0.0
    for k in range(3):
        px, py, qx, qy = (ax, ay, bx, by) if k == 0 else (bx, by, cx, cy) if k == 1 else (cx, cy, ax, ay)
        across, down = turn * (py - qy), turn * (qx - px)
        here = -across * px - down * py  # the edge function at the texel's corner
        if here + 256.0 * (max(across, 0.0) + max(down, 0.0)) <= 0.0:
            return 0.0, 0.0, 0.0
        least = min(least, here + 256.0 * (min(across, 0.0) + min(down, 0.0)))
    if least >= 0.0:
        return 65536.0, 65536.0 * 128.0, 65536.0 * 128.0
    xs[0], ys[0], xs[1], ys[1], xs[2], ys[2] = ax, ay, bx, by, cx, cy
    n = cut_line(xs, ys, 3, 0, 0.0, 1.0, ox, oy)
    n = cut_line(ox, oy, n, 0, 256.0, -1.0, xs, ys)
    n = cut_line(xs, ys, n, 1, 0.0, 1.0, ox, oy)
    n = cut_line(ox, oy, n, 1, 256.0, -1.0, xs, ys)
    area, mx, my = 0.0, 0.0, 0.0
    for i in range(1, n - 1):
        a = 0.5 * turn * ((xs[i] - xs[0]) * (ys[i + 1] - ys[0]) - (ys[i] - ys[0]) * (xs[i + 1] - xs[0]))
        area += a
        mx += a * (xs[0] + xs[i] + xs[i + 1]) / 3.0
        my += a * (ys[0] + ys[i] + ys[i + 1]) / 3.0
    return max(area, 0.0), mx, my


@jit.part
def largest_chart(n, listed, chart, areas, charts, sums):
    """The chart with the largest part of the texel (of equal ones the first), its area, and the next largest or -1; -1 if there is none."""
    known = 0
    for i in range(n):
        if areas[i] > 0.0:
            k = 0
            while k < known and charts[k] != chart[listed[i]]:
                k += 1
            if k == known:
                charts[k], sums[k] = chart[listed[i]], 0.0
                known += 1
            sums[k] += areas[i]
    best, second = -1, -1
    for k in range(known):
        if best < 0 or sums[k] > sums[best] or (sums[k] == sums[best] and charts[k] < charts[best]):
            best, second = k, best
        elif second < 0 or sums[k] > sums[second]:
            second = k
    return (charts[best] if best >= 0 else -1), (sums[best] if best >= 0 else 0.0), (charts[second] if second >= 0 else -1)


@jit.part
def corners_at(x, y, ax, ay, bx, by, cx, cy):
    """Barycentric coordinates of a point, of corners 1 and 2."""
    whole = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    return ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / whole, ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / whole


@jit.parallel_kernel
def _cut(queue, start, listed, width, triangles, screen, chart, density, most, triangle, corners, area, coverage, loser):
    xs, ys, ox, oy = np.empty(_CORNERS), np.empty(_CORNERS), np.empty(_CORNERS), np.empty(_CORNERS)
    areas, mx, my = np.empty(most), np.empty(most), np.empty(most)
    charts, sums = np.empty(most, np.int32), np.empty(most)
    row = jit.take(queue)
    while row * width < len(triangle):
        oy0 = np.float64(row * 256)
        for column in range(width):
            texel = row * width + column
            first, n = start[texel], np.int64(start[texel + 1]) - np.int64(start[texel])
            ox0 = np.float64(column * 256)
            for i in range(n):
                t = listed[first + i]
                a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
                areas[i], mx[i], my[i] = cut_triangle(
                    screen[a, 0] - ox0, screen[a, 1] - oy0, screen[b, 0] - ox0, screen[b, 1] - oy0, screen[c, 0] - ox0, screen[c, 1] - oy0,
                    xs, ys, ox, oy,
                )  # fmt: skip
            if n == 0:
                continue
            winner, whole, other = largest_chart(n, listed[first : first + n], chart, areas, charts, sums)
            if winner < 0:
                continue
            best, cx, cy, metres = -1, 0.0, 0.0, 0.0
            for i in range(n):
                t = listed[first + i]
                if areas[i] > 0.0 and chart[t] == winner:
                    cx, cy, metres = cx + mx[i], cy + my[i], metres + areas[i] * density[t]
                    best = i if best < 0 or areas[i] > areas[best] else best
            t = listed[first + best]
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            px, py = screen[a, 0] - ox0, screen[a, 1] - oy0
            qx, qy, rx, ry = screen[b, 0] - ox0, screen[b, 1] - oy0, screen[c, 0] - ox0, screen[c, 1] - oy0
            s1, s2 = corners_at(cx / whole, cy / whole, px, py, qx, qy, rx, ry)
            if min(s1, min(s2, 1.0 - s1 - s2)) < -1e-9:  # the middle of the whole part lies in a lesser triangle: that of its own, then
                s1, s2 = corners_at(mx[best] / areas[best], my[best] / areas[best], px, py, qx, qy, rx, ry)
            triangle[texel], loser[texel] = t, other
            corners[texel, 0], corners[texel, 1] = np.float32(min(max(s1, 0.0), 1.0)), np.float32(min(max(s2, 0.0), 1.0 - min(max(s1, 0.0), 1.0)))
            area[texel], coverage[texel] = metres, np.float32(min(whole / _WHOLE, 1.0))
        row = jit.take(queue)


