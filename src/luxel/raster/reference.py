"""The slow oracle: coverage and depth sample by sample, in plain Python integers and float32 scalars, against which `cover` is tested.

Written from the rules (Direct3D 11.3 functional specification, section 3.4.2), not from the fast path: no spans, no tiles, no shifts, no
turning of triangles seen from behind. Positions are integers in 1/256 pixel, y down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from luxel.arrays import Array

Point = tuple[int, int]
_F = np.float32


def cross(p: Point, q: Point, s: Point) -> int:
    """Twice the signed area of the triangle p q s: its sign tells on which side of the line from p to q the point s lies."""
    return (q[0] - p[0]) * (s[1] - p[1]) - (q[1] - p[1]) * (s[0] - p[0])


def owns_edge(p: Point, q: Point, rest: Point) -> bool:
    """Whether a triangle with the edge p q and the third corner `rest` owns the samples on that edge: it is a top or a left one."""
    if p[1] == q[1]:
        return rest[1] > p[1]  # exactly horizontal, and above the rest
    upper, lower = sorted((p, q), key=lambda point: point[1])
    return cross(upper, lower, rest) < 0  # the rest lies to the right


def covers(corners: Sequence[Point], s: Point) -> bool:
    """Whether the triangle holds the sample s: inside all edges, or on edges of which it owns every one."""
    for i in range(3):
        p, q, rest = corners[i], corners[(i + 1) % 3], corners[(i + 2) % 3]
        inner, side = cross(p, q, rest), cross(p, q, s)
        if inner == 0:
            return False
        if side == 0:
            if not owns_edge(p, q, rest):
                return False
        elif (side > 0) != (inner > 0):
            return False
    return True


class Plane:
    """Depth over a triangle: float64 to set up, float32 to evaluate, counted from the corner of the pixel that holds corner 0."""

    def __init__(self, corners: Sequence[Point], depths: Sequence[np.float32]) -> None:
        (x0, y0), (x1, y1), (x2, y2) = corners
        self.x, self.y = x0 // 256, y0 // 256
        ux, uy, vx, vy = float(x1 - x0), float(y1 - y0), float(x2 - x0), float(y2 - y0)
        z0, z1, z2 = (float(z) for z in depths)
        uz, vz = z1 - z0, z2 - z0
        scale = 1.0 / (ux * vy - vx * uy)
        dx, dy = (uz * vy - vz * uy) * scale, (ux * vz - vx * uz) * scale
        self.base = _F(z0 - dx * (x0 % 256) - dy * (y0 % 256))
        self.along, self.down = _F(dx * 256), _F(dy * 256)
        self.low, self.high = min(depths), max(depths)

    def at(self, s: Point) -> np.float32:
        """Depth at the sample s, between those of the corners."""
        across, down = _F(s[0] / 256 - self.x), _F(s[1] / 256 - self.y)
        depth = (self.base + self.down * down) + self.along * across
        return min(max(depth, self.low), self.high)


def samples_of(corners: Sequence[Point], pattern: Array, width: int, height: int) -> Iterator[tuple[int, int, int]]:
    """(sample, row, column) of all samples of a width x height picture that the triangle holds; pattern: (s, 2) in 1/256 pixel."""
    xs, ys = zip(*corners, strict=True)
    for y in range(max(min(ys) // 256, 0), min(max(ys) // 256 + 1, height)):
        for x in range(max(min(xs) // 256, 0), min(max(xs) // 256 + 1, width)):
            for s, (sx, sy) in enumerate(pattern):
                if covers(corners, (x * 256 + int(sx), y * 256 + int(sy))):
                    yield s, y, x


def reference_cover(corners: Array, depths: Array, pattern: Array, width: int, height: int, cull: bool = False) -> tuple[Array, Array]:
    """The nearest triangle at every sample; of equally near ones the first.

    Args:
        corners: (n, 3, 2) integers, 1/256 pixel.
        depths: (n, 3) float32, nearer is larger.
        pattern: (s, 2) int, sample positions in 1/256 pixel.
        width, height: Of the picture, pixels.
        cull: Leave out triangles seen from behind (clockwise before y was turned down).

    Returns:
        ids (s, height, width) int32, -1 where there is nothing; depths, the same shape, float32, -1 where there is nothing.
    """
    ids, nearest = np.full((len(pattern), height, width), -1, np.int32), np.full((len(pattern), height, width), -1, np.float32)
    for t, (triangle, z) in enumerate(zip(corners.tolist(), depths, strict=True)):
        a, b, c = (tuple(point) for point in triangle)
        area = cross(a, b, c)
        if area == 0 or (cull and area > 0):
            continue
        plane = Plane((a, b, c), z)
        for place in samples_of((a, b, c), pattern, width, height):
            s, y, x = place
            depth = plane.at((x * 256 + int(pattern[s, 0]), y * 256 + int(pattern[s, 1])))
            if depth > nearest[place]:
                ids[place], nearest[place] = t, depth
    return ids, nearest
