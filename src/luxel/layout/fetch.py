"""The order of vertices: renumbered by first use, and how well a memory cache likes it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.layout.cache import used_vertices
from luxel.layout.checks import checked_triangles, whole


class Fetched(NamedTuple):
    """Vertex data read from memory.

    Attributes:
        bytes: Read, in whole cache lines.
        overfetch: bytes / size of the vertices used. Best: 1. Below 1 is impossible but for rounding to lines; worst: 3 lines a triangle.
    """

    bytes: int
    overfetch: float


@jit.kernel
def _first_use(triangles, target, source):
    """Number the vertices in the order of first use; `target` (n,) int32 holds -1. Return how many there are."""
    count = 0
    for t in range(len(triangles)):
        for corner in range(3):
            v = triangles[t, corner]
            if target[v] < 0:
                target[v] = count
                source[count] = v
                count += 1
    return count


@jit.kernel
def _unused(target, source, count):
    """Number the vertices that no triangle names after the others, in their old order."""
    for v in range(len(target)):
        if target[v] < 0:
            target[v] = count
            source[count] = v
            count += 1
    return count


@jit.kernel
def _fetch(triangles, stride, line, tags):
    """Cache lines read through a direct-mapped cache; `tags` (lines,) int64 holds -1."""
    read = 0
    for t in range(len(triangles)):
        for corner in range(3):
            start = np.int64(triangles[t, corner]) * stride
            for tag in range(start // line, (start + stride + line - 1) // line):
                place = tag % len(tags)
                read += tags[place] != tag
                tags[place] = tag
    return read


def renumber(triangles: object, vertex_count: int | None = None, keep_unused: bool = True) -> tuple[Array, Array]:
    """Number the vertices in the order in which the triangles first name them.

    Args:
        triangles: (m, 3) int32.
        vertex_count: Vertices of the mesh; None: one more than the largest index.
        keep_unused: Vertices that no triangle names go to the end, in their old order; else they are dropped.

    Returns:
        The triangles with their new indices, and (n,) int32 `source`: new vertex i is old vertex `source[i]`, so that
        `positions[source]` are the positions in the new order.

    Raises:
        InputError: An index is out of range.
    """
    faces, n = checked_triangles(triangles, vertex_count)
    target, source = np.full(n, -1, np.int32), np.empty(n, np.int32)
    count = int(_first_use(faces, target, source))
    if keep_unused:
        count = int(_unused(target, source, count))
    return np.ascontiguousarray(target[faces]), source[:count].copy()


def fetched(triangles: object, vertex_count: int | None, stride: int, line: int = 64, lines: int = 2048) -> Fetched:
    """Bytes of vertex data that drawing reads through a direct-mapped cache of `lines` lines of `line` bytes (128 KiB).

    Vertex i lies at byte `i * stride` of one interleaved buffer. Every index reads its vertex: the cache of transformed vertices is not in
    this model, which is meshoptimizer's.

    Raises:
        InputError: An index is out of range, there are no triangles, or a size is not positive.
    """
    faces, n = checked_triangles(triangles, vertex_count, empty=False)
    stride, line, lines = whole(stride, "stride", 1), whole(line, "line", 1), whole(lines, "lines", 1)
    total = int(_fetch(faces, stride, line, np.full(lines, -1, np.int64))) * line
    return Fetched(total, total / (used_vertices(faces, n) * stride))


def overfetch(triangles: object, vertex_count: int | None, stride: int, line: int = 64, lines: int = 2048) -> float:
    """Bytes read / size of the vertices used, as of `fetched`. Best: about 1, every line read once. Worst: 3 lines for each triangle."""
    return fetched(triangles, vertex_count, stride, line, lines).overfetch


def edge_span(triangles: object, vertex_count: int | None = None) -> float:
    """Locality of the vertex order: geometric mean of |i - j| over the triangles' edges (i, j).

    Best: just above 1, neighbours lie side by side (a strip: 2^(1/3)). Worst: near a fifth of the number of vertices, numbered at random.
    What a cache-oblivious layout keeps small (Yoon and Lindstrom 2006, "Mesh Layouts for Block-Based Caches"). Edges of a vertex with
    itself do not count.

    Raises:
        InputError: An index is out of range, or no triangle has an edge.
    """
    faces, _ = checked_triangles(triangles, vertex_count, empty=False)
    spans = np.abs(np.diff(faces[:, [0, 1, 2, 0]].astype(np.int64), axis=1))
    spans = spans[spans > 0]
    if not len(spans):
        raise InputError("triangles: expected an edge between two vertices, got only triangles of one vertex")
    return float(np.exp(np.log(spans).mean()))
