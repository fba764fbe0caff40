"""Whole pictures: modes, options, sizes, windows, streams and errors."""

import numpy as np
import pytest
from scenes import UNLIT, around, flat_camera, flat_mesh, instance, rectangle, room

import luxel
from luxel import Ambient, Camera, InputError, Light, Material, Mesh, Scene, Texture, TextureRef
from luxel.filter.antialias import decimate
from luxel.io.images import read_image
from luxel.raster import frame, render
from luxel.raster.outputs import SHAPES
from luxel.scene.builtin import bumpy_sphere_scene
from luxel.scene.builtin.shapes import sphere
from luxel.scene.colour import bytes_from_linear
from luxel.scene.transforms import look_at

EVERYTHING = ("color", "linear", *SHAPES)
IDS = ("triangle", "depth", "object", "material")


def same_bytes(a, b, names):
    return all(np.array_equal(getattr(a, n).view(np.uint8), getattr(b, n).view(np.uint8)) for n in names)


# Sizes


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (63, 65), (65, 63), (129, 1), (8, 8), (255, 257)])
@pytest.mark.parametrize("samples", [1, 4])
def test_any_size(size, samples):
    """A wall that fills it shows everywhere, a scene beside it nowhere."""
    color = (0.2, 0.4, 0.6, 1)
    scene = Scene.from_mesh(rectangle(-10, -10, size[0] + 10, size[1] + 10), Material(color, **UNLIT))
    picture = luxel.render(scene, flat_camera(size), size, samples=samples, outputs=EVERYTHING)
    assert np.allclose(picture.linear, color)
    assert (picture.color == [*bytes_from_linear(np.array(color[:3], np.float32)), 255]).all()
    assert picture.size == size
    assert set(np.unique(picture.triangle)) <= {0, 1}


