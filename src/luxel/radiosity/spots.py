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
from luxel.radiosity.solve import Problem, Rows, Source, complete
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
    numbers, albedo = problem.elements.numbers, problem.albedo
    light, area = _sent(problem, direct), numbers[AREA].astype(np.float64)
    once = _received(sight, light, labour)
    around = labour.join(labour.brightness_around(sight, problem.own, problem.elements, once), len(light))
    around /= 1.0 - min(float(albedo.mean(0) @ area) / area.sum(), 0.99)  # bounce after bounce, as in a closed room of the mean albedo
    found = bright(light.sum(1, dtype=np.float64), around, numbers[AREA])
    return found if len(found) and _enough(found, light, once, area, sight, labour) else found[:0]


def _sent(problem: Problem, direct: Array) -> Array:
    """(n, 3) float32 W/m2: what elements send on of so much `direct` light (3, n)."""
    return np.ascontiguousarray((problem.albedo * direct).T)


def _received(sight: Sight, light: Array, labour: Labour) -> Array:
    """(n,) float64 W/m2: what all elements receive of the `light` (n, 3), all channels together."""
    return np.asarray(labour.join(labour.bounce(sight, light), len(light)).sum(0, dtype=np.float64))


def _enough(found: Array, light: Array, once: Array, area: Array, sight: Sight, labour: Labour) -> bool:
    """Whether the elements `found` (k,) send enough of what is received `once` (n,) of the `light` (n, 3) of all."""
    alone = np.zeros_like(light)
    alone[found] = light[found]
    root = np.sqrt(once)
    part = np.divide(_received(sight, alone, labour), root, out=np.zeros(len(light)), where=root > 0)
    return bool(part @ area > _LEAST_LIGHT * (root @ area))


def spot_points(elements: int, quality: Quality) -> int:
    """About so many points shoot for the spots of a scene of so many elements, if it has any: each has a row."""
    return min(quality.spot_points, ROW_BYTES // (2 * elements))


def most_spot_rows(elements: int, quality: Quality) -> int:
    """And at most so many: spots of odd shapes are cut to more points than were asked for (1.4 times as many in what was tried)."""
    return 3 * spot_points(elements, quality) // 2


def _as_source(problem: Problem, sight: Sight, direct: Array, element: Array, quality: Quality, labour: Labour) -> tuple[Source, Array] | None:
    """The elements that may be spots, (k,), as a source of no more patches than there is room for, and which elements each of its own is of.

    What is small, bright and loose, as leaves about a lamp are, makes a patch each. Of too many those stay that send most; and none do if they
    bring too little alone: so many little ones rays tell well enough of.
    """
    numbers = problem.elements.numbers
    points, most = spot_points(numbers.shape[1], quality), most_spot_rows(numbers.shape[1], quality)
    while len(element):
        source, origin = shining_source([numbers[:, element]], points, quality.light_resolution, problem.rays.scene, labour)
        count = len(source.tree.patches)
        if count <= most:
            return source, element[origin].astype(np.int32)
        light, kept = _sent(problem, direct), len(element) * most // count
        points = max(1, points * kept // len(element))  # each as large as before: what stays is not cut finer
        power = light[element].sum(1, dtype=np.float64) * numbers[AREA, element]
        element = np.sort(element[np.argsort(-power, kind="stable")[:kept]])
        if len(element) and not _enough(element, light, _received(sight, light, labour), numbers[AREA].astype(np.float64), sight, labour):
            break
    return None


def find_spots(problem: Problem, sight: Sight, direct: Array, quality: Quality, labour: Labour) -> Spots | None:
    """The spots of a scene that lights give so much `direct` light (3, n), and their rows; None if there are none."""
    if not spot_points(problem.elements.numbers.shape[1], quality):
        return None
    found = _as_source(problem, sight, direct, _found(problem, sight, direct, labour), quality, labour)
    if found is None:
        return None
    source, element = found
    count = len(source.tree.patches)
    rows = complete(problem, source, Rows(count, problem.own.numbers.shape[1], count, labour.empty), labour)
    return Spots(element, source.numbers[AREA], patch_starts(source.tree), rows.rows, rows.touched)
