"""The words of the command line to values, and which camera they mean."""

import numpy as np
import pytest

from luxel.cli import values
from luxel.cli.drawing import View, with_lightmap
from luxel.errors import ExtraMissingError, FileError, InputError
from luxel.io.images import write_png
from luxel.scene import Camera, Scene
from luxel.scene.builtin import box, cornell_box, quad

SIZE = (320, 200)


@pytest.mark.parametrize(
    ("text", "size"),
    [("1280x720", (1280, 720)), ("64", (64, 64)), (" 3 X 4 ", (3, 4)), ("8,9", (8, 9)), ("8*9", (8, 9))],
)
def test_size(text, size):
    assert values.size(text) == size


@pytest.mark.parametrize("text", ["", "x", "0x5", "5x", "1.5x2", "-3x4", "1x2x3"])
def test_size_wrong(text):
    with pytest.raises(InputError, match="--size: expected WIDTHxHEIGHT"):
        values.size(text)


@pytest.mark.parametrize(
    ("text", "vector"), [("1,2,-3.5", (1, 2, -3.5)), ("z", (0, 0, 1)), ("-X", (-1, 0, 0)), ("+y", (0, 1, 0))]
)
def test_vector(text, vector):
    assert values.vector(text, "--up") == vector


@pytest.mark.parametrize("text", ["1,2", "a,b,c", "", "1,2,3,4", "nan,0,0", "inf,1,1"])
def test_vector_wrong(text):
    with pytest.raises(InputError, match="--eye: expected"):
        values.vector(text, "--eye")


@pytest.mark.parametrize(
    ("text", "rgb"),
    [
        ("none", None),
        ("transparent", None),
        ("white", (1, 1, 1)),
        ("#ff0000", (1, 0, 0)),
        ("00f", (0, 0, 1)),
        ("#808080", [((128 / 255 + 0.055) / 1.055) ** 2.4] * 3),
    ],
)
def test_background(text, rgb):
    if rgb is None:
        assert values.background(text) is None
    else:
        assert values.background(text) == pytest.approx(tuple(rgb))


def test_background_wrong_suggests():
    with pytest.raises(InputError, match="did you mean orange"):
        values.background("oragne")


def test_choice_and_names():
    assert values.choice("box", ("box", "tent"), "--filter") == "box"
    with pytest.raises(InputError, match="expected one of box, tent, got 'tnet'; did you mean tent"):
        values.choice("tnet", ("box", "tent"), "--filter")
    assert values.names("color, depth,color", ("color", "depth"), "--outputs") == ("color", "depth")
    with pytest.raises(InputError, match="--outputs"):
        values.names(" , ", ("color",), "--outputs")


def test_output(tmp_path, monkeypatch):
    assert values.output(tmp_path / "A.PNG", (".png",)) == tmp_path / "A.PNG"
    with pytest.raises(InputError, match=r"ends in one of .png"):
        values.output(tmp_path / "a.bmp", (".png",))
    with pytest.raises(FileError, match="no folder"):
        values.output(tmp_path / "no" / "a.png", (".png",))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ExtraMissingError, match=r"luxel\[exr\]"):
        values.output(tmp_path / "a.exr", (".exr",))
    (tmp_path / "b.png").mkdir()
    with pytest.raises(FileError, match="a folder"):
        values.output(tmp_path / "b.png", (".png",))


def scene_with_cameras():
    scene = Scene.from_mesh(box())
    scene.cameras += [Camera(name="near"), Camera.look_at((0, 0, 9), (0, 0, 0), yfov=0.5, name="far")]
    return scene


def test_the_files_camera_is_the_default():
    scene = scene_with_cameras()
    assert View().cameras(scene, SIZE) == scene.cameras[:1]
    assert View("1").cameras(scene, SIZE) == scene.cameras[1:]
    assert View("far").cameras(scene, SIZE) == scene.cameras[1:]
    (wide,) = View("far", fov=90).cameras(scene, SIZE)
    assert wide.yfov == pytest.approx(np.pi / 2)
    np.testing.assert_array_equal(wide.world_from_camera, scene.cameras[1].world_from_camera)


