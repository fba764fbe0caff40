"""What lit surfaces show, as pictures in texture space: drawn by the renderer itself, from above the lightmap's page.

The page is a flat scene, each triangle lying where its lightmap coordinates are, a texel being a unit. So textures, vertex colours and metals
count here exactly as they do when the scene is rendered.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.radiosity.spread import spread
from luxel.scene.camera import Camera
from luxel.scene.colour import linear_from_srgb
from luxel.scene.light import Ambient
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene
from luxel.scene.transforms import translation

_SAMPLES = 8
_GUTTER = 4  # texels around charts that get a value


class Shown(NamedTuple):
    """A lightmap's page as it is seen, without highlights.

    Attributes:
        radiance: (h, w, 3) float32, W/(m2 sr): albedo * E / pi + what is emitted.
        alpha: (h, w) float32: of the materials that are not opaque, else 1.
        material: (h, w) int32: index into the scene's materials of the nearest surface; -1 where the page is empty.
        covered: (h, w) bool: surfaces, without their gutters.
    """

    radiance: Array
    alpha: Array
    material: Array
    covered: Array


def lit_materials(scene: Scene) -> dict[int, list[int]]:
    """Of every texture that is a lightmap, the materials that show it: not those that are unlit, as they show none."""
    found: dict[int, list[int]] = {}
    for i, material in enumerate(scene.materials):
        if material.lightmap_texture is not None and material.shading != "unlit":
            found.setdefault(material.lightmap_texture.texture, []).append(i)
    return found


def shown(scene: Scene, texture: int) -> Shown:
    """Draw one lightmap as its surfaces show it.

    Args:
        scene: A lit scene.
        texture: Index of the lightmap in its textures.
    """
    light = light_of(scene.textures[texture])
    size = light.shape[1], light.shape[0]
    users = lit_materials(scene)[texture]
    flat = _flat(scene, set(users), size)
    white = TextureRef(len(flat.textures), 1)
    flat.textures.append(Texture(np.full((1, 1, 3), np.pi, np.float32), srgb=False))
    none = (0.0, 0.0, 0.0)
    albedo, cover = _draw(flat, size, lambda i, m: _solid(m, emissive=none, lightmap_texture=white, lightmap_scale=1.0))
    emitted = np.zeros_like(albedo)
    if any(any(scene.materials[i].emissive) for i in users):
        dark = {"base_color": (0.0, 0.0, 0.0, 1.0), "lightmap_texture": None}
        emitted, _ = _draw(flat, size, lambda i, m: _solid(m, **dark))
    number, _ = _draw(flat, size, lambda i, m: Material((i + 1.0, 0.0, 0.0, 1.0), shading="unlit", double_sided=True), bare=True)
    alpha = np.ones_like(cover)
    if any(scene.materials[i].alpha_mode != "OPAQUE" for i in users):
        _, seen = _draw(flat, size, lambda i, m: replace(_solid(m), alpha_mode="OPAQUE" if m.alpha_mode == "OPAQUE" else "BLEND"))
        alpha = np.minimum(seen / np.maximum(cover, 1e-6), 1)
    covered = cover > 0
    label = _nearest(np.rint(number[..., 0]).astype(np.int32) - 1, covered)
    values = np.concatenate([albedo, emitted, alpha[..., None]], -1)
    grown = spread(values[None], covered[None], np.ones_like(covered)[None], _GUTTER, label[None])[0][0]  # lamps do not shine into others' gutters
    scale = np.array([*(material.lightmap_scale for material in scene.materials), 0], np.float32) / np.float32(pi)
    radiance = grown[..., :3] * light * scale[label][..., None] + grown[..., 3:6]
    return Shown(radiance, grown[..., 6], label, covered)


def light_of(texture: Texture) -> Array:
    """What a lightmap holds: (h, w, 3) float32, linear, to be multiplied by `lightmap_scale`."""
    image = texture.image
    image = np.repeat(image[..., :1], 3, 2) if image.shape[2] < 3 else image[..., :3]
    if image.dtype != np.uint8:
        return np.ascontiguousarray(image)
    unit = image / np.float32(255)
    return np.asarray(linear_from_srgb(unit), np.float32) if texture.srgb else unit


def _flat(scene: Scene, users: set[int], size: tuple[int, int]) -> Scene:
    """The meshes of some materials, laid on the page: x to the right and y up, in texels."""
    flat = Scene(materials=list(scene.materials), textures=list(scene.textures), ambient=Ambient())
    for instance in scene.instances:
        mesh = scene.meshes[instance.mesh]
        if mesh.material not in users or not len(mesh.triangles):
            continue
        ref = scene.materials[mesh.material].lightmap_texture
        assert ref is not None
        coords = mesh.texcoords1 if ref.texcoord else mesh.texcoords
        uv = _moved(np.zeros((len(mesh.positions), 2), np.float32) if coords is None else coords, ref) * np.array(size, np.float32)
        places = np.stack([uv[:, 0], size[1] - uv[:, 1], np.zeros(len(uv), np.float32)], 1)
        up = np.tile(np.array([0, 0, 1], np.float32), (len(uv), 1))
        flat.add(Mesh(places, mesh.triangles, up, mesh.texcoords, mesh.texcoords1, mesh.colors, material=mesh.material))
    return flat


def _moved(uv: Array, ref: TextureRef) -> Array:
    """Texture coordinates (n, 2) after KHR_texture_transform."""
    c, s = np.float32(np.cos(ref.rotation)), np.float32(np.sin(ref.rotation))
    turned = (uv * np.array(ref.scale, np.float32)) @ np.array([[c, -s], [s, c]], np.float32)
    return turned + np.array(ref.offset, np.float32)


def _solid(material: Material, **changes: object) -> Material:
    """The material seen from both sides, without holes and normal map; models without a lightmap are taken for Blinn-Phong."""
    shading = "phong" if material.shading == "gouraud" else material.shading
    kept: dict[str, object] = {"shading": shading, "alpha_mode": "OPAQUE", "double_sided": True, "normal_texture": None, "occlusion_texture": None}
    return replace(material, **(kept | changes))  # type: ignore[arg-type]


def _draw(flat: Scene, size: tuple[int, int], dressed: Callable[[int, Material], Material], bare: bool = False) -> tuple[Array, Array]:
    """The page with other materials: the mean colour of what covers each texel, (h, w, 3), and how much covers it, (h, w), 0..1.

    Args:
        flat: From `_flat`.
        size: Width and height, texels.
        dressed: From a material's number and itself to what it is drawn with.
        bare: Without the colours of vertices.
    """
    from luxel.raster.render import render

    meshes = [replace(mesh, colors=None) for mesh in flat.meshes] if bare else flat.meshes
    scene = replace(flat, meshes=meshes, materials=[dressed(i, material) for i, material in enumerate(flat.materials)])
    above = Camera(translation((size[0] / 2, size[1] / 2, 1.0)), yfov=None, height=float(size[1]), near=0.0, far=2.0)
    linear = render(scene, above, size, samples=_SAMPLES, cull="none", outputs=("linear",)).linear
    assert linear is not None
    cover = linear[..., 3]
    return linear[..., :3] / np.maximum(cover, 1e-6)[..., None], cover


def _nearest(label: Array, covered: Array) -> Array:
    """Labels (h, w), those of texels that are not covered taken from the nearest that is; -1 where none is."""
    from scipy.ndimage import distance_transform_edt

    if not covered.any():
        return np.full_like(label, -1)
    rows, columns = distance_transform_edt(~covered, return_distances=False, return_indices=True)
    return label[rows, columns]
