"""Materials and textures: the core model, and the extensions that luxel's Material can hold."""

from __future__ import annotations

from typing import Any, cast, get_args

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.files import tell
from luxel.io.gltf.document import Document, Part
from luxel.scene.colour import linear_from_srgb
from luxel.scene.material import AlphaMode, Filter, Material, Shading, Texture, TextureRef, Wrap
from luxel.scene.scene import Scene

_WRAPS: dict[int, Wrap] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_FILTERS: dict[int, Filter] = {  # of minFilter; magnification is nearest only with 9728
    9728: "nearest", 9729: "bilinear", 9984: "nearest", 9985: "trilinear", 9986: "nearest", 9987: "trilinear",
}  # fmt: skip
_SOURCES = ("MOZ_texture_rgbe", "EXT_texture_webp", "EXT_texture_avif")


class Textures:
    """The scene's textures as materials ask for them: one for each image, sampler and encoding."""

    def __init__(self, document: Document, scene: Scene) -> None:
        self.document = document
        self.scene = scene
        self._images: dict[int, Array | None] = {}
        self._numbers: dict[tuple[Any, ...], int] = {}

    def ref(self, info: Part | None, srgb: bool) -> TextureRef | None:
        """What a textureInfo object refers to; None where there is none or its image cannot be had (which is said)."""
        if info is None:
            return None
        part = self.document.item("textures", info.integer("index"), info.where)
        source = next(
            (p.integer("source", None) for name in _SOURCES if (p := part.extension(name))),
            part.integer("source", None),
        )
        if source is None:
            tell(part.where, "has no image that luxel can read and is ignored")
            return None
        image = self._image(source, part.where)
        texcoord = info.integer("texCoord", 0)
        transform = info.extension("KHR_texture_transform")
        if transform is not None:
            texcoord = transform.integer("texCoord", texcoord)
        if image is None:
            return None
        if texcoord > 1:
            tell(info.where, f"uses TEXCOORD_{texcoord}, luxel reads 0 and 1; the texture is ignored")
            return None
        ref = TextureRef(self._number(source, image, part, srgb), texcoord)
        if transform is not None:
            ref.offset, ref.scale = (
                transform.numbers("offset", 2, (0.0, 0.0)),
                transform.numbers("scale", 2, (1.0, 1.0)),
            )
            ref.rotation = transform.number("rotation", 0.0)
        return ref

    def beside(self, info: Part) -> TextureRef | None:
        """The lightmap that luxel wrote beside the file; None, which is said, where it cannot be had."""
        from luxel.io.images import decode_image

        uri = info.text("uri")
        try:
            image = decode_image(self.document.resource(uri, info.where).tobytes(), f"{info.where}, {uri[:200]}")
        except FileError as error:
            tell(error.where, f"{error.what}; the lightmap is left out")
            return None
        key = ("beside", uri)
        if key not in self._numbers:
            self._numbers[key] = len(self.scene.textures)
            self.scene.textures.append(Texture(image, False, ("clamp", "clamp"), "bilinear", uri))
        return TextureRef(self._numbers[key], info.integer("texCoord", 1))

    def _number(self, source: int, image: Array, part: Part, srgb: bool) -> int:
        wrap, filtering = self._sampler(part)
        key = (source, srgb, wrap, filtering)
        if key not in self._numbers:
            item = self.document.item("images", source, part.where)
            name = part.text("name", "") or item.text("name", "") or _stem(item)
            if srgb and image.dtype != np.uint8 and part.where and not self._linear(source):
                image = linear_from_srgb(image)  # 16-bit pictures: a float texture is taken as linear
            self._numbers[key] = len(self.scene.textures)
            self.scene.textures.append(Texture(image, srgb, wrap, filtering, name))
        return self._numbers[key]

    def _linear(self, source: int) -> bool:
        """The image's format holds linear light (EXR, HDR), whatever it is used for."""
        item = self.document.item("images", source, self.document.where)
        name = f"{item.text('mimeType', '')} {item.text('uri', '')[:200]}".lower()
        return any(word in name for word in (".exr", ".hdr", "exr", "radiance"))

    def _sampler(self, part: Part) -> tuple[tuple[Wrap, Wrap], Filter]:
        index = part.integer("sampler", None)
        if index is None:
            return ("repeat", "repeat"), "trilinear"
        sampler = self.document.item("samplers", index, part.where)
        wraps = [sampler.integer(key, 10497) for key in ("wrapS", "wrapT")]
        least, most = sampler.integer("minFilter", 9987), sampler.integer("magFilter", 9729)
        for key, value, known in (
            ("wrapS", wraps[0], _WRAPS),
            ("wrapT", wraps[1], _WRAPS),
            ("minFilter", least, _FILTERS),
        ):
            if value not in cast(dict[int, Any], known):
                raise FileError(sampler.where, f"{key}: expected one of {sorted(cast(dict[int, Any], known))}, got {value}")
        filtering = _FILTERS[least]
        if most == 9728 and filtering == "bilinear":
            filtering = "nearest"
        return (_WRAPS[wraps[0]], _WRAPS[wraps[1]]), filtering

    def _image(self, index: int, asked_by: str) -> Array | None:
        if index not in self._images:
            part = self.document.item("images", index, asked_by)
            self._images[index] = self._read_image(part)
        return self._images[index]

    def _read_image(self, part: Part) -> Array | None:
        from luxel.io.images import decode_image

        try:
            if part.has("bufferView"):
                data, _ = self.document.view(part.integer("bufferView"), part.where)
            else:
                data = self.document.resource(part.text("uri"), part.where)
            return decode_image(data.tobytes(), part.where)
        except FileError as error:
            tell(error.where, f"{error.what}; the texture is left out")
            return None


