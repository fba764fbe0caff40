"""Around: the faces of a binary PLY file that meet what a rank has, so that it makes normals as one process does without holding the mesh.

A normal is a sum over all faces at its place. So the file is read through once, piece by piece: which vertices stand where the rank has some, and
which faces have one of those. Held are a byte a vertex of the file, and the faces that are found.
"""

from __future__ import annotations

from typing import IO

import numpy as np

from luxel.arrays import Array
from luxel.cluster.ply_table import PIECE, Table, compact, corners
from luxel.scene.normals import place_keys

_ROOM = 8  # entries of a table for each place that is looked for: most others are told by it


def around(vertex: Table, face: Table, file: IO[bytes], own: Array) -> tuple[Array, Array]:
    """All faces with a corner where the triangles `own` (k, 3) have one: their numbers (m,) int64, ascending, and corners (m, 3)."""
    wanted = np.unique(place_keys(vertex.stacked(vertex.take(file, compact(own)[0]), "xyz")))
    mask = np.uint64((1 << (_ROOM * len(wanted)).bit_length()) - 1)
    table = np.zeros(int(mask) + 1, bool)
    table[wanted & mask] = True
    near = np.empty(vertex.rows, bool)
    for start, rows in vertex.read(file, 0, vertex.rows):
        keys = place_keys(vertex.stacked(rows, "xyz"))
        found = table[keys & mask]
        maybe = keys[found]
        found[found] = wanted[np.minimum(np.searchsorted(wanted, maybe), len(wanted) - 1)] == maybe
        near[start : start + len(rows)] = found
    numbers, faces = [np.zeros(0, np.int64)], [own[:0]]
    for start in range(0, face.rows, PIECE):
        piece = corners(face, file, start, min(start + PIECE, face.rows))
        assert piece is not None  # ranks have seen that all are triangles
        chosen = np.flatnonzero(near[piece].any(1))
        numbers.append(start + chosen)
        faces.append(piece[chosen])
    return np.concatenate(numbers), np.concatenate(faces)
