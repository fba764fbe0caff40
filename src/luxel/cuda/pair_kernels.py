"""The grids of `luxel.cuda.threads.pairs`: one thread a pair of polygons, then a pair of surfaces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from luxel.cuda.door import cuda, kernel
from luxel.cuda.grids import kernels
from luxel.cuda.primitives import again
from luxel.cuda.threads import pairs as pairs_source


def bodies(again: Callable[[str], Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a thread does: lines and grids, as `luxel.cuda.grids.kernels` has them."""
    return {}, {"add_pairs": again(pairs_source.__name__).add_pairs}


globals().update(kernels(__name__, *bodies(again)))  # each is an attribute of this module
_pairs = again(pairs_source.__name__)
_exchange_plain, _exchange_hidden, _Scratch = _pairs.exchange_plain, _pairs.exchange_hidden, _pairs.Scratch
_CORNERS, _LEVELS, _PLANES, _CELLS, _BLOCKERS = _pairs.CORNERS, _pairs.LEVELS, _pairs.PLANES, _pairs.CELLS, _pairs.BLOCKERS
_PARTS = _pairs.PARTS


@kernel
def exchange_plain(n, m, given):
    """`threads.pairs.exchange_plain`, with as little memory as that takes."""
    i, j = cuda.grid(2)
    none, none3 = cuda.local.array((1, 1), np.float64), cuda.local.array((1, 1, 1), np.float64)
    scratch = _Scratch(
        cuda.local.array((_CORNERS, 3), np.float64), cuda.local.array((_CORNERS, 3), np.float64), none, cuda.local.array((1, _BLOCKERS), np.int64),
        cuda.local.array(1, np.int64), cuda.local.array((_PLANES, 4), np.float64), cuda.local.array(6, np.float64),
        cuda.local.array((2, _CORNERS, _CORNERS), np.float64), none, none, none3, cuda.local.array(1, np.int64), none3, none, none,
        none,
    )  # fmt: skip
    if i < n and j < m:
        _exchange_plain(i, j, *given, scratch)


@kernel
def exchange_hidden(n, _, given):
    """`threads.pairs.exchange_hidden`: `n` threads."""
    i, _ = cuda.grid(2)
    last, world, wanted, found, room = given
    a, b, c = cuda.local.array((_CORNERS, 3), np.float64), cuda.local.array((_CORNERS, 3), np.float64), cuda.local.array((4, 3), np.float64)
    levels, planes, bounds = cuda.local.array(_LEVELS, np.int64), cuda.local.array((_PLANES, 4), np.float64), cuda.local.array(6, np.float64)
    terms, cells = cuda.local.array((2, _CORNERS, _CORNERS), np.float64), cuda.local.array((_CELLS, 6), np.float64)
    samples, parts = cuda.local.array((4, 6), np.float64), cuda.local.array((_PARTS, 9), np.float64)
    part_a, part_b = cuda.local.array((_CORNERS, 3), np.float64), cuda.local.array((_CORNERS, 3), np.float64)
    if i < n:
        scratch = _Scratch(
            a, b, c, room.blockers[i], levels, planes, bounds, terms, cells, samples, room.pieces[i], room.counts[i], room.points[i], part_a, part_b,
            parts,
        )  # fmt: skip
        _exchange_hidden(last, world, wanted, found, scratch)
