import numpy as np
import pytest
from fragments import batch, evaluate, hemisphere, rgb, row, shade, unit

from luxel import jit
from luxel.raster import channels as c
from luxel.raster.materials import LIGHTMAPPED, MODEL_MASK, MODEL_PBR, MODEL_PHONG, pack_materials
from luxel.raster.surface import mask_alpha
from luxel.scene.light import Ambient, Light
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene


def flat_texture(*code, **rest):
    return Texture(np.full((2, 2, len(code)), code, np.uint8), **{"srgb": False} | rest)


def surface_of(material, textures=(), shading=None, colored=False, **rows):
    mesh = Mesh(np.zeros((1, 3)), np.zeros((0, 3), np.int32), colors=np.ones((1, 4)) if colored else None, material=0)
    scene = Scene(meshes=[mesh], materials=[material], textures=list(textures))
    g, n = batch(**rows)
    evaluate(g, np.zeros(c.FRAGMENTS, np.int32), n, pack_materials(scene, shading))
    return g, n


def test_normals_become_unit_and_turn_on_back_faces():
    normals = 3 * hemisphere(5)
    g, n = surface_of(Material(), normal=normals, FRONT=[1, -1, 1, -1, 1])
    assert np.allclose(rgb(g, n, c.NX), unit(normals) * [[1], [-1], [1], [-1], [1]], atol=1e-6)


def test_flat_shading_takes_the_face_normal():
    g, n = surface_of(Material(), shading="flat", normal=hemisphere(2), face=[(0, 5, 0), (0, 0, -2)], FRONT=[1, -1])
    assert np.allclose(rgb(g, n, c.NX), [(0, 1, 0), (0, 0, 1)])


def test_base_colour_is_factor_times_vertex_colour_times_texture():
    material = Material(base_color=(0.5, 0.25, 1, 0.5), base_color_texture=TextureRef(0), shading="unlit", alpha_mode="BLEND")
    g, n = surface_of(material, [flat_texture(51, 102, 153, 204)], colored=True, CR=[0.5], CG=[1], CB=[2], CA=[0.5])
    assert np.allclose(rgb(g, n, c.CR)[0], np.array([0.2, 0.4, 0.6]) * (0.25, 0.25, 2), atol=1e-6)
    assert np.allclose(row(g, n, c.CA), 0.8 * 0.25)


def test_metal_and_roughness_come_from_blue_and_green():
    material = Material(base_color=(0.8, 0.6, 0.4, 1), metallic=0.5, roughness=0.9, metallic_roughness_texture=TextureRef(0), shading="pbr")
    g, n = surface_of(material, [flat_texture(0, 51, 102)])
    metallic = 0.5 * 0.4
    assert np.allclose(row(g, n, c.ROUGHNESS), 0.9 * 0.2)
    assert np.allclose(rgb(g, n, c.SPR)[0], 0.04 * (1 - metallic) + metallic * np.array([0.8, 0.6, 0.4]), atol=1e-6)
    assert np.allclose(rgb(g, n, c.CR)[0], (1 - metallic) * np.array([0.8, 0.6, 0.4]), atol=1e-6)
    assert int(g[c.MODEL]) == MODEL_PBR


def test_phong_and_pbr_translate_into_each_other():
    g, n = surface_of(Material(roughness=0.5), shading="phong")
    assert np.allclose(row(g, n, c.SHININESS), 2 / 0.5**4 - 2)
    assert np.allclose(rgb(g, n, c.SPR), 0.04)
    g, n = surface_of(Material(specular=(0.5, 0.4, 0.3), shininess=30), shading="phong")
    assert np.allclose(rgb(g, n, c.SPR), (0.5, 0.4, 0.3))
    assert np.allclose(row(g, n, c.SHININESS), 30)
    g, n = surface_of(Material(specular=(0.5, 0.4, 0.3), shininess=30), shading="pbr")
    assert np.allclose(row(g, n, c.ROUGHNESS), (2 / 32) ** 0.25)
    g, n = surface_of(Material(shininess=30), shading="phong")
    assert np.allclose(row(g, n, c.SHININESS), 30, rtol=1e-5)
    assert int(g[c.MODEL]) == MODEL_PHONG


