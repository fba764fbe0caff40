"""Material and texture: glTF's metallic-roughness model, with what OBJ's MTL adds to it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError

Shading = Literal["flat", "gouraud", "phong", "pbr", "unlit"]
AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]
Wrap = Literal["repeat", "clamp", "mirror"]
Filter = Literal["nearest", "bilinear", "trilinear"]


@dataclass(eq=False)
class Texture:
    """A picture and how to sample it.

    Attributes:
        image: (h, w, 1..4) uint8, or float32 for light of any range; row 0 is at the top (texture coordinate v = 0).
        srgb: The colour channels of a uint8 picture are sRGB-encoded (base colour, emissive); False for data.
        wrap: How coordinates outside 0..1 are taken, along u and along v.
        filter: Sampling; "trilinear" makes and uses mipmaps.
        name: As in the file; may be empty.

    Raises:
        InputError: The image has another shape, or no numbers.
    """

    image: Array
    srgb: bool = True
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    filter: Filter = "trilinear"
    name: str = ""

    def __post_init__(self) -> None:
        image = np.asarray(self.image)
        if image.ndim == 2:
            image = image[..., None]
        if image.ndim != 3 or not 1 <= image.shape[2] <= 4 or 0 in image.shape:
            raise InputError(f"texture {self.name!r}: expected (h, w, 1..4), got {image.shape}")
        if image.dtype != np.uint8:
            if image.dtype.kind not in "fiu":
                raise InputError(f"texture {self.name!r}: expected uint8 or float32, got {image.dtype}")
            image = image.astype(np.float32)
        self.image = np.ascontiguousarray(image)


@dataclass(eq=False)
class TextureRef:
    """Where a material takes a texture from.

    Attributes:
        texture: Index into the scene's textures.
        texcoord: 0 or 1: which texture coordinates of the mesh.
        offset, rotation, scale: KHR_texture_transform, in texture coordinates and radians.
    """

    texture: int
    texcoord: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)


@dataclass(eq=False)
class Material:
    """How a surface answers light. Colours are linear.

    Attributes:
        base_color: RGBA factor.
        metallic, roughness: 0..1.
        emissive: RGB, already multiplied by KHR_materials_emissive_strength.
        specular, shininess: Of Blinn-Phong: RGB factor and exponent (MTL's Ks and Ns). None: derived from roughness and metallic.
        normal_scale, occlusion_strength: glTF's factors of the two textures.
        alpha_mode, alpha_cutoff: OPAQUE ignores alpha, MASK keeps alpha >= cutoff, BLEND composites.
        double_sided: Back faces are drawn, and lit with the turned normal.
        shading: The model this material asks for; None leaves it to the renderer ("pbr" for glTF, else "phong").
        *_texture: Base colour (RGBA, sRGB), metallic-roughness (G roughness, B metallic), normal, occlusion (R), emissive (sRGB),
            lightmap (irradiance E in W/m2, linear; the surface then shows albedo * E / pi in place of the lights' diffuse).
        lightmap_scale: Multiplies the stored lightmap to give E.
        name: As in the file; may be empty.
    """

    base_color: tuple[float, float, float, float] = (0.8, 0.8, 0.8, 1.0)
    metallic: float = 0.0
    roughness: float = 0.6
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    specular: tuple[float, float, float] | None = None
    shininess: float | None = None
    normal_scale: float = 1.0
    occlusion_strength: float = 1.0
    alpha_mode: AlphaMode = "OPAQUE"
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    shading: Shading | None = None
    base_color_texture: TextureRef | None = None
    metallic_roughness_texture: TextureRef | None = None
    normal_texture: TextureRef | None = None
    occlusion_texture: TextureRef | None = None
    emissive_texture: TextureRef | None = None
    lightmap_texture: TextureRef | None = None
    lightmap_scale: float = 1.0
    name: str = field(default="")
