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


@pytest.mark.parametrize("text", ["1048577", "8x2000000"])
def test_size_too_large(text):
    with pytest.raises(InputError, match="--size: expected at most 1048576 pixels a side, got"):
        values.size(text)


@pytest.mark.parametrize("text", ["0", "9", "-1", "2.5", "many", "", "1e3", "9" * 30])
def test_whole_numbers(text):
    assert values.whole(" 8 ", "--ssaa", 1, 8) == 8
    with pytest.raises(InputError, match=f"--ssaa: expected a whole number from 1 to 8, got '{text}'"):
        values.whole(text, "--ssaa", 1, 8)
    with pytest.raises(InputError, match="--threads: expected a whole number of at least 1, got '0'"):
        values.whole("0", "--threads", 1)


@pytest.mark.parametrize("text", ["65", "-65", "nan", "inf", "bright", ""])
def test_numbers(text):
    assert values.number("-2.5", "--exposure", "stops") == -2.5
    with pytest.raises(InputError, match=f"--exposure: expected -64 to 64 stops, got '{text}'"):
        values.number(text, "--exposure", "-64 to 64 stops", lambda x: abs(x) <= 64)


def test_background_wrong_suggests():
    with pytest.raises(InputError, match="did you mean orange"):
        values.background("oragne")


def test_choice_and_names():
    assert values.choice("box", ("box", "tent"), "--filter") == "box"
    with pytest.raises(InputError, match="expected one of box, tent, got 'tnet'; did you mean tent"):
        values.choice("tnet", ("box", "tent"), "--filter")
    assert values.choice("4", (1, 4), "--samples") == 4
    with pytest.raises(InputError, match="--samples: expected one of 1, 4, got '3'"):
        values.choice("3", (1, 4), "--samples")
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
    monkeypatch.setattr("os.access", lambda path, mode: False)  # for root everything is open
    with pytest.raises(FileError, match="no permission"):
        values.output(tmp_path / "c.png", (".png",))


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


def before(view, scene=None):
    (camera,) = view.cameras_before([], scene or scene_with_cameras(), SIZE)
    return camera


def same(camera, /, **options):
    """Whether `camera` is the one of a View with these options."""
    (other,) = View(**options).cameras(scene_with_cameras(), SIZE)
    assert camera.yfov == other.yfov
    np.testing.assert_array_equal(camera.world_from_camera, other.world_from_camera)


def test_the_camera_before_is_this_one_but_for_what_is_named():
    assert before(View()) is None
    same(before(View(azimuth=10, elevation=5, previous="azimuth=12")), azimuth=12, elevation=5)
    same(before(View(azimuth="10", fov="30", previous="fov=35")), azimuth=10, fov=35)
    same(before(View(azimuth=10, up="z", fov=30, previous="eye=0,1,9")), eye="0,1,9", up="z", fov=30)
    same(before(View(eye="1,1,5", target="0,0,1", previous="eye=2,1,5")), eye="2,1,5", target="0,0,1")
    same(before(View(eye="1,1,5", previous="azimuth=3 elevation=4")), azimuth=3, elevation=4)
    same(before(View("near", previous="camera=far")), camera="far")
    same(before(View(azimuth=1, previous="ortho=3")), azimuth=1, ortho="3")
    same(before(View(previous="azimuth=25")), azimuth=25)
    named = scene_with_cameras()
    named.cameras[1].name = "far away"
    assert before(View(previous="camera='far away'"), named) is named.cameras[1]


def test_in_a_turntable_the_camera_before_is_that_of_the_picture_before():
    scene, view = scene_with_cameras(), View(turntable=3)
    cameras = view.cameras(scene, SIZE)
    befores = view.cameras_before(cameras, scene, SIZE)
    for i in range(3):
        np.testing.assert_array_equal(befores[i].world_from_camera, cameras[i - 1].world_from_camera)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected camera options such as"),
        ("azimuth", "expected camera options such as"),
        ("azimuth=", "expected camera options such as"),
        ("camera='near", "expected camera options such as"),
        ("azimut=3", "did you mean azimuth"),
        ("turntable=3", "expected one of camera, azimuth"),
        ("azimuth=north", "--azimuth: expected degrees, got 'north'"),
        ("eye=1,2,3 azimuth=4", "--eye goes with"),
    ],
)
def test_wrong_camera_before(text, message):
    with pytest.raises(InputError, match=f"--previous: .*{message}"):
        View(previous=text)


@pytest.mark.parametrize(
    "options",
    [
        {"turntable": 3, "previous": "azimuth=3"},
        {"camera": "0", "azimuth": 3},
        {"camera": "0", "eye": "1,2,3"},
        {"eye": "1,2,3", "elevation": 4},
        {"eye": "1,2,3", "turntable": 4},
        {"target": "1,2,3"},
        {"fov": 0},
        {"fov": 180},
        {"fov": 50, "ortho": "2"},
        {"turntable": 0},
        {"turntable": 10**8},
        {"up": "0,0,0"},
        {"eye": "1,2"},
        {"eye": "1,2,3", "target": "x,y,z"},
    ],
)
def test_options_that_exclude_each_other(options):
    with pytest.raises(InputError, match="--"):
        View(**options)


@pytest.mark.parametrize("options", [{"eye": "1,2,3", "target": "1,2,3"}, {"eye": "0,0,0"}])
def test_a_camera_that_stands_in_its_target(options):
    with pytest.raises(InputError, match="--eye: expected another place than the target"):
        View(**options).cameras(Scene.from_mesh(box()), SIZE)


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
