"""Shapes: centred on the origin, outward triangles counter-clockwise, with normals and texture coordinates.

Texture coordinates are 0..1 over a face, or once around and from top to bottom. Vertices are doubled along creases and
along the seam of the texture, with positions that are equal to the bit, so that no crack opens.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.scene.builtin.grid import compact, merged, normalized, quads, strips, surface
from luxel.scene.mesh import Mesh

CREASE = float(np.radians(40.0))


def quad(width: float = 1.0, height: float = 1.0, name: str = "quad") -> Mesh:
    """A rectangle in the xy plane that faces +z."""
    x, y = width / 2, height / 2
    return surface([[[-x, -y, 0], [x, -y, 0]], [[-x, y, 0], [x, y, 0]]], name)


def plane(width: float = 1.0, depth: float = 1.0, columns: int = 1, rows: int = 1, name: str = "plane") -> Mesh:
    """A rectangle in the xz plane that faces +y, of `columns` x `rows` cells."""
    x, z = np.meshgrid(np.linspace(-width / 2, width / 2, columns + 1), np.linspace(depth / 2, -depth / 2, rows + 1))
    return surface(np.stack([x, np.zeros_like(x), z], -1), name)


def box(
    size: Sequence[float] = (1.0, 1.0, 1.0),
    bevel: float = 0.0,
    segments: int = 2,
    texture_size: float | None = None,
    name: str = "box",
) -> Mesh:
    """A box.

    Args:
        size: Metres along x, y and z.
        bevel: Metres by which its edges are rounded.
        segments: Half the steps of a rounded edge.
        texture_size: Metres that the texture covers before it repeats; None spreads it over each face.
        name: Of the mesh.

    Raises:
        InputError: The bevel is negative or more than half of the smallest side.
    """
    half = checked(size, (3,), np.float64, "size") / 2
    if not 0 <= bevel <= half.min():
        raise InputError(f"bevel: expected 0 .. {half.min():g} (half of the smallest side), got {bevel:g}")
    inner = half - bevel
    steps = bevel * np.tan(np.linspace(0, np.pi / 4, segments + 1)) if bevel else np.zeros(1)
    ticks = [np.unique(np.concatenate([-(i + steps), i + steps])) for i in inner]
    corner, facing, texcoords, triangles = _cube(ticks, texture_size)
    if not bevel:
        return Mesh(corner, triangles, facing, texcoords, name=name)
    core = np.clip(corner, -inner, inner)
    normals = normalized(corner - core)
    return Mesh(core + bevel * normals, triangles, normals, texcoords, name=name)


def superellipsoid(
    size: Sequence[float] = (1.0, 1.0, 1.0),
    squareness: float = 0.5,
    cells: int = 10,
    crown: float | None = None,
    name: str = "cushion",
) -> Mesh:
    """A soft box such as a cushion: |x|^p + |y|^p + |z|^p = 1 in halves of `size`, p = 2 / (1 - squareness).

    Args:
        size: Metres along x, y and z.
        squareness: 0 is an ellipsoid; towards 1 it becomes a box.
        cells: Steps along each side of its six faces.
        crown: Squareness along y alone, when it differs: a cushion that is thick in the middle has less.
        name: Of the mesh.
    """
    crown = squareness if crown is None else crown
    if not (0 <= squareness < 1 and 0 <= crown < 1):
        raise InputError(f"squareness, crown: expected 0 <= s < 1, got {squareness}, {crown}")
    half = checked(size, (3,), np.float64, "size") / 2
    ticks = np.tan(np.linspace(-np.pi / 4, np.pi / 4, cells + 1))
    corner, _, texcoords, triangles = _cube([ticks] * 3)
    p, q = 2 / (1 - squareness), 2 / (1 - crown)
    a = np.abs(normalized(corner))
    flat = np.maximum(a[:, 0] ** p + a[:, 2] ** p, 1e-30)  # x and z first, then y: Barr's superquadric
    radius = (flat ** (q / p) + a[:, 1] ** q) ** (-1 / q)
    rim = flat ** (q / p - 1)
    gradient = np.stack([rim * a[:, 0] ** (p - 1), a[:, 1] ** (q - 1), rim * a[:, 2] ** (p - 1)], 1)
    positions = normalized(corner) * radius[:, None] * half
    return Mesh(positions, triangles, normalized(np.sign(corner) * gradient / half), texcoords, name=name)


def _cube(ticks: Sequence[Array], texture_size: float | None = None) -> tuple[Array, Array, Array, Array]:
    """The six faces of a box cut at `ticks` along x, y, z: corners, face normals, texture coordinates, triangles.

    Points of two faces along their common edge are equal to the bit, because both take them from the same ticks.
    """
    corners, facings, texcoords, triangles = [], [], [], []
    start = 0
    for right, up, front in ((0, 1, 2), (2, 1, 0), (0, 2, 1)):
        for side in (0, -1):
            u, v = ticks[right], ticks[up]
            points = np.empty((len(v), len(u), 3))
            points[..., right], points[..., up], points[..., front] = u[None, :], v[:, None], ticks[front][side]
            handed = 1 if (right, up, front) == (0, 1, 2) else -1
            mirrored = handed * (1 if side else -1) < 0  # columns x rows would face inwards
            if mirrored:
                points = points[:, ::-1]
            facing = np.zeros(3)
            facing[front] = 1 if side else -1
            s, t = np.meshgrid(_along(-u[::-1] if mirrored else u, texture_size), -_along(v, texture_size))
            corners.append(points.reshape(-1, 3))
            facings.append(np.broadcast_to(facing, corners[-1].shape))
            texcoords.append(np.stack([s, t - t.min()], -1).reshape(-1, 2))
            triangles.append(start + quads(len(v), len(u)))
            start += len(corners[-1])
    return np.concatenate(corners), np.concatenate(facings), np.concatenate(texcoords), np.concatenate(triangles)


def _along(ticks: Array, texture_size: float | None) -> Array:
    return (ticks - ticks[0]) / (texture_size or ticks[-1] - ticks[0])


def lathe(profile: object, segments: int = 48, crease: float = CREASE, name: str = "lathe") -> Mesh:
    """The surface of revolution of a profile about +y.

    Args:
        profile: (k, 2) radius >= 0 and height, metres. Outside is to its right: walk up the outer wall. Equal
            ends close a ring.
        segments: Steps around.
        crease: Radians; the profile stays sharp where it turns by more.
        name: Of the mesh.
    """
    p = checked(profile, ("k", 2), np.float64, "profile")
    if len(p) < 2 or (p[:, 0] < 0).any() or segments < 3:
        raise InputError(f"lathe: expected 2 points of radius >= 0 and 3 segments or more, got {len(p)} and {segments}")
    along = np.diff(p, axis=0)
    length = np.linalg.norm(along, axis=1)
    if not (length > 0).all():
        raise InputError(f"profile: point {int(np.argmin(length))} and the next are the same")
    outward = np.stack([along[:, 1], -along[:, 0]], 1) / length[:, None]
    before, after = np.roll(outward, 1, 0), outward  # of the vertex where segment i starts; [0] is used in rings only
    closed = (p[0] == p[-1]).all()
    sharp = (before * after).sum(1) < np.cos(crease)
    soft = _directions(before + after)
    start = np.where(sharp[:, None], after, soft)
    end = np.roll(np.where(sharp[:, None], before, soft), -1, 0)
    if not closed:
        start[0], end[-1] = outward[0], outward[-1]
    t = np.concatenate([[0.0], np.cumsum(length)]) / length.sum()
    rows = np.stack([p[:-1], p[1:]], 1).reshape(-1, 2)
    normals = np.stack([start, end], 1).reshape(-1, 2)
    height = np.stack([t[:-1], t[1:]], 1).ravel()
    keep = np.ones(len(rows), bool)
    keep[2::2] = sharp[1:]  # a smooth vertex needs one row
    number = np.cumsum(keep) - 1
    return _revolved(rows[keep], normals[keep], height[keep], number[0::2], number[1::2], segments, name)


def _directions(vectors: Array) -> Array:
    """Unit length along the last axis; opposed neighbours (a knife edge) give zero, which their crease never uses."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def _revolved(rows: Array, normals: Array, height: Array, low: Array, high: Array, segments: int, name: str) -> Mesh:
    """Turn rows (radius, y) around; strips of quads join row `low[i]` with row `high[i]`."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    around = np.stack([np.sin(angle), np.cos(angle)], 1)
    around[-1] = around[0]  # the seam closes to the bit
    columns = segments + 1

    def turned(pairs: Array) -> Array:
        y = np.broadcast_to(pairs[:, None, 1], (len(pairs), columns))
        return np.stack([pairs[:, :1] * around[:, 0], y, pairs[:, :1] * around[:, 1]], -1).reshape(-1, 3)

    u, v = np.meshgrid(np.linspace(0, 1, columns), 1 - height)
    steps = np.arange(segments)
    triangles = strips((low[:, None] * columns + steps).ravel(), (high[:, None] * columns + steps).ravel())
    return compact(Mesh(turned(rows), triangles, turned(normals), np.stack([u, v], -1).reshape(-1, 2), name=name))


def sphere(radius: float = 0.5, segments: int = 48, rings: int | None = None, name: str = "sphere") -> Mesh:
    """A sphere of meridians and parallels; `rings` defaults to half of `segments`."""
    polar = np.linspace(0, np.pi, (rings or segments // 2) + 1)
    profile = radius * np.stack([np.sin(polar), -np.cos(polar)], 1)
    profile[[0, -1], 0] = 0.0
    return lathe(profile, segments, np.pi, name)


def cylinder(radius: float = 0.5, height: float = 1.0, segments: int = 48, name: str = "cylinder") -> Mesh:
    """A closed cylinder about +y."""
    y = height / 2
    return lathe([(0, -y), (radius, -y), (radius, y), (0, y)], segments, name=name)


def cone(radius: float = 0.5, height: float = 1.0, segments: int = 48, top: float = 0.0, name: str = "cone") -> Mesh:
    """A closed cone about +y, cut where it is `top` metres in radius."""
    y = height / 2
    return lathe([(0, -y), (radius, -y), (top, y), *([(0, y)] if top else [])], segments, name=name)


def torus(radius: float = 0.4, tube_radius: float = 0.1, segments: int = 48, sides: int = 24, name: str = "torus") -> Mesh:
    """A ring about +y; `radius` is of its centre line."""
    if not 0 < tube_radius <= radius:
        raise InputError(f"torus: expected 0 < tube_radius <= radius, got {tube_radius:g} and {radius:g}")
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    profile = np.stack([radius + tube_radius * np.cos(angle), tube_radius * np.sin(angle)], 1)
    profile[-1] = profile[0]
    return lathe(profile, segments, np.pi, name)


def icosphere(radius: float = 0.5, subdivisions: int = 3, name: str = "icosphere") -> Mesh:
    """A sphere of 20 x 4^subdivisions nearly equal triangles, with shared vertices.

    Its texture coordinates break along -z.
    """
    g = (1 + 5**0.5) / 2
    points = np.array([[s * 1.0, t * g, 0.0] for t in (1, -1) for s in (-1, 1)])
    points = np.concatenate([points, np.roll(points, 1, 1), np.roll(points, 2, 1)])
    near = np.linalg.norm(points[:, None] - points[None], axis=-1) < 2.1  # a triangle joins nearest neighbours
    found = [t for t in combinations(range(12), 3) if near[np.ix_(t, t)].all()]
    triangles = np.array([t if np.linalg.det(points[list(t)]) > 0 else t[::-1] for t in found])
    points = normalized(points)
    for _ in range(subdivisions):
        edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), 1)
        edges, where = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = triangles.T
        ab, bc, ca = len(points) + where.reshape(3, -1)
        points = np.concatenate([points, normalized(points[edges].sum(1))])
        triangles = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    u = np.arctan2(points[:, 0], points[:, 2]) / (2 * np.pi) + 0.5
    v = np.arccos(np.clip(points[:, 1], -1, 1)) / np.pi
    return Mesh(radius * points, triangles, points, np.stack([u, v], 1), name=name)


def tube(curve: object, radius: float | Sequence[float] | Array = 0.05, sides: int = 16, name: str = "tube") -> Mesh:
    """A tube along a curve, closed by flat ends, or a ring where the curve ends at its start.

    Args:
        curve: (k, 3) metres, k >= 2, no two neighbours the same.
        radius: Metres, one for all or one a point; positive.
        sides: Steps around.
        name: Of the mesh.
    """
    p = checked(curve, ("k", 3), np.float64, "curve")
    r = np.broadcast_to(np.asarray(radius, np.float64), (len(p),))
    if len(p) < 2 or not (np.linalg.norm(np.diff(p, axis=0), axis=1) > 0).all():
        raise InputError("curve: expected at least 2 points, no two neighbours the same")
    closed = (p[0] == p[-1]).all()
    along = normalized(np.gradient(p, axis=0))
    if closed:
        along[0] = along[-1] = normalized(p[1] - p[-2])
    side, up = _frames(along, closed)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    out = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    out[:, -1] = out[:, 0]
    if closed:
        out[-1] = out[0]
    points = p[:, None] + r[:, None, None] * out
    wall = surface(points, name)
    wall.normals = normalized(out).reshape(-1, 3).astype(np.float32)
    if closed:
        return wall
    return merged([wall, _cap(points[0, ::-1], p[0], -along[0]), _cap(points[-1], p[-1], along[-1])], name)


def _frames(along: Array, closed: bool) -> tuple[Array, Array]:
    """Two directions across the curve at each point, which turn about it as little as may be."""
    side = np.empty_like(along)
    side[0] = normalized(np.cross(along[0], np.eye(3)[np.argmin(np.abs(along[0]))]))
    for i in range(1, len(along)):
        side[i] = normalized(side[i - 1] - along[i] * (side[i - 1] @ along[i]))
    up = np.cross(along, side)
    if closed:  # spread the twist that is left at the end over the whole ring
        twist = np.arctan2(side[-1] @ up[0], side[-1] @ side[0]) * np.linspace(0, 1, len(along))[:, None]
        side, up = np.cos(twist) * side - np.sin(twist) * up, np.cos(twist) * up + np.sin(twist) * side
    return side, up


def _cap(rim: Array, centre: Array, facing: Array) -> Mesh:
    """A flat fan over a closed rim that runs counter-clockwise seen from where it faces."""
    n = len(rim) - 1
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    texcoords = 0.5 + 0.5 * np.stack([np.cos(angle), -np.sin(angle)], 1)
    ring = np.arange(n)
    triangles = np.stack([np.full(n, n), ring, (ring + 1) % n], 1)
    return Mesh(
        np.concatenate([rim[:-1], centre[None]]),
        triangles,
        np.broadcast_to(facing, (n + 1, 3)),
        np.concatenate([texcoords, [[0.5, 0.5]]]),
    )