def _stem(image: Part) -> str:
    uri = image.text("uri", "")
    return "" if uri[:5].lower() == "data:" else uri[:200]


def read_material(part: Part, textures: Textures) -> Material:
    """One material of the file."""
    pbr = part.part("pbrMetallicRoughness") or Part(part.where, {})
    strength = part.extension("KHR_materials_emissive_strength")
    boost = strength.number("emissiveStrength", 1.0, 0.0) if strength else 1.0
    mode = part.text("alphaMode", "OPAQUE")
    if mode not in ("OPAQUE", "MASK", "BLEND"):
        raise FileError(part.where, f"alphaMode: expected OPAQUE, MASK or BLEND, got {mode[:20]!r}")
    own = own_extras(part)
    shading = own.text("shading", "pbr")
    if part.extension("KHR_materials_unlit") is not None:
        shading = "unlit"
    if shading not in (*get_args(Shading), "any"):
        raise FileError(own.where, f"shading {shading[:20]!r}")
    normal, occlusion, beside = part.part("normalTexture"), part.part("occlusionTexture"), own.part("lightmap")
    light, gain = beside or part.extension("MOZ_lightmap"), own.number("gain", 1.0, 0.0)
    base = pbr.numbers("baseColorFactor", 4, (1.0, 1.0, 1.0, 1.0))
    return Material(
        name=part.text("name", ""),
        shading=None if shading == "any" else shading,
        specular=own.numbers("specular", 3, None),
        shininess=own.number("shininess", None, 0.0),
        base_color=(gain * base[0], gain * base[1], gain * base[2], base[3]),
        metallic=pbr.number("metallicFactor", 1.0, 0.0),
        roughness=pbr.number("roughnessFactor", 1.0, 0.0),
        emissive=cast(Any, tuple(boost * c for c in part.numbers("emissiveFactor", 3, (0.0, 0.0, 0.0)))),
        alpha_mode=cast(AlphaMode, mode),
        alpha_cutoff=part.number("alphaCutoff", 0.5, 0.0),
        double_sided=part.flag("doubleSided"),
        normal_scale=normal.number("scale", 1.0) if normal else 1.0,
        occlusion_strength=occlusion.number("strength", 1.0, 0.0) if occlusion else 1.0,
        base_color_texture=textures.ref(pbr.part("baseColorTexture"), True),
        metallic_roughness_texture=textures.ref(pbr.part("metallicRoughnessTexture"), False),
        normal_texture=textures.ref(normal, False),
        occlusion_texture=textures.ref(occlusion, False),
        emissive_texture=textures.ref(part.part("emissiveTexture"), True),
        lightmap_texture=textures.beside(beside) if beside else textures.ref(light, False),
        lightmap_scale=light.number("intensity", 1.0, 0.0) if light else 1.0,
    )


def own_extras(part: Part) -> Part:
    """What luxel wrote into the extras of an object because glTF has no place for it; empty where it did not."""
    extras = part.data.get("extras")
    own = extras.get("luxel") if isinstance(extras, dict) else None
    return Part(f"{part.where}, extras", own if isinstance(own, dict) else {})


def default_material() -> Material:
    """What glTF gives a primitive without a material."""
    return Material(name="default", shading="pbr", base_color=(1.0, 1.0, 1.0, 1.0), metallic=1.0, roughness=1.0)