@pytest.mark.parametrize(
    ("word", "message"), [("2", "0 .. 1"), ("fra", "did you mean far"), ("-1", "one of near, far")]
)
def test_a_camera_that_is_not_there(word, message):
    with pytest.raises(InputError, match=message):
        View(word).cameras(scene_with_cameras(), SIZE)
    with pytest.raises(InputError, match="the file has no camera"):
        View(word).cameras(Scene.from_mesh(box()), SIZE)


def test_framing_options_are_degrees():
    (camera,) = View(azimuth=90, elevation=0, fov=30).cameras(scene_with_cameras(), SIZE)
    np.testing.assert_allclose(camera.world_from_camera[:3, 2], (1, 0, 0), atol=1e-12)
    assert camera.yfov == pytest.approx(np.radians(30))
    (camera,) = View(distance=5).cameras(Scene.from_mesh(box()), SIZE)
    assert np.linalg.norm(camera.eye) == pytest.approx(5)


def test_orthographic():
    (camera,) = View(ortho="3").cameras(Scene.from_mesh(box()), SIZE)
    assert (camera.yfov, camera.height) == (None, 3)
    (fitted,) = View(ortho="fit", azimuth=0, elevation=0).cameras(Scene.from_mesh(box()), (100, 100))
    assert fitted.height == pytest.approx(1 / 0.95, rel=0.01)
    (placed,) = View(eye="0,0,5", ortho="2").cameras(Scene.from_mesh(box()), SIZE)
    assert placed.near < 4.5 < 5.5 < placed.far


def test_eye_and_target():
    (camera,) = View(eye="0,0,5").cameras(Scene.from_mesh(box()), SIZE)
    np.testing.assert_allclose(camera.world_from_camera, [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]])
    assert 0 < camera.near < 0.01
    (camera,) = View(eye="1,1,1", target="1,1,9", up="x").cameras(Scene.from_mesh(box()), SIZE)
    np.testing.assert_allclose(camera.world_from_camera[:3, 1:3].T, [[1, 0, 0], [0, 0, -1]], atol=1e-12)


def test_turntable():
    assert len(View(turntable=7).cameras(Scene.from_mesh(box()), SIZE)) == 7


@pytest.mark.parametrize(
    "options",
    [
        {"camera": "0", "azimuth": 3},
        {"camera": "0", "eye": "1,2,3"},
        {"eye": "1,2,3", "elevation": 4},
        {"eye": "1,2,3", "turntable": 4},
        {"target": "1,2,3"},
        {"fov": 0},
        {"fov": 180},
        {"fov": 50, "ortho": "2"},
        {"turntable": 0},
        {"eye": "1,2"},
        {"eye": "1,2,3", "target": "x,y,z"},
    ],
)
def test_options_that_exclude_each_other(options):
    with pytest.raises(InputError, match="--"):
        View(**options)


@pytest.mark.parametrize("height", ["0", "-1", "tall", "nan", "inf"])
def test_wrong_height(height):
    with pytest.raises(InputError, match="--ortho"):
        View(ortho=height)


def test_lightmap_goes_to_the_meshes_that_have_coordinates(tmp_path):
    write_png(tmp_path / "light.png", np.full((4, 4, 3), 255, np.uint8))
    mesh = quad()
    mesh.texcoords1 = mesh.texcoords
    scene = Scene.from_mesh(mesh)
    with_lightmap(scene, tmp_path / "light.png")
    material = scene.materials[mesh.material]
    assert material.lightmap_texture.texcoord == 1
    assert material.lightmap_scale == pytest.approx(np.pi)
    scene.check()
    with pytest.raises(InputError, match="TEXCOORD_1"):
        with_lightmap(cornell_box(), tmp_path / "light.png")
