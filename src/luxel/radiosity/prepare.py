"""Prepare: all that comes before there is light.

    scene -> lightmap coordinates and lamps -> luxels -> those inside solids moved out, or found -> elements, patches and lights
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.clock import Clock
from luxel.errors import DarkError, InputError, LuxelWarning
from luxel.radiosity.effort import memory_check
from luxel.radiosity.elements import Cut, cut, frames_of_texels
from luxel.radiosity.gather import Lookup, View, element_pages, texel_maps
from luxel.radiosity.glow import glowing_table
from luxel.radiosity.inside import MOST_BACKS, free_places, seen_backs
from luxel.radiosity.labour import Labour
from luxel.radiosity.lamps import Lamps, lamps_of
from luxel.radiosity.luxels import Luxels, find_luxels, two_sided_triangles
from luxel.radiosity.occlusion import Occlusion
from luxel.radiosity.pages import triangle_pages
from luxel.radiosity.quality import Quality
from luxel.radiosity.rays import obstacles, scene_masks
from luxel.radiosity.unwrap import Atlas, expected_luxels, unwrap
from luxel.raster.geometry import Geometry, flatten
from luxel.scene.normals import with_normals
from luxel.scene.scene import Scene

_FEW_VALID = 0.5
"""A share of valid luxels that is worth a word."""

_FINEST = 0.02
"""Of a luxel's side: what positions may be rounded by."""

_MANY_LIGHTS = 40
"""Times the points from which lights are to shoot: more are worth a word. A ball may need some twenty times as many, as it bends."""

_LAYING = "laying out the lightmap"


@dataclass
class Prepared:
    """A scene ready to be solved.

    Attributes:
        atlas: Where its n luxels lie.
        luxels: Those inside solids in part are moved out.
        geometry: `flatten(atlas.scene, "none")`, m triangles.
        valid: (n,) bool: False inside solids.
        cut: In elements, patches and lights.
        rays: All that hides.
        two_sided: (m,) bool, of each triangle.
        reach: Metres: no ray goes farther.
    """

    atlas: Atlas
    luxels: Luxels
    geometry: Geometry
    valid: Array
    cut: Cut
    rays: Occlusion
    two_sided: Array
    reach: float

    @cached_property
    def view(self) -> View:
        """Where this process's elements look."""
        pages = element_pages(self.luxels, self.cut.luxel, self.cut.back)
        lookup = Lookup(texel_maps(self.geometry, self.atlas.size), triangle_pages(self.atlas, self.geometry), self.two_sided, pages)
        return View(self.rays, self.cut.problem.own.numbers, lookup, self.reach)

    def per_luxel(self, values: Array) -> Array:
        """(n, 3) float32 per luxel of (3, elements): of their fronts."""
        front = np.flatnonzero(~self.cut.back)
        result = np.zeros((len(self.luxels.area), 3), np.float32)
        result[self.cut.luxel.take(front)] = values[:, front].T
        return result


def _loaded(scene: Any) -> Scene:
    from luxel.io import load
    from luxel.io.build import finite_mesh

    if isinstance(scene, Scene):
        return replace(scene, meshes=[finite_mesh(mesh.name or f"mesh {number}", mesh) for number, mesh in enumerate(scene.meshes)])
    return load(scene)


def laid_out(scene: Any, sky: Any, settings: Quality, density: float | None, page: int, labour: Labour, clock: Clock,
             tell: Callable[[float, str], None]) -> tuple[Lamps, Atlas]:  # fmt: skip
    """A scene, read if need be, with what shines but has no surface, and where every luxel is to lie."""
    tell(0.0, "reading")
    scene = _loaded(scene)
    scene = replace(scene, meshes=[mesh if mesh.normals is not None else with_normals(mesh) for mesh in scene.meshes])  # smooth, but for creases
    clock.lap("load")
    lamps = lamps_of(scene, sky)
    if density is not None:
        memory_check(settings, lamps, density, labour)(expected_luxels(scene, density), 0)
    tell(0.0, _LAYING)
    atlas = unwrap(scene, density, page, threads=labour.threads, progress=lambda share: tell(share, _LAYING))
    clock.lap("unwrap")
    return lamps, atlas


