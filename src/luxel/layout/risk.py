"""The chance that a vertex in a FIFO will be dropped while triangles of it are left."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.layout.greedy import LEFT_CELLS, OPEN_CELLS

_RISK = (
    (0.5, 0.0, 0.2, 0.0, 0.015),
    (1.7, 0.0, 0.7, 0.005, 0.04),
    (2.5, 0.25, 0.5, 0.06, 0.18),
    (0.0, 0.82, 0.3, 0.1, 0.2),
    (0.0, 1.0, 0.3, 0.05, 0.4),
)
"""For C1 = 1 .. 5 and more: loads left at which half are dropped alive (constant, times the cache), the slope's width (same), the least chance."""


def risk_table(cache: int) -> Array:
    """(cache, OPEN_CELLS, LEFT_CELLS) float32: the chance that a vertex is dropped alive, by age, open corners and triangles left - 1.

    Certain if fewer loads remain than C1; else a logistic curve over the loads that remain, fitted to counts at caches of 8, 12, 16 and 32 on
    fandisk, lionstatue and beetle.
    """
    age, opened, left = np.ogrid[:cache, :OPEN_CELLS, 1 : LEFT_CELLS + 1]
    c1 = np.where(opened > 0, np.maximum(opened - left + 1, 1), 0)
    remaining = cache - 1 - age
    half, per_cache, width, width_per_cache, least = np.array(_RISK).T[:, np.clip(c1, 1, len(_RISK)) - 1]
    steepness = np.clip((half + per_cache * cache - remaining) / (width + width_per_cache * cache), -50, 50)
    chance = least + (1 - least) / (1 + np.exp(-steepness))
    return np.ascontiguousarray(np.where(c1 > remaining, 1.0, np.where(c1 > 0, chance, 0.0)), np.float32)