def test_half_a_metal_is_diffuse_in_phong():
    g, n = surface_of(Material(base_color=(0.8, 0.6, 0.4, 1), metallic=1.0), shading="phong")
    assert np.allclose(rgb(g, n, c.CR), (0.4, 0.3, 0.2))
    assert np.allclose(rgb(g, n, c.SPR), (0.42, 0.32, 0.22))


def test_smoothness_is_limited_also_from_a_texture():
    material = Material(roughness=1, metallic_roughness_texture=TextureRef(0), shading="pbr")
    g, n = surface_of(material, [flat_texture(0, 0, 0)])
    assert np.allclose(row(g, n, c.ROUGHNESS), 0.045)
    g, n = surface_of(Material(roughness=0), shading="pbr")
    assert np.allclose(row(g, n, c.ROUGHNESS), 0.045)


# A pixel to the right is +x on the surface, a pixel down is -y; u grows to the right, v downwards.
FACING = {"dx": [(0.01, 0, 0)], "dy": [(0, -0.01, 0)], "U0X": [0.1], "V0Y": [0.1]}
TILTED = (178, 204, 229)  # towards +X and +Y of the map: right and up


def expected_tilt(strength=1.0):
    x, y, z = 2 * np.array(TILTED) / 255 - 1
    return unit((x * strength, y * strength, z))


def test_a_normal_map_tilts_right_and_up_without_tangents():
    material = Material(normal_texture=TextureRef(0))
    g, n = surface_of(material, [flat_texture(*TILTED)], **FACING)
    assert np.allclose(rgb(g, n, c.NX)[0], expected_tilt(), atol=1e-6)


def test_a_normal_map_follows_mirrored_and_turned_coordinates():
    material, textures = Material(normal_texture=TextureRef(0)), [flat_texture(*TILTED)]
    x, y, z = expected_tilt()
    mirrored = FACING | {"U0X": [-0.1]}
    assert np.allclose(rgb(*surface_of(material, textures, **mirrored), c.NX)[0], (-x, y, z), atol=1e-6)
    turned = {"dx": FACING["dx"], "dy": FACING["dy"], "U0Y": [0.1], "V0X": [-0.1]}  # u grows downwards, v to the left
    assert np.allclose(rgb(*surface_of(material, textures, **turned), c.NX)[0], (y, -x, z), atol=1e-6)


def test_a_normal_map_with_tangents_is_the_same_as_without():
    material, textures = Material(normal_texture=TextureRef(0), normal_scale=0.5), [flat_texture(*TILTED)]
    for frame in ({"TX": [1], "TW": [1]}, FACING):
        assert np.allclose(rgb(*surface_of(material, textures, **frame), c.NX)[0], expected_tilt(0.5), atol=1e-6)
    x, y, z = expected_tilt(0.5)
    mirrored = {"TX": [-1], "TW": [-1]}
    assert np.allclose(rgb(*surface_of(material, textures, **mirrored), c.NX)[0], (-x, y, z), atol=1e-6)


def test_a_bump_seen_from_behind_is_a_dent():
    # From behind, a pixel to the right is -x; the interpolated normal still points to the front, away from the eye.
    material, textures = Material(normal_texture=TextureRef(0)), [flat_texture(*TILTED)]
    behind = {"dx": [(-0.01, 0, 0)], "dy": [(0, -0.01, 0)], "U0X": [-0.1], "V0Y": [0.1], "FRONT": [-1]}
    assert np.allclose(rgb(*surface_of(material, textures, **behind), c.NX)[0], -expected_tilt(), atol=1e-6)
    with_tangents = behind | {"TX": [1], "TW": [1]}
    assert np.allclose(rgb(*surface_of(material, textures, **with_tangents), c.NX)[0], -expected_tilt(), atol=1e-6)


