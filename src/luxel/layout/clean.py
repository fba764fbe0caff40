"""What a mesh can do without: vertices that are equal in everything, triangles without area, triangles drawn twice."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.checks import checked_triangles


@jit.kernel
def _weld(rows, slots, target, source):
    """Number the different rows in the order in which they come; `slots`, a power of two of them, hold -1. Return how many there are."""
    n, width = rows.shape
    mask, count = len(slots) - 1, 0
    for i in range(n):
        mixed = np.int64(0)
        for k in range(width):  # below 2^32 * 2^27 in between: no wrap
            mixed = ((mixed ^ np.int64(rows[i, k])) * np.int64(0x45D9F3B)) & np.int64(0xFFFFFFFF)
            mixed ^= mixed >> 15
        place = mixed & mask
        while slots[place] >= 0:
            other, same = source[slots[place]], True
            for k in range(width):
                same = same and rows[other, k] == rows[i, k]
            if same:
                break
            place = (place + 1) & mask
        if slots[place] < 0:
            slots[place], source[count] = count, i
            count += 1
        target[i] = slots[place]
    return count


def vertex_rows(arrays: Sequence[Array]) -> Array:
    """(n, words) uint32: the bytes of several arrays (n, ...) side by side, so that equal rows are vertices equal in all of them.

    -0.0 becomes 0.0: they are the same number. Arrays of bytes are taken as they are, filled up to whole words.
    """
    parts = []
    for array in arrays:
        width = int(np.prod(array.shape[1:], dtype=np.int64))
        flat = np.ascontiguousarray(array).reshape(len(array), width)
        flat = flat + flat.dtype.type(0) if flat.dtype.kind == "f" else flat
        data = flat.view(np.uint8).reshape(len(flat), width * flat.dtype.itemsize)
        parts.append(np.pad(data, ((0, 0), (0, -data.shape[1] % 4))))
    return np.concatenate(parts, 1).view(np.uint32) if parts else np.zeros((0, 0), np.uint32)


def weld(rows: Array) -> tuple[Array, Array]:
    """Find equal rows, exactly (a hash only says where to look).

    Args:
        rows: (n, words) uint32, from `vertex_rows`.

    Returns:
        (n,) int32, the number of each row among the k different ones, in the order of their first use; and (k,) int32, the first row of each.
    """
    n = len(rows)
    target, source = np.empty(n, np.int32), np.empty(n, np.int32)
    slots = np.full(1 << max(4, (2 * n).bit_length()), -1, np.int32)
    count = int(_weld(np.ascontiguousarray(rows), slots, target, source))
    return target, source[:count].copy()


def canonical(triangles: Array) -> Array:
    """(m, 3): each triangle turned so that it reads least; equal rows are the same triangle with the same winding."""
    turned = np.stack([np.roll(triangles, -k, 1) for k in range(3)])
    least = ((turned[:, :, 0].astype(np.int64) << 32) | turned[:, :, 1]).argmin(0)
    return np.ascontiguousarray(turned[least, np.arange(len(triangles))])


def degenerate(triangles: object, positions: Array | None = None) -> Array:
    """(m,) bool: triangles that name a vertex twice, or (with `positions` (n, 3)) have two corners in the same place.

    Slivers are not counted: they may close a T-junction.

    Raises:
        InputError: An index is out of range.
    """
    faces, _ = checked_triangles(triangles, None if positions is None else len(positions))
    a, b, c = faces.T
    flat = (a == b) | (b == c) | (c == a)
    if positions is not None:
        pa, pb, pc = positions[a], positions[b], positions[c]
        flat |= (pa == pb).all(1) | (pb == pc).all(1) | (pc == pa).all(1)
    return np.asarray(flat)


def duplicate(triangles: object) -> Array:
    """(m,) bool: triangles that were there before, with the same winding. The two sides of a sheet are not duplicates.

    Raises:
        InputError: An index is out of range.
    """
    faces, _ = checked_triangles(triangles)
    again = np.ones(len(faces), bool)
    again[weld(vertex_rows([canonical(faces)]))[1]] = False
    return again
