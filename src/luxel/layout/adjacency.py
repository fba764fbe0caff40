"""Which triangles touch a vertex: compressed rows, made in two passes over the indices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.fans import U


class Adjacency(NamedTuple):
    """The triangles of vertex v are `triangles[start[v]:start[v + 1]]`, ascending; one that names v twice is there twice.

    Attributes:
        start: (n + 1,) int32.
        triangles: (3 m,) int32.
    """

    start: Array
    triangles: Array


@jit.parallel_kernel
def _count(queue, corners, size, counts):
    """How often each piece of `size` corners names each vertex: `counts` (p, n) hold 0. All is unsigned (see `luxel.layout.fans`)."""
    piece = jit.take(queue)
    while piece < len(counts):
        mine = counts[piece]
        for i in range(U(piece * size), U(min(len(corners), (piece + 1) * size))):
            mine[corners[i]] += np.uint32(1)
        piece = jit.take(queue)


@jit.kernel
def _ends(counts, start):
    """Fill `start` (n + 1,), and make of the counts where each piece's share of a vertex's rows ends."""
    end = np.uint32(0)
    for v in range(U(counts.shape[1])):
        start[v] = end
        for piece in range(U(len(counts))):
            end = np.uint32(end + counts[piece, v])
            counts[piece, v] = end
    start[U(counts.shape[1])] = end


@jit.parallel_kernel
def _fill(queue, corners, size, ends, rows):
    """Fill `rows`, each piece from its last triangle to its first."""
    piece = jit.take(queue)
    while piece < len(ends):
        mine = ends[piece]
        first, last = U(piece * size), U(min(len(corners), (piece + 1) * size))
        for back in range(last - first):
            i = last - U(1) - back
            v = corners[i]
            mine[v] -= np.uint32(1)
            rows[mine[v]] = i // U(3)
        piece = jit.take(queue)


def adjacency(faces: Array, vertex_count: int, threads: int = 1) -> Adjacency:
    """The triangles around each vertex of `faces`, (m, 3) int32 below `vertex_count`. Threads beyond one for every 100 thousand are not used."""
    pieces = max(1, min(threads, len(faces) // 100_000))
    size = 3 * -(-len(faces) // pieces)
    start, rows = np.empty(vertex_count + 1, np.uint32), np.empty(3 * len(faces), np.uint32)
    corners, counts = faces.reshape(-1).view(np.uint32), np.zeros((pieces, vertex_count), np.uint32)
    jit.run(_count, pieces, corners, size, counts)
    _ends(counts, start)
    jit.run(_fill, pieces, corners, size, counts, rows)
    return Adjacency(start.view(np.int32), rows.view(np.int32))


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
