"""Layers: blended triangles of many ranks, in exact depth order.

Each rank peels its own blended triangles over the opaque picture that all ranks have made (see `raster.layer`). The rank that has a tile sorts what
all have at each sample, the farthest first and of equally near ones the higher id, as one process peels them, and tells the owners which layer each
is in. For what a triangle has of a pixel in one layer is one fragment: only now can the owners shade them, and colours return to be laid over each
other.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array

WORDS = 3
"""Of a triangle at a sample: place, depth (its bits), id."""


@jit.kernel
def _collect(slots, samples, peeled, depths, source, m, offset, drawn, out):
    """Count the samples of a layer in the rows; or write them, if `out` has room."""
    n, writing = 0, len(out) > 0
    for slot in slots:
        for i in range(samples):
            t = peeled[slot, i]
            if t < 0:
                continue
            if writing:
                out[n, 0], out[n, 1] = slot * samples + i, depths[slot, i]
                out[n, 2] = offset + (t if t < m else source[t - m])
                drawn[n] = t
            n += 1
    return n


def collect(slots: Array, samples: int, peeled: Array, depths: Array, source: Array, m: int, offset: int) -> tuple[Array, Array]:
    """(n, WORDS) int32: what a layer has, sample by sample; and (n,) int32, the drawn ids.

    Args:
        slots: (k,) int64 rows of the arrays.
        samples: In each row.
        peeled, depths: (tiles, ...) int32 and float32, from `raster.layer`.
        source, m, offset: As of `claims.to_global`.
    """
    arrays = peeled, depths.view(np.int32), source, m, offset
    n = _collect(slots, samples, *arrays, np.empty(0, np.int32), np.empty((0, WORDS), np.int32))
    out, drawn = np.empty((n, WORDS), np.int32), np.empty(n, np.int32)
    if n:
        _collect(slots, samples, *arrays, drawn, out)
    return out, drawn


def layered(words: Array) -> tuple[Array, Array]:
    """Of (n, WORDS) in any order: (n,) int64 from far to near, sample by sample; and (n,) int32 the layer that each is in, from 0, the farthest."""
    order = np.lexsort((-words[:, 2].astype(np.int64), words.view(np.float32)[:, 1], words[:, 0]))
    place = words[order, 0]
    start = np.flatnonzero(np.append(True, place[1:] != place[:-1])) if len(place) else np.zeros(0, np.int64)
    layer = np.empty(len(words), np.int32)
    layer[order] = np.arange(len(words)) - np.repeat(start, np.diff(start, append=len(words)))
    return order, layer


@jit.kernel
def _over(order, samples, places, found, colors):
    for n in order:
        slot, i = places[n] // samples, places[n] % samples
        under = np.float32(1.0) - found[n, 3]
        for k in range(4):
            colors[slot, k * samples + i] = found[n, k] + colors[slot, k * samples + i] * under


def lay_over(order: Array, samples: int, places: Array, found: Array, colors: Array) -> None:
    """Composite (n, 4) float32 premultiplied colours at `places` (n,) int32, in this order, over `colors` (tiles, 4 * samples) float32."""
    _over(order, samples, places, found, colors)


def below(ids: Array, m: int, offset: int, pieces: int) -> Array:
    """Global ids (...) int32 as this rank's own, for `raster.layer` to compare with: what comes before its own is nothing, and what comes after
    them is the piece after the last, whose source must be larger than any."""
    local = ids - np.int32(offset)
    return np.where((ids < 0) | (local < 0), np.int32(-1), np.where(local >= m, np.int32(m + pieces), local)).astype(np.int32)
