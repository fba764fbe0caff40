"""Layers: blended triangles of many ranks, in exact depth order.

Each rank peels its own blended triangles over the opaque picture that all ranks have made (see `raster.layer`), and shades them. The rank that has a
tile gets the layers of all and composites them at every sample, the farthest first, and of equally near ones the higher id: the order of one process.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array

WORDS = 7
"""Of a layer at a sample: place, depth, id, premultiplied colour and alpha; the floats by their bits."""


@jit.kernel
def _collect(slots, samples, peeled, depths, source, m, offset, colors, out):
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
                for k in range(4):
                    out[n, 3 + k] = colors[slot, k * samples + i]
            n += 1
    return n


def collect(slots: Array, samples: int, peeled: Array, depths: Array, source: Array, m: int, offset: int, colors: Array) -> Array:
    """(n, WORDS) int32: a layer at each sample that it has.

    Args:
        slots: (k,) int64 rows of the arrays.
        samples: In each row.
        peeled, depths: (tiles, ...) int32 and float32, from `raster.layer`.
        source, m, offset: As of `claims.to_global`.
        colors: (tiles, 4 * samples) float32, the layer alone.
    """
    none, arrays = np.empty((0, WORDS), np.int32), (peeled, depths.view(np.int32), source, m, offset, colors.view(np.int32))
    out = np.empty((_collect(slots, samples, *arrays, none), WORDS), np.int32)
    if len(out):
        _collect(slots, samples, *arrays, out)
    return out


@jit.kernel
def _over(order, samples, words, floats, colors):
    for n in order:
        slot, i = words[n, 0] // samples, words[n, 0] % samples
        under = np.float32(1.0) - floats[n, 6]
        for k in range(4):
            colors[slot, k * samples + i] = floats[n, 3 + k] + colors[slot, k * samples + i] * under


def lay_over(words: Array, samples: int, colors: Array) -> None:
    """Composite layers (n, WORDS), in any order, over `colors` (tiles, 4 * samples) float32, premultiplied."""
    floats = words.view(np.float32)
    _over(np.lexsort((-words[:, 2].astype(np.int64), floats[:, 1], words[:, 0])), samples, words, floats, colors)


def below(ids: Array, m: int, offset: int, pieces: int) -> Array:
    """Global ids (...) int32 as this rank's own, for `raster.layer` to compare with: what comes before its own is nothing, and what comes after
    them is the piece after the last, whose source must be larger than any."""
    local = ids - np.int32(offset)
    return np.where((ids < 0) | (local < 0), np.int32(-1), np.where(local >= m, np.int32(m + pieces), local)).astype(np.int32)
