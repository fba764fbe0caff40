import io
import json
from dataclasses import replace

import numpy as np
import pygltflib
import pytest
from PIL import Image
from sheets import Sheet, atlas_of

import luxel
from luxel.errors import ExtraMissingError, FileError, InputError, LuxelWarning
from luxel.radiosity.conventions import converted
from luxel.radiosity.lightmap import attach
from luxel.radiosity.output import CONVENTIONS, check_writable, save_baked, save_pages
from luxel.radiosity.shown import shown
from luxel.scene import Ambient, Camera, Light, Material, Texture, TextureRef

RED = Material((0.8, 0.2, 0.1, 1.0), shading="pbr", name="red", roughness=1.0)
LAMP = Material((0.5, 0.5, 0.5, 1.0), shading="pbr", name="lamp", emissive=(20.0, 10.0, 5.0), roughness=1.0)
SHEETS = [
    Sheet((0, 0, 0), (1, 0, 0), (0, 0, 1), (2, 2), (13, 12), 0, RED),
    Sheet((0, 0, 1), (1, 0, 0), (0, 0, 1), (18, 3), (12, 11), 0, replace(RED, base_color=(0.3, 0.9, 0.6, 1.0), name="green")),
    Sheet((1, 0, 0), (1, 0, 0), (0, 0, 1), (3, 17), (12, 13), 1, RED),
    Sheet((1, 0, 1), (1, 0, 0), (0, 0, 1), (18, 17), (12, 12), 1, LAMP),
]
ABOVE = Camera.look_at((1, 4, 1.001), (1, 0, 1), yfov=0.5)


def lit_scene(seed=0, brightest=3.0):
    """Four sheets on two pages under smooth light."""
    rng = np.random.default_rng(seed)
    waves = rng.uniform(0, 0.3, (2, 3, 2))
    y, x = np.mgrid[:32, :32]
    pages = np.stack([np.stack([1 + np.sin(a * x + b * y) for a, b in page], -1) for page in waves]) * (brightest / 2)
    scene = attach(atlas_of(SHEETS), pages.astype(np.float32))
    scene.cameras = [ABOVE]
    return scene


def seen(scene):
    return luxel.render(scene, size=(96, 96), samples=4, outputs=("linear",)).linear


def difference(a, b, lamp=False):
    """Largest, of the sheets that do not shine (or of that one)."""
    corner = np.zeros((96, 96), bool)
    corner[46:, 46:] = True
    return np.abs(seen(a) - seen(b))[corner == lamp].max()


@pytest.mark.parametrize("extension", ["glb", "gltf"])
@pytest.mark.parametrize("convention", CONVENTIONS)
def test_every_convention_comes_back_as_the_same_picture(tmp_path, convention, extension):
    if convention == "sidecar":
        pytest.importorskip("OpenEXR")
    scene = lit_scene()
    files = save_baked(scene, tmp_path / f"x.{extension}", convention, white=25.0 if convention == "unlit" else 1.0)
    assert all(file.is_file() for file in files)
    back = luxel.load(files[0])
    step = {"moz": 0.01, "unlit": 0.02 * 25, "emissive": 0.02, "sidecar": 1e-6}[convention]  # near white, an sRGB code is worth 1 %
    assert difference(back, scene) <= step
    assert difference(back, scene, lamp=True) <= {"moz": 0.01, "unlit": 0.25, "emissive": 0.2, "sidecar": 1e-5}[convention]


def test_unlit_shows_what_is_up_to_white_to_a_code():
    scene = lit_scene()
    scene.instances.pop()  # the lamp
    plain = converted(scene, "unlit")
    assert {m.shading for m in plain.materials} == {"unlit"}
    assert all(t.image.dtype == np.uint8 and t.srgb for t in plain.textures)
    a, b = (luxel.render(s, size=(96, 96), samples=4).color.astype(int) for s in (scene, plain))
    assert np.abs(a - b).max() <= 3
    assert np.abs(a - b).mean() < 0.5


