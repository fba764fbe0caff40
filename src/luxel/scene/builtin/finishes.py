"""The materials of the room, and their textures."""

from __future__ import annotations

from typing import Any

from luxel.scene.builtin import textures as t
from luxel.scene.colour import linear_from_srgb
from luxel.scene.material import Material, Texture, TextureRef

Rgb = tuple[int, int, int]


def finishes(floor: tuple[float, float], footprints: list[tuple[float, float, float, float, float]]) -> tuple[dict[str, Material], list[Texture]]:
    """Materials by name, and the textures that they use.

    Args:
        floor: Metres of the floor along x and z.
        footprints: Of the furniture, as `textures.contact` takes them: they darken the floor.
    """
    made = _Finishes()
    _walls(made, floor, footprints)
    _woods(made)
    _cloths(made)
    _things(made)
    return made.materials, made.textures


class _Finishes:
    def __init__(self) -> None:
        self.materials: dict[str, Material] = {}
        self.textures: list[Texture] = []

    def texture(self, name: str, image: Any, srgb: bool = True, scale: tuple[float, float] = (1.0, 1.0)) -> TextureRef:
        self.textures.append(Texture(image, srgb, name=name))
        return TextureRef(len(self.textures) - 1, scale=scale)

    def add(self, name: str, color: Rgb = (255, 255, 255), roughness: float = 0.6, alpha: float = 1.0, **rest: Any) -> None:
        """`color` is sRGB, as picked from a picture."""
        red, green, blue = (float(c) for c in linear_from_srgb([c / 255 for c in color]))
        self.materials[name] = Material((red, green, blue, alpha), roughness=roughness, shading="pbr", name=name, **rest)


def _walls(made: _Finishes, floor: tuple[float, float], footprints: list[tuple[float, float, float, float, float]]) -> None:
    color, groove = t.planks()
    repeats = (floor[0] / 2.4, floor[1] / 0.85)
    made.add(
        "floor",
        roughness=0.5,
        base_color_texture=made.texture("planks", color, scale=repeats),
        normal_texture=made.texture("plank joints", t.normal_map(groove, 1.2), srgb=False, scale=repeats),
        occlusion_texture=made.texture("floor occlusion", t.contact((200, 240), floor, footprints), srgb=False),
    )
    corners = made.texture("corners", t.corners(), srgb=False)
    plaster = made.texture("plaster", t.normal_map(t.noise((256, 256), (24, 24), 31, 3), 2.0), srgb=False, scale=(5, 2.4))
    for name, wall in (("wall", (236, 228, 214)), ("accent wall", (108, 134, 130)), ("ceiling", (246, 243, 236))):
        made.add(name, wall, 0.92, occlusion_texture=corners, normal_texture=plaster, normal_scale=0.25)
    made.add("white paint", (240, 237, 230), 0.4)
    made.add("daylight", (0, 0, 0), 1.0, emissive=(1.0, 1.0, 1.0), emissive_texture=made.texture("sky", t.sky()))


def _woods(made: _Finishes) -> None:
    oak = made.texture("oak", t.wood(256, 1, (150, 106, 66), (202, 160, 112)))
    walnut = made.texture("walnut", t.wood(256, 2, (74, 46, 30), (124, 84, 54)))
    made.add("shelf wood", roughness=0.5, base_color_texture=walnut)
    made.add("table wood", roughness=0.3, base_color_texture=oak)
    made.add("dark wood", (92, 60, 38), 0.35)


def _cloths(made: _Finishes) -> None:
    height = t.weave()
    threads = made.texture("threads", t.normal_map(height, 2.5), srgb=False)
    for name, color in (
        ("sofa", (196, 186, 170)),
        ("teal", (52, 92, 98)),
        ("mustard", (206, 158, 62)),
        ("terracotta", (184, 96, 70)),
    ):
        made.add(name, roughness=0.95, base_color_texture=made.texture(name, t.cloth(height, color)), normal_texture=threads)
    made.add(
        "gingham",
        roughness=0.95,
        base_color_texture=made.texture("gingham", t.checks(96, ((238, 230, 214), (70, 96, 112)))),
    )
    made.add(
        "wool",
        roughness=1.0,
        base_color_texture=made.texture("wool", t.cloth(height, (226, 214, 194), 8)),
        normal_texture=threads,
    )
    made.add("rug", roughness=1.0, base_color_texture=made.texture("rug", t.rug()))
    made.add("curtain", roughness=0.95, double_sided=True, base_color_texture=made.texture("curtain", t.stripes()))


def _things(made: _Finishes) -> None:
    made.add("brass", (232, 190, 110), 0.28, metallic=1.0)
    made.add("steel", (226, 228, 230), 0.16, metallic=1.0)
    made.add("gilt", (206, 164, 92), 0.4, metallic=0.8)
    made.add("glaze", (64, 108, 126), 0.12)
    made.add("glass", (206, 232, 226), 0.05, alpha=0.13, alpha_mode="BLEND", double_sided=True)
    made.add("shade", (250, 226, 184), 0.9, double_sided=True, emissive=(0.62, 0.4, 0.2))
    made.add("bulb", (252, 244, 220), 0.5, emissive=(6.0, 4.4, 2.8))
    made.add("books", roughness=0.7)
    made.add("painting", roughness=0.55, base_color_texture=made.texture("painting", t.painting()))
    made.add("terracotta pot", (178, 104, 74), 0.8)
    made.add("soil", (58, 42, 32), 1.0)
    made.add("stalk", (86, 116, 62), 0.7)
    leaf = made.texture("leaf", t.leaf())
    made.add("leaf", roughness=0.5, base_color_texture=leaf, alpha_mode="MASK", double_sided=True)
    made.add("twig", (104, 76, 56), 0.8)
    made.add("blossom", (240, 196, 196), 0.7)
    made.add("orange", (236, 140, 44), 0.45)
    made.add("lemon", (240, 208, 72), 0.4)
    made.add("apple", (190, 50, 44), 0.25)
    made.add("green apple", (150, 178, 70), 0.25)