def test_a_picture_wider_than_one_window():
    """40,000 x 4: a diagonal across it, and every pixel of a stripe pattern, in two and a half windows."""
    size = 40_000, 4
    x = np.arange(0, 40_000, 16)
    mesh = flat_mesh(np.stack([x, x, x + 8], 1).reshape(-1, 1) * [1, 0] + np.tile([[0, 0], [0, 4], [0, 4]], (len(x), 1)), np.arange(3 * len(x)), 0.5)
    scene = Scene.from_mesh(mesh, Material((1, 1, 1, 1), **UNLIT))
    scene.add(flat_mesh([[0, 0], [40_000, 0], [40_000, 4], [0, 4]], [[0, 1, 2], [0, 2, 3]], -0.5), Material((1, 0, 0, 1), **UNLIT))
    picture = luxel.render(scene, flat_camera(size), size, outputs=("linear", "triangle", "depth"))
    column, row = np.meshgrid(np.arange(40_000) + 0.5, np.arange(4) + 0.5)
    white = column % 16 / 8 < row / 4
    on_edge = column % 16 / 8 == row / 4
    assert np.array_equal((picture.linear[..., 1] == 1)[~on_edge], white[~on_edge])
    assert (picture.linear[..., 0] == 1).all()
    assert np.array_equal(picture.triangle[white & ~on_edge], (column // 16).astype(int)[white & ~on_edge])
    below = row / 4 > column / 40_000
    rest = ~white & ~on_edge
    assert np.array_equal(picture.triangle[rest], len(x) + below[rest].astype(int))


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("seed", [0, 1])
def test_windows_and_bands_change_nothing(monkeypatch, samples, seed):
    scene, camera = room(seed), around(seed, near=0.1)
    want = luxel.render(scene, camera, (150, 100), samples=samples, outputs=EVERYTHING, previous_camera=around(0.6))
    assert len(np.unique(want.triangle)) > 100
    for window, band in ((frame._WINDOW, 1), (32, frame._BAND_BYTES), (64, 1)):
        monkeypatch.setattr(frame, "_WINDOW", window)
        monkeypatch.setattr(frame, "_BAND_BYTES", band)
        have = luxel.render(scene, camera, (150, 100), samples=samples, outputs=EVERYTHING, tile=32, previous_camera=around(0.6), threads=2)
        assert same_bytes(have, want, IDS)
        for name in ("position", "normal", "barycentric", "texcoord", "motion"):
            assert np.allclose(getattr(have, name), getattr(want, name), atol=1e-3)
        assert (np.abs(have.color.astype(int) - want.color) > 1).mean() < 0.002


@pytest.mark.parametrize("filter", ["box", "mitchell"])
@pytest.mark.parametrize("samples", [1, 4])
def test_a_streamed_file_is_the_picture(monkeypatch, tmp_path, samples, filter):
    scene, camera, size = room(2), around(), (150, 130)
    options = {"samples": samples, "filter": filter, "background": (0.1, 0.2, 0.3), "exposure": 0.5, "tile": 16}
    want = luxel.render(scene, camera, size, **options).color
    for band in (render._BAND_BYTES, 8 * 150 * 40, 1):
        monkeypatch.setattr(render, "_BAND_BYTES", band)
        told = []
        seconds = luxel.render_to_png(tmp_path / "a.png", scene, camera, size, progress=told.append, **options)
        have = read_image(tmp_path / "a.png")
        assert have.shape[:2] == (130, 150)
        assert np.array_equal(have, want[..., : have.shape[2]])
        assert told[-1] == 1
        assert told == sorted(told)
        assert seconds["write"] > 0


# Culling and mirrors


@pytest.mark.parametrize(("cull", "double_sided", "front", "back"), [
    ("material", False, True, False), ("material", True, True, True), ("back", True, True, False), ("back", False, True, False),
    ("none", False, True, True), ("none", True, True, True),
])  # fmt: skip
def test_culling(cull, double_sided, front, back):
    mesh = rectangle(0, 0, 8, 8)
    mesh.triangles[1] = mesh.triangles[1][::-1]
    scene = Scene.from_mesh(mesh, Material(double_sided=double_sided, shading="unlit"))
    seen = np.unique(luxel.render(scene, flat_camera((8, 8)), (8, 8), cull=cull, outputs=("triangle",)).triangle)
    assert (0 in seen, 1 in seen) == (front, back)


def test_materials_are_culled_each_by_its_own():
    scene = Scene()
    for x, double_sided in ((0, False), (10, True), (20, False)):
        mesh = rectangle(x, 0, x + 10, 10)
        mesh.triangles = np.ascontiguousarray(mesh.triangles[:, ::-1])
        scene.add(mesh, Material(double_sided=double_sided, shading="unlit"))
    seen = luxel.render(scene, flat_camera((30, 10)), (30, 10), outputs=("object",)).object
    assert (seen[:, 10:20] == 1).all()
    assert (seen[:, :10] == -1).all()
    assert (seen[:, 20:] == -1).all()


def test_a_mirrored_instance_shows_its_front():
    """A mirrored sphere is lit and culled as the sphere itself; so is one that is turned, scaled unevenly and mirrored."""
    mesh = sphere(1.0, 32)
    camera = Camera.look_at([0, 0, 5], [0, 0, 0])
    light = [Light(intensity=3.0)]
    whole = Scene(meshes=[mesh], instances=[instance(np.eye(4))], lights=light)
    want = luxel.render(whole, camera, (64, 64), outputs=("linear", "normal", "depth"))
    mirrored = Scene(meshes=[mesh], instances=[instance(np.diag([-1.0, 1, 1, 1]))], lights=light)
    have = luxel.render(mirrored, camera, (64, 64), outputs=("linear", "normal", "depth"))
    assert (np.isfinite(want.depth) != np.isfinite(have.depth)).mean() < 0.01
    both = np.isfinite(want.depth) & np.isfinite(have.depth)
    assert np.allclose(have.normal[both], want.normal[both], atol=0.03)
    assert np.allclose(have.linear[both], want.linear[both], atol=0.05)
    assert (have.normal[both][:, 2] > 0).all()
    flat = Scene(meshes=[mesh], instances=[instance(np.diag([-2.0, 1, 0.5, 1]))], lights=light)
    normals = luxel.render(flat, camera, (64, 64), outputs=("normal", "position"))
    seen = (normals.normal != 0).any(-1)
    exact = normals.position / np.array([4, 1, 0.25])
    exact = exact / np.maximum(np.linalg.norm(exact, axis=-1, keepdims=True), 1e-9)
    assert seen.sum() > 500
    assert np.abs(normals.normal - exact)[seen].max() < 0.06


def test_every_instance_stands_where_its_matrix_says():
    mesh = rectangle(0, 0, 4, 4)
    scene = Scene(meshes=[mesh], materials=[Material(**UNLIT)])
    mesh.material = 0
    places = [(0, 0), (10, 3), (20, 16)]
    for number, (x, y) in enumerate(places):
        matrix = np.eye(4)
        matrix[:2, 3] = x, -y
        scene.instances.append(instance(matrix, 0, number))
    seen = luxel.render(scene, flat_camera((24, 20)), (24, 20), outputs=("object",)).object
    want = np.full((20, 24), -1)
    for number, (x, y) in enumerate(places):
        want[y : y + 4, x : x + 4] = number
    assert np.array_equal(seen, want)


# Light


def test_lightmap_shows_albedo_times_irradiance_over_pi():
    """E varies over TEXCOORD_1; neither lights nor the base texture's coordinates touch it."""
    light = np.linspace(0, 5, 8 * 8 * 3, dtype=np.float32).reshape(8, 8, 3)
    mesh = rectangle(0, 0, 32, 32)
    mesh.texcoords1 = mesh.texcoords.copy()
    mesh.texcoords = mesh.texcoords * 7
    material = Material((0.5, 0.8, 0.2, 1), lightmap_texture=TextureRef(0, texcoord=1), lightmap_scale=2.0, specular=(0, 0, 0), shading="phong")
    scene = Scene.from_mesh(mesh, material)
    scene.textures.append(Texture(light, srgb=False, filter="nearest"))
    scene.lights.append(Light(intensity=100.0))
    scene.ambient = Ambient()
    have = luxel.render(scene, flat_camera((32, 32)), (32, 32), outputs=("linear",)).linear[..., :3]
    want = np.repeat(np.repeat(light, 4, 0), 4, 1) * 2 * np.array([0.5, 0.8, 0.2]) / np.pi
    assert np.allclose(have, want, atol=1e-5)


@pytest.mark.parametrize("shading", ["flat", "gouraud", "phong", "pbr", "unlit"])
@pytest.mark.parametrize("samples", [1, 4])
def test_a_facing_wall_in_every_shading(shading, samples):
    """White, matt, facing a light of pi W/m2: it shows 1 (and pbr a little less diffuse, and its highlight)."""
    material = Material((1, 1, 1, 1), specular=None if shading == "pbr" else (0, 0, 0), roughness=1.0)
    scene = Scene.from_mesh(rectangle(0, 0, 16, 16), material)
    scene.lights, scene.ambient = [Light()], Ambient()
    have = luxel.render(scene, flat_camera((16, 16)), (16, 16), shading=shading, samples=samples, outputs=("linear",)).linear
    assert np.allclose(have[..., :3], 1, atol=0.08 if shading == "pbr" else 1e-5)
    assert np.allclose(have[..., 3], 1)


# Background, exposure, alpha


def test_background_and_exposure():
    scene = Scene.from_mesh(rectangle(2, 2, 6, 6), Material((0.4, 0.2, 0.1, 1), **UNLIT))
    inside = np.zeros((8, 8), bool)
    inside[2:6, 2:6] = True
    for background, empty in ((None, (0, 0, 0, 0)), ((0.1, 0.3, 0.5), (0.1, 0.3, 0.5, 1)), ((0.1, 0.3, 0.5, 0.5), (0.05, 0.15, 0.25, 0.5))):
        for stops in (0.0, 1.0, -2.0):
            have = luxel.render(scene, flat_camera((8, 8)), (8, 8), background=background, exposure=stops, outputs=("linear", "color"))
            assert np.allclose(have.linear[~inside], empty, atol=1e-6)  # the background is not exposed
            light = np.array([0.4, 0.2, 0.1]) * 2**stops
            assert np.allclose(have.linear[inside], [*light, 1], atol=1e-6)
            assert np.array_equal(have.color[3, 3, :3], bytes_from_linear(light.astype(np.float32)))
            assert (have.color[inside][:, 3] == 255).all()
            assert have.color[0, 0, 3] == round(255 * empty[3])


def test_colour_is_the_linear_picture_encoded():
    picture = luxel.render(room(4), around(), (90, 60), samples=4, outputs=("color", "linear"), background=(0.2, 0.3, 0.4, 0.7))
    encoded = render.Picture(linear=picture.linear)
    assert np.abs(np.asarray(encoded).astype(int) - picture.color).max() <= 1
    transparent = luxel.render(room(4), around(), (90, 60), samples=4, outputs=("color", "linear"))
    assert np.array_equal(transparent.color[..., 3] == 0, transparent.linear[..., 3] == 0)


def test_supersampled_is_shaded_at_every_sample_and_multisampled_once():
    """A texture of fine stripes: MSAA shows each pixel's centre, SSAA the average."""
    image = np.zeros((1, 64, 3), np.uint8)
    image[:, ::2] = 255
    mesh = flat_mesh([[0, 0], [0, 32], [32, 0]], [[0, 1, 2]], texcoords=[[0, 0], [0, 2], [2, 0]])  # one triangle, so one shading point a pixel
    scene = Scene.from_mesh(mesh, Material((1, 1, 1, 1), base_color_texture=TextureRef(0), **UNLIT))
    scene.textures.append(Texture(image, srgb=False, filter="nearest"))
    averaged = luxel.render(scene, flat_camera((16, 16)), (16, 16), ssaa=4, outputs=("linear",)).linear[..., 0]
    assert np.allclose(averaged, 0.5)
    once = luxel.render(scene, flat_camera((16, 16)), (16, 16), samples=16, outputs=("linear",)).linear[..., 0]
    assert set(np.unique(once)) <= {0.0, 1.0}


@pytest.mark.parametrize("rate", [2, 3])
def test_lowpass_is_the_finer_picture_decimated_in_frequency(rate):
    scene, camera, size = room(3), around(), (40, 28)
    picture = luxel.render(scene, camera, size, ssaa=rate, filter="lowpass", outputs=EVERYTHING, background=(0.2, 0.3, 0.4))
    fine = luxel.render(scene, camera, (rate * 40, rate * 28), samples=1, outputs=("linear",), background=(0.2, 0.3, 0.4))
    assert np.array_equal(picture.linear, decimate(fine.linear, rate))
    assert np.array_equal(picture.color[..., :3], bytes_from_linear(picture.linear[..., :3]))
    same_bytes(picture, luxel.render(scene, camera, size, samples=1, outputs=EVERYTHING), IDS)  # what is not colour is drawn at its own rate


def test_lowpass_takes_away_what_pixels_cannot_show():
    """Stripes a quarter of a pixel wide are grey, and a picture of one colour stays so."""
    scene, white = Scene(), Material((1, 1, 1, 1), **UNLIT)
    for x in range(0, 64, 2):
        scene.add(rectangle(x / 4, 0, (x + 1) / 4, 16), white)
    options = {"ssaa": 4, "filter": "lowpass", "outputs": ("linear",), "background": (0, 0, 0)}
    grey = luxel.render(scene, flat_camera((16, 16)), (16, 16), **options).linear[..., 0]
    assert np.abs(grey[:, 2:-2] - 0.5).max() < 0.02
    wall = luxel.render(Scene.from_mesh(rectangle(-1, -1, 17, 17), white), flat_camera((16, 16)), (16, 16), **options)
    assert np.allclose(wall.linear, 1.0, atol=1e-6)


@pytest.mark.parametrize("draw", [luxel.render, lambda *rest, **options: luxel.render_to_png("x.png", *rest, **options)])
def test_lowpass_says_what_it_needs(draw, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="lowpass filters the picture that ssaa draws"):
        draw(room(), None, (8, 8), filter="lowpass")
    with pytest.raises(InputError, match="lowpass needs the whole picture"):
        luxel.render_to_png("x.png", room(), None, (8, 8), filter="lowpass", ssaa=2)
    assert not any(tmp_path.iterdir())


# Views


def test_views_share_a_preparation():
    scene, cameras = room(5), [around(a) for a in (0, 1, 2)]
    for camera, picture in zip(cameras, luxel.render_views(scene, cameras, (60, 40), samples=4, outputs=("color", "triangle")), strict=True):
        alone = luxel.render(scene, camera, (60, 40), samples=4, outputs=("color", "triangle"))
        assert same_bytes(alone, picture, ("color", "triangle"))
    prepared = luxel.prepare(scene)
    assert np.array_equal(luxel.render(prepared, cameras[0], (60, 40)).color, luxel.render(scene, cameras[0], (60, 40)).color)


@pytest.mark.parametrize("shading", ["flat", "gouraud", "phong", "pbr", "unlit", None])
def test_threads_and_tiles_barely_touch_colour(shading):
    """Ids and depth in bytes; colour by no more than the rounding of other reference points."""
    scene, camera = room(6), around()
    want = luxel.render(scene, camera, (130, 90), samples=4, shading=shading, outputs=("color", *IDS), threads=1)
    again = luxel.render(scene, camera, (130, 90), samples=4, shading=shading, outputs=("color", *IDS), threads=2)
    assert same_bytes(want, again, ("color", *IDS))
    for tile in (8, 32, 128):
        have = luxel.render(scene, camera, (130, 90), samples=4, shading=shading, outputs=("color", *IDS), tile=tile, threads=2)
        assert same_bytes(have, want, IDS)
        assert (np.abs(have.color.astype(int) - want.color) > 1).mean() < 0.001


# What comes in broken


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_impossible_vertices_drop_their_triangles_alone(bad):
    mesh = rectangle(0, 0, 16, 16, normals=[[0, 0, 1]] * 4)
    mesh.positions[1, 0] = bad
    scene = Scene.from_mesh(mesh, Material(**UNLIT))
    seen = luxel.render(scene, flat_camera((16, 16)), (16, 16), outputs=("triangle", "color")).triangle
    assert set(np.unique(seen)) == {-1, 0}  # triangle 1 has the vertex


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_impossible_vertices_in_a_moved_mesh_without_normals(bad):
    mesh = rectangle(0, 0, 16, 16)
    mesh.positions[1, 0] = bad
    mesh.material = 0
    matrix = np.eye(4)
    matrix[0, 3] = 0.5
    scene = Scene(meshes=[mesh], materials=[Material(double_sided=True)], instances=[instance(matrix)])
    picture = luxel.render(scene, flat_camera((16, 16)), (16, 16), outputs=("triangle", "linear", "normal"))
    assert set(np.unique(picture.triangle)) == {-1, 0}
    assert np.isfinite(picture.linear).all()  # the triangle beside it has its own normals
    assert np.allclose(picture.normal[picture.triangle == 0], [0, 0, 1])


@pytest.mark.parametrize(("options", "message"), [
    ({"size": (0, 5)}, "size"), ({"size": 5}, "size"), ({"size": (2, 2, 2)}, "size"), ({"size": (1 << 21, 1)}, "size"),
    ({"samples": 3}, "samples"), ({"samples": 8, "pattern": "grid"}, "grid 8"), ({"ssaa": 0}, "ssaa"), ({"ssaa": 2.5}, "ssaa"),
    ({"ssaa": 2, "samples": 4}, "samples and ssaa"), ({"filter": "bx"}, "filter"), ({"shading": "toon"}, "shading"), ({"cull": "front"}, "cull"),
    ({"background": (1, 2)}, "background"), ({"background": (1, 2, np.nan)}, "background"), ({"outputs": ("colour",)}, "outputs"),
    ({"background": (0, -0.1, 0)}, "RGB of at least 0"), ({"background": (0, 0, 0, 1.1)}, "alpha from 0 to 1"), ({"background": "white"}, "'white'"),
    ({"background": (0, 0, 0, -0.1)}, "alpha"), ({"samples": "4"}, "expected 1, 2, 4, 8 or 16, got '4'"), ({"samples": 4.0}, "got 4.0"),
    ({"outputs": ()}, "outputs"), ({"exposure": np.inf}, "exposure"), ({"threads": 0}, "threads"), ({"threads": "many"}, "threads"),
    ({"threads": np.inf}, "threads"), ({"threads": 2.7}, "threads"), ({"threads": True}, "threads"), ({"outputs": None}, "outputs"),
    ({"pattern": "foo"}, "pattern"), ({"filter": "lowpass", "ssaa": 8, "size": (4000, 4000)}, "at most 134 million samples"),
    ({"tile": 48}, "tile"), ({"tile": 64.0}, "tile"), ({"camera": "front"}, "camera"), ({"samples": [4]}, "samples"), ({"filter": ["box"]}, "filter"),
])  # fmt: skip
def test_wrong_values_are_named(options, message):
    scene = Scene.from_mesh(rectangle(0, 0, 9, 9))
    with pytest.raises(InputError, match=message):
        luxel.render(scene, **{"camera": flat_camera((9, 9)), "size": (9, 9)} | options)


def test_numpy_numbers_are_numbers():
    scene = Scene.from_mesh(rectangle(0, 0, 9, 9), Material(**UNLIT))
    options = {"samples": np.int64(4), "tile": np.int32(16), "threads": np.int64(2), "exposure": np.float32(1)}
    camera = flat_camera((9, 9), near=np.float32(-1), far=np.float64(1))
    have = luxel.render(scene, camera, (np.int32(9), np.int64(9)), **options)
    assert np.array_equal(have.color, luxel.render(scene, flat_camera((9, 9)), (9, 9), samples=4, tile=16, threads=2, exposure=1).color)


def test_progress_rises_to_one(monkeypatch):
    monkeypatch.setattr(frame, "_BAND_BYTES", 1)
    monkeypatch.setattr(frame, "_WINDOW", 32)
    told = []
    luxel.render(room(1), around(), (70, 70), tile=8, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1
    assert len(told) > 9


def test_seconds_are_told_by_stage():
    seconds = luxel.render(room(1), around(), (70, 70), samples=4, outputs=("color", "depth")).seconds
    assert {"prepare", "project", "clip", "bin", "cover", "shade", "outputs", "blend", "resolve"} <= set(seconds)
    assert all(value >= 0 for value in seconds.values())


@pytest.mark.parametrize("options", [{}, {"samples": 4}, {"samples": 8, "filter": "mitchell"}, {"ssaa": 2}, {"samples": 4, "tile": 16, "threads": 2}])
def test_tiles_covered_and_shaded_at_once_are_those_of_two_passes(options):
    """Where only colours are wanted, what is visible is never written down."""
    scene = bumpy_sphere_scene(40)
    alone = luxel.render(scene, size=(150, 110), outputs=("color", "linear"), **options)
    beside = luxel.render(scene, size=(150, 110), outputs=("color", "linear", "triangle", "depth"), **options)
    assert "cover" not in alone.seconds
    assert "cover" in beside.seconds
    assert alone.color.tobytes() == beside.color.tobytes()
    assert alone.linear.tobytes() == beside.linear.tobytes()


def test_without_a_camera_the_scene_is_framed():
    picture = luxel.render(Scene.from_mesh(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])), size=(40, 40), cull="none", outputs=("triangle",))
    seen = picture.triangle >= 0
    assert seen.mean() > 0.1
    assert not seen[[0, -1]].any()


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"exposure": 1e4}, "exposure"),
        ({"shading": "unlit"}, "prepared"),
        ({"cull": "none"}, "prepared"),
        ({"previous_camera": 3, "outputs": ("motion",)}, "previous_camera"),
        ({"size": (2.7, 3.9)}, "size"),
    ],
)
def test_what_would_be_ignored_or_overflow_is_refused(options, word):
    prepared = luxel.prepare((np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)))
    with pytest.raises(luxel.InputError, match=word):
        luxel.render(prepared, **{"size": (4, 4), **options})


