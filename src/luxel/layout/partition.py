"""Large meshes in parts: grown regions of neighbours, ordered by threads side by side.

A region grows breadth-first over shared vertices until it has its share of the triangles; the next starts at the border of those before. What a part
costs alone is a second load of the vertices on its border, about the root of its size; a cold cache costs a dozen. The parts depend on the mesh
only, so the order is the same for any number of threads.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.adjacency import Adjacency, adjacency

PART = 1 << 17
"""Most triangles of a part."""


@jit.part
def _seed(start, rows, placed, border, ends, cursor):
    """A vertex with triangles that are in no part yet: the one that has waited longest at some border, else the next of the input."""
    while ends[0] < ends[1]:
        v = border[ends[0]]
        ends[0] += 1
        for i in range(start[v], start[v + np.uint32(1)]):
            if placed[rows[i]] == 0:
                return v
    v = np.uint32(cursor[0])
    while True:
        for i in range(start[v], start[v + np.uint32(1)]):
            if placed[rows[i]] == 0:
                cursor[0] = v
                return v
        v = np.uint32(v + 1)


@jit.kernel
def _regions(faces, start, rows, size, queue, border, seen, placed, members):
    """Write the triangles region after region into `members`; `queue` and `border` (n,) are scratch, `seen` (n,) and `placed` (m,) hold 0.

    All arrays are unsigned (see `luxel.layout.greedy`).
    """
    m = len(faces)
    ends, cursor = np.zeros(2, np.int64), np.zeros(1, np.int64)
    one, done, region = np.uint64(1), np.uint64(0), 0
    while done < m:
        region += 1
        end = np.uint64(min(m, region * size))
        first, last = np.uint64(0), np.uint64(0)
        while done < end:
            if first == last:
                v = _seed(start, rows, placed, border, ends, cursor)
                if last == len(queue):
                    first = last = np.uint64(0)
                seen[v] = region
                queue[last] = v
                last += one
            v = queue[first]
            first += one
            for i in range(start[v], start[v + np.uint32(1)]):
                t = rows[i]
                if placed[t]:
                    continue
                placed[t] = 1
                members[done] = t
                done += one
                for corner in range(3):
                    u = faces[t, corner]
                    if seen[u] != region:
                        seen[u] = region
                        queue[last] = u
                        last += one
                if done == end:
                    first -= one  # the rest of its triangles wait with it
                    break
        if ends[0] == ends[1]:
            ends[0] = ends[1] = 0
        for i in range(first, last):
            if ends[1] < len(border):
                border[ends[1]] = queue[i]
                ends[1] += 1
    return region


@jit.kernel
def _compact(faces, members, number, inside, vertices):
    """Write the faces of a part with its own vertex numbers into `inside`; `number` (n,) holds 0, and again at the end. Return their count."""
    count = np.uint32(0)
    for i in range(np.uint64(len(members))):
        t = members[i]
        for corner in range(3):
            v = faces[t, corner]
            if number[v] == 0:
                vertices[count] = v
                count = np.uint32(count + 1)
                number[v] = count
            inside[i, corner] = number[v] - 1
    for i in range(count):
        number[vertices[i]] = 0
    return count


def part_size(count: int, most: int | None = None) -> int:
    """Triangles of a part of `count`: at most `most` (None: `PART`), and an even number of parts, which two threads share evenly."""
    most = PART if most is None else most
    return count if count <= most else -(-count // (2 * -(-count // (2 * most))))


def regions(faces: Array, rows: Adjacency, size: int) -> Array:
    """(m,) int32: the triangles, region after region of `size` each (the last may be smaller)."""
    n, m, word = len(rows.start) - 1, len(faces), np.uint32
    members = np.empty(m, np.int32)
    arrays = (array.view(word) for array in (faces, rows.start, rows.triangles))
    _regions(*arrays, size, np.empty(n, word), np.empty(n, word), np.zeros(n, word), np.zeros(m, np.uint8), members.view(word))
    return members


def in_parts(faces: Array, rows: Adjacency, size: int, threads: int, work: Callable[[Array, Adjacency], Array],
             progress: Callable[[int, int], None] | None = None) -> Array:  # fmt: skip
    """(m,) int32: the order that `work(faces, rows)` gives each part of `size` triangles, part after part.

    Args:
        faces: (m, 3) int32.
        rows: Their adjacency.
        size: Triangles of a part; no more than one part is made if it holds them all.
        threads: Parts are ordered by that many threads.
        work: Takes a part's triangles with vertices of their own and their adjacency, and returns the order of the triangles.
        progress: Called with the triangles done and their number after each part, one call at a time.
    """
    m = len(faces)
    if m <= size:
        return work(faces, rows)
    members, source = regions(faces, rows, size), np.empty(m, np.int32)
    parts = -(-m // size)
    lock, done, todo = threading.Lock(), [0], iter(range(parts))

    def worker(_queue: Any) -> None:
        number = np.zeros(len(rows.start) - 1, np.uint32)
        while True:
            with lock:
                k = next(todo, None)
            if k is None:
                return
            mine = members[k * size : (k + 1) * size]
            inside = np.empty((len(mine), 3), np.int32)
            arrays = (array.view(np.uint32) for array in (faces, mine))
            count = int(_compact(*arrays, number, inside.view(np.uint32), np.empty(3 * len(mine), np.uint32)))
            source[k * size : k * size + len(mine)] = mine[work(inside, adjacency(inside, count))]
            with lock:
                done[0] += len(mine)
                if progress:
                    progress(done[0], m)

    jit.run(worker, min(threads, parts))
    return source
