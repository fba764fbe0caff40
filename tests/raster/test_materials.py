from dataclasses import replace

import numpy as np
import pytest

from luxel.errors import InputError
from luxel.raster import materials
from luxel.raster.materials import (
    ALPHA_BLEND,
    ALPHA_MASK,
    CODE,
    CUTOFF,
    DOUBLE_SIDED,
    EMISSIVE,
    EMIT,
    GOURAUD,
    METAL,
    MODEL_LAMBERT,
    MODEL_MASK,
    MODEL_PBR,
    MODEL_PHONG,
    MODEL_UNLIT,
    NEEDS_COLOR,
    NEEDS_FACE,
    NEEDS_NORMAL,
    NEEDS_TANGENT,
    NEEDS_UV0,
    NEEDS_UV1,
    NEEDS_VIEW,
    NORMAL_SLOT,
    pack_materials,
)  # fmt: skip
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

TEXTURE = Texture(np.full((4, 4, 3), 128, np.uint8))
LIT = NEEDS_NORMAL | NEEDS_VIEW


def flags_of(material, shading=None):
    return int(pack_materials(Scene(materials=[material], textures=[TEXTURE] * 6), shading).flags[0])


@pytest.mark.parametrize(
    ("material", "shading", "flags"),
    [
        (Material(), None, LIT),
        (Material(), "pbr", LIT),
        (Material(), "flat", NEEDS_FACE | NEEDS_VIEW),
        (Material(), "unlit", 0),
        (Material(), "gouraud", GOURAUD | NEEDS_COLOR),
        (Material(specular=(0, 0, 0)), None, NEEDS_NORMAL),
        (Material(alpha_mode="MASK", double_sided=True), None, LIT | ALPHA_MASK | DOUBLE_SIDED),
        (Material(alpha_mode="BLEND", shading="unlit"), None, ALPHA_BLEND),
        (Material(base_color_texture=TextureRef(0)), None, LIT | NEEDS_UV0),
        (Material(lightmap_texture=TextureRef(0, 1)), None, LIT | NEEDS_UV1),
        (Material(lightmap_texture=TextureRef(0, 1)), "unlit", 0),
        (Material(normal_texture=TextureRef(2)), None, LIT | NEEDS_UV0 | NEEDS_TANGENT),
        (Material(base_color_texture=TextureRef(0, 1), shading="unlit"), None, NEEDS_UV1),
    ],
)
def test_materials_say_what_they_need(material, shading, flags):
    assert flags_of(material, shading) == flags


def test_models():
    for material, shading, code in (
        (Material(), None, MODEL_PHONG),
        (Material(shading="pbr"), None, MODEL_PBR),
        (Material(shading="pbr"), "phong", MODEL_PHONG),
        (Material(specular=(0, 0, 0)), "flat", MODEL_LAMBERT),
        (Material(emissive=(0, 1, 0)), "unlit", MODEL_UNLIT),
        (Material(emissive=(0, 1, 0)), None, MODEL_PHONG | EMISSIVE),
    ):
        assert pack_materials(Scene(materials=[material]), shading).ints[0, CODE] == code


def test_the_last_row_is_the_default_material():
    table = pack_materials(Scene(materials=[Material(base_color=(1, 0, 0, 1))]))
    assert table.floats.shape[0] == table.ints.shape[0] == len(table.flags) == 2
    assert np.allclose(table.floats[-1, :4], Material().base_color)
    assert table.floats[0, CUTOFF] == 0.5


def test_features_are_those_of_the_materials_in_use():
    triangle = np.zeros((3, 3)), np.zeros((1, 3), np.int32)
    plain, colored = Mesh(*triangle), Mesh(*triangle, colors=np.ones((3, 4)), material=1)
    materials = [Material(normal_texture=TextureRef(0)), Material(double_sided=True)]
    assert pack_materials(Scene(meshes=[plain], materials=materials, textures=[TEXTURE])).features == LIT
    both = pack_materials(Scene(meshes=[plain, colored], materials=materials, textures=[TEXTURE]))
    assert both.features == LIT | NEEDS_COLOR | DOUBLE_SIDED
    assert both.flags[1] & NEEDS_COLOR
    assert not both.flags[2] & NEEDS_COLOR
    assert pack_materials(Scene()).features == 0


def test_textures_that_nobody_names_take_no_room():
    scene = Scene(materials=[Material(base_color_texture=TextureRef(1))], textures=[TEXTURE, TEXTURE, TEXTURE])
    table = pack_materials(scene)
    assert len(table.texels) == 16 + 4 + 1
    assert len(table.radiance) == 0


def test_the_vertices_of_gouraud_materials_are_lit_without_textures():
    material = Material(base_color=(0.5, 0.6, 0.7, 0.8), base_color_texture=TextureRef(0), normal_texture=TextureRef(0))
    scene = Scene(materials=[material], textures=[TEXTURE])
    vertices, fragments = pack_materials(scene, "gouraud", vertices=True), pack_materials(scene, "gouraud")
    assert vertices.flags[0] == LIT | ALPHA_BLEND  # alpha is kept, for the fragments to judge
    assert np.allclose(vertices.floats[0, :4], material.base_color)
    assert len(vertices.texels) == 0
    assert fragments.ints[0, CODE] & MODEL_MASK == MODEL_UNLIT
    assert (fragments.floats[0, :4] == 1).all()
    assert fragments.flags[0] == GOURAUD | NEEDS_COLOR | NEEDS_UV0


def test_metal_and_lamps_that_only_a_texture_knows_are_paint_at_the_vertices():
    plain = Material(metallic=1.0, emissive=(1, 1, 1))
    textured = replace(plain, metallic_roughness_texture=TextureRef(0), emissive_texture=TextureRef(0))
    table = pack_materials(Scene(materials=[textured, plain], textures=[TEXTURE]), "gouraud", vertices=True)
    assert table.floats[:2, METAL].tolist() == [0, 1]
    assert table.floats[:2, EMIT].tolist() == [0, 1]
    assert (table.ints[:2, CODE] & EMISSIVE).tolist() == [0, EMISSIVE]


def test_flat_shading_has_no_normal_map():
    """It has no tangents to bend its normals by."""
    image = np.zeros((2, 2, 3), np.uint8)
    scene = Scene(materials=[Material(normal_texture=TextureRef(0), base_color_texture=TextureRef(0))], textures=[Texture(image)])
    column = materials.TEXTURE + NORMAL_SLOT
    assert pack_materials(scene, "flat").ints[0, column] == -1
    assert pack_materials(scene, "phong").ints[0, column] == 0


def test_unknown_shading_is_refused():
    with pytest.raises(InputError, match="expected one of flat, gouraud, phong, pbr, unlit, hardware; got 'shiny'"):
        pack_materials(Scene(), "shiny")
