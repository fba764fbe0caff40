"""Sum of a soup: a number of 128 bits that two files share if they have the same triangles, in any order, with everything at their corners.

A triangle's hash has the bytes of its corners' rows, in its winding from whichever corner, and of its own row; the sum of all hashes does not depend
on the order, nor on the numbers of vertices. Different soups have one sum by an accident of 2^-128: Clarke et al., "Incremental multiset hash
functions" (2003). So no rank needs to hold a file to know that another is the same mesh.
"""

from __future__ import annotations

import math
from typing import IO, Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.cluster.ply_table import PIECE, Table, compact
from luxel.layout import clean

_U = np.uint64
_SEEDS = (_U(0x9E3779B97F4A7C15), _U(0xC2B2AE3D27D4EB4F))


@jit.device
def _mixed(h, word):
    """A hash with one more word in it: the finaliser of SplitMix64 (Steele, Lea, Flood, 2014)."""
    h = (h ^ word) * _U(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> _U(27))) * _U(0x94D049BB133111EB)
    return h ^ (h >> _U(31))


@jit.kernel
def _hash_rows(rows, seed, out):
    for i in range(len(rows)):
        h = seed
        for word in rows[i]:
            h = _mixed(h, _U(word))
        out[i] = h


@jit.kernel
def _sum(triangles, own, vertices, faces, seed):
    total = _U(0)
    for t in range(len(triangles)):
        if own[t] == 0:
            continue
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        least = _U(0xFFFFFFFFFFFFFFFF)
        for _ in range(3):
            least = min(least, _mixed(_mixed(_mixed(seed, a), b), c))
            a, b, c = b, c, a
        total += _mixed(least, faces[t])
    return total


def soup_sum(file: IO[bytes], vertex: Table, face: Table, comm: Comm, drop_degenerate: bool) -> Array:
    """(2,) uint64: the sum over all faces of a file, which are triangles; each rank reads its share.

    Args:
        file: Open for reading.
        vertex, face: Its tables.
        comm: The ranks.
        drop_degenerate: Leave out triangles with two corners in one place.
    """
    names = [prop.name for prop in face.element.properties]
    index = next(prop.name for prop in face.element.properties if prop.count is not None)
    total = np.zeros(2, np.uint64)
    first, last = comm.share_out(math.ceil(face.rows / PIECE))[comm.rank]
    for _, rows in face.read(file, first * PIECE, min(last * PIECE, face.rows)):
        used, triangles = compact(rows[face.fields[index]].astype(np.int64))
        points = vertex.take(file, used)
        words = _words(points, [vertex.fields[name] for name in vertex.fields])
        positions = vertex.stacked(points, "xyz")
        keep = np.ones(len(rows), np.uint8)
        if drop_degenerate:
            keep[clean.degenerate(triangles, positions)] = 0
        rest = _words(rows, [face.fields[name] for name in names if name != index])
        for k, seed in enumerate(_SEEDS):
            of_vertices, of_faces = np.empty(len(points), np.uint64), np.empty(len(rows), np.uint64)
            _hash_rows(words, seed, of_vertices)
            _hash_rows(rest, seed, of_faces)
            total[k] += _sum(triangles, keep, of_vertices, of_faces, seed)
    return comm.summed(total)


def _words(rows: Any, fields: list[str]) -> Array:
    if not fields:
        return np.zeros((len(rows), 0), np.uint32)
    return clean.vertex_rows([rows[name][:, None].astype(rows.dtype[name].newbyteorder("=")) for name in fields])
