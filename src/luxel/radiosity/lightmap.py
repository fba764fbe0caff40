"""Lightmap: from a value a luxel to pages without holes, and to a scene that shows them.

    luxels, values -> fill: luxels inside solids take their neighbours' light
                   -> pages_of: one picture a page
                   -> dilate: the texels around every chart, which filters reach
                   -> stitch: no step where charts meet (`seams`)
                   -> attach: materials with a lightmap

`finish` does all but the last.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.radiosity.seams import stitch
from luxel.radiosity.spread import spread
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.scene import Scene

if TYPE_CHECKING:
    from luxel.radiosity.luxels import Luxels
    from luxel.radiosity.unwrap import Atlas

_NEAR, _ALIKE = 64, 0.5  # how many luxels are looked at, and the cosine between normals that face a like way

__all__ = ["attach", "dilate", "fill", "finish", "pages_of", "stitch"]


def pages_of(luxels: Luxels, values: Array) -> tuple[Array, Array]:
    """Put values where their luxels are.

    Args:
        luxels: n luxels.
        values: (n, c) or (n,), of any real dtype.

    Returns:
        Pages (p, h, w, c) float32, 0 where there is no luxel, and (p, h, w) bool: where there is one.
    """
    values = _per_luxel(luxels, values)
    page, row, column = luxels.texel.T
    pages = np.zeros((*luxels.shape, values.shape[1]), np.float32)
    pages[page, row, column] = values
    mask = np.zeros(luxels.shape, bool)
    mask[page, row, column] = True
    return pages, mask


def fill(luxels: Luxels, values: Array, valid: Array) -> Array:
    """Luxels that are not valid, such as those inside solids, take the light of their neighbours on the same chart, ring by ring.

    Those of a chart without any valid luxel take it from the nearest valid luxel that faces a like way, if there is one: a rim narrower than a texel
    may lie in a solid with every luxel's centre and still be seen.

    Args:
        luxels: n luxels.
        values: (n, c) float.
        valid: (n,) bool.

    Returns:
        (n, c) float32.
    """
    values, valid = _per_luxel(luxels, values), checked(valid, (len(luxels.texel),), bool, "valid")
    if valid.all():
        return values
    pages, mask = pages_of(luxels, values)
    page, row, column = luxels.texel.T
    known, chart = np.zeros(luxels.shape, bool), np.full(luxels.shape, -1, np.int32)
    known[page, row, column], chart[page, row, column] = valid, luxels.chart
    spread_values = spread(pages, known, mask, label=chart)[0][page, row, column]
    lone = np.flatnonzero(~np.isin(luxels.chart, np.unique(luxels.chart[valid])))
    if len(lone) and valid.any():
        spread_values[lone] = values[like(luxels, lone, valid)]
    return spread_values


def like(luxels: Luxels, wanted: Array, valid: Array) -> Array:
    """(k,) int: for each of some luxels, `wanted` (k,), the nearest `valid` (n,) one on its chart; if there is none, the nearest that faces a like
    way, or the nearest of all. At least one must be valid.
    """
    from scipy.spatial import KDTree

    known = np.flatnonzero(valid)
    apart = 4.0 * float(np.abs(luxels.position).max()) + 1.0  # charts are put so far apart that none is nearer than the same
    by_chart = np.concatenate([luxels.position, apart * luxels.chart[:, None]], 1, dtype=np.float64)
    _, near = KDTree(by_chart[known]).query(by_chart[wanted])
    found = known[near]
    lone = np.flatnonzero(luxels.chart[found] != luxels.chart[wanted])
    if len(lone):
        _, near = KDTree(luxels.position[known]).query(luxels.position[wanted[lone]], k=min(_NEAR, len(known)))
        near = known[np.reshape(near, (len(lone), -1))]
        alike = np.einsum("ijk,ik->ij", luxels.face_normal[near], luxels.face_normal[wanted[lone]]) > _ALIKE
        found[lone] = near[np.arange(len(lone)), np.argmax(alike, 1)]  # nearest first; 0 if none is alike
    return found


def dilate(pages: Array, mask: Array, radius: int) -> Array:
    """Let the charts grow by `radius` texels, so that filtering at their borders finds light and not emptiness.

    Args:
        pages: (p, h, w, c) float32; not changed.
        mask: (p, h, w) bool: texels that have a value, and keep it.
        radius: Texels; the width of the gutter, or more.
    """
    from scipy.ndimage import binary_dilation

    if radius < 1 or not mask.any():
        return pages.copy()
    square = np.ones((1, 3, 3), bool)
    wanted = binary_dilation(mask, square, iterations=radius)
    return spread(pages, mask, wanted, radius)[0]


def finish(atlas: Atlas, luxels: Luxels, values: Array, valid: Array | None = None, gutter: int = 4) -> tuple[Array, Array]:
    """From a value a luxel to pages that can be shown: filled, dilated, stitched.

    Args:
        atlas, luxels: Of the bake.
        values: (n, c) float, such as irradiance E in W/m2.
        valid: (n,) bool: luxels whose value counts; None: all.
        gutter: Texels around charts that get a value.

    Returns:
        As of `pages_of`.
    """
    if valid is not None:
        values = fill(luxels, values, valid)
    pages, mask = pages_of(luxels, values)
    return stitch(atlas, luxels, dilate(pages, mask, gutter), valid=valid), mask


def attach(atlas: Atlas, pages: Array, occlusion: Array | None = None) -> Scene:
    """The atlas's scene, with the pages as lightmaps of its materials.

    A material that is used on several pages becomes one a page. The scene of the atlas is not changed.

    Args:
        atlas: Whose scene and pages.
        pages: (p, h, w, 3) float32: irradiance E in W/m2.
        occlusion: (p, h, w) or (p, h, w, 1) float, 0 (dark) to 1: becomes the occlusion texture of materials that have none.

    Raises:
        InputError: The pages are not those of the atlas.
    """
    pages = checked(pages, (atlas.pages, atlas.size[1], atlas.size[0], 3), np.float32, "pages")
    old = atlas.scene
    scene = replace(old, meshes=[replace(mesh, material=-1) for mesh in old.meshes], materials=[], textures=list(old.textures))
    light = len(scene.textures)
    scene.textures += [_page(page, f"lightmap {i}") for i, page in enumerate(pages)]
    shade = len(scene.textures)
    if occlusion is not None:
        grey = np.clip(np.reshape(occlusion, pages.shape[:3]), 0, 1)
        scene.textures += [_page((255 * page[..., None] + 0.5).astype(np.uint8), f"occlusion {i}") for i, page in enumerate(grey)]
    numbers: dict[tuple[int, int], int] = {}
    for instance, page in zip(old.instances, atlas.instance_page.tolist(), strict=True):
        mesh = old.meshes[instance.mesh]
        if not len(mesh.triangles):
            continue
        if mesh.texcoords1 is None:
            raise InputError(f"mesh {instance.mesh} of the atlas: expected texcoords1, got None")
        key = (mesh.material, page)
        if key not in numbers:
            material = replace(old.materials[mesh.material] if mesh.material >= 0 else Material())
            material.lightmap_texture, material.lightmap_scale = TextureRef(light + page, texcoord=1), 1.0
            if occlusion is not None and material.occlusion_texture is None:
                material.occlusion_texture = TextureRef(shade + page, texcoord=1)
            numbers[key] = len(scene.materials)
            scene.materials.append(material)
        scene.meshes[instance.mesh] = replace(mesh, material=numbers[key])
    return scene


def _page(image: Array, name: str) -> Texture:
    """A texture of a page: no mipmaps, in which charts would run together."""
    return Texture(image, srgb=False, wrap=("clamp", "clamp"), filter="bilinear", name=name)


def _per_luxel(luxels: Luxels, values: Array) -> Array:
    """(n, c) float32."""
    n = len(luxels.texel)
    values = np.asarray(values)
    return checked(values[:, None] if values.ndim == 1 else values, (n, "c"), np.float32, f"values of {n} luxels")