def test_unlit_says_what_it_clips_and_white_holds_it():
    scene = lit_scene(brightest=9.0)
    scene.instances.pop()
    with pytest.warns(LuxelWarning, match=r"unlit: \d+% of the texels are brighter than white, 1 W"):
        converted(scene, "unlit")
    plain = converted(scene, "unlit", white=4.0)
    assert plain.materials[0].base_color == (4.0, 4.0, 4.0, 1.0)
    assert difference(plain, scene) < 0.08


def test_emissive_keeps_the_range_of_each_material():
    made = converted(lit_scene(), "emissive")
    strengths = {material.name: max(material.emissive) for material in made.materials}
    assert strengths["lamp"] > 20
    assert strengths["red"] < 1.5
    assert {material.base_color[:3] for material in made.materials} == {(0.0, 0.0, 0.0)}


def test_pages_show_albedo_times_irradiance_and_what_shines():
    scene = lit_scene()
    page = next(i for i, t in enumerate(scene.textures) if t.name == "lightmap 1")
    found = shown(scene, page)
    light = scene.textures[page].image
    inside = (slice(19, 28), slice(5, 13))
    assert np.allclose(found.radiance[inside], light[inside] * np.float32([0.8, 0.2, 0.1]) / np.pi, rtol=1e-4)
    inside = (slice(19, 27), slice(20, 28))
    assert np.allclose(found.radiance[inside], light[inside] * 0.5 / np.pi + np.float32([20, 10, 5]), rtol=1e-4)
    names = np.array([m.name for m in scene.materials] + [""])
    assert set(names[found.material[17:30, 3:15]].ravel()) == {"red"}
    assert set(names[found.material[17:29, 18:30]].ravel()) == {"lamp"}
    assert found.covered.sum() == 13 * 12 + 12 * 12


def test_textures_and_holes_are_baked_too():
    board = np.full((8, 8, 4), 255, np.uint8)
    board[:4, :, :3], board[:, :4, 3] = 188, 0  # sRGB for a half above, a hole at the left
    material = Material((1, 1, 1, 1), shading="pbr", alpha_mode="MASK", base_color_texture=TextureRef(0), roughness=1)
    atlas = atlas_of([Sheet((0, 0, 0), (2, 0, 0), (0, 0, 2), (0, 0), (32, 32), 0, material)])
    atlas.scene.textures.append(Texture(board, filter="nearest"))
    scene = attach(atlas, np.full((1, 32, 32, 3), np.pi / 2, np.float32))
    scene.cameras = [ABOVE]
    plain = converted(scene, "unlit")
    image = plain.textures[plain.materials[0].base_color_texture.texture].image
    assert plain.materials[0].alpha_mode == "MASK"
    assert np.abs(image[2:14, 18:30, :3].astype(int) - 137).max() <= 1  # a quarter
    assert np.abs(image[18:30, 18:30, :3].astype(int) - 188).max() <= 1
    assert not image[:, 2:14, 3].any()
    assert (image[:, 18:, 3] == 255).all()
    assert np.abs(seen(plain) - seen(scene)).mean() < 0.01


def test_lights_stay_or_go():
    scene = lit_scene()
    scene.lights = [Light("point")]
    assert len(converted(scene, "moz").lights) == 1
    bare = converted(scene, "moz", lights=False)
    assert not bare.lights
    assert vars(bare.ambient) == vars(Ambient())  # so that nobody brings a head light
    assert len(scene.lights) == 1
    assert scene.ambient is None


def test_highlights_stay_in_emissive_files():
    scene = lit_scene()
    for material in scene.materials:
        material.roughness = 0.3
    scene.lights = [Light("point", intensity=30.0, world_from_light=luxel.scene.transforms.translation((0.7, 1.5, 0.7)))]
    assert difference(converted(scene, "emissive"), scene) < 0.03


