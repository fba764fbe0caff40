"""Sort-first: groups of ranks share the screen. Each draws a run of tiles, and rank 0 gets the pixels.

Every rank projects and bins with the whole picture's fixed point, window and tiles, and draws what touches its own tiles: so what it draws has
one process's bits. Molnar et al., "A sorting classification of parallel rendering" (1994).
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.cluster.plan import Plan, tile_costs
from luxel.raster.chunks import Reach
from luxel.raster.frame import Band

Box = tuple[int, int, int, int]


def boxes(first: int, last: int, across: int, tile: int, keep: Box) -> list[Box]:
    """The pixels of tiles first .. last - 1, of which there are `across` in a row, as at most three rectangles: left, top, right, bottom.

    Args:
        keep: The rectangle that counts: what lies outside of it is left out.
    """
    rows = [(first // across, first % across, last // across, last % across)]
    (begin, left, end, right) = rows[0]
    if first >= last:
        runs = []
    elif begin == end:
        runs = [(left, begin, right, end + 1)]
    else:
        whole = begin + (left > 0)
        runs = [(left, begin, across, begin + 1)] * (left > 0) + [(0, whole, across, end)] + [(0, end, right, end + 1)] * (right > 0)
    cropped = [(max(x0 * tile, keep[0]), max(y0 * tile, keep[1]), min(x1 * tile, keep[2]), min(y1 * tile, keep[3])) for x0, y0, x1, y1 in runs]
    return [box for box in cropped if box[0] < box[2] and box[1] < box[3]]


def glue(arrays: Iterable[Array], given: list[list[Box]], comm: Comm) -> None:
    """Bring what the ranks have drawn to rank 0.

    Args:
        arrays: Pictures (h, w, ...), drawn in part, those of rank 0 get the rest.
        given: Of each rank, the rectangles that it has drawn; all ranks know them.
    """
    for array in arrays:
        if comm.rank:
            comm.move([(0, array[y0:y1, x0:x1]) for x0, y0, x1, y1 in given[comm.rank]], [])
            continue
        into, beside = [], []
        for rank in range(1, comm.size):
            for x0, y0, x1, y1 in given[rank]:
                part = array[y0:y1, x0:x1]
                if not part.flags.c_contiguous:
                    beside.append((part, np.empty(part.shape, part.dtype)))
                    part = beside[-1][1]
                into.append((rank, part))
        comm.move([], into)
        for part, got in beside:
            part[...] = got


class ScreenBand(Band):
    """A window of which each rank draws its own run of tiles."""

    def __init__(self, comm: Comm, plan: Plan, clocked: dict[str, float], *rest: Any) -> None:
        self.comm, self.plan, self.clocked = comm, plan, clocked
        super().__init__(*rest)

    def _choose(self) -> tuple[int, int]:
        o, tiles = self.options, self.across * self.down
        self.cuts = self.plan.cuts(
            lambda: tile_costs(self.seen.geometry, self.seen.view, self.window, o.tile, len(o.positions), self.comm, False),
            self.window, tiles, np.ones(self.comm.size, np.int64), self.seen.view.clip_from_world,
        )  # fmt: skip
        self.began = time.perf_counter()
        return int(self.cuts[self.comm.rank]), int(self.cuts[self.comm.rank + 1])

    def _reach(self, bounds: Box) -> Reach:
        return self.plan.reach(self.seen.geometry, self.seen.view, self.window, bounds)

    def run(self, progress: Any = None) -> None:
        """Draw this rank's tiles, and bring them together."""
        super().run(progress)
        drawn = time.perf_counter()
        x, y = self.place
        given = [
            [(x + x0, y + y0, x + x1, y + y1) for x0, y0, x1, y1 in boxes(int(a), int(b), self.across, self.options.tile, self.keep)]
            for a, b in zip(self.cuts, self.cuts[1:], strict=False)
        ]
        glue((array for array in (self.target.color, self.target.linear, *self.outputs) if array.size), given, self.comm)
        glued = time.perf_counter()
        for name, seconds in (("busy", drawn - self.began), ("glue", glued - drawn)):
            self.clocked[name] = self.clocked.get(name, 0.0) + seconds
