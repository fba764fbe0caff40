"""Elements: what the solver works on, made from a scene's luxels.

A luxel of a two-sided surface is two elements, back to back; any other is one. What emits is cut finer, until each light has enough points to
be seen as a surface and not as a few dots, and by its geometry where that is finer than luxels (`facets`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.radiosity.element import AREA, GX, GZ, LIFT, NX, NZ, PX, PZ, UX, UZ, VX, VZ, find_free
from luxel.radiosity.facets import Facets, facets_of, without
from luxel.radiosity.inside import MOST_BACKS, free_places, seen_backs
from luxel.radiosity.labour import Labour
from luxel.radiosity.luxels import Luxels
from luxel.radiosity.nearest import backed
from luxel.radiosity.occlusion import Masks, Occlusion, prepare
from luxel.radiosity.patches import Tree, build_tree, connected
from luxel.radiosity.quality import Quality
from luxel.radiosity.rays import visible
from luxel.radiosity.solve import Problem, Source, source_of
from luxel.radiosity.transport import Occluders, Visibility, elements_of
from luxel.raster.bin import MASK, OPAQUE
from luxel.raster.geometry import Geometry

if TYPE_CHECKING:
    from luxel.radiosity.unwrap import Atlas

_NEAR = 2e-5  # of the scene's diagonal
_STEPS = np.array([0.6180339887498949, 0.7548776662466927, 0.5698402909980532])  # 1 / x, x^2 = x + 1; 1 / x and its square, x^3 = x + 1
_MOST_CUTS = 32  # sub-points along a side of a luxel that emits


def frames_of_texels(atlas: Atlas, geometry: Geometry, luxels: Luxels) -> tuple[Array, Array]:
    """(n, 3) float32 each: the sides of each luxel on the surface, as a parallelogram of its area: along a row of the lightmap, and down a column."""
    corners = geometry.triangles[luxels.triangle]
    a, b, c = (geometry.positions[corners[:, k]].astype(np.float64) for k in range(3))
    uv = geometry.texcoords1.astype(np.float64) * atlas.size
    p, q, r = (uv[corners[:, k]] for k in range(3))
    du1, du2, dv1, dv2 = q[:, 0] - p[:, 0], r[:, 0] - p[:, 0], q[:, 1] - p[:, 1], r[:, 1] - p[:, 1]
    with np.errstate(all="ignore"):
        scale = (1.0 / (du1 * dv2 - du2 * dv1))[:, None]
        u = ((b - a) * dv2[:, None] - (c - a) * dv1[:, None]) * scale
        v = ((c - a) * du1[:, None] - (b - a) * du2[:, None]) * scale
        shrink = np.sqrt(luxels.area / np.linalg.norm(np.cross(u, v), axis=1))[:, None]
        u, v = u * shrink, v * shrink
    broken = ~(np.isfinite(u).all(1) & np.isfinite(v).all(1))  # a triangle without area in the atlas: a square will do
    if broken.any():
        from luxel.radiosity.hemicube import frames_of

        side = np.sqrt(luxels.area[broken])[:, None]
        frame = frames_of(luxels.face_normal[broken])
        u[broken], v[broken] = frame[:, 0] * side, frame[:, 1] * side
    return u.astype(np.float32), v.astype(np.float32)


def _numbers(luxels: Luxels, u: Array, v: Array) -> Array:
    """(17, n) float32, in the order of the luxels."""
    numbers = np.zeros((17, len(luxels.area)), np.float32)
    numbers[PX : PZ + 1], numbers[NX : NZ + 1], numbers[GX : GZ + 1] = luxels.position.T, luxels.normal.T, luxels.face_normal.T
    numbers[AREA], numbers[UX : UZ + 1], numbers[VX : VZ + 1] = luxels.area, u.T, v.T
    return numbers


def _turned(numbers: Array) -> Array:
    """The other sides."""
    numbers[NX : GZ + 1] *= -1
    return numbers


def _in_tree_order(tree: Tree, numbers: Array) -> Array:
    return np.ascontiguousarray(numbers[:, tree.order])


class Cut(NamedTuple):
    """A scene cut into a problem.

    Attributes:
        problem: To solve.
        luxel: (n,) int32: the luxel of each element.
        back: (n,) bool: it is the back of a two-sided luxel.
    """

    problem: Problem
    luxel: Array
    back: Array


def occluders_of(geometry: Geometry, two_sided: Array, masks: Masks | None, rays: Occlusion, labour: Labour) -> Occluders:
    """What hides: all triangles but those that are blended.

    Args:
        two_sided: (m,) bool, of each triangle.
        masks: Of `scene_masks`.
        rays: All that hides.
    """
    positions = geometry.positions.astype(np.float64)
    mode = np.repeat(geometry.parts.alpha_mode, np.diff(geometry.part_start))
    finite = np.isfinite(positions)[geometry.triangles].all((1, 2))
    whole = geometry.triangles[finite & (mode == OPAQUE)]
    a, b, c = (positions[whole[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    with np.errstate(all="ignore"):
        normal = np.nan_to_num(normal / np.linalg.norm(normal, axis=1)[:, None])
    planes = np.concatenate([normal, (normal * a).sum(1)[:, None]], 1).astype(np.float32)
    holed = np.where((finite & (mode == MASK))[:, None], geometry.triangles, 0)  # a triangle of one corner thrice hides nothing
    sides = two_sided[finite & (mode == OPAQUE)]
    one = np.flatnonzero(~sides)
    sides[one] = labour.each(len(one), lambda some: backed(rays, positions, whole[one[some]], normal[one[some]], labour.threads))
    return Occluders(
        np.ascontiguousarray(np.nan_to_num(geometry.positions).T), np.ascontiguousarray(whole), planes, sides,
        prepare(geometry.positions, holed, masks),
    )  # fmt: skip


def cut(luxels: Luxels, sides: tuple[Array, Array], geometry: Geometry, charts: Array, valid: Array, two_sided: Array, masks: Masks | None,
        rays: Occlusion, quality: Quality, labour: Labour) -> Cut:  # fmt: skip
    """Cut a scene into elements, patches and lights.

    Args:
        sides: Of `frames_of_texels`.
        geometry: `flatten(atlas.scene, "none")`.
        charts: (m,) int32, of each triangle.
        valid: (n,) bool: luxels that take part.
        two_sided: (m,) bool, of each triangle.
        rays: All that hides.
    """
    numbers = _numbers(luxels, *sides)
    fronts = np.flatnonzero(valid).astype(np.int32)
    backs = np.flatnonzero(luxels.two_sided).astype(np.int32)
    luxel = np.concatenate([fronts, backs])
    numbers = np.concatenate([numbers[:, fronts], _turned(numbers[:, backs])], 1)
    numbers = labour.each(len(luxel), lambda some: _free(rays, charts, luxels.chart[luxel[some]], numbers[:, some], labour.threads))
    extent = (quality.patch * np.sqrt(numbers[AREA] / np.maximum(luxels.coverage[luxel], 0.05))).astype(np.float32)
    tree = build_tree(np.ascontiguousarray(numbers[PX : PZ + 1].T), np.ascontiguousarray(numbers[GX : GZ + 1].T), numbers[AREA], extent)
    elements = elements_of(_in_tree_order(tree, numbers))
    tree = connected(tree, elements.numbers[PX : PZ + 1].T, elements.numbers[GX : GZ + 1].T, partial(_visible, rays, labour=labour))
    patches = source_of(tree, elements.numbers, quality.resolution)
    mine = labour.mine(len(luxel))
    own = elements if isinstance(mine, slice) else elements_of(np.ascontiguousarray(elements.numbers[:, mine]))
    albedo = np.ascontiguousarray(luxels.albedo[luxel][tree.order].T)
    span = geometry.positions[np.isfinite(geometry.positions).all(1)]
    diagonal = float(np.linalg.norm(np.ptp(span, axis=0)))
    shining = np.flatnonzero(luxels.emission[fronts].sum(1) > 0)
    lights, point_luxel = None, np.zeros(0, np.int32)
    if len(shining):
        facets = facets_of(luxels, fronts[shining], geometry, charts, quality.light_points, labour.threads)
        facets = _outside(facets, luxels.two_sided[fronts[shining]], two_sided, 2.0 * diagonal, rays, labour)
        lamps = numbers[:, shining[~facets.bent]], facets.numbers
        lights, origin = shining_source(lamps, quality.light_points, quality.light_resolution, rays, labour)
        point_luxel = fronts[shining[np.append(np.flatnonzero(~facets.bent), facets.luxel)[origin]]]
    exitance = luxels.emission[point_luxel].astype(np.float32)
    problem = Problem(
        elements, own, albedo, patches, lights, exitance, point_luxel, occluders_of(geometry, two_sided, masks, rays, labour), _NEAR * diagonal,
        Visibility(rays, quality.rays, quality.exact),
    )  # fmt: skip
    return Cut(problem, luxel[tree.order], tree.order >= len(fronts))


def _free(rays: Occlusion, charts: Array, chart: Array, numbers: Array, threads: int) -> Array:
    """(17, k): elements without what is covered (`find_free`)."""
    numbers = np.ascontiguousarray(numbers)
    find_free(rays, charts, chart, numbers, threads)
    return numbers


def _visible(rays: Occlusion, a: Array, b: Array, labour: Labour) -> Array:
    """(k,) bool: which of the points (k, 3) see each other."""
    return labour.each(len(a), lambda some: visible(rays, a[some], b[some], labour.threads))


def _outside(facets: Facets, sided: Array, two_sided: Array, reach: float, rays: Occlusion, labour: Labour) -> Facets:
    """Facets without what of them is inside solids, as luxels are moved out of them; `sided` (k,) bool: luxels that have two sides."""
    numbers = facets.numbers

    def backs(some: Any) -> Array:
        place, normal = (np.ascontiguousarray(numbers[row : row + 3, asked[some]].T) for row in (PX, GX))
        return seen_backs(rays, two_sided, place, normal, reach, labour.threads)

    def free(some: Any) -> Array:
        place, normal, u, v = (np.ascontiguousarray(numbers[row : row + 3, hidden[some]].T) for row in (PX, GX, UX, VX))
        place, share = free_places(rays, two_sided, place, normal, u, v, reach, labour.threads)
        return np.concatenate([place.T, share[None]])

    asked = np.flatnonzero(~sided[facets.luxel])
    hidden = asked[labour.each(len(asked), backs) > MOST_BACKS] if len(asked) else asked
    if not len(hidden):
        return facets
    found = labour.each(len(hidden), free)
    numbers[PX : PZ + 1, hidden] = found[:3]
    numbers[AREA, hidden] *= found[3]
    numbers[UX : VZ + 1, hidden] *= np.sqrt(found[3])
    return without(facets, hidden[found[3] == 0])


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
    ordered = _in_tree_order(tree, fine)
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
    free = _visible(rays, middle.T, there.T, labour)
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
    kept = _visible(rays, middle, fine[PX : PZ + 1].T, labour)
    count = np.bincount(whole[kept], minlength=numbers.shape[1])
    none = np.flatnonzero(count == 0)  # the middle itself shines for all of these
    fine[PX : PZ + 1, none * cuts * cuts], kept[none * cuts * cuts], count[none] = numbers[PX : PZ + 1, none], True, 1
    fine, whole = fine[:, kept], whole[kept]
    fine[UX : VZ + 1] /= np.sqrt(count)[whole]
    fine[AREA] /= count[whole]
    return fine, whole
