"""Spots: the few elements so bright that rays tell others too little of them.

A lamp a hand below a ceiling lights a ring on it which lights the room. To a luxel's rays, some hundred over the hemisphere, such a ring is as a lamp
would be: a few rays meet it or none do, all luxels cast the same, and images of the ring appear on the walls. So what sends on much of the direct
light from a small part of all surface shoots as lamps do, by rows of transport from many points of it, in every pass of the light; rays bring
what all others send. Which those are depends on the direct light and on who sees whom, and passing light on stays linear: what is kept lights the
scene anew. Bright is what is far brighter than where it is seen, not than the scene: the sun outdoors says nothing of a room.
"""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.radiosity.element import AREA
from luxel.radiosity.gather import Sight, Spots
from luxel.radiosity.labour import Labour
from luxel.radiosity.patches import patch_starts
from luxel.radiosity.quality import Quality
from luxel.radiosity.shining import shining_source
from luxel.radiosity.solve import Problem, Rows, complete
from luxel.radiosity.transport import ROW_BYTES

_BRIGHT = 8.0
"""Times the light of where it is seen: what sends more is bright."""

_MOST_AREA = 0.01
"""Of all surface, at most, are spots: rays tell well enough of what is larger."""

_LEAST_LIGHT = 0.01
"""Of what elements receive in one bounce spots send so much at least, or rows are not worth it. Elements count by the roots of what they receive:
dim places somewhat, though hardly any light is there."""


def bright(radiosity: Array, around: Array, area: Array) -> Array:
    """(k,) int64: which elements may be spots, in order, by the radiosity (n,) W/m2 of the direct light alone, the light `around` (n,) W/m2 where
    they are seen, 0 if they are not, and their area (n,) m2."""
    share = np.divide(radiosity, around, out=np.zeros(len(area)), where=around > 0)
    brightest = np.argsort(-share, kind="stable")
    few = brightest[np.cumsum(area[brightest], dtype=np.float64) <= _MOST_AREA * area.sum(dtype=np.float64)]
    return np.sort(few[share[few] > _BRIGHT])


def _found(problem: Problem, sight: Sight, direct: Array, labour: Labour) -> Array:
    """(k,) int64: the elements that are spots where lights give so much `direct` light (3, n)."""
    numbers, albedo, n = problem.elements.numbers, problem.albedo, direct.shape[1]
    light, area = np.ascontiguousarray((albedo * direct).T), numbers[AREA].astype(np.float64)

    def received(light: Array) -> Array:
        return np.asarray(labour.join(labour.bounce(sight, light), n).sum(0, dtype=np.float64))

    once = received(light)
    around = labour.join(labour.brightness_around(sight, problem.own, problem.elements, once), n)
    around /= 1.0 - min(float(albedo.mean(0) @ area) / area.sum(), 0.99)  # bounce after bounce, as in a closed room of the mean albedo
    found = bright(light.sum(1, dtype=np.float64), around, numbers[AREA])
    alone = np.zeros_like(light)
    alone[found] = light[found]
    root = np.sqrt(once)
    part = np.divide(received(alone), root, out=np.zeros(n), where=root > 0) if len(found) else np.zeros(n)
    return found if part @ area > _LEAST_LIGHT * (root @ area) else found[:0]


def spot_points(elements: int, quality: Quality) -> int:
    """About so many points shoot for the spots of a scene of so many elements, if it has any: each has a row."""
    return min(quality.spot_points, ROW_BYTES // (2 * elements))


def most_spot_rows(elements: int, quality: Quality) -> int:
    """And at most so many: spots of odd shapes are cut to more points than were asked for (1.4 times as many in what was tried)."""
    return 3 * spot_points(elements, quality) // 2


def find_spots(problem: Problem, sight: Sight, direct: Array, quality: Quality, labour: Labour) -> Spots | None:
    """The spots of a scene that lights give so much `direct` light (3, n), and their rows; None if there are none."""
    numbers = problem.elements.numbers
    points = spot_points(numbers.shape[1], quality)
    if not points:
        return None
    element = _found(problem, sight, direct, labour)
    if not len(element):
        return None
    source, origin = shining_source([numbers[:, element]], points, quality.light_resolution, problem.rays.scene, labour)
    count = len(source.tree.patches)
    rows = complete(problem, source, Rows(count, problem.own.numbers.shape[1], count, labour.empty), labour)
    return Spots(element[origin].astype(np.int32), source.numbers[AREA], patch_starts(source.tree), rows.rows, rows.touched)
