"""Large meshes in parts: grown regions of neighbours, ordered by threads side by side.

A region grows breadth-first over shared vertices until it has its share of the triangles; the next starts at the border of those before. What a part
costs alone is a second load of the vertices on its border, about the root of its size. The parts depend on the mesh only, so the order is the
same for any number of threads. A part is grown when some thread has nothing to do, while the others order those before.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.adjacency import Adjacency
from luxel.layout.fans import ROW, U

PART = 1 << 17
"""Most triangles of a part."""
_DONE, _FIRST, _LAST, _CURSOR = U(0), U(1), U(2), U(3)
_FAR, _NEAR = U(12), U(6)
"""How many vertices ahead of the growth its memory is asked for: rows, and then triangles."""


@jit.part
def _seed(start, rows, placed, border, state):
    """A vertex with triangles that are in no part yet: the one that has waited longest at some border, else the next of the input."""
    while state[_FIRST] < state[_LAST]:
        v = border[state[_FIRST]]
        state[_FIRST] += U(1)
        for i in range(start[v], start[U(v) + U(1)]):
            if placed[rows[i]] == 0:
                return v
    v = state[_CURSOR]
    while True:
        for i in range(start[v], start[v + U(1)]):
            if placed[rows[i]] == 0:
                state[_CURSOR] = v
                return np.uint32(v)
        v += U(1)


@jit.inlined
def _ask(queue, first, last, start, rows, faces):
    """Have brought near what the next vertices of the queue will read."""
    if first + _FAR < last:
        jit.prefetch(rows, U(start[queue[first + _FAR]]))
    if first + _NEAR < last:
        v = U(queue[first + _NEAR])
        for i in range(start[v], start[v + U(1)]):
            jit.prefetch(faces, ROW * U(rows[i]))


@jit.kernel
def _grow(faces, start, rows, region, end, queue, border, seen, placed, members, state):
    """Add one more region to `members`, which then hold `end` triangles; what stays in the queue goes to the `border`. All is unsigned."""
    done, first, last = state[_DONE], U(0), U(0)
    while done < end:
        if first == last:
            v = _seed(start, rows, placed, border, state)
            if last == len(queue):
                first = last = U(0)
            seen[v] = region
            queue[last] = v
            last += U(1)
        _ask(queue, first, last, start, rows, faces)
        v = U(queue[first])
        first += U(1)
        for i in range(start[v], start[v + U(1)]):
            t = rows[i]
            if placed[t]:
                continue
            placed[t] = 1
            members[done] = t
            done += U(1)
            for corner in range(3):
                u = faces[ROW * t + U(corner)]
                if seen[u] != region:
                    seen[u] = region
                    queue[last] = u
                    last += U(1)
            if done == end:
                first -= U(1)  # the rest of its triangles wait with it
                break
    if state[_FIRST] == state[_LAST]:
        state[_FIRST] = state[_LAST] = 0
    for i in range(first, last):
        if state[_LAST] < len(border):
            border[state[_LAST]] = queue[i]
            state[_LAST] += U(1)
    state[_DONE] = done


@jit.kernel
def _compact(faces, members, number, inside, vertices):
    """Write the faces of a part with its own vertex numbers into `inside`; `number` (n,) holds 0, and again at the end. Return their count."""
    count = np.uint32(0)
    for i in range(U(len(members))):
        for corner in range(3):
            v = faces[ROW * members[i] + U(corner)]
            if number[v] == 0:
                vertices[count] = v
                count = np.uint32(count + np.uint32(1))
                number[v] = count
            inside[ROW * i + U(corner)] = number[v] - np.uint32(1)
    for i in range(U(count)):
        number[vertices[i]] = 0
    return count


def part_size(count: int, most: int | None = None) -> int:
    """Triangles of a part of `count`: at most `most` (None: `PART`), and an even number of parts, which two threads share evenly."""
    most = PART if most is None else most
    return count if count <= most else -(-count // (2 * -(-count // (2 * most))))


class Regions:
    """The parts of a mesh, `size` triangles each (the last may be smaller), grown one after another when they are asked for.

    Args:
        faces: (m, 3) int32.
        rows: Their adjacency.
        size: Triangles of a part.
    """

    def __init__(self, faces: Array, rows: Adjacency, size: int) -> None:
        n, m, word = len(rows.start) - 1, len(faces), np.uint32
        self.faces, self.vertex_count, self.size, self.count = faces, n, size, -(-m // size)
        self._members = np.empty(m, word)
        self._mesh = faces.reshape(-1).view(word), rows.start.view(word), rows.triangles.view(word)
        self._scratch = np.empty(n, word), np.empty(n, word), np.zeros(n, word), np.zeros(m, np.uint8), self._members, np.zeros(4, U)
        self._grown, self._lock = 0, threading.Lock()

    def members(self, k: int) -> Array:
        """(size,) int32: the triangles of part k. Threads may ask at once."""
        with self._lock:
            while self._grown <= k:
                self._grown += 1
                _grow(*self._mesh, self._grown, U(min(len(self._members), self._grown * self.size)), *self._scratch)
        return self._members[k * self.size : (k + 1) * self.size].view(np.int32)


Work = Callable[[Array, int], Array]
"""Takes a part's triangles with vertices of their own, and their number, and returns the order of the triangles."""
Crew = Callable[[Work, Iterable[tuple[Array, int]]], Iterator[Array]]
"""Does the work of all parts, in turn, wherever it likes; the work can be pickled."""


def in_parts(regions: Regions, threads: int, work: Work, progress: Callable[[int, int], None] | None = None, crew: Crew | None = None) -> Array:
    """(m,) int32: the order that `work` gives each part, part after part.

    Args:
        regions: The parts.
        threads: Parts are ordered by that many threads.
        work: Orders a part.
        progress: Called with the triangles done and their number after each part, one call at a time.
        crew: Orders the parts, in place of threads.
    """
    m, size = len(regions.faces), regions.size
    source = np.empty(m, np.int32)
    lock, done, todo = threading.Lock(), [0], iter(range(regions.count))

    def tell(triangles: int) -> None:
        with lock:
            done[0] += triangles
            if progress:
                progress(done[0], m)

    if crew is not None:
        number = np.zeros(regions.vertex_count, np.uint32)
        for k, order in enumerate(crew(work, (_alone(regions, k, number) for k in range(regions.count)))):
            source[k * size : k * size + len(order)] = regions.members(k)[order]
            tell(len(order))
        return source

    def worker(_queue: Any) -> None:
        number = np.zeros(regions.vertex_count, np.uint32)
        while True:
            with lock:
                k = next(todo, None)
            if k is None:
                return
            mine = regions.members(k)
            source[k * size : k * size + len(mine)] = mine[work(*_alone(regions, k, number))]
            tell(len(mine))

    jit.run(worker, min(threads, regions.count))
    return source


def _alone(regions: Regions, k: int, number: Array) -> tuple[Array, int]:
    """Part k with vertices of its own, and how many; `number` (n,) holds 0, and again at the end."""
    mine = regions.members(k)
    inside = np.empty((len(mine), 3), np.int32)
    arrays = (array.reshape(-1).view(np.uint32) for array in (regions.faces, mine))
    return inside, int(_compact(*arrays, number, inside.reshape(-1).view(np.uint32), np.empty(3 * len(mine), np.uint32)))
