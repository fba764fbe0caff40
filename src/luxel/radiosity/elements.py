"""Elements: what the solver works on, made from a scene's luxels.

A luxel of a two-sided surface is two elements, back to back; any other is one.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.radiosity.element import AREA, GX, GZ, LIFT, NX, NZ, PX, PZ, UX, UZ, VX, VZ, find_free, turned
from luxel.radiosity.facets import Facets, facets_of, without
from luxel.radiosity.inside import MOST_BACKS, free_places, look_out, seen_backs
from luxel.radiosity.labour import Labour
from luxel.radiosity.luxels import Luxels, part_of
from luxel.radiosity.nearest import backed, covered
from luxel.radiosity.occlusion import Masks, Occlusion, prepare
from luxel.radiosity.patches import build_tree, connected
from luxel.radiosity.quality import Quality
from luxel.radiosity.rays import visible_to_all
from luxel.radiosity.shining import light_source
from luxel.radiosity.solve import Problem, source_of
from luxel.radiosity.transport import Occluders, Visibility, elements_of
from luxel.raster.bin import MASK, OPAQUE
from luxel.raster.geometry import Geometry
from luxel.raster.materials import MaterialTable

if TYPE_CHECKING:
    from luxel.radiosity.unwrap import Atlas

_NEAR = 2e-5  # of the scene's diagonal
_LOOKS, _LOOKS_EACH, _CLOSED = 1 << 15, (24, 1024), 1e-4  # rays from a side of all lamps, and of each element; a lamp is closed if so few leave it


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
        glowing: MaterialTable | None, rays: Occlusion, quality: Quality, labour: Labour) -> Cut:  # fmt: skip
    """Cut a scene into elements, patches and lights.

    Args:
        sides: Of `frames_of_texels`.
        geometry: `flatten(atlas.scene, "none")`.
        charts: (m,) int32, of each triangle.
        valid: (n,) bool: luxels that take part.
        two_sided: (m,) bool, of each triangle.
        glowing: Of `glowing_table`.
        rays: All that hides.
    """
    numbers = _numbers(luxels, *sides)
    fronts = np.flatnonzero(valid).astype(np.int32)
    backs = np.flatnonzero(luxels.two_sided).astype(np.int32)
    luxel = np.concatenate([fronts, backs])
    numbers = np.concatenate([numbers[:, fronts], turned(numbers[:, backs])], 1)
    numbers = labour.each(len(luxel), lambda some: _free(rays, charts, luxels.chart[luxel[some]], numbers[:, some], labour.threads))
    extent = (quality.patch * np.sqrt(numbers[AREA] / np.maximum(luxels.coverage[luxel], 0.05))).astype(np.float32)
    tree = build_tree(np.ascontiguousarray(numbers[PX : PZ + 1].T), np.ascontiguousarray(numbers[GX : GZ + 1].T), numbers[AREA], extent)
    elements = elements_of(np.ascontiguousarray(numbers[:, tree.order]))
    tree = connected(tree, elements.numbers[PX : PZ + 1].T, elements.numbers[GX : GZ + 1].T, partial(visible_to_all, rays, labour=labour))
    patches = source_of(tree, elements.numbers, quality.resolution)
    mine = labour.mine(len(luxel))
    own = elements if isinstance(mine, slice) else elements_of(np.ascontiguousarray(elements.numbers[:, mine]))
    albedo = np.ascontiguousarray(luxels.albedo[luxel][tree.order].T)
    span = geometry.positions[np.isfinite(geometry.positions).all(1)]
    diagonal = float(np.linalg.norm(np.ptp(span, axis=0)))

    def facets(chosen: Array) -> Facets:
        found = facets_of(luxels, chosen, geometry, charts, glowing, quality.light_points, labour.threads)
        return _outside(found, luxels.two_sided[chosen], two_sided, 2.0 * diagonal, rays, labour)

    def lost(sides: Array, whose: Array, behind: Array) -> Array:
        shell = two_sided & np.isin(charts, luxels.chart[whose])
        lamp = 2 * part_of(geometry, luxels.triangle[whose]) + behind
        return _lost(sides, lamp, behind, shell, diagonal, rays, labour)

    lights, points = light_source(luxels, luxel, len(fronts), numbers, facets, lost, rays, quality, labour)
    exitance = luxels.emission[points.luxel] * points.share
    problem = Problem(
        elements, own, albedo, patches, lights, exitance, *points, occluders_of(geometry, two_sided, masks, rays, labour), _NEAR * diagonal,
        Visibility(rays, quality.rays, quality.exact),
    )  # fmt: skip
    return Cut(problem, luxel[tree.order], tree.order >= len(fronts))


def _free(rays: Occlusion, charts: Array, chart: Array, numbers: Array, threads: int) -> Array:
    """(17, k): elements without what is covered (`find_free`)."""
    numbers = np.ascontiguousarray(numbers)
    find_free(rays, charts, chart, numbers, threads)
    return numbers


def _lost(numbers: Array, lamp: Array, behind: Array, shell: Array, diagonal: float, rays: Occlusion, labour: Labour) -> Array:
    """(k,) bool: which sides of two-sided lamps shine on nothing but what lies on them, or the inside of the lamp: on nobody who has a lightmap.

    Args:
        numbers: (17, k) float32, of the sides.
        lamp: (k,) int64: which are one side of one lamp; if all of these see hardly anything but their lamp's inside, it is closed.
        behind: (k,) bool: it is the back; what is in the same place lies on this.
        shell: (m,) bool: two-sided triangles that glow.
        diagonal: Of the scene, metres.
    """
    looks = int(np.clip(_LOOKS // len(lamp), *_LOOKS_EACH))

    def out(which: Array, side: bool, some: Any) -> Array:
        place, normal = (np.ascontiguousarray(numbers[row : row + 3, which[some]].T) for row in (PX, GX))
        return look_out(rays, shell, place, normal, side, looks, 2.0 * diagonal, labour.threads)

    def covers(some: Any) -> Array:
        place, normal = (np.ascontiguousarray(numbers[row : row + 3, some].T) for row in (PX, GX))
        above = np.maximum(LIFT * np.sqrt(numbers[AREA, some].astype(np.float64)), 2 * _NEAR * diagonal)
        return covered(rays, ~shell, place, normal, behind[some], above, labour.threads)

    seen = np.zeros(len(lamp), np.int64)
    for side in (False, True):
        which = np.flatnonzero(behind == side)
        if len(which):
            seen[which] = labour.each(len(which), partial(out, which, side))
    closed = np.bincount(lamp, seen) <= _CLOSED * looks * np.bincount(lamp)
    return labour.each(len(lamp), covers) | closed[lamp]


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
