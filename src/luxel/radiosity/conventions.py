"""Conventions: what a lit scene becomes so that readers that know nothing of lightmaps show its light.

No ratified extension of glTF holds a lightmap. "moz" and "sidecar" keep materials and lightmap apart (see `luxel.io.gltf.write_lightmaps`).
"unlit" and "emissive" put what the surfaces show, albedo * E / pi and what they emit, into a picture on TEXCOORD_1 that takes the place of the
base colour of KHR_materials_unlit, or of the emissive texture. In these the textures have the resolution of the lightmap, 8 bits a channel.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError, LuxelWarning
from luxel.radiosity.shown import Shown, lit_materials, shown
from luxel.scene.colour import bytes_from_linear
from luxel.scene.light import Ambient
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.scene import Scene

Convention = Literal["moz", "unlit", "emissive", "sidecar"]
CONVENTIONS: tuple[str, ...] = get_args(Convention)

_CLIPPED = 0.01  # share of the texels from which on it is said that they are clipped


def converted(scene: Scene, convention: Convention = "moz", *, white: float = 1.0, lights: bool = True) -> Scene:
    """A lit scene in one of the conventions; the scene itself is not changed.

    Args:
        scene: Its materials have lightmaps: E in W/m2.
        convention: "moz" and "sidecar" leave the materials as they are, "unlit" and "emissive" bake them into pictures.
        white: Radiance, W/(m2 sr), that "unlit" shows as white; what is brighter is clipped. From 1 on luxel reads it back in full.
        lights: False leaves the punctual lights out, for viewers that add them to the lightmap.

    Raises:
        InputError: No such convention, no material with a lightmap, or `white` is not above 0.
    """
    if convention not in CONVENTIONS:
        raise InputError(f"convention: expected one of {', '.join(CONVENTIONS)}, got {convention!r}")
    if not 0 < white < np.inf:
        raise InputError(f"white: expected a radiance above 0, got {white!r}")
    pages = lit_materials(scene)
    if not pages:
        raise InputError("expected a lit scene, got one without a lightmap: no material has a lightmap_texture")
    ambient = Ambient() if scene.ambient is None and not (lights and scene.lights) else scene.ambient  # or else a head light would come
    scene = replace(scene, ambient=ambient, lights=list(scene.lights) if lights else [], materials=list(scene.materials))
    if convention in ("unlit", "emissive"):
        scene.textures = list(scene.textures)
        for page, users in pages.items():
            (_unlit if convention == "unlit" else _emissive)(scene, page, users, white)
        _drop_unused(scene)
    return scene


def _unlit(scene: Scene, page: int, users: list[int], white: float) -> None:
    """Every material of the page shows the baked picture, and nothing else."""
    seen = shown(scene, page)
    over = float((seen.radiance.max(-1) > white * 1.001)[seen.covered].mean()) if seen.covered.any() else 0.0
    if over > _CLIPPED:
        most = float(seen.radiance[seen.covered].max())
        what = f"unlit: {over:.0%} of the texels are brighter than white, {white:g} W/(m2 sr), and are clipped; the brightest has {most:.3g}"
        warnings.warn(what, LuxelWarning, stacklevel=3)
    image = bytes_from_linear(np.clip(seen.radiance / np.float32(white), 0, 1))
    clear = any(scene.materials[i].alpha_mode != "OPAQUE" for i in users)
    if clear:
        image = np.concatenate([image, _bytes(seen.alpha)[..., None]], -1)
    ref = _picture(scene, image, page)
    gain = max(white, 1.0)
    _bare_colours(scene, users)
    for i in users:
        old = scene.materials[i]
        scene.materials[i] = Material(
            (gain, gain, gain, 1.0), alpha_mode=old.alpha_mode, alpha_cutoff=old.alpha_cutoff, double_sided=old.double_sided,
            shading="unlit", base_color_texture=ref, name=old.name,
        )  # fmt: skip


def _emissive(scene: Scene, page: int, users: list[int], white: float) -> None:
    """Every material of the page emits the baked picture, times its own brightest value; its base is black, so that lights add highlights only."""
    seen = shown(scene, page)
    peaks = {i: _peak(seen, i) for i in users}
    table = np.ones(len(scene.materials) + 1, np.float32)  # the last is of texels without a material, -1
    table[list(peaks)] = list(peaks.values())
    image = bytes_from_linear(np.clip(seen.radiance / table[seen.material][..., None], 0, 1))
    ref = _picture(scene, image, page)
    for i, peak in peaks.items():
        old = scene.materials[i]
        metal = old.metallic >= 1 and old.metallic_roughness_texture is None  # has no diffuse part, and its highlights their colour from the base
        base = old.base_color if metal else (0.0, 0.0, 0.0, old.base_color[3])
        texture = old.base_color_texture if metal or old.alpha_mode != "OPAQUE" else None
        scene.materials[i] = replace(
            old, base_color=base, base_color_texture=texture, emissive=(peak, peak, peak), emissive_texture=ref, lightmap_texture=None,
            lightmap_scale=1.0,
        )  # fmt: skip


def _peak(seen: Shown, material: int) -> float:
    """The brightest channel of what a material shows; 1 for one that shows nothing."""
    own = seen.radiance[seen.material == material]
    return float(own.max(initial=0.0)) or 1.0


def _picture(scene: Scene, image: Array, page: int) -> TextureRef:
    """Append a baked picture, sampled as the lightmap was."""
    light = scene.textures[page]
    scene.textures.append(Texture(image, True, light.wrap, light.filter, light.name.replace("lightmap", "baked")))
    users = (m.lightmap_texture for m in scene.materials if m.lightmap_texture is not None and m.lightmap_texture.texture == page)
    return replace(next(users), texture=len(scene.textures) - 1)


def _bytes(values: Array) -> Array:
    return (np.clip(values, 0, 1) * 255 + 0.5).astype(np.uint8)


def _bare_colours(scene: Scene, users: list[int]) -> None:
    """The colours of the vertices are in the picture now."""
    scene.meshes = [replace(mesh, colors=None) if mesh.material in users and mesh.colors is not None else mesh for mesh in scene.meshes]


def _drop_unused(scene: Scene) -> None:
    """Leave out textures that no material names any more."""
    slots = [name for name in Material.__dataclass_fields__ if name.endswith("_texture")]
    used = sorted({ref.texture for material in scene.materials for slot in slots if (ref := getattr(material, slot)) is not None})
    scene.materials = [replace(material) for material in scene.materials]
    for material in scene.materials:
        for slot in slots:
            ref = getattr(material, slot)
            if ref is not None:
                setattr(material, slot, replace(ref, texture=used.index(ref.texture)))
    scene.textures = [scene.textures[old] for old in used]
