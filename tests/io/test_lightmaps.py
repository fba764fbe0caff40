"""Lightmaps in glTF: as luxel reads them back, and as others find them in the file."""

import io
import json

import numpy as np
import pygltflib
import pytest
from PIL import Image

import luxel.io
from luxel.errors import LuxelWarning
from luxel.io.gltf import write
from luxel.io.images import decode_image
from luxel.scene import Material, Mesh, Scene, Texture, TextureRef


def lit_scene(image, scale=2.0) -> Scene:
    scene = Scene(textures=[Texture(image, False, ("clamp", "clamp"), "bilinear", "light")])
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    for name in ("one", "two"):
        light = TextureRef(0, texcoord=1)
        material = Material(lightmap_texture=light, lightmap_scale=scale, shading="pbr", name=name)
        scene.add(Mesh(corners, [[0, 1, 2]], texcoords1=corners[:, :2]), material)
    return scene


@pytest.fixture
def light():
    return np.exp2(np.random.default_rng(3).uniform(-6, 6, (12, 20, 3))).astype(np.float32)


@pytest.mark.parametrize("extension", ["glb", "gltf"])
def test_moz_lightmaps_are_radiance_pictures_with_a_png(tmp_path, light, extension):
    path = tmp_path / f"x.{extension}"
    write.save(lit_scene(light), path, "moz")
    back = luxel.io.load(path)
    assert len(back.textures) == 1
    material = back.materials[1]
    shown = back.textures[material.lightmap_texture.texture].image * material.lightmap_scale
    assert (np.abs(shown - 2 * light) <= 2 * light.max(-1, keepdims=True) / 256).all()

    gltf = pygltflib.GLTF2.load(str(path))
    assert {"MOZ_lightmap", "MOZ_texture_rgbe"} <= set(gltf.extensionsUsed)
    assert not gltf.extensionsRequired
    info = gltf.materials[0].extensions["MOZ_lightmap"]
    assert info == gltf.materials[1].extensions["MOZ_lightmap"]
    texture = gltf.textures[info["index"]]
    plain, whole = (gltf.images[i] for i in (texture.source, texture.extensions["MOZ_texture_rgbe"]["source"]))
    assert (plain.mimeType, whole.mimeType, info["texCoord"]) == ("image/png", "image/vnd.radiance", 1)
    png = np.asarray(Image.open(io.BytesIO(data_of(gltf, plain, tmp_path)))) / 255 * info["intensity"]
    assert np.abs(png - np.minimum(2 * light, info["intensity"])).max() <= info["intensity"] / 255
    if extension == "gltf":
        assert sorted(p.name for p in tmp_path.iterdir()) == ["x.bin", "x.gltf", "x_lightmap_0.hdr", "x_lightmap_0.png"]


def data_of(gltf, image, folder) -> bytes:
    if image.uri:
        return (folder / image.uri).read_bytes()
    view = gltf.bufferViews[image.bufferView]
    return gltf.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]


def test_few_bright_spots_do_not_take_the_steps_of_the_png(tmp_path):
    light = np.full((20, 20, 3), 0.5, np.float32)
    light[0, 0] = 1000
    write.save(lit_scene(light, 1.0), tmp_path / "x.glb", "moz")
    gltf = pygltflib.GLTF2.load(str(tmp_path / "x.glb"))
    assert gltf.materials[0].extensions["MOZ_lightmap"]["intensity"] == 1.0
    assert luxel.io.load(tmp_path / "x.glb").textures[0].image.max() == pytest.approx(1000, rel=1 / 256)


def test_a_dark_lightmap_is_no_fault(tmp_path):
    write.save(lit_scene(np.zeros((8, 8, 3), np.float32)), tmp_path / "x.glb", "moz")
    assert not luxel.io.load(tmp_path / "x.glb").textures[0].image.any()


@pytest.mark.parametrize("extension", ["glb", "gltf"])
def test_side_cars_are_exact_and_say_their_unit(tmp_path, light, extension):
    OpenEXR = pytest.importorskip("OpenEXR")
    write.save(lit_scene(light), tmp_path / f"x.{extension}", "sidecar")
    back = luxel.io.load(tmp_path / f"x.{extension}")
    material = back.materials[1]
    texture = back.textures[material.lightmap_texture.texture]
    assert np.array_equal(texture.image, light)
    assert (material.lightmap_scale, material.lightmap_texture.texcoord, texture.filter, texture.srgb) == (2.0, 1, "bilinear", False)
    with OpenEXR.File(str(tmp_path / "x_lightmap_0.exr"), header_only=True) as file:
        assert (file.header()["quantity"], file.header()["unit"]) == ("irradiance E", "W/m2")
    gltf = pygltflib.GLTF2.load(str(tmp_path / f"x.{extension}"))
    assert not gltf.images
    assert not gltf.extensionsUsed
    assert gltf.materials[0].extras["luxel"]["lightmap"]["unit"] == "W/m2"


def test_a_side_car_that_is_gone_is_said(tmp_path, light):
    pytest.importorskip("OpenEXR")
    write.save(lit_scene(light), tmp_path / "x.glb", "sidecar")
    (tmp_path / "x_lightmap_0.exr").unlink()
    with pytest.warns(LuxelWarning, match="x_lightmap_0.exr.*the lightmap is left out"):
        back = luxel.io.load(tmp_path / "x.glb")
    assert back.materials[0].lightmap_texture is None


def test_colours_above_white_come_back_and_are_no_fault_of_the_file(tmp_path):
    scene = Scene.from_mesh(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), Material((4.0, 2.0, 1.0, 0.5), shading="unlit"))
    luxel.io.save(scene, tmp_path / "x.gltf")
    made = json.loads((tmp_path / "x.gltf").read_text())["materials"][0]
    assert made["pbrMetallicRoughness"]["baseColorFactor"] == [1.0, 0.5, 0.25, 0.5]
    assert luxel.io.load(tmp_path / "x.gltf").materials[0].base_color == (4.0, 2.0, 1.0, 0.5)


def test_the_radiance_picture_is_one(light, tmp_path):
    write.save(lit_scene(light), tmp_path / "x.gltf", "moz")
    data = (tmp_path / "x_lightmap_0.hdr").read_bytes()
    assert data.startswith(b"#?RADIANCE\n")
    assert decode_image(data, "x").shape == light.shape