def prepare(atlas: Atlas, settings: Quality, check: Callable[[float, int], None], labour: Labour, clock: Clock,
            tell: Callable[[float, str], None]) -> Prepared:  # fmt: skip
    """What is laid out, ready to be lit; `check` refuses so many luxels of so many triangles if they do not fit in memory."""
    tell(0.0, "finding luxels")
    luxels = find_luxels(atlas, labour.threads)
    if not len(luxels.area):
        raise InputError("bake: the scene has no surface")
    check(len(luxels.area) + int(luxels.two_sided.sum()), len(atlas.chart))
    clock.lap("luxels")
    geometry = flatten(atlas.scene, "none")
    two_sided = two_sided_triangles(atlas.scene, geometry)
    masks = scene_masks(atlas.scene, geometry)
    rays = obstacles(geometry, masks)
    finite = geometry.positions[np.isfinite(geometry.positions).all(1)]
    reach = 2.0 * float(np.linalg.norm(np.ptp(finite, axis=0)))
    if labour.team.leads:
        _tell_of_distance(finite, luxels)
    sides = frames_of_texels(atlas, geometry, luxels)
    tell(0.0, "finding luxels in solids")
    valid = _move_out(luxels, sides, rays, two_sided, reach, labour)
    if labour.team.leads and valid.mean() < _FEW_VALID:
        share = f"{1 - valid.mean():.0%} of the luxels see hardly anything but backs of surfaces"
        warnings.warn(f"{share}: are normals inverted? They stay dark", LuxelWarning, stacklevel=3)
    clock.lap("inside")
    tell(0.0, "cutting patches")
    pieces = cut(luxels, sides, geometry, atlas.chart, valid, two_sided, masks, glowing_table(atlas.scene), rays, settings, labour)
    if labour.team.leads:
        _tell_of_lights(pieces, settings)
    clock.lap("patches")
    return Prepared(atlas, luxels, geometry, valid, pieces, rays, two_sided, reach)


def _tell_of_lights(pieces: Cut, settings: Quality) -> None:
    """Warn if what glows falls to very many pieces."""
    lights = pieces.problem.lights
    if lights is not None and len(lights.tree.patches) > _MANY_LIGHTS * settings.light_points:
        word = f"{len(lights.tree.patches):,} small surfaces glow apart from each other, and each shoots its light for itself"
        warnings.warn(f"{word}: that takes long", LuxelWarning, stacklevel=4)


def _tell_of_distance(positions: Array, luxels: Luxels) -> None:
    """Warn if a scene is so far from the origin that single precision cannot tell apart what is near each other there."""
    far, side = np.abs(positions).max(), np.sqrt(np.median(luxels.area))
    step = np.spacing(np.float32(far))
    if step > _FINEST * side:
        word = f"the scene reaches {far:.3g} m from the origin, where numbers are {step:.1g} m apart and luxels {side:.1g} m wide"
        warnings.warn(f"{word}: light is lost; move it to the origin", LuxelWarning, stacklevel=4)


def _move_out(luxels: Luxels, sides: tuple[Array, Array], rays: Occlusion, two_sided: Array, reach: float, labour: Labour) -> Array:
    """Which luxels are not inside solids, (n,) bool; what is inside in part is changed to the rest of it."""

    def backs(some: Any) -> Array:
        which = order[some]
        return seen_backs(rays, two_sided, luxels.position[which], luxels.face_normal[which], reach, labour.threads)

    def free(some: Any) -> Array:
        which = hidden[some]
        u, v = (side[which] for side in sides)
        place, share = free_places(rays, two_sided, luxels.position[which], luxels.face_normal[which], u, v, reach, labour.threads)
        return np.concatenate([place.T, share[None]])

    valid = luxels.two_sided.copy()
    asked = np.flatnonzero(~valid)
    order = asked[np.argsort(luxels.chart[asked], kind="stable")]  # neighbours together
    if len(order):
        valid[order] = labour.each(len(order), backs) <= MOST_BACKS
    hidden = order[~valid[order]]
    if len(hidden):
        *place, share = labour.each(len(hidden), free)
        kept = share > 0
        valid[hidden], moved = kept, hidden[kept]
        luxels.position[moved] = np.stack(place, 1)[kept]
        luxels.area[moved] *= share[kept]
        for side in sides:
            side[moved] *= np.sqrt(share[kept])[:, None]
    return valid


def check_light(prepared: Prepared, lamps: Lamps) -> None:
    """Refuse a scene in which nothing shines after all."""
    if prepared.cut.problem.lights is None and not len(lamps.table) and lamps.sky is None:
        hidden = "all that is emissive lies in solids, or the normals about it are inverted"
        dark = "what is emissive has no surface, or its pictures are black"
        raise DarkError(f"bake: nothing shines: {hidden if prepared.luxels.emission.any() else dark}")
