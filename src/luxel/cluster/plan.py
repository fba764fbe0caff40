"""Plan: which tiles of the screen each group of ranks draws.

The tiles, row by row, are cut into as many runs as there are groups, so that each costs the same. What a tile costs is guessed from a quick count
of triangles, every k-th of which is projected, and is corrected by what drawing took in the picture before. Static division, for comparison,
gives every group as many tiles.

Sort-first, after Molnar et al., "A sorting classification of parallel rendering" (1994); cuts of equal cost as in Mueller, "The sort-first
rendering architecture for high-performance graphics" (1995).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.raster.chunks import Chunks, Reach, chunks_of, reach
from luxel.raster.geometry import Geometry
from luxel.raster.project import View, Window

BALANCES = ("dynamic", "static")
_SAMPLED = 1 << 12  # triangles that are looked at, of a whole mesh
_TRIANGLE, _PIXEL, _TILE = 20.0, 45.0, 2000.0  # nanoseconds, of a mesh of small triangles in one light: only their ratios count
_FAITH = 0.4  # how much of a misjudgement is made good in the next picture


@jit.kernel
def _count(first, last, step, positions, triangles, m, window, tile, counts, areas):
    """Add every step-th triangle to the tiles that its box touches, `step` times, and its area, spread over them evenly."""
    x, y = np.empty(3), np.empty(3)
    ox, oy, width, height, full_width, full_height = window
    across = (width + tile - 1) // tile
    for t in range(first, last, step):
        behind = False
        for k in range(3):
            v = triangles[t, k]
            px, py, pz = np.float64(positions[v, 0]), np.float64(positions[v, 1]), np.float64(positions[v, 2])
            w = m[3, 0] * px + m[3, 1] * py + m[3, 2] * pz + m[3, 3]
            behind |= not w > 0.0
            x[k] = ((m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]) / w * 0.5 + 0.5) * full_width - ox
            y[k] = (0.5 - (m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]) / w * 0.5) * full_height - oy
        left, top, right, bottom = x.min(), y.min(), x.max(), y.max()
        if behind:  # it reaches behind the eye: it may be anywhere
            left, top, right, bottom = 0.0, 0.0, width - 1.0, height - 1.0
        if not (right >= 0.0 and bottom >= 0.0 and left < width and top < height):
            continue
        lx, ly = int(max(left, 0.0)) // tile, int(max(top, 0.0)) // tile
        hx, hy = int(min(right, width - 1.0)) // tile, int(min(bottom, height - 1.0)) // tile
        area = 0.0 if behind else abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) * 0.5 * step
        share = int(min(area / ((hx - lx + 1) * (hy - ly + 1)), 1e9))
        for ty in range(ly, hy + 1):
            for tx in range(lx, hx + 1):
                counts[ty * across + tx] += step
                areas[ty * across + tx] += share


def tile_costs(geometry: Geometry, view: View, window: Window, tile: int, samples: int, comm: Comm, shared: bool) -> Array:
    """(tiles,) float64: guessed nanoseconds that one thread takes to draw each tile; the same on all ranks.

    Args:
        geometry: Of the whole scene, or of this rank's share of it.
        samples: A pixel, for what is shaded at its edges.
        shared: Each rank has a share of the triangles, not all of them: what it counts is of its own.
    """
    m = len(geometry.triangles)
    first, last = (0, m) if shared else comm.share_out(m)[comm.rank]
    step = max(1, math.ceil(m / (max(1, _SAMPLED // comm.size) if shared else _SAMPLED)))
    tiles = -(-window.width // tile) * -(-window.height // tile)
    found = np.zeros((2, tiles), np.int64)
    _count(first, last, step, geometry.positions, geometry.triangles, view.clip_from_world, np.array(window, np.int64), tile, *found)
    counts, areas = comm.summed(found)
    return _TRIANGLE * counts + _PIXEL * (0.75 + samples / 4) * np.minimum(areas, tile * tile) + _TILE


def cut(costs: Array, hands: Array) -> Array:
    """(parts + 1,) int64: where (n,) costs are cut into runs whose sums are as `hands` (parts,), as nearly as may be; some are empty if there are
    more."""
    total = np.concatenate([[0.0], np.cumsum(costs)])
    wanted = total[-1] * np.concatenate([[0.0], np.cumsum(hands)]) / hands.sum()
    after = np.searchsorted(total, wanted)
    before = np.maximum(after - 1, 0)
    at = np.where(wanted - total[before] < total[np.minimum(after, len(costs))] - wanted, before, np.minimum(after, len(costs)))
    at[0], at[-1] = 0, len(costs)
    return np.maximum.accumulate(at).astype(np.int64)


class Plan:
    """Cuts the tiles of a picture's windows among groups of ranks, and learns from what they took; kept from picture to picture.

    Attributes:
        how: "dynamic" or "static".
    """

    def __init__(self, how: str = "dynamic") -> None:
        self.how = how
        self._known: dict[Window, Array] = {}  # measured cost of a tile over the guessed one
        self._counted: dict[Window, tuple[Array, Array]] = {}
        self._chunks: tuple[Array, Chunks] | None = None
        self._drawn: list[tuple[Window, Array, Array, Array]] = []

    def cuts(self, costs: Callable[[], Array], window: Window, tiles: int, hands: Array, view: Array | None = None) -> Array:
        """(groups + 1,) int64: group g draws the tiles cuts[g] .. cuts[g + 1] - 1.

        Args:
            costs: Gives those of the tiles; called on all ranks, or on none.
            window: Of the picture.
            tiles: Of the window.
            hands: (groups,) int64: how many ranks each of the groups has that share them.
            view: (4, 4) clip_from_world; if it is that of the picture before, so are the costs, as they have been measured.
        """
        if self.how == "static" or len(hands) == 1:
            return cut(np.ones(tiles), hands)
        before = self._counted.get(window)
        if before is None or view is None or not np.array_equal(before[0], view):
            self._counted[window] = before = np.eye(4) if view is None else view, costs()
        guessed = before[1] * self._known.get(window, 1.0)
        cuts = cut(guessed, hands)
        self._drawn.append((window, cuts, guessed, hands))
        return cuts

    def reach(self, geometry: Geometry, view: View, window: Window, bounds: tuple[int, int, int, int]) -> Reach:
        """What of a geometry may touch these pixels of a window; its chunks are made once."""
        if self._chunks is None or self._chunks[0] is not geometry.triangles:
            self._chunks = geometry.triangles, chunks_of(geometry)
        return reach(self._chunks[1], view, window, bounds)

    def learn(self, seconds: Array) -> None:
        """(groups,) float64: what each group took to draw what it was given since the last call."""
        for window, cuts, guessed, hands in self._drawn:
            parts = np.add.reduceat(np.append(guessed, 0.0), cuts[:-1]) * (np.diff(cuts) > 0) / hands
            took = np.where(parts > 0, np.maximum(seconds, 1e-9) / np.maximum(parts, 1e-9), 0.0)
            ratio = took / (seconds.sum() / max(parts.sum(), 1e-9))
            factor = np.repeat(np.where(parts > 0, ratio, 1.0) ** _FAITH, np.diff(cuts))
            self._known[window] = self._known.get(window, 1.0) * factor
        self._drawn.clear()
