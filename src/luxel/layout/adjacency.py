"""Which triangles touch a vertex: compressed rows, made in two passes over the indices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array


class Adjacency(NamedTuple):
    """The triangles of vertex v are `triangles[start[v]:start[v + 1]]`, ascending; one that names v twice is there twice.

    Attributes:
        start: (n + 1,) int32.
        triangles: (3 m,) int32.
    """

    start: Array
    triangles: Array


@jit.kernel
def _rows(faces, start, rows):
    """Fill both arrays; `start` (n + 1,) holds 0."""
    n, m = len(start) - 1, len(faces)
    for t in range(m):
        for corner in range(3):
            start[faces[t, corner]] += 1
    end = 0
    for v in range(n):
        end += start[v]
        start[v] = end
    start[n] = end
    for t in range(m - 1, -1, -1):
        for corner in range(3):
            v = faces[t, corner]
            start[v] -= 1
            rows[start[v]] = t


def adjacency(faces: Array, vertex_count: int) -> Adjacency:
    """The triangles around each vertex of `faces`, (m, 3) int32 below `vertex_count`."""
    start, rows = np.zeros(vertex_count + 1, np.int32), np.empty(3 * len(faces), np.int32)
    _rows(faces, start, rows)
    return Adjacency(start, rows)
