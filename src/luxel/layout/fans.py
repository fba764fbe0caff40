"""The triangles around each vertex with their other two corners beside them, and what the fast orders keep of a vertex: made for few cache misses.

Vertices are records of four words in an array of one axis, and triangles around a vertex rows of three: with a second axis Numba would look up
and multiply by its length at every access. All are unsigned: Numba tests whether a signed index counts from the end.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array

U = np.uint64
STAMP, LEFT, OPEN, FIRST = U(0), U(1), U(2), U(3)
ROW = U(3)


class Fans(NamedTuple):
    """A mesh as its vertices see it, to be used up by one order.

    Attributes:
        vertex: (4 (n + 1),) uint32, records of four: STAMP, 0; LEFT, the number of triangles around the vertex; OPEN, that of their other corners;
            FIRST, its first row. The last record ends the rows.
        rows: (9 m,) uint32, rows of three: a triangle, its next corner after the vertex and the one after that. Of each vertex ascending by triangle.
        most: Triangles around the vertex that has most.
        proper: No triangle names a vertex twice.
    """

    vertex: Array
    rows: Array
    most: int
    proper: bool


@jit.inlined
def at(i, k):
    """Where field k of record i is."""
    return (U(i) << U(2)) + k


@jit.kernel
def _fans(faces, vertex, rows):
    """Fill both; `vertex` holds 0. Return the most triangles around a vertex, and how many name a vertex twice."""
    m, n = U(len(faces)) // ROW, (U(len(vertex)) >> U(2)) - U(1)
    for i in range(U(len(faces))):
        vertex[at(faces[i], LEFT)] += np.uint32(1)
    end, most, improper = np.uint32(0), np.uint32(0), 0
    for v in range(n):
        left = vertex[at(v, LEFT)]
        end, most = np.uint32(end + left), max(most, left)
        vertex[at(v, OPEN)], vertex[at(v, FIRST)] = 2 * left, end
    vertex[at(n, FIRST)] = end
    for back in range(m):
        t = m - U(1) - back
        a, b, c = faces[ROW * t], faces[ROW * t + U(1)], faces[ROW * t + U(2)]
        improper += (a == b) | (b == c) | (c == a)
        for _ in range(3):
            place = np.uint32(vertex[at(a, FIRST)] - np.uint32(1))
            vertex[at(a, FIRST)] = place
            row = ROW * U(place)
            rows[row], rows[row + U(1)], rows[row + U(2)] = t, b, c
            a, b, c = b, c, a
    return most, improper


def fans(faces: Array, vertex_count: int) -> Fans:
    """The fans of `faces`, (m, 3) int32 below `vertex_count`."""
    vertex, rows = np.zeros(4 * (vertex_count + 1), np.uint32), np.empty(9 * len(faces), np.uint32)
    most, improper = _fans(faces.reshape(-1).view(np.uint32), vertex, rows)
    return Fans(vertex, rows, int(most), not improper)
