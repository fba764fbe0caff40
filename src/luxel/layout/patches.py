"""Patches: an order for GPUs whose batches hold few triangles, so that each batch transforms few vertices and leaves whole mesh behind it.

A batch (see `luxel.layout.batch`) forgets everything at its end, so what counts is how few vertices its triangles have together: a round
patch. Each is grown by the triangle of least cost around it: what its new vertices cost, less what is gained where vertices of the patch get
near their last triangle and will not be needed by another. The next patch starts beside the last, where the least is left.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.layout.adjacency import Adjacency, bounded
from luxel.layout.batch import Model
from luxel.layout.greedy import VALENCE

NEW = np.array([0.0, 1.152, 1.158, 1.125, 0.919, 1.703, 1.798, 1.513, 1.262], np.float32)
HELD = np.array([0.0, 1.366, 0.305, -0.174, -0.694, -0.977, -0.699, 1.632, -0.275], np.float32)
START = np.array([0.0, -0.343, 0.542, 2.668, 4.251, 5.309, 5.814, 8.41, 5.455], np.float32)
"""By triangles left, 1 .. 8 and more: the cost of a new vertex, the gain at a vertex of the patch, and the cost of a vertex to start at.

Found by an evolution on NVIDIA's model: first on fandisk, lionstatue, beetle, horse and koala, then as intel of `luxel.layout.fitted`. Judged on
the other models.
"""
_STACK = 1 << 16
_NONE = np.uint32(0xFFFFFFFF)


@jit.part
def _cheapest(around, count, batch, faces, start, rows, left, stamp, drawn, new, held):
    """The undrawn triangle of least cost at one of the `count` vertices `around`, and how many of its vertices are new; _NONE if there is none."""
    best, best_new, least = _NONE, 0, np.float32(np.inf)
    most = np.uint32(len(new) - 1)
    for k in range(count):
        v = around[k]
        if left[v] == 0:
            continue
        for i in range(start[v], start[v + np.uint32(1)]):
            t = rows[i]
            if drawn[t]:
                continue
            cost, loads = np.float32(0), 0
            for corner in range(3):
                u = faces[t, corner]
                cell = min(left[u], most)
                inside = stamp[u] == batch
                cost += -held[cell] if inside else new[cell]
                loads += not inside
            if cost < least:
                best, best_new, least = t, loads, cost
    return best, best_new


@jit.kernel
def _patches(faces, start, rows, warp, group, new, held, fresh, left, stamp, drawn, around, stack, source):
    """Write the order into `source`; return how many batches there are.

    `left` (n,) holds the valences, `stamp` (n,) and `drawn` (m,) 0; `around` (warp + 3,) and `stack` are scratch. All are unsigned.
    """
    m = len(faces)
    batch, done, cursor, seen = np.uint32(1), np.uint64(0), np.uint64(0), 0
    count, triangles = np.uint64(0), 0
    while done < m:
        t, loads = _cheapest(around, count, batch, faces, start, rows, left, stamp, drawn, new, held)
        if t != _NONE and (triangles == group or count + np.uint64(loads) > warp):
            t, _ = _cheapest(around, count, np.uint32(batch + 1), faces, start, rows, left, stamp, drawn, fresh, held)
            count, triangles, batch = np.uint64(0), 0, np.uint32(batch + 1)
        while t == _NONE and seen > 0:
            seen -= 1
            around[warp + 2] = stack[seen & (_STACK - 1)]
            t, _ = _cheapest(around[warp + 2 :], 1, batch, faces, start, rows, left, stamp, drawn, fresh, held)
        if t == _NONE:
            while drawn[cursor]:
                cursor += np.uint64(1)
            t = np.uint32(cursor)
        loads = 0
        for corner in range(3):
            loads += stamp[faces[t, corner]] != batch
        if triangles == group or count + np.uint64(loads) > warp:
            count, triangles, batch = np.uint64(0), 0, np.uint32(batch + 1)
        source[done] = t
        drawn[t] = 1
        done += np.uint64(1)
        triangles += 1
        for corner in range(3):
            v = faces[t, corner]
            left[v] -= 1
            if stamp[v] != batch:
                stamp[v] = batch
                around[count] = v
                count += np.uint64(1)
                stack[seen & (_STACK - 1)] = v
                seen += 1
    return batch


def patches(faces: Array, rows: Adjacency, model: Model, new: Array = NEW, held: Array = HELD, fresh: Array = START) -> Array:
    """(m,) int32: the triangles in patches for a GPU whose batches end after `model.group` triangles or `model.warp` vertices."""
    faces, rows = bounded(faces, rows, VALENCE)
    n, m, word = len(rows.start) - 1, len(faces), np.uint32
    group, warp = model.group or m, model.warp or 3 * (model.group or 1)
    source = np.empty(m, np.int32)
    arrays = (array.view(word) for array in (faces, rows.start, rows.triangles))
    scratch = np.diff(rows.start).view(word), np.zeros(n, word), np.zeros(m, np.uint8), np.empty(warp + 3, word), np.empty(_STACK, word)
    _patches(*arrays, warp, group, new, held, fresh, *scratch, source.view(word))
    return source
