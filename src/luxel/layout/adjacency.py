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
    """Fill both arrays; `start` (n + 1,) holds 0. All are uint32: signed indices would be asked whether they count from the end."""
    n, m = len(start) - 1, len(faces)
    for t in range(m):
        for corner in range(3):
            start[faces[t, corner]] += 1
    end = 0
    for v in range(n):
        end += start[v]
        start[v] = end
    start[n] = end
    for back in range(m):
        t = np.uint64(m - 1 - back)
        for corner in range(3):
            v = faces[t, corner]
            place = np.uint32(start[v] - 1)
            start[v] = place
            rows[place] = t


def adjacency(faces: Array, vertex_count: int) -> Adjacency:
    """The triangles around each vertex of `faces`, (m, 3) int32 below `vertex_count`."""
    start, rows = np.zeros(vertex_count + 1, np.int32), np.empty(3 * len(faces), np.int32)
    _rows(faces.view(np.uint32), start.view(np.uint32), rows.view(np.uint32))
    return Adjacency(start, rows)


@jit.kernel
def _split(faces, start, rows, most, count):
    """Name every `most` triangles of a vertex with more than that a vertex of their own; return how many vertices there are then."""
    for v in range(len(start) - 1):
        valence = start[v + 1] - start[v]
        if valence > most:
            for i in range(most, valence):
                if i % most == 0:
                    count += 1
                t = rows[start[v] + i]
                for corner in range(3):
                    if faces[t, corner] == v:
                        faces[t, corner] = count - 1
                        break
    return count


def bounded(faces: Array, rows: Adjacency, most: int) -> tuple[Array, Adjacency]:
    """The same mesh if no vertex has more than `most` triangles; else one in which the hubs are cut into vertices that have not.

    What an order does for the pieces of a hub it does for the hub, or better: so the greedy orders need no bound on the valence, and a vertex of
    a million triangles costs no more than a million others.
    """
    n = len(rows.start) - 1
    if not n or int(np.diff(rows.start).max()) <= most:
        return faces, rows
    cut = faces.copy()
    count = int(_split(cut, *rows, most, n))
    return cut, adjacency(cut, count)