def test_streaming_names_an_option_it_has_not(tmp_path):
    scene = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)
    with pytest.raises(luxel.InputError, match="outputs"):
        luxel.render_to_png(tmp_path / "a.png", scene, size=(4, 4), outputs=("depth",))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("tile", [32, 64, 128])
def test_thousands_of_triangles_in_a_tile_keep_their_own_colours(tile):
    """More than stay set up at a time: every pixel has the colour of the triangle that is seen there, not of one set up in its place."""
    rng = np.random.default_rng(11)
    count, size = 12_000, (130, 70)
    corners = rng.uniform((-2, -2), (132, 72), (count, 1, 2)) + rng.uniform(-3, 3, (count, 3, 2))
    colors = np.concatenate([rng.random((count, 3)), np.ones((count, 1))], 1).astype(np.float32)
    depths = rng.uniform(-0.9, 0.9, count).repeat(3)
    mesh = flat_mesh(corners.reshape(-1, 2), np.arange(3 * count), depths, colors=colors.repeat(3, 0))
    scene, camera, options = Scene.from_mesh(mesh, Material((1, 1, 1, 1), **UNLIT)), flat_camera(size), {"tile": tile, "background": (0, 0, 0)}
    picture = luxel.render(scene, camera, size, outputs=("linear", "triangle"), **options)
    seen = picture.triangle >= 0
    assert len(np.unique(picture.triangle)) > 3000
    assert np.array_equal(picture.linear[seen], colors[picture.triangle[seen]])
    many = luxel.render(scene, camera, size, outputs=("linear",), samples=16, **options)
    fine = luxel.render(scene, camera, size, outputs=("linear",), ssaa=8, **options)
    assert np.abs(many.linear - fine.linear).mean() < 0.05


