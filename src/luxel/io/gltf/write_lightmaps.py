"""Lightmaps in glTF: no ratified extension holds them, so there are conventions.

MOZ_lightmap (of Hubs, and of three.js's add-ons): a linear texture, times an intensity, is irradiance E. Light of any range goes into a
Radiance picture through MOZ_texture_rgbe, with a PNG, linear and clipped, as the source for readers that do not know it. What is saved to
be read back exactly, and by luxel, has an OpenEXR picture in its place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import quote

import numpy as np
import pygltflib as g

from luxel.arrays import Array
from luxel.io.images import exr_bytes, png_bytes
from luxel.io.radiance import radiance_bytes
from luxel.scene.material import Material, TextureRef

if TYPE_CHECKING:
    from luxel.io.gltf.write_materials import Materials

Convention = Literal["exact", "moz", "sidecar"]

NOTES = {
    "quantity": "irradiance E",
    "unit": "W/m2",
    "shown": "a diffuse surface shows albedo * E / pi",
    "texcoord": "TEXCOORD_1; (0, 0) is the top left corner",
}
"""The header of a side-car."""

_BRIGHT = 99.0  # percentile of E: up to twice of it, the PNG holds everything


class Lightmaps:
    """The lightmaps of a file's materials, each written when it is first asked for."""

    def __init__(self, materials: Materials, convention: str) -> None:
        self.materials, self.convention = materials, convention
        self._textures: dict[int, tuple[int, float]] = {}
        self._files: dict[int, str] = {}

    def extension(self, material: Material) -> dict[str, Any] | None:
        """MOZ_lightmap of a material; None where it has no lightmap, or that lies beside."""
        ref = material.lightmap_texture
        if ref is None or self.convention == "sidecar":
            return None
        index, scale = self._texture(ref)
        info: dict[str, Any] = {"index": index, "texCoord": ref.texcoord, "intensity": scale * float(material.lightmap_scale)}
        moved = self.materials.transform(ref)
        return info | ({"extensions": moved} if moved else {})

    def extras(self, material: Material) -> dict[str, Any]:
        """What the extras of a material say of a lightmap that lies beside."""
        ref = material.lightmap_texture
        if ref is None or self.convention != "sidecar":
            return {}
        if ref.texture not in self._files:
            image = _light(self.materials.scene.textures[ref.texture].image)
            self._files[ref.texture] = self.materials.beside(exr_bytes(image, NOTES), f"lightmap_{len(self._files)}.exr")
        said = {"uri": quote(self._files[ref.texture]), "texCoord": ref.texcoord, "intensity": float(material.lightmap_scale)}
        return {"lightmap": {**said, "quantity": NOTES["quantity"], "unit": NOTES["unit"]}}

    def _texture(self, ref: TextureRef) -> tuple[int, float]:
        """The glTF texture, and what its values are to be multiplied by."""
        texture = self.materials.scene.textures[ref.texture]
        if texture.image.dtype == np.uint8 or self.convention == "exact":
            return self.materials.texture(ref.texture), 1.0
        if ref.texture not in self._textures:
            light = _light(texture.image)
            scale = _scale(light)
            name, gltf = f"lightmap_{len(self._textures)}", self.materials.buffer.gltf
            plain = (np.clip(light / np.float32(scale), 0, 1) * 255 + 0.5).astype(np.uint8)
            source = self.materials.stored(png_bytes(plain), "image/png", f"{name}.png")
            whole = self.materials.stored(radiance_bytes(light / np.float32(scale)), "image/vnd.radiance", f"{name}.hdr")
            made = g.Texture(source=source, sampler=self.materials.sampler(texture), name=texture.name or None)
            made.extensions = {"MOZ_texture_rgbe": {"source": whole}}
            self.materials.extensions.add("MOZ_texture_rgbe")
            gltf.textures.append(made)
            self._textures[ref.texture] = len(gltf.textures) - 1, scale
        return self._textures[ref.texture]


def _light(image: Array) -> Array:
    """(h, w, 3) float32."""
    return np.repeat(image[..., :1], 3, 2) if image.shape[2] < 3 else np.ascontiguousarray(image[..., :3])


def _scale(light: Array) -> float:
    """What counts as 1 in the PNG: the most there is, but for spots so bright that the rest would be left with few steps."""
    lit = light.max(-1)
    lit = lit[lit > 0]
    return float(min(lit.max(), 2 * np.percentile(lit, _BRIGHT))) if len(lit) else 1.0
