"""From what files hold to triangles: polygons, strips, fans, and corners that index each attribute on their own."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array

_MOST_CORNERS = 1000  # a concave polygon with more is cut as a fan: ear clipping takes the square of this


def triangulate(counts: Array, corners: Array, positions: Array) -> Array:
    """Cut polygons into triangles.

    Args:
        counts: (f,) integer: corners of each polygon. Those with fewer than 3 give nothing.
        corners: (sum of counts,) integer: the vertex at each corner, within `positions`.
        positions: (n, 3) floats: decide how concave polygons are cut.

    Returns:
        (m, 3) int64: indices into `corners`, in the order of the polygons, each polygon wound as before.
    """
    counts = counts.astype(np.int64)
    begin = np.cumsum(counts) - counts
    cuts = np.maximum(counts - 2, 0)
    target = np.cumsum(cuts) - cuts
    out = np.empty((int(cuts.sum()), 3), np.int64)
    for size in np.unique(counts[counts >= 3]).tolist():
        faces = np.flatnonzero(counts == size)
        local = _fan(size)
        if size == 3:
            out[target[faces]] = begin[faces, None] + local
            continue
        for part in np.array_split(faces, 1 + len(faces) * size // 1_000_000):
            points = positions[corners[begin[part, None] + np.arange(size)]].astype(np.float64)
            cut = np.broadcast_to(local, (len(part), *local.shape))
            folded = _folded(points, local)
            if folded.any():
                cut = cut.copy()
                for k in np.flatnonzero(folded):
                    cut[k] = _clip_ears(points[k])
            out[target[part, None] + np.arange(size - 2)] = begin[part, None, None] + cut
    return out


def _fan(size: int) -> Array:
    """(size - 2, 3) int64: the triangles of a convex polygon."""
    k = np.arange(1, size - 1)
    return np.stack([np.zeros_like(k), k, k + 1], 1)


def _folded(points: Array, fan: Array) -> Array:
    """(f,) bool: which polygons, points (f, size, 3), would fold over themselves when cut as a fan."""
    edges = points[:, 1:] - points[:, :1]
    normals = np.cross(edges[:, :-1], edges[:, 1:])
    return (np.einsum("fkj,fj->fk", normals, normals.sum(1)) < 0).any(1)


def _clip_ears(points: Array) -> Array:
    """(size - 2, 3) int64: triangles of one polygon, points (size, 3), by ear clipping in the plane of its normal."""
    size = len(points)
    edges = points[1:] - points[:1]
    normal = np.cross(edges[:-1], edges[1:]).sum(0)
    if size > _MOST_CORNERS or not normal.any():
        return _fan(size)
    axis = int(np.abs(normal).argmax())
    flat = points[:, [(axis + 1) % 3, (axis + 2) % 3]] * (1, np.sign(normal[axis]))
    left = list(range(size))
    triangles = []
    while len(left) > 3:
        ear = _find_ear(flat, left)
        triangles.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
    return np.array([*triangles, left])


def _find_ear(flat: Array, left: list[int]) -> int:
    """A place in `left` whose corner is convex and holds no other corner; the most convex one where there is none."""
    points = flat[left]
    before, after = np.roll(points, 1, 0), np.roll(points, -1, 0)
    turn = _cross2(points - before, after - points)
    for k in np.flatnonzero(turn > 0):
        a, b, c = before[k], points[k], after[k]
        inside = (_cross2(b - a, points - a) >= 0) & (_cross2(c - b, points - b) >= 0) & (_cross2(a - c, points - c) >= 0)
        corner = (points == a).all(1) | (points == b).all(1) | (points == c).all(1)
        if not (inside & ~corner).any():
            return int(k)
    return int(turn.argmax())


def _cross2(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def strip(indices: Array) -> Array:
    """(m, 3): the triangles of a strip of indices (k,), each wound as the first; those that use a vertex twice are left out."""
    triangles = np.stack([indices[:-2], indices[1:-1], indices[2:]], 1) if len(indices) >= 3 else np.zeros((0, 3), indices.dtype)
    triangles[1::2, 1:] = triangles[1::2, :0:-1].copy()
    return _proper(triangles)


def fan(indices: Array) -> Array:
    """(m, 3): the triangles of a fan of indices (k,) around the first; those that use a vertex twice are left out."""
    if len(indices) < 3:
        return np.zeros((0, 3), indices.dtype)
    return _proper(np.stack([np.full(len(indices) - 2, indices[0]), indices[1:-1], indices[2:]], 1))


def _proper(triangles: Array) -> Array:
    a, b, c = triangles.T
    return np.ascontiguousarray(triangles[(a != b) & (b != c) & (c != a)])


def unify(columns: list[Array]) -> tuple[Array, Array]:
    """One index for corners that index several arrays at once.

    Args:
        columns: Each (k,) integer >= 0: what the corners index in one array.

    Returns:
        first: (n,) int64: a corner that shows each different combination, ordered by the first column, then the next.
        number: (k,) int32: the combination of each corner, 0..n-1.
    """
    bits = [int(column.max(initial=0)).bit_length() for column in columns]
    if sum(bits) <= 63:
        key = columns[0].astype(np.int64)
        for column, width in zip(columns[1:], bits[1:], strict=True):
            key = (key << width) | column
        order = np.argsort(key, kind="stable")
        fresh = np.r_[True, np.diff(key[order]) != 0] if len(key) else np.zeros(0, bool)
    else:
        order = np.lexsort(columns[::-1])
        fresh = np.zeros(len(order), bool)
        fresh[:1] = True
        for column in columns:
            fresh[1:] |= np.diff(column[order]) != 0
    number = np.empty(len(order), np.int32)
    number[order] = np.cumsum(fresh) - 1
    return order[fresh], number
