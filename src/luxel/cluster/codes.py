"""Codes: what is nearest at every sample of a mesh that is drawn piece by piece: eight times the triangle, plus which piece clipping made of it."""

from __future__ import annotations

import numpy as np

from luxel import jit

CODE = 3
"""Bits for the piece: clipping makes up to seven of a triangle, numbered from 1; 0 is the triangle itself."""

MOST = 1 << 31 - CODE
"""Triangles, from which on int32 cannot hold the codes."""


@jit.kernel
def take_nearer(slots, samples, ids, depths, start, m, source, piece, codes, nearest):
    """Merge what `cover` found of a piece of the mesh, whose triangles are `start`, `start` + 1, ..., into rows `slots` of `codes` and `nearest`."""
    for slot in slots:
        for i in range(samples):
            t = ids[slot, i]
            if t >= 0 and depths[slot, i] > nearest[slot, i]:  # of equally near ones the first stays: pieces come in order
                nearest[slot, i] = depths[slot, i]
                codes[slot, i] = (start + t) << CODE if t < m else (start + source[t - m]) << CODE | piece[t - m]


@jit.kernel
def to_drawn(slots, samples, codes, seen, m, begin):
    """Replace codes by the ids of the triangles `seen` and of their pieces, which begin at `begin`."""
    for slot in slots:
        for i in range(samples):
            code = codes[slot, i]
            if code >= 0:
                k = np.searchsorted(seen, code >> CODE)
                which = code & ((1 << CODE) - 1)
                codes[slot, i] = k if which == 0 else m + begin[k] + which - 1