@pytest.mark.parametrize("side", [1, -1])
def test_a_normal_map_is_steady_up_to_normals_that_lie_in_the_surface(side):
    # Interpolated normals turn away from the triangle at silhouettes of coarse meshes, at the limit by a right angle, from the front or behind.
    material, textures = Material(normal_texture=TextureRef(0)), [flat_texture(*TILTED)]
    seen = {"dx": [(0.01 * side, 0, 0)], "dy": [(0, -0.01, 0)], "U0X": [0.1 * side], "V0Y": [0.1], "FRONT": [side]}
    limit, near = (rgb(*surface_of(material, textures, **seen, normal=[(0.8, 0.6, z)]), c.NX)[0] for z in (0, 1e-4))
    assert np.allclose(limit, near, atol=1e-3)


def test_a_normal_map_without_coordinates_leaves_the_normal():
    g, n = surface_of(Material(normal_texture=TextureRef(0)), [flat_texture(*TILTED)], dx=[(0, 0, 0)], dy=[(0, 0, 0)])
    assert np.allclose(rgb(g, n, c.NX)[0], (0, 0, 1))


def test_occlusion_dims_ambient_light_only():
    material = Material(base_color=(1, 1, 1, 1), specular=(0, 0, 0), occlusion_texture=TextureRef(0), occlusion_strength=0.5)
    textures, white = [flat_texture(51, 0, 0)], Ambient((1, 1, 1), (1, 1, 1))
    light = Light()  # shines along -z, on the normal
    assert np.allclose(shade([material], ambient=white, textures=textures)[0, :3], 1 - 0.5 * 0.8, atol=1e-6)
    assert np.allclose(shade([material], [light], textures=textures)[0, :3], 1, atol=1e-6)
    bright = shade([material], [light], white, "pbr", textures=textures) - shade([material], [light], shading="pbr", textures=textures)
    assert np.allclose(bright[0, :3], 0.6, atol=1e-5)


def test_emission_is_factor_times_texture():
    material = Material(base_color=(0, 0, 0, 1), specular=(0, 0, 0), emissive=(2, 1, 0.5), emissive_texture=TextureRef(0))
    assert np.allclose(shade([material], textures=[flat_texture(51, 102, 255)])[0, :3], (0.4, 0.4, 0.5), atol=1e-6)


@pytest.mark.parametrize("shading", ["flat", "phong", "pbr"])
def test_a_lightmap_takes_the_place_of_diffuse_light(shading):
    stored = Texture(np.array([[[1.0, 2.0, 3.0]], [[5.0, 5.0, 5.0]]], np.float32), filter="nearest")
    albedo = np.array([0.5, 0.4, 0.3])
    material = Material(base_color=(*albedo, 1), roughness=1, lightmap_texture=TextureRef(0, texcoord=1), lightmap_scale=2)
    matt = Material(base_color=(*albedo, 1), specular=(0, 0, 0), lightmap_texture=TextureRef(0, texcoord=1), lightmap_scale=2)
    rows = {"U1": [0.5], "V1": [0.25], "U0": [np.nan], "V0": [np.nan], "face": [(0, 0, 1)]}
    dark = shade([material], shading=shading, textures=[stored], **rows)[0, :3]
    assert np.allclose(dark, albedo * [2, 4, 6] / np.pi, atol=1e-6)
    if shading != "pbr":
        lit = shade([matt], [Light()], Ambient((1, 1, 1), (1, 1, 1)), shading, [stored], **rows)[0, :3]
        assert np.array_equal(lit, dark)
    highlight = shade([material], [Light()], None, shading, [stored], **rows)[0, :3] - dark
    bare = Material(base_color=(0, 0, 0, 1), roughness=1)
    assert np.allclose(highlight, shade([bare], [Light()], shading=shading, face=[(0, 0, 1)])[0, :3], atol=1e-6)


