"""Orders that look at no cache: random, and along a space-filling curve."""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.errors import InputError


def shuffled(count: int, seed: int = 0) -> Array:
    """(count,) int32: a random permutation, the worst case that a mesh is likely to be in."""
    return np.random.default_rng(seed).permutation(count).astype(np.int32)


@jit.part
def _spread(x):
    """The 21 bits of x, two zeros between each and the next."""
    x = np.uint64(x)
    x = (x | (x << np.uint64(32))) & np.uint64(0x1F00000000FFFF)
    x = (x | (x << np.uint64(16))) & np.uint64(0x1F0000FF0000FF)
    x = (x | (x << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    x = (x | (x << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (x | (x << np.uint64(2))) & np.uint64(0x1249249249249249)


@jit.kernel
def _codes(faces, positions, low, scale, codes):
    """Morton code of each triangle's centroid, 21 bits an axis."""
    for t in range(len(faces)):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        code = np.uint64(0)
        for axis in range(3):
            centre = (positions[a, axis] + positions[b, axis] + positions[c, axis]) / 3.0
            code |= _spread(np.uint64((centre - low[axis]) * scale)) << np.uint64(axis)
        codes[t] = code


def morton_codes(faces: Array, positions: object, vertex_count: int) -> Array:
    """(m,) uint64: each triangle's centroid on the Z-order curve (Morton 1966), 21 bits an axis, equal steps along all axes.

    Raises:
        InputError: There are no positions, or not `vertex_count` of them, or one that a triangle names is not finite.
    """
    if positions is None:
        raise InputError("positions: expected (n, 3) to order along a Morton curve, got none")
    points = checked(positions, (vertex_count, 3), np.float64, "positions")
    used = np.zeros(vertex_count, np.bool_)
    used[faces.ravel()] = True
    wrong = np.nonzero(used & ~np.isfinite(points).all(1))[0]
    if len(wrong):
        raise InputError(f"positions: expected finite numbers, got {points[wrong[0]].tolist()} at vertex {wrong[0]}")
    low, high = points[used].min(0), points[used].max(0)
    extent = float((high / 2 - low / 2).max())
    codes = np.empty(len(faces), np.uint64)
    if not np.isfinite(2 * extent):
        raise InputError(f"positions: expected an extent that is finite, got {low.tolist()} to {high.tolist()}")
    _codes(faces, points, low, ((1 << 21) - 1) / (2 * extent) if extent > 1e-300 else 0.0, codes)
    return codes


def morton(faces: Array, positions: object, vertex_count: int) -> Array:
    """(m,) int32: the triangles along a Morton curve through their centroids."""
    return np.argsort(morton_codes(faces, positions, vertex_count), kind="stable").astype(np.int32)
