"""Reuse: a scene's own TEXCOORD_1 as lightmap coordinates, where they serve; and room for new ones where textures use them."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import LuxelWarning
from luxel.radiosity.diagnosis import diagnose
from luxel.radiosity.pages import draw_page
from luxel.radiosity.pieces import Surface, areas, connected
from luxel.radiosity.texture_space import place_vertices
from luxel.scene.material import Material
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Instance, Scene

MOST_PAGES = 16
"""Meshes whose own coordinates overlap get pages of their own, up to this many in all."""

_SLOTS = ("base_color", "metallic_roughness", "normal", "occlusion", "emissive")
_COARSE = 256  # texels a side at which instances are compared


def own_coordinates(scene: Scene, drawn: list[Instance], meshes: list[Mesh], surfaces: list[Surface], wanted: list[float] | None,
                    page: tuple[int, int], threads: int) -> Any:  # fmt: skip
    """An `Atlas` of the meshes' own TEXCOORD_1, or None if they have none or it does not serve.

    Args:
        surfaces: Of the drawn instances, in metres.
        wanted: Texels per metre of each, which decides the size of the pages, `page` at most; or None: the size is `page`.
    """
    from luxel.radiosity.unwrap import Atlas

    if not drawn or any(mesh.texcoords1 is None for mesh in meshes):
        return None
    texcoords = [np.asarray(mesh.texcoords1) for mesh in meshes]
    if any(not np.isfinite(t).all() or t.min(initial=0) < -1e-3 or t.max(initial=0) > 1 + 1e-3 for t in texcoords):
        return None
    pages = _share_out(texcoords, surfaces, threads)
    if pages is None:
        return None
    charts, first = [], 0
    for texcoord, surface in zip(texcoords, surfaces, strict=True):
        charts.append(connected(surface.triangles, surface.positions, np.c_[texcoord, np.zeros(len(texcoord))].astype(np.float32)) + first)
        first = int(charts[-1].max(initial=first - 1)) + 1
    size = page if wanted is None else _size(texcoords, surfaces, wanted)
    if size[0] > page[0] or size[1] > page[1]:  # new coordinates can have several pages, and the density
        return None
    made = [replace(mesh) for mesh in meshes]
    instances = [replace(instance, mesh=i) for i, instance in enumerate(drawn)]
    lit = replace(scene, meshes=made, instances=instances)
    atlas = Atlas(lit, pages, int(pages.max()) + 1, size, np.concatenate(charts).astype(np.int32), True)
    return atlas if diagnose(atlas, threads).serves else None


def _share_out(texcoords: list[Array], surfaces: list[Surface], threads: int) -> Array | None:
    """(instances,) int32: the first page on which each covers no texel, coarsely, that one before it covers; None if that takes too many pages."""
    threads = jit.checked_threads(threads)
    size = (_COARSE, _COARSE)
    taken: list[Array] = []
    page = []
    for texcoord, surface in zip(texcoords, surfaces, strict=True):
        screen, one = place_vertices(texcoord, size, threads), np.zeros(len(surface.triangles), np.int32)
        place = draw_page(surface.triangles, screen, one, areas(surface.positions, surface.triangles), size, threads).place
        number = next((k for k, mask in enumerate(taken) if np.count_nonzero(mask[place]) <= len(place) // 50), len(taken))
        if number == len(taken):
            if len(taken) == MOST_PAGES:
                return None
            taken.append(np.zeros(_COARSE * _COARSE, bool))
        taken[number][place] = True
        page.append(number)
    return np.array(page, np.int32)


def _size(texcoords: list[Array], surfaces: list[Surface], wanted: list[float]) -> tuple[int, int]:
    """Width and height at which the surface has the density wanted, on the average over its area, along u and along v."""
    from luxel.radiosity.charts import linear_density

    sums, total = np.zeros(2), 0.0
    for texcoord, surface, density in zip(texcoords, surfaces, wanted, strict=True):
        area = float(areas(surface.positions, surface.triangles).sum())
        chart = np.zeros(len(surface.triangles), np.int32)
        per_metre = linear_density(surface.positions, surface.triangles, texcoord, chart, 1)[0]
        sums, total = sums + area * np.maximum(per_metre, 1e-9) / density, total + area
    sides = np.round(total / np.maximum(sums, 1e-9))
    return max(4, int(sides[0])), max(4, int(sides[1]))


def make_room(scene: Scene) -> Scene:
    """A scene whose textures leave TEXCOORD_1 free: those that use it move to TEXCOORD_0 where that is free, and are dropped where it is not.

    Lightmaps that a scene already has are dropped too.
    """
    materials = [_moved(material) for material in scene.materials]
    moves = [_uses(material) == {1} for material in scene.materials] + [False]
    meshes = [replace(mesh, texcoords=mesh.texcoords1) if moves[mesh.material] else mesh for mesh in scene.meshes]
    return replace(scene, materials=materials, meshes=meshes)


def _uses(material: Material) -> set[int]:
    return {ref.texcoord for slot in _SLOTS if (ref := getattr(material, f"{slot}_texture")) is not None}


def _moved(material: Material) -> Material:
    uses = _uses(material)
    changes: dict[str, Any] = {}
    for slot in _SLOTS:
        ref = getattr(material, f"{slot}_texture")
        if ref is not None and ref.texcoord == 1:
            changes[f"{slot}_texture"] = replace(ref, texcoord=0) if uses == {1} else None
    if uses == {0, 1}:
        names = ", ".join(name.removesuffix("_texture").replace("_", " ") for name in changes)
        text = f"material {material.name!r}: its {names} texture uses TEXCOORD_1, which does not serve for the lightmap and is replaced; dropped"
        warnings.warn(text, LuxelWarning, stacklevel=5)
    changes["lightmap_texture"] = None
    return replace(material, **changes)
