"""Materials and textures of a Scene as glTF's, each written when a mesh first asks for it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
import pygltflib as g

from luxel.arrays import Array
from luxel.io.files import atomic_write
from luxel.io.images import png_bytes, write_exr
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

    def __init__(self, scene: Scene, buffer: Buffer, path: Path | None) -> None:
        """`path`: of the .gltf, beside which pictures go; None puts them into the buffer."""
        self.scene, self.buffer, self.path = scene, buffer, path
        self.extensions: set[str] = set()
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
        strength = max(1.0, *material.emissive)
        made = g.Material(
            name=material.name or None,
            pbrMetallicRoughness=g.PbrMetallicRoughness(
                baseColorFactor=_floats(material.base_color),
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
        own = _own(material)
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
        light = material.lightmap_texture
        if light is not None:
            info: dict[str, Any] = {
                "index": self._texture(light.texture),
                "texCoord": light.texcoord,
                "intensity": float(material.lightmap_scale),
            }
            moved = self._transform(light)
            self._extend(made, "MOZ_lightmap", info | ({"extensions": moved} if moved else {}))

    def _extend(self, made: g.Material, name: str, value: dict[str, Any]) -> None:
        made.extensions = {**(made.extensions or {}), name: value}
        self.extensions.add(name)

    def _info(self, ref: TextureRef | None, kind: Any = g.TextureInfo, **more: float) -> Any:
        if ref is None:
            return None
        info = kind(index=self._texture(ref.texture), texCoord=ref.texcoord, **more)
        info.extensions = self._transform(ref)
        return info

    def _transform(self, ref: TextureRef) -> dict[str, Any]:
        values = {"offset": _floats(ref.offset), "rotation": float(ref.rotation), "scale": _floats(ref.scale)}
        if values == {"offset": [0.0, 0.0], "rotation": 0.0, "scale": [1.0, 1.0]}:
            return {}
        self.extensions.add("KHR_texture_transform")
        return {"KHR_texture_transform": values}

    def _texture(self, index: int) -> int:
        if index not in self._textures:
            gltf, texture = self.buffer.gltf, self.scene.textures[index]
            least, most = _FILTERS[texture.filter]
            gltf.samplers.append(g.Sampler(magFilter=most, minFilter=least, wrapS=_WRAPS[texture.wrap[0]], wrapT=_WRAPS[texture.wrap[1]]))
            self._textures[index] = len(gltf.textures)
            source, sampler = self._image(index, texture), len(gltf.samplers) - 1
            gltf.textures.append(g.Texture(sampler=sampler, source=source, name=texture.name or None))
        return self._textures[index]

    def _image(self, index: int, texture: Texture) -> int:
        key = id(texture.image)  # an image used as colour and as data is stored once
        if key not in self._images:
            gltf = self.buffer.gltf
            self._images[key] = len(gltf.images)
            if texture.image.dtype == np.uint8 or texture.srgb:
                data, mime, ending = png_bytes(eight_bit(texture)), "image/png", ".png"
            else:
                data, mime, ending = _exr_bytes(texture.image), "image/x-exr", ".exr"
            if self.path is None:
                image = g.Image(bufferView=self.buffer.view(data), mimeType=mime)
            else:
                name = f"{self.path.stem}_{Path(texture_file(texture, index)).stem}{ending}"
                with atomic_write(self.path.with_name(name)) as file:
                    file.write(data)
                image = g.Image(uri=quote(name), mimeType=mime)
            gltf.images.append(image)
        return self._images[key]


def _own(material: Material) -> dict[str, Any]:
    """What glTF cannot say, for luxel to read back."""
    own: dict[str, Any] = {} if material.shading in ("pbr", "unlit") else {"shading": material.shading or "any"}
    if material.specular is not None:
        own["specular"] = _floats(material.specular)
    if material.shininess is not None:
        own["shininess"] = float(material.shininess)
    return own


def _exr_bytes(image: Array) -> bytes:
    """Light of any range: glTF knows no float pictures, but readers of MOZ_lightmap take OpenEXR."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "image.exr")
        write_exr(path, {"": image})
        return path.read_bytes()


def _floats(values: Any) -> list[float]:
    return [float(value) for value in values]
