"""What can be drawn of materials, textures and lights: they are plain data, changed at will, and looked at before they are used."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from math import inf, isfinite
from typing import Any

import numpy as np

from luxel.errors import InputError
from luxel.scene.light import Ambient, Light
from luxel.scene.material import Material, Texture, TextureRef

_FACTORS = ("metallic", "roughness", "normal_scale", "occlusion_strength", "alpha_cutoff", "lightmap_scale")
_SLOTS = tuple(name for name in Material.__dataclass_fields__ if name.endswith("_texture"))


def number(value: Any, where: str, above: float = -inf) -> None:
    """InputError unless `value` is a finite number above a bound."""
    try:
        good = isfinite(value) and value > above
    except TypeError:
        good = False
    if not good:
        bound = f" above {above:g}" if above > -inf else ""
        raise InputError(f"{where}: expected a finite number{bound}, got {value!r}")


def numbers(value: Any, count: int, where: str) -> None:
    """InputError unless `value` is a sequence of so many finite numbers."""
    try:
        good = len(value) == count and all(map(isfinite, value))
    except TypeError:
        good = False
    if not good:
        raise InputError(f"{where}: expected {count} finite numbers, got {value!r}")


def name(value: Any, allowed: Collection[Any], where: str) -> None:
    """InputError unless `value` is one of those allowed."""
    if not isinstance(value, str) or value not in allowed:
        raise InputError(f"{where}: expected one of {', '.join(allowed)}, got {value!r}")


def kind(items: Iterable[Any], wanted: type, where: str) -> None:
    """InputError unless all `items` are of a class."""
    for i, item in enumerate(items):
        if not isinstance(item, wanted):
            raise InputError(f"{where} {i}: expected a {wanted.__name__}, got {type(item).__name__}")


def check_materials(materials: list[Material], textures: list[Texture]) -> None:
    """InputError where one has a value that cannot be drawn with, or names a texture that is not there."""
    kind(materials, Material, "material")
    kind(textures, Texture, "texture")
    for i, material in enumerate(materials):
        where = f"material {i}"
        numbers(material.base_color, 4, f"{where}, base_color")
        numbers(material.emissive, 3, f"{where}, emissive")
        if material.specular is not None:
            numbers(material.specular, 3, f"{where}, specular")
        if material.shininess is not None:
            number(material.shininess, f"{where}, shininess")
        for factor in _FACTORS:
            number(getattr(material, factor), f"{where}, {factor}")
        name(material.alpha_mode, ("OPAQUE", "MASK", "BLEND"), f"{where}, alpha_mode")
        if material.shading is not None:
            name(material.shading, ("flat", "gouraud", "phong", "pbr", "unlit"), f"{where}, shading")
        for slot in _SLOTS:
            ref = getattr(material, slot)
            if ref is not None:
                _check_ref(ref, len(textures), f"{where}, {slot}")
    for i, texture in enumerate(textures):
        if not isinstance(texture.wrap, (tuple, list)) or len(texture.wrap) != 2:
            raise InputError(f"texture {i}, wrap: expected a pair, along u and along v, got {texture.wrap!r}")
        for wrap in texture.wrap:
            name(wrap, ("repeat", "clamp", "mirror"), f"texture {i}, wrap")
        name(texture.filter, ("nearest", "bilinear", "trilinear"), f"texture {i}, filter")


def check_lights(lights: list[Light], ambient: Ambient | None) -> None:
    """InputError where one has a value that cannot be drawn with."""
    kind(lights, Light, "light")
    kind([] if ambient is None else [ambient], Ambient, "ambient")
    for i, light in enumerate(lights):
        where = f"light {i}"
        name(light.kind, ("point", "spot", "directional"), f"{where}, kind")
        numbers(light.color, 3, f"{where}, color")
        number(light.intensity, f"{where}, intensity")
        if light.range != inf:
            number(light.range, f"{where}, range", above=0)
        number(light.inner_cone, f"{where}, inner_cone")
        number(light.outer_cone, f"{where}, outer_cone")
        if not np.isfinite(light.world_from_light).all():  # type: ignore[arg-type]
            raise InputError(f"{where}, world_from_light: expected finite numbers")
    if ambient is not None:
        numbers(ambient.sky, 3, "ambient, sky")
        numbers(ambient.ground, 3, "ambient, ground")


def _check_ref(ref: Any, count: int, where: str) -> None:
    kind([ref], TextureRef, where)
    if not isinstance(ref.texture, (int, np.integer)) or not 0 <= ref.texture < count:
        what = repr(ref.texture) if isinstance(ref.texture, (int, np.integer)) else type(ref.texture).__name__
        raise InputError(f"{where}: expected the number of one of the scene's {count} textures, got {what}")
    if ref.texcoord not in (0, 1):
        raise InputError(f"{where}, texcoord: expected 0 or 1, got {ref.texcoord!r}")
    numbers(ref.offset, 2, f"{where}, offset")
    numbers(ref.scale, 2, f"{where}, scale")
    number(ref.rotation, f"{where}, rotation")