def test_a_normal_map_is_steady_from_steep_to_grazing_views():
    """A floor's bent normals are what a texture of one colour says, from steep views to less than a ten-thousandth of a degree, on both sides."""
    bent = np.full((4, 4, 3), np.round(127.5 * (np.array([0.6, 0, 0.8]) + 1)), np.uint8)
    floor = Mesh([[-50, 0, 50], [50, 0, 50], [50, 0, -50], [-50, 0, -50]], [[0, 1, 2], [0, 2, 3]], [[0, 1, 0]] * 4,
                 [[0, 0], [100, 0], [100, 100], [0, 100]])  # fmt: skip
    material = Material((1, 1, 1, 1), specular=(0, 0, 0), double_sided=True, normal_texture=TextureRef(0))
    scene = Scene.from_mesh(floor, material)
    scene.textures = [Texture(bent, srgb=False)]
    for height in (10, 1e-2, 1e-5, -1e-5, -1):
        scene.lights = [Light(intensity=np.pi, world_from_light=look_at((np.sign(height), 0, 0), (0, 0, 0)))]
        picture = luxel.render(scene, Camera.look_at((14, height, 14), (0, 0, 0), yfov=0.02, near=1e-3), (32, 32), outputs=("linear", "triangle"))
        shown = picture.linear[picture.triangle >= 0, 0]
        assert len(shown) > 30, height
        assert np.allclose(shown, 0.6, atol=4e-3), height
