"""Vertex normals: area- and angle-weighted, smooth over equal positions, split at creases.

Each corner of a triangle gives its unit face normal times the face's area times the corner's angle (the angle weight after
Thuermer and Wuethrich, "Computing Vertex Normals from Polygonal Facets", 1998; the area keeps slivers quiet). With a crease angle, a
corner takes only the faces around its vertex that turn from its own face by no more than that.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.scene.mesh import Mesh

CREASE_ANGLE = float(np.radians(50.0))
"""Radians: default where a file has no normals. Cubes and hexagons keep their edges, octagons and scans are smooth."""

_MOST_FACES = 1024
"""Around one vertex; beyond this every face at a creased vertex keeps its own normal, as comparing all pairs would take too long."""

_CHUNK = 1 << 18  # triangles at a time: the temporaries of one chunk stay in the cache


def vertex_normals(positions: object, triangles: object) -> Array:
    """Smooth normals (n, 3) float32, unit length, of positions (n, 3) and triangles (m, 3).

    Vertices at equal positions share one normal, so a seam or a soup of triangles is as smooth as a welded mesh. A vertex of
    no triangle, or of degenerate ones only, gets (0, 0, 1).
    """
    positions, triangles = (
        checked(positions, ("n", 3), np.float32, "positions"),
        checked(triangles, ("m", 3), np.int32, "triangles"),
    )
    same = weld(positions)
    return _unit(_smooth(positions, triangles, same), same)


def with_normals(mesh: Mesh, crease_angle: float | None = CREASE_ANGLE, numbers: Array | None = None) -> Mesh:
    """`mesh` with new normals; other attributes are kept, and shared where no vertex is added.

    Args:
        mesh: Not changed.
        crease_angle: Radians. Where faces around a vertex turn by more than this, the vertex is duplicated, with a normal for each
            side; None or pi smooths everything and duplicates nothing, 0 gives flat faces.
        numbers: (m,) int64, ascending: where `mesh` is a part of a larger one, its triangles in that. Then vertices of which the part has all
            triangles get that mesh's normals, to the last bit.
    """
    if crease_angle is not None and not (isinstance(crease_angle, (int, float, np.number)) and 0 <= crease_angle <= np.pi + 1e-6):
        raise InputError(f"crease_angle: expected radians in 0..pi, got {crease_angle!r}")
    with np.errstate(all="ignore"):
        same = weld(mesh.positions)
        sums = _smooth(mesh.positions, mesh.triangles, same, numbers)
        normals = _unit(sums, same)
        del sums
        if crease_angle is None or crease_angle >= np.pi:
            return replace(mesh, normals=normals)
        corners = _sharp_corners(mesh, normals, same, crease_angle)
        if not len(corners):
            return replace(mesh, normals=normals)
        return _split(mesh, normals, corners, _creased(mesh, corners, same, crease_angle))


def face_normals(positions: Array, triangles: Array) -> Array:
    """(m, 3) float64: twice the area times the unit normal of each triangle (m, 3); zero where degenerate."""
    a, b, c = (positions.take(triangles[:, k], 0).astype(np.float64) for k in range(3))
    return _cross(b - a, c - a)


def _cross(a: Array, b: Array) -> Array:
    """np.cross, three times as fast on long arrays."""
    out = np.empty_like(a)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(a[:, i], b[:, j], out=out[:, k])
        out[:, k] -= a[:, j] * b[:, i]
    return out


def weld(positions: Array) -> Array | None:
    """(n,) int32: for each vertex of positions (n, 3) float32 the lowest one at the same place; None where all differ."""
    order, alike = _neighbours(positions)
    if not alike.any():
        return None
    equal = _equal_to_next(positions, order)
    mixed = np.flatnonzero(alike & ~equal)
    if len(mixed):  # different places with one hash, perhaps alternating
        order = _apart(positions, order, alike, mixed)
        equal = _equal_to_next(positions, order)
    equal &= alike
    if not equal.any():
        return None
    starts = np.flatnonzero(np.r_[True, ~equal])
    same = np.empty(len(order), np.int32)
    same[order] = np.repeat(order[starts], np.diff(starts, append=len(order)))
    return same


def _equal_to_next(positions: Array, order: Array) -> Array:
    """(n - 1,) bool: whether the vertices of `order` stand where the next one stands."""
    out = np.ones(len(order) - 1, bool)
    for start in range(0, len(out), _CHUNK):
        part = positions[order[start : start + _CHUNK + 1]]
        for k in range(3):
            out[start : start + _CHUNK] &= part[1:, k] == part[:-1, k]
    return out


def place_keys(positions: Array) -> Array:
    """(n,) uint64: a hash of each place (n, 3) float32; equal places have equal ones."""
    key = np.zeros(len(positions), np.uint64)
    for k in range(3):
        key += (positions[:, k] + np.float32(0)).view(np.uint32)  # + 0 turns -0 into 0
        key *= np.uint64(0xBF58476D1CE4E5B9)
        key ^= key >> np.uint64(29)
    key *= np.uint64(0x94D049BB133111EB)
    return key


def _neighbours(positions: Array) -> tuple[Array, Array]:
    """Vertices (n,) int32 ordered by a hash of their place, then number; and whether each has the hash of the next."""
    bits = np.uint64(max(len(positions), 2).bit_length())
    key = place_keys(positions)
    key >>= bits
    key <<= bits
    key |= np.arange(len(key), dtype=np.uint64)  # sorting the number with the hash is much quicker than an argsort
    key.sort()
    order = (key & ((np.uint64(1) << bits) - np.uint64(1))).astype(np.int32)
    key >>= bits
    return order, key[1:] == key[:-1]


def _apart(positions: Array, order: Array, alike: Array, mixed: Array) -> Array:
    """`order` with the runs of one hash that hold the entries `mixed` sorted by place, so that equal places stand together."""
    run = np.cumsum(np.r_[True, ~alike])
    chosen = np.zeros(int(run[-1]) + 1, bool)
    chosen[run[mixed]] = True
    at = np.flatnonzero(chosen[run])
    x, y, z = (positions[order[at]] + np.float32(0)).T
    order = order.copy()
    order[at] = order[at][np.lexsort((order[at], z, y, x, run[at]))]
    return order


def _corner_weights(positions: Array, triangles: Array) -> tuple[Array, Array]:
    """Area-weighted face normals (m, 3) float64 and corner angles (m, 3) float64 of a chunk of triangles."""
    a, b, c = (positions.take(triangles[:, k], 0).astype(np.float64) for k in range(3))
    edges = (b - a, c - b, a - c)
    normal = _cross(edges[0], -edges[2])
    area = np.sqrt(np.einsum("ij,ij->i", normal, normal))
    angles = np.empty((len(triangles), 3))
    for k in range(2):
        angles[:, k] = np.arctan2(area, -np.einsum("ij,ij->i", edges[k], edges[k - 1]))
    angles[:, 2] = np.pi - angles[:, 0] - angles[:, 1]
    return normal, angles


def _smooth(positions: Array, triangles: Array, same: Array | None, numbers: Array | None = None) -> Array:
    """(n, 3) float64: the weighted sum of face normals at each (welded) vertex. It is taken chunk by chunk; of a part, by the chunks of the whole."""
    sums = np.zeros((len(positions), 3))
    cuts = np.arange(0, len(triangles), _CHUNK)
    if numbers is not None:
        cuts = np.flatnonzero(np.diff(numbers // _CHUNK, prepend=-1))
    for start, end in pairwise([*cuts.tolist(), len(triangles)]):
        chunk = triangles[start:end]
        normal, angles = _corner_weights(positions, chunk)
        vertex = (chunk if same is None else same[chunk]).reshape(-1)
        low = int(vertex.min())
        vertex = vertex - low  # neighbours in the file are mostly neighbours in memory: add to their stretch only
        for k in range(3):
            part = np.bincount(vertex, (normal[:, k, None] * angles).reshape(-1))
            sums[low : low + len(part), k] += part
    return sums


def _unit(sums: Array, same: Array | None) -> Array:
    """(n, 3) float32 of unit length from sums (n, 3); (0, 0, 1) where there is no direction."""
    out = np.empty(sums.shape, np.float32)
    for start in range(0, len(sums), _CHUNK):
        part = sums[start : start + _CHUNK]
        # Scaled by the largest component first, so that neither tiny nor vast triangles lose their direction.
        part = part / np.maximum(np.abs(part).max(1, keepdims=True), 1e-300)
        length = np.sqrt(np.einsum("ij,ij->i", part, part))
        good = np.isfinite(length) & (length > 0)
        part = np.where(good[:, None], part / np.where(good, length, 1)[:, None], (0.0, 0.0, 1.0))
        out[start : start + _CHUNK] = part
    return out if same is None else out[same]


def _sharp_corners(mesh: Mesh, normals: Array, same: Array | None, crease_angle: float) -> Array:
    """(k,) int64 corners (3 * triangle + 0..2) at vertices where a face leans more than half the crease from the smooth normal.

    Elsewhere any two faces are within the crease of each other and the smooth normal stands.
    """
    limit = np.cos(crease_angle / 2)
    sharp = np.zeros(len(mesh.positions), bool)
    for start in range(0, len(mesh.triangles), _CHUNK):
        chunk = mesh.triangles[start : start + _CHUNK]
        face = face_normals(mesh.positions, chunk)
        least = limit * np.sqrt(np.einsum("ij,ij->i", face, face))
        for k in range(3):
            vertex = chunk[:, k]
            sharp[vertex[np.einsum("ij,ij->i", face, normals.take(vertex, 0)) < least]] = True
    if not sharp.any():
        return np.zeros(0, np.int64)
    if same is not None:  # all copies of a sharp vertex are sharp
        at = np.zeros(len(sharp), bool)
        at[same[sharp]] = True
        sharp = at[same]
    return np.flatnonzero(sharp[mesh.triangles.reshape(-1)])


def _creased(mesh: Mesh, corners: Array, same: Array | None, crease_angle: float) -> Array:
    """(k, 3) float32 unit normals of `corners`: each sums the faces at its vertex within the crease of its own face."""
    vertex = mesh.triangles.reshape(-1)[corners]
    group = vertex if same is None else same[vertex]
    order = np.argsort(group, kind="stable")
    corners, group = corners[order], group[order]
    normal, angles = _corner_weights(mesh.positions, mesh.triangles[corners // 3])
    weighted = normal * angles[np.arange(len(corners)), corners % 3][:, None]
    face = _unit(normal, None)
    starts = np.flatnonzero(np.r_[True, group[1:] != group[:-1]])
    sizes = np.diff(np.append(starts, len(group)))
    begin, size = np.repeat(starts, sizes), np.repeat(sizes, sizes)
    sums = np.zeros((len(corners), 3))
    limit = np.float32(np.cos(crease_angle) - 1e-6)
    active = np.arange(len(corners))
    # The j-th face around every vertex at once: as many rounds as the largest vertex has faces.
    active = active[size <= _MOST_FACES]
    sums[size > _MOST_FACES] = normal[size > _MOST_FACES]
    for j in range(min(int(sizes.max(initial=0)), _MOST_FACES)):
        active = active[size[active] > j]
        other = begin[active] + j
        near = (np.einsum("ij,ij->i", face[active], face[other]) >= limit) | (other == active)
        sums[active[near]] += weighted[other[near]]
    out = np.empty((len(corners), 3), np.float32)
    out[order] = _unit(sums, None)
    return out


def _split(mesh: Mesh, normals: Array, corners: Array, corner_normals: Array) -> Mesh:
    """`mesh` with its `corners` given `corner_normals` (k, 3), duplicating vertices only where their normals differ."""
    flat = mesh.triangles.reshape(-1)
    vertex = flat[corners]
    rows = np.concatenate([vertex[:, None].view(np.uint32), (corner_normals + np.float32(0)).view(np.uint32)], 1)
    order = np.lexsort(rows.T[::-1])
    fresh = np.r_[True, (rows[order][1:] != rows[order][:-1]).any(1)]
    kind = np.empty(len(corners), np.int64)
    kind[order] = np.cumsum(fresh) - 1
    kind_vertex, kind_normal = vertex[order[fresh]], corner_normals[order[fresh]]
    # The first normal of a vertex keeps its place; the others are appended.
    first = np.r_[True, kind_vertex[1:] != kind_vertex[:-1]]
    number = kind_vertex.astype(np.int64)
    number[~first] = len(mesh.positions) + np.arange(np.count_nonzero(~first))
    flat = flat.copy()
    flat[corners] = number[kind]
    source = kind_vertex[~first]
    if not len(source):
        normals[kind_vertex] = kind_normal
        return replace(mesh, normals=normals)
    normals = np.concatenate([normals, kind_normal[~first]])
    normals[kind_vertex[first]] = kind_normal[first]
    carried: dict[str, Any] = {
        name: np.concatenate([value, value[source]])
        for name in ("positions", "texcoords", "texcoords1", "colors", "tangents")
        if (value := getattr(mesh, name)) is not None
    }
    return replace(mesh, triangles=flat.reshape(-1, 3), normals=normals, **carried)