def test_others_can_read_the_files(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    scene = lit_scene()
    for convention in ("moz", "unlit", "emissive"):
        save_baked(scene, tmp_path / "x.glb", convention, white=25.0)
        loaded = trimesh.load(tmp_path / "x.glb")
        assert len(loaded.geometry) == 4
        assert np.allclose(loaded.bounds, [[0, 0, 0], [2, 0, 2]])
        gltf = pygltflib.GLTF2.load(str(tmp_path / "x.glb"))
        assert not gltf.extensionsRequired
        for material in gltf.materials:
            info = {
                "moz": lambda m: pygltflib.TextureInfo(**{k: m.extensions["MOZ_lightmap"][k] for k in ("index", "texCoord")}),
                "unlit": lambda m: m.pbrMetallicRoughness.baseColorTexture,
                "emissive": lambda m: m.emissiveTexture,
            }[convention](material)
            view = gltf.bufferViews[gltf.images[gltf.textures[info.index].source].bufferView]
            data = gltf.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
            assert info.texCoord == 1
            assert Image.open(io.BytesIO(data)).size == (32, 32)


def test_exr_files_beside_any_convention(tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    scene = lit_scene()
    files = save_baked(scene, tmp_path / "x.gltf", "unlit", exr=True, white=25.0)
    assert [file.name for file in files] == ["x.gltf", "x_lightmap_0.exr", "x_lightmap_1.exr"]
    for file, texture in zip(files[1:], scene.textures, strict=True):
        assert np.array_equal(luxel.io.images.read_image(file), texture.image)
        with OpenEXR.File(str(file), header_only=True) as exr:
            assert exr.header()["unit"] == "W/m2"
    layers = {"sun": np.ones((2, 4, 4, 3), np.float32)}
    for file in save_pages(tmp_path / "y.exr", np.zeros((2, 4, 4, 3), np.float32), layers):
        with OpenEXR.File(str(file), separate_channels=True) as exr:
            assert {"R", "sun.R", "sun.G", "sun.B"} <= set(exr.channels())


def test_lit_files_can_be_converted_again(tmp_path):
    scene = lit_scene()
    save_baked(scene, tmp_path / "a.glb", "moz")
    save_baked(luxel.load(tmp_path / "a.glb"), tmp_path / "b.glb", "emissive")
    assert difference(luxel.load(tmp_path / "b.glb"), scene) < 0.03


@pytest.mark.parametrize(
    ("name", "options", "error", "words"),
    [
        ("x.obj", {}, InputError, r"ends in \.glb or \.gltf"),
        ("x.glb", {"convention": "mozilla"}, InputError, "expected one of moz, unlit, emissive, sidecar, got 'mozilla'"),
        ("x.glb", {"white": 0.0}, InputError, "white"),
        ("none/x.glb", {}, FileError, "x.glb"),
    ],
)
def test_what_cannot_be_written_is_said(tmp_path, name, options, error, words):
    with pytest.raises(error, match=words):
        save_baked(lit_scene(), tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_unlit_scenes_have_nothing_to_save(tmp_path):
    with pytest.raises(InputError, match="without a lightmap"):
        save_baked(atlas_of(SHEETS).scene, tmp_path / "x.glb")


def test_a_failure_leaves_the_old_file(tmp_path, monkeypatch):
    (tmp_path / "x.glb").write_bytes(b"old")
    monkeypatch.setitem(__import__("sys").modules, "OpenEXR", None)
    for options in ({"convention": "sidecar"}, {"exr": True}):
        with pytest.raises(ExtraMissingError, match=r"luxel\[exr\]"):
            save_baked(lit_scene(), tmp_path / "x.glb", **options)
    assert (tmp_path / "x.glb").read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


def test_targets_are_tried_before_the_work(tmp_path):
    check_writable(tmp_path / "x.glb", 1000)
    assert not list(tmp_path.iterdir())
    with pytest.raises(FileError, match="there is no folder"):
        check_writable(tmp_path / "none" / "x.glb")
    with pytest.raises(FileError, match="it is a folder"):
        check_writable(tmp_path)
    with pytest.raises(FileError, match=r"will be needed, and the disk has [\d,]+ MB left"):
        check_writable(tmp_path / "x.glb", 1 << 60)


def test_extras_of_a_side_car_are_for_people_too(tmp_path):
    pytest.importorskip("OpenEXR")
    save_baked(lit_scene(), tmp_path / "x.gltf", "sidecar")
    said = json.loads((tmp_path / "x.gltf").read_text())["materials"][0]["extras"]["luxel"]["lightmap"]
    assert said == {"uri": "x_lightmap_0.exr", "texCoord": 1, "intensity": 1.0, "quantity": "irradiance E", "unit": "W/m2"}
