"""Shining: surfaces that emit, as lights.

What emits is cut finer than luxels, until each light has enough points to be seen as a surface and not as a few dots, and by its geometry where that
is finer (`facets`). Both sides of a two-sided surface emit alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.radiosity.element import AREA, GX, GZ, LIFT, PX, PZ, UX, UZ, VX, VZ, turned
from luxel.radiosity.facets import Facets
from luxel.radiosity.labour import Labour
from luxel.radiosity.luxels import Luxels
from luxel.radiosity.occlusion import Occlusion
from luxel.radiosity.patches import Tree, build_tree, connected
from luxel.radiosity.quality import Quality
from luxel.radiosity.rays import visible_to_all
from luxel.radiosity.solve import Source, source_of

_STEPS = np.array([0.6180339887498949, 0.7548776662466927, 0.5698402909980532])  # 1 / x, x^2 = x + 1; 1 / x and its square, x^3 = x + 1
_MOST_CUTS = 32  # sub-points along a side of a luxel that emits


class Points(NamedTuple):
    """Light points: their luxels (k,) int32, and their exitance relative to these, (k, 3) float32."""

    luxel: Array
    share: Array


def light_source(luxels: Luxels, luxel: Array, fronts: int, numbers: Array, facets: Callable[[Array], Facets],
                 lost: Callable[[Array, Array, Array], Array], rays: Occlusion, quality: Quality,
                 labour: Labour) -> tuple[Source | None, Points]:  # fmt: skip
    """What shines of a scene's elements, as a source, and the points of this; None and no points if it is dark.

    Args:
        luxel: (e,) int32, of each element: so many `fronts`, and backs of two-sided luxels.
        numbers: (17, e) float32, of the elements.
        facets: Of some luxels, (k,) int32, ascending.
        lost: From numbers (17, k) of sides of two-sided luxels, the luxel of each (k,), and which are backs (k,) bool, to (k,) bool: whose light
            nobody gets who has a lightmap.
        rays: All that hides.
    """
    nothing = None, Points(np.zeros(0, np.int32), np.zeros((0, 3), np.float32))
    shining = np.flatnonzero(luxels.emission[luxel].sum(1) > 0)
    if not len(shining):
        return nothing
    glowing = np.unique(luxel[shining])
    made = facets(glowing)
    flat = shining[~made.bent[np.searchsorted(glowing, luxel[shining])]]
    sided = np.flatnonzero(luxels.two_sided[glowing[made.luxel]])
    both = np.append(np.arange(len(made.luxel)), sided)  # facets, and those with a back once more
    whose, share = np.append(luxel[flat], glowing[made.luxel[both]]), np.concatenate([np.ones((len(flat), 3), np.float32), made.share[both]])
    lamps = np.concatenate([numbers[:, flat], made.numbers, turned(made.numbers[:, sided])], 1)
    behind = np.append(flat >= fronts, np.arange(len(both)) >= len(made.luxel))
    sides = np.flatnonzero(luxels.two_sided[whose])
    kept = np.delete(np.arange(len(whose)), sides[lost(lamps[:, sides], whose[sides], behind[sides])] if len(sides) else sides)
    if not len(kept):
        return nothing
    lamps, whose, share, flats = lamps[:, kept], whose[kept], share[kept], int(np.count_nonzero(kept < len(flat)))
    twice = max(1.0, float(lamps[AREA].sum(dtype=np.float64) / luxels.area[glowing].sum(dtype=np.float64)))
    kinds = lamps[:, :flats], lamps[:, flats:]
    source, origin = shining_source(kinds, int(twice * quality.light_points), quality.light_resolution, rays, labour)
    return source, Points(whose[origin], share[origin])


def shining_source(kinds: Sequence[Array], points: int, resolution: int, rays: Occlusion, labour: Labour) -> tuple[Source, Array]:
    """Elements that shine, (17, m) numbers of each kind, as a source of about so many patches, each of which shoots from a point of it; and which of
    the elements, counted over all kinds, each element of the source is a part of, (k,) int64. Those of a kind are cut alike."""
    side = float(np.sqrt(sum(numbers[AREA].sum() for numbers in kinds) / points))  # of a point's patch
    cut_up, before = [], 0
    for numbers in kinds:
        if numbers.shape[1]:
            cuts = int(np.clip(np.ceil(2 * np.sqrt(numbers[AREA].mean()) / side), 1, _MOST_CUTS))
            fine, whole = _points(numbers, cuts, rays, labour)
            cut_up.append((fine, whole + before))
        before += numbers.shape[1]
    fine, whole = (np.concatenate(parts, -1) for parts in zip(*cut_up, strict=True))
    extent = np.full(fine.shape[1], side, np.float32)
    tree = build_tree(np.ascontiguousarray(fine[PX : PZ + 1].T), np.ascontiguousarray(fine[GX : GZ + 1].T), fine[AREA], extent)
    ordered = np.ascontiguousarray(fine[:, tree.order])
    tree = connected(tree, ordered[PX : PZ + 1].T, ordered[GX : GZ + 1].T, partial(visible_to_all, rays, labour=labour))
    source = source_of(tree, ordered, resolution)
    scattered = source.shooters._replace(centers=_scattered(tree, ordered, rays, labour))
    return source._replace(shooters=scattered, shines=True), whole[tree.order]


def _scattered(tree: Tree, numbers: Array, rays: Occlusion, labour: Labour) -> Array:
    """(p, 3) float32: a point of each patch, of elements (17, n) in the tree's order; they follow each other by the golden ratio, and its like in
    the plane (Roberts 2018).

    Were they in rows and columns, an edge parallel to these would hide many of them at once, and its shadow would have steps.
    """
    spans, number = tree.span[tree.patches].astype(np.int64), np.arange(1, len(tree.patches) + 1)
    which, a, b = (_STEPS[:, None] * number) % 1.0
    element = numbers[:, spans[:, 0] + (which * (spans[:, 1] - spans[:, 0])).astype(np.int64)]
    middle = element[PX : PZ + 1] + LIFT * np.sqrt(element[AREA]) * element[GX : GZ + 1]
    there = (element[PX : PZ + 1] + (a - 0.5) * element[UX : UZ + 1] + (b - 0.5) * element[VX : VZ + 1]).astype(np.float32)
    free = visible_to_all(rays, middle.T, there.T, labour)
    return np.ascontiguousarray(np.where(free, there, element[PX : PZ + 1]).T)


def _points(numbers: Array, cuts: int, rays: Occlusion, labour: Labour) -> tuple[Array, Array]:
    """Elements (17, m) cut to `cuts` x `cuts` parts, and which each part is of. Those that the middle of their element does not see, as the surface
    bends away or something stands on it, are left out, and the others are larger."""
    at = (np.arange(cuts) + 0.5) / cuts - 0.5
    x, y = (grid.ravel() for grid in np.meshgrid(at, at))
    whole = np.repeat(np.arange(numbers.shape[1]), cuts * cuts)
    fine = numbers[:, whole]
    middle = (fine[PX : PZ + 1] + LIFT * np.sqrt(fine[AREA]) * fine[GX : GZ + 1]).T
    fine[PX : PZ + 1] += fine[UX : UZ + 1] * np.tile(x, numbers.shape[1]) + fine[VX : VZ + 1] * np.tile(y, numbers.shape[1])
    kept = visible_to_all(rays, middle, fine[PX : PZ + 1].T, labour)
    count = np.bincount(whole[kept], minlength=numbers.shape[1])
    none = np.flatnonzero(count == 0)  # the middle itself shines for all of these
    fine[PX : PZ + 1, none * cuts * cuts], kept[none * cuts * cuts], count[none] = numbers[PX : PZ + 1, none], True, 1
    fine, whole = fine[:, kept], whole[kept]
    fine[UX : VZ + 1] /= np.sqrt(count)[whole]
    fine[AREA] /= count[whole]
    return fine, whole
