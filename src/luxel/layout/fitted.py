"""The cost of `greedy`, whose numbers a search found: one set for plain FIFOs, one for each GPU model that another set suits better.

cost = load[C1] + last[C2] + slope and curve of a parabola over C3, the place in the cache by the time the vertex turns black (0 new, 1 old), or
`gone` if it will be gone by then; C1, C2 and C3 as in `luxel.layout.greedy`. C1 counts up to 5, C2 up to 6, and more is the same.

Found by a (1 + 1) evolution on the misses of whole orders:

- "fifo" at 12 and 16 together, on fandisk, lionstatue and beetle;
- "amd" (with orders made for a FIFO of 11) and "intel" (128) each on its model, on eight meshes: bumpy spheres of 10 and 3 thousand triangles, the
  hull of 5000 random points on a sphere, a grid with random diagonals, 24 small ones apart (amd only: without the two small ones for intel), and
  13 thousand triangles each of fandisk, lionstatue and beetle.

All other models of `benchmarks/RESULTS.md` judge them. docs/decisions/0008-mesh-layout.md has what other fits gave.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array


class Cost(NamedTuple):
    """The numbers of a cost: load, slope and curve by C1 = 0 .. 5, last by C2 = 1 .. 6."""

    load: tuple[float, ...]
    last: tuple[float, ...]
    slope: tuple[float, ...]
    curve: tuple[float, ...]
    gone: float


FITTED = {
    "fifo": Cost(
        (0.0, 0.768, 1.681, 3.071, 4.284, 4.52), (0.0, -0.162, -1.574, -1.965, -2.178, -3.675), (0.42, 0.962, 0.887, 0.784, 0.952, -0.62),
        (1.001, -1.2, 0.58, 0.05, -0.019, 0.291), -0.169,
    ),
    "amd": Cost(
        (0.0, 0.696, 1.738, 3.597, 4.382, 4.583), (0.0, -0.175, -1.549, -2.142, -2.182, -3.252), (0.332, 1.21, 0.887, 0.925, 1.079, -0.746),
        (1.179, -1.415, 0.64, 0.05, -0.068, 0.361), -0.04,
    ),
    "intel": Cost(
        (0.0, 0.874, 1.496, 2.586, 41.506, 4.13), (0.0, -0.564, -1.712, -1.933, -1.848, -4.362), (0.633, 1.108, 1.09, 0.309, 1.448, -6.247),
        (0.055, -1.296, 0.595, 0.354, -0.511, 1.243), 1.482,
    ),
}  # fmt: skip


def fitted_cost(cost: Cost, age: Array, c1: Array, left: Array, cache: int) -> Array:
    """The cost of vertices by their age, C1 and C2 (`left`), float32; the arrays are of shapes that go together."""
    load, last, slope, curve = (np.array(numbers) for numbers in cost[:4])
    c, few = np.minimum(c1, 5), np.minimum(left, 6) - 1
    place = (age + c) / cache
    found = load[c] + last[few] + np.where(place > 1, cost.gone, place * (curve[c] * place - slope[c]))
    return np.ascontiguousarray(found, np.float32)
