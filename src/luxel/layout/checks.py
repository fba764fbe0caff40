"""What every function of the layout checks at its door."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError

MOST_INDICES = (1 << 31) - 1
SMALLEST_CACHE = 3


def checked_triangles(triangles: object, vertex_count: int | None = None, empty: bool = True) -> tuple[Array, int]:
    """`triangles` as (m, 3) int32 in C order, and the number of vertices: `vertex_count`, or one more than the largest index.

    Raises:
        InputError: The shape or dtype is wrong, an index is negative or not below `vertex_count`, there are 2^31 indices or more,
            or there are no triangles and `empty` is false.
    """
    rows = getattr(triangles, "shape", (0,))
    if rows and 3 * rows[0] > MOST_INDICES:
        raise InputError(f"triangles: expected fewer than 2^31 indices, got {rows[0]} triangles with {3 * rows[0]}")
    faces = checked(triangles, ("m", 3), np.int32, "triangles")
    if not len(faces):
        if not empty:
            raise InputError("triangles: expected at least one triangle to order, got none")
        return faces, checked_count(vertex_count or 0)
    low, high = int(faces.min()), int(faces.max())
    n = high + 1 if vertex_count is None else checked_count(vertex_count)
    if low < 0 or high >= n:
        wrong = low if low < 0 else high
        where = int(np.nonzero((faces == wrong).any(1))[0][0])
        raise InputError(f"triangles: triangle {where} names vertex {wrong} of a mesh with {n} vertices")
    return faces, n


def checked_count(vertex_count: object) -> int:
    """A number of vertices, 0 .. 2^31 - 1."""
    count = whole(vertex_count, "vertex_count", 0)
    if count > MOST_INDICES:
        raise InputError(f"vertex_count: expected fewer than 2^31, got {count}")
    return count


def checked_cache(cache: object) -> int:
    """A cache size in vertices, at least 3: a triangle must fit."""
    return whole(cache, "cache", SMALLEST_CACHE)


def whole(value: object, name: str, least: int) -> int:
    """`value` as a whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise InputError(f"{name}: expected a whole number of at least {least}, got {value!r}")
    return int(value)


def checked_weights(weights: Sequence[float] | None) -> tuple[float, ...] | None:
    """Three or four finite numbers, or None."""
    if weights is None:
        return None
    try:
        numbers = tuple(float(x) for x in weights)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) not in (3, 4) or not all(math.isfinite(x) for x in numbers):
        raise InputError(f"weights: expected k1, k2, k3 and perhaps a fourth, finite numbers, got {weights!r}")
    return numbers


def positive(value: object, name: str) -> float:
    """`value` as a finite number above 0."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)) or not 0 < value < math.inf:
        raise InputError(f"{name}: expected a number above 0, got {value!r}")
    return float(value)
