"""Materials and textures of a Scene as glTF's, each written when a mesh first asks for it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
import pygltflib as g

from luxel.io.files import atomic_write
from luxel.io.gltf.write_lightmaps import Lightmaps
from luxel.io.images import exr_bytes, png_bytes
from luxel.io.mtl import texture_file
from luxel.io.obj_write import eight_bit
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.scene import Scene

if TYPE_CHECKING:
    from luxel.io.gltf.write import Buffer

_WRAPS = {"repeat": g.REPEAT, "clamp": g.CLAMP_TO_EDGE, "mirror": g.MIRRORED_REPEAT}
_FILTERS = {
    "nearest": (g.NEAREST, g.NEAREST),
    "bilinear": (g.LINEAR, g.LINEAR),
    "trilinear": (g.LINEAR_MIPMAP_LINEAR, g.LINEAR),
}


class Materials:
    """The materials of the file; `extensions` collects the names of those that they use."""

    def __init__(self, scene: Scene, buffer: Buffer, path: Path, lightmaps: str) -> None:
        """`path`: of the file. Pictures go beside a .gltf, and into the buffer of a .glb. `lightmaps`: see `write.save`."""
        self.scene, self.buffer, self.path = scene, buffer, path
        self.extensions: set[str] = set()
        self._lightmaps = Lightmaps(self, lightmaps)
        self._images: dict[int, int] = {}
        self._textures: dict[int, int] = {}
        self._plain: int | None = None
        # All of the scene's, in its order, so that numbers agree.
        buffer.gltf.materials.extend(self._material(material) for material in scene.materials)

    def number(self, index: int) -> int:
        """The glTF material of the scene's material `index`; -1 is luxel's default."""
        if index >= 0:
            return index
        if self._plain is None:
            self._plain = len(self.buffer.gltf.materials)
            self.buffer.gltf.materials.append(self._material(Material()))
        return self._plain

    def _material(self, material: Material) -> g.Material:
        strength, gain = max(1.0, *material.emissive), max(1.0, *material.base_color[:3])
        made = g.Material(
            name=material.name or None,
            pbrMetallicRoughness=g.PbrMetallicRoughness(
                baseColorFactor=_floats([*(c / gain for c in material.base_color[:3]), material.base_color[3]]),
                metallicFactor=float(material.metallic),
                roughnessFactor=float(material.roughness),
            ),
            emissiveFactor=[float(c) / strength for c in material.emissive],
            alphaMode=material.alpha_mode,
            doubleSided=bool(material.double_sided),
        )
        if material.alpha_mode == "MASK":
            made.alphaCutoff = float(material.alpha_cutoff)
        self._refs(material, made)
        if strength > 1:
            self._extend(made, "KHR_materials_emissive_strength", {"emissiveStrength": strength})
        if material.shading == "unlit":
            self._extend(made, "KHR_materials_unlit", {})
        own = _own(material) | self._lightmaps.extras(material) | ({"gain": gain} if gain > 1 else {})
        if own:
            made.extras = {"luxel": own}
        return made

    def _refs(self, material: Material, made: g.Material) -> None:
        pbr = made.pbrMetallicRoughness
        pbr.baseColorTexture = self._info(material.base_color_texture)
        pbr.metallicRoughnessTexture = self._info(material.metallic_roughness_texture)
        made.emissiveTexture = self._info(material.emissive_texture)
        made.normalTexture = self._info(material.normal_texture, g.NormalMaterialTexture, scale=float(material.normal_scale))
        strength = float(material.occlusion_strength)
        made.occlusionTexture = self._info(material.occlusion_texture, g.OcclusionTextureInfo, strength=strength)
        light = self._lightmaps.extension(material)
        if light is not None:
            self._extend(made, "MOZ_lightmap", light)

    def _extend(self, made: g.Material, name: str, value: dict[str, Any]) -> None:
        made.extensions = {**(made.extensions or {}), name: value}
        self.extensions.add(name)

    def _info(self, ref: TextureRef | None, kind: Any = g.TextureInfo, **more: float) -> Any:
        if ref is None:
            return None
        info = kind(index=self.texture(ref.texture), texCoord=ref.texcoord, **more)
        info.extensions = self.transform(ref)
        return info

    def transform(self, ref: TextureRef) -> dict[str, Any]:
        """KHR_texture_transform, where there is one."""
        values = {"offset": _floats(ref.offset), "rotation": float(ref.rotation), "scale": _floats(ref.scale)}
        if values == {"offset": [0.0, 0.0], "rotation": 0.0, "scale": [1.0, 1.0]}:
            return {}
        self.extensions.add("KHR_texture_transform")
        return {"KHR_texture_transform": values}

    def texture(self, index: int) -> int:
        """The glTF texture of the scene's texture `index`."""
        if index not in self._textures:
            gltf, texture = self.buffer.gltf, self.scene.textures[index]
            self._textures[index] = len(gltf.textures)
            gltf.textures.append(g.Texture(source=self._image(index, texture), sampler=self.sampler(texture), name=texture.name or None))
        return self._textures[index]

    def sampler(self, texture: Texture) -> int:
        """Append a sampler and return its number."""
        samplers = self.buffer.gltf.samplers
        least, most = _FILTERS[texture.filter]
        samplers.append(g.Sampler(magFilter=most, minFilter=least, wrapS=_WRAPS[texture.wrap[0]], wrapT=_WRAPS[texture.wrap[1]]))
        return len(samplers) - 1

    def _image(self, index: int, texture: Texture) -> int:
        key = id(texture.image)  # an image used as colour and as data is stored once
        if key not in self._images:
            name = Path(texture_file(texture, index)).stem
            if texture.image.dtype == np.uint8 or texture.srgb:
                self._images[key] = self.stored(png_bytes(eight_bit(texture)), "image/png", f"{name}.png")
            else:
                self._images[key] = self.stored(exr_bytes(texture.image), "image/x-exr", f"{name}.exr")
        return self._images[key]

    def stored(self, data: bytes, mime: str, name: str) -> int:
        """Put a picture where it belongs and return its number; `name` follows the file's where it lies beside."""
        if self.path.suffix.lower() == ".glb":
            image = g.Image(bufferView=self.buffer.view(data), mimeType=mime)
        else:
            image = g.Image(uri=quote(self.beside(data, name)), mimeType=mime)
        self.buffer.gltf.images.append(image)
        return len(self.buffer.gltf.images) - 1

    def beside(self, data: bytes, name: str) -> str:
        """Write a file beside the scene's and return its name."""
        name = f"{self.path.stem}_{name}"
        with atomic_write(self.path.with_name(name)) as file:
            file.write(data)
        return name


def _own(material: Material) -> dict[str, Any]:
    """What glTF cannot say, for luxel to read back."""
    own: dict[str, Any] = {} if material.shading in ("pbr", "unlit") else {"shading": material.shading or "any"}
    if material.specular is not None:
        own["specular"] = _floats(material.specular)
    if material.shininess is not None:
        own["shininess"] = float(material.shininess)
    return own


def _floats(values: Any) -> list[float]:
    return [float(value) for value in values]