def test_second_coordinates_and_transform_reach_the_texture():
    image = np.arange(16, dtype=np.uint8).reshape(4, 4, 1) * 10
    ref = TextureRef(0, texcoord=1, offset=(0.25, 0.5), scale=(0.5, 0.5))
    material = Material(base_color=(1, 1, 1, 1), base_color_texture=ref, shading="unlit")
    texture = Texture(image, srgb=False, filter="nearest")
    g, n = surface_of(material, [texture], U1=[0.3, 0.9], V1=[0.1, 0.9], U0=[0], V0=[0])
    assert np.allclose(row(g, n, c.CR) * 255, [10 * (4 * 2 + 1), 10 * (4 * 3 + 2)], atol=1e-3)


def test_runs_of_materials_are_each_evaluated():
    materials = [Material(base_color=(k / 10, 0, 0, 1), shading="unlit") for k in range(5)]
    index = np.sort(np.random.default_rng(0).integers(-1, 5, c.FRAGMENTS)).astype(np.int32)
    for order in (index, index[::-1].copy(), np.random.default_rng(1).permutation(index)):
        g, n = batch(U0=np.zeros(c.FRAGMENTS))
        evaluate(g, order, n, pack_materials(Scene(materials=materials)))
        assert np.allclose(row(g, n, c.CR), np.where(order < 0, 0.8, order / 10))


def test_an_empty_batch_touches_nothing():
    g, _ = batch()
    before = g.copy()
    evaluate(g, np.zeros(c.FRAGMENTS, np.int32), 0, pack_materials(Scene()))
    assert np.array_equal(g, before, equal_nan=True)


@jit.kernel
def masks(table, uv, out):
    for i in range(len(uv)):
        out[i] = mask_alpha(table, 0, uv[i, 0], uv[i, 1], uv[i, 0], uv[i, 1])


def test_alpha_for_coverage_is_that_of_the_texture():
    image = np.zeros((1, 2, 4), np.uint8)
    image[0, :, 3] = 255, 51
    uv, out = np.array([(0.25, 0.5), (0.5, 0.5), (0.75, 0.5)], np.float32), np.zeros(3, np.float32)
    for kind, between in (("trilinear", 0.6), ("nearest", 0.2)):
        material = Material(base_color=(1, 1, 1, 0.5), base_color_texture=TextureRef(0), alpha_mode="MASK")
        masks(pack_materials(Scene(materials=[material], textures=[Texture(image, filter=kind)])), uv, out)
        assert np.allclose(out, np.array([1, between, 0.2]) * 0.5, atol=1e-6)
    masks(pack_materials(Scene(materials=[Material(base_color=(1, 1, 1, 0.3))])), uv, out)
    assert np.allclose(out, 0.3)


def test_the_lightmap_flag_is_only_for_those_who_have_one():
    table = pack_materials(Scene(materials=[Material(lightmap_texture=TextureRef(0)), Material()], textures=[flat_texture(1)]))
    assert (table.ints[:, 0] & LIGHTMAPPED != 0).tolist() == [True, False, False]
    assert (table.ints[:, 0] & MODEL_MASK == MODEL_PHONG).all()


@pytest.mark.parametrize("mode", ["OPAQUE", "MASK", "BLEND"])
def test_only_blended_materials_are_transparent(mode):
    """OPAQUE ignores alpha, of factor, vertices and texture; what MASK keeps is whole."""
    material = Material(base_color=(1, 1, 1, 0.5), base_color_texture=TextureRef(0), alpha_mode=mode)
    g, n = surface_of(material, [flat_texture(255, 255, 255, 51)], colored=True, CA=[0.5])
    assert np.allclose(row(g, n, c.CA), 0.05 if mode == "BLEND" else 1)
