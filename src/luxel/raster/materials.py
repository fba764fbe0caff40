"""Materials as tables that kernels read: one row a material, and the last row the default material (index -1)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.raster.mipmap import pack_textures
from luxel.scene.material import Material, TextureRef
from luxel.scene.scene import Scene

# Shading models: how `light` answers. Flat and Phong shading are Lambert where the material has no specular part.
MODEL_UNLIT, MODEL_LAMBERT, MODEL_PHONG, MODEL_PBR = range(4)
# Added to the model: which of the optional rows of a fragment hold something.
EMISSIVE, OCCLUDED, LIGHTMAPPED = 4, 8, 16
MODEL_MASK = 3

# What a material needs of a fragment, and how it is drawn (`MaterialTable.flags`).
NEEDS_NORMAL, NEEDS_FACE, NEEDS_VIEW, NEEDS_UV0, NEEDS_UV1, NEEDS_TANGENT, NEEDS_COLOR = (1 << i for i in range(7))
ALPHA_MASK, ALPHA_BLEND, DOUBLE_SIDED, GOURAUD = (1 << i for i in range(7, 11))

SLOTS = ("base_color", "metallic_roughness", "normal", "occlusion", "emissive", "lightmap")
BASE_SLOT, ROUGHNESS_SLOT, NORMAL_SLOT, OCCLUSION_SLOT, EMISSIVE_SLOT, LIGHTMAP_SLOT = range(6)

# Columns of `MaterialTable.floats`; six numbers of each texture's transform follow from TRANSFORMS on.
# GLOSS is the exponent where Blinn-Phong has a specular colour of its own, else the roughness.
RED, GREEN, BLUE, ALPHA, METAL, GLOSS, EMIT, SPECULAR = 0, 1, 2, 3, 4, 5, 6, 9
NORMAL_SCALE, OCCLUSION_STRENGTH, LIGHTMAP_SCALE, CUTOFF, TRANSFORMS = 12, 13, 14, 15, 16
FLOATS = TRANSFORMS + 6 * len(SLOTS)
# Columns of `MaterialTable.ints`: the model, whether specular follows from metallic and roughness, each slot's texture and texcoord.
CODE, DERIVED, TEXTURE, TEXCOORD = 0, 1, 2, 2 + len(SLOTS)
INTS = TEXCOORD + len(SLOTS)

SHADINGS = ("flat", "gouraud", "phong", "pbr", "unlit", "hardware")
LEAST_ROUGHNESS = 0.045


class MaterialTable(NamedTuple):
    """Materials and textures of a scene. Kernels take the whole tuple.

    Attributes:
        floats: (m + 1, FLOATS) float32.
        ints: (m + 1, INTS) int32.
        flags: (m + 1,) int32: NEEDS_*, ALPHA_*, DOUBLE_SIDED, GOURAUD.
        textures, levels, texels, radiance: See `mipmap.TexturePool`.
        features: All flags of all materials that the scene's meshes use, or-ed.
    """

    floats: Array
    ints: Array
    flags: Array
    textures: Array
    levels: Array
    texels: Array
    radiance: Array
    features: int

    @property
    def rich(self) -> bool:
        """Whether any material has a texture or is of the metallic-roughness model."""
        textured = self.ints[:, TEXTURE : TEXTURE + len(SLOTS)] >= 0
        return bool(textured.any() or (self.ints[:, CODE] & MODEL_MASK == MODEL_PBR).any())


def pack_materials(scene: Scene, shading: str | None = None, vertices: bool = False) -> MaterialTable:
    """Make the table of a scene's materials.

    Args:
        scene: Its materials, textures and meshes are read.
        shading: Model of all materials ("flat", "gouraud", "phong", "pbr", "unlit", or "hardware", which is "gouraud" here); None takes each
            material's own, "phong" where it has none.
        vertices: Make the table for lighting the vertices of Gouraud materials: Blinn-Phong without textures. The table for fragments
            then takes the interpolated colour, times the base colour texture, as it is. Other textures play no part.

    Raises:
        InputError: No such shading, or `Scene.check` refuses the scene.
    """
    if shading is not None and shading not in SHADINGS:
        raise InputError(f"shading: expected one of {', '.join(SHADINGS)}; got {shading!r}")
    scene.check()
    materials = [*scene.materials, Material()]
    colored = {mesh.material % len(materials) for mesh in scene.meshes if mesh.colors is not None}
    floats = np.zeros((len(materials), FLOATS), np.float32)
    ints = np.zeros((len(materials), INTS), np.int32)
    flags = np.zeros(len(materials), np.int32)
    for i, material in enumerate(materials):
        model = "gouraud" if shading == "hardware" else shading or material.shading or "phong"
        if vertices:
            material, model = _bare(material), "phong"
        floats[i], ints[i], flags[i] = _pack(material, model, i in colored)
    used = sorted({mesh.material % len(materials) for mesh in scene.meshes})
    features = int(np.bitwise_or.reduce(flags[used])) if used else 0
    return MaterialTable(floats, ints, flags, *pack_textures(Scene() if vertices else scene), features)


def _bare(material: Material) -> Material:
    """The material without its textures; what only a texture tells, metal from paint and lamps from the rest, is taken for paint."""
    none: dict[str, Any] = {f"{slot}_texture": None for slot in SLOTS}
    metallic = 0.0 if material.metallic_roughness_texture else material.metallic
    emissive = (0.0, 0.0, 0.0) if material.emissive_texture else material.emissive
    return replace(material, metallic=metallic, emissive=emissive, alpha_mode="BLEND", **none)  # alpha is judged at the fragments


def _pack(material: Material, model: str, colored: bool) -> tuple[Array, Array, int]:
    refs = [getattr(material, f"{slot}_texture") for slot in SLOTS]
    code = _code(material, model)
    if code & MODEL_MASK == MODEL_UNLIT:
        refs[1:] = [None] * (len(SLOTS) - 1)
    if model == "flat":
        refs[NORMAL_SLOT] = None  # the triangle's own normal, and no tangents to bend it by
    floats = np.zeros(FLOATS, np.float32)
    floats[RED : ALPHA + 1] = 1.0 if model == "gouraud" else material.base_color
    floats[EMIT : EMIT + 3] = material.emissive
    floats[SPECULAR : SPECULAR + 3] = 0 if material.specular is None else material.specular
    floats[METAL] = material.metallic
    exponent, roughness = _gloss(material)
    floats[GLOSS] = exponent if code & MODEL_MASK == MODEL_PHONG and material.specular is not None else roughness
    floats[NORMAL_SCALE : CUTOFF + 1] = (
        material.normal_scale, material.occlusion_strength, material.lightmap_scale, material.alpha_cutoff,
    )  # fmt: skip
    ints = np.zeros(INTS, np.int32)
    for slot, ref in enumerate(refs):
        ints[TEXTURE + slot] = -1 if ref is None else ref.texture
        ints[TEXCOORD + slot] = 0 if ref is None else ref.texcoord
        floats[TRANSFORMS + 6 * slot : TRANSFORMS + 6 * slot + 6] = _transform(ref or TextureRef(0))
    ints[CODE], ints[DERIVED] = code, material.specular is None
    return floats, ints, _flags(material, model, refs, code, colored)


def _gloss(material: Material) -> tuple[float, float]:
    """Exponent and roughness; what is missing is made from what is there: exponent = 2 / roughness^4 - 2."""
    roughness = max(material.roughness, LEAST_ROUGHNESS)
    if material.shininess is None:
        return 2 / roughness**4 - 2, roughness
    exponent = max(material.shininess, 0.0)
    return exponent, max((2 / (exponent + 2)) ** 0.25, LEAST_ROUGHNESS)


def _transform(ref: TextureRef) -> tuple[float, ...]:
    """a b c d e f of u' = a u + b v + c, v' = d u + e v + f: scaled, turned counter-clockwise in the picture, moved (KHR_texture_transform)."""
    c, s = math.cos(ref.rotation), math.sin(ref.rotation)
    return c * ref.scale[0], s * ref.scale[1], ref.offset[0], -s * ref.scale[0], c * ref.scale[1], ref.offset[1]


def _code(material: Material, model: str) -> int:
    if model in ("unlit", "gouraud"):
        return MODEL_UNLIT
    dull = material.specular is not None and not any(material.specular)
    code = MODEL_PBR if model == "pbr" else MODEL_LAMBERT if dull else MODEL_PHONG
    code |= EMISSIVE if any(material.emissive) else 0
    code |= OCCLUDED if material.occlusion_texture else 0
    return code | (LIGHTMAPPED if material.lightmap_texture else 0)


def _flags(material: Material, model: str, refs: list[TextureRef | None], code: int, colored: bool) -> int:
    flags = {"OPAQUE": 0, "MASK": ALPHA_MASK, "BLEND": ALPHA_BLEND}[material.alpha_mode]
    flags |= DOUBLE_SIDED if material.double_sided else 0
    flags |= NEEDS_COLOR if colored else 0
    for ref in refs:
        flags |= 0 if ref is None else NEEDS_UV1 if ref.texcoord else NEEDS_UV0
    if model == "gouraud":
        flags |= GOURAUD | NEEDS_COLOR
    if code & MODEL_MASK != MODEL_UNLIT:
        flags |= NEEDS_FACE if model == "flat" else NEEDS_NORMAL
        flags |= NEEDS_TANGENT if material.normal_texture and model != "flat" else 0
        flags |= NEEDS_VIEW if code & MODEL_MASK != MODEL_LAMBERT else 0
    return flags
