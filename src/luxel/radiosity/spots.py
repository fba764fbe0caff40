"""Spots: the few elements so bright that rays tell others too little of them.

A lamp a hand below a ceiling lights a ring on it which lights the room. To a luxel's rays, some hundred over the hemisphere, such a ring is as a lamp
would be: a few rays meet it or none do, all luxels cast the same, and images of the ring appear on the walls. So what sends on much of the direct
light from a small part of all surface shoots as lamps do, by rows of transport from many points of it, in every pass of the light; rays bring
what all others send. Which those are depends on the direct light alone, and passing light on stays linear: what is kept lights the scene anew.
"""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.radiosity.element import AREA
from luxel.radiosity.elements import Quality, shining_source
from luxel.radiosity.gather import Spots
from luxel.radiosity.labour import Labour
from luxel.radiosity.patches import patch_starts
from luxel.radiosity.solve import Problem, Rows, complete
from luxel.radiosity.transport import ROW_BYTES

_BRIGHT = 8.0
"""Times the light that all surface would send on if the direct light were spread evenly: what sends more is bright."""

_MOST_AREA = 0.01
"""Of all surface, at most, are spots: rays tell well enough of what is larger."""

_LEAST_LIGHT = 0.01
"""Of what is sent on of the direct light, at least, spots send: less is not worth rows."""


def bright(direct: Array, albedo: Array, area: Array) -> Array:
    """(k,) int64: which elements are spots, in order, by the irradiance of lights (3, n) W/m2, their albedo (3, n) and area (n,) m2."""
    radiosity = (albedo * direct).sum(0, dtype=np.float64)
    power, whole = radiosity * area, float(area.sum(dtype=np.float64))
    passed_on = min(float((albedo.mean(0) * area).sum(dtype=np.float64)) / whole, 0.99)
    even = float(power.sum()) / whole / (1.0 - passed_on)
    brightest = np.argsort(-radiosity, kind="stable")
    few = brightest[np.cumsum(area[brightest], dtype=np.float64) <= _MOST_AREA * whole]
    found = np.sort(few[radiosity[few] > _BRIGHT * even])
    return found if power[found].sum() > _LEAST_LIGHT * power.sum() else found[:0]


def spot_rows(elements: int, quality: Quality) -> int:
    """About so many rows there are of the spots of a scene of so many elements, if it has any: half as many again at most (1.4 in what was tried)."""
    return min(quality.spot_points, ROW_BYTES // (2 * elements))


def find_spots(problem: Problem, direct: Array, quality: Quality, labour: Labour) -> Spots | None:
    """The spots of a scene that lights give so much `direct` light (3, n), and their rows; None if there are none."""
    numbers = problem.elements.numbers
    element = bright(direct, problem.albedo, numbers[AREA])
    points = spot_rows(numbers.shape[1], quality)
    if not len(element) or not points:
        return None
    source, origin = shining_source(numbers[:, element], points, quality.light_resolution, problem.rays.scene, labour)
    count = len(source.tree.patches)
    rows = complete(problem, source, Rows(count, problem.own.numbers.shape[1], count, labour.empty), labour)
    return Spots(element[origin].astype(np.int32), source.numbers[AREA], patch_starts(source.tree), rows.rows, rows.touched)
