"""`render(shading="hardware")`: the rasteriser sees, the model of the interpolator colours."""

import json

import numpy as np
import pytest

import luxel
from luxel.cli import main
from luxel.errors import InputError, LuxelWarning
from luxel.hardware import float24, interpolator
from luxel.hardware.bounds import bounds
from luxel.scene.builtin import bumpy_sphere, cornell_box

SIZE = (70, 50)
FLAT = luxel.Camera.look_at(eye=(0, 0, 3), target=(0, 0, 0), yfov=None, height=2.2, near=0, far=9)


def ball(**material):
    """Seen from along -z without perspective: colours that are linear in space are linear on the screen."""
    scene = luxel.Scene.from_mesh(bumpy_sphere(12), luxel.Material(base_color=(0.8, 0.5, 0.3, 1), **material))
    scene.lights.append(luxel.Light("directional", intensity=2.5, world_from_light=luxel.scene.transforms.look_at((1, 1, 2), (0, 0, 0))))
    return scene


@pytest.mark.parametrize("options", [{}, {"samples": 4}, {"samples": 16}, {"ssaa": 3}, {"samples": 2, "filter": "gaussian"}, {"tile": 16}])
def test_without_perspective_it_is_gouraud_within_the_bound(options):
    outputs = ("linear", "triangle", "depth", "object")
    soft, hard = (luxel.render(ball(), FLAT, SIZE, shading=name, outputs=outputs, **options) for name in ("gouraud", "hardware"))
    for name in outputs[1:]:
        assert np.array_equal(getattr(soft, name), getattr(hard, name))
    assert np.array_equal(soft.linear[..., 3], hard.linear[..., 3])
    scale = 2  # the brightest vertex is below
    assert 0.5 < soft.linear.max() < scale
    difference = np.abs(soft.linear - hard.linear)
    if "filter" not in options:  # a triangle's colour where its samples in a pixel are on average is the average of their colours
        assert difference.max() < scale * float(bounds().color) + 2e-6
    else:
        assert np.median(difference[soft.linear[..., 3] == 1]) < scale * float(bounds().color)


def test_a_pixel_is_the_models_word():
    """One triangle, seen straight: every pixel is what `interpolator.draw` gives."""
    corners = np.array([[1300, 900], [16000, 4100], [5000, 12100]])
    colors = np.array([[1.0, 0.1, 0.2, 1], [0.2, 0.9, 0.3, 1], [0.1, 0.4, 1.0, 1]], np.float32)
    positions = np.stack([corners[:, 0] / 256 - 35, 25 - corners[:, 1] / 256, np.zeros(3)], 1)
    normals = np.tile(np.array([0, 0, 1], np.float32), (3, 1))
    mesh = luxel.Mesh(positions.astype(np.float32), np.array([[0, 2, 1]], np.int32), colors=colors, normals=normals)
    scene = luxel.Scene.from_mesh(mesh, luxel.Material(specular=(0, 0, 0)))
    scene.ambient = luxel.Ambient(sky=(1, 1, 1), ground=(1, 1, 1))
    camera = luxel.Camera.look_at(eye=(0, 0, 3), target=(0, 0, 0), yfov=None, height=50, near=0, far=9)
    picture = luxel.render(scene, camera, SIZE, shading="hardware", outputs=("linear", "triangle"))
    lit = [picture.linear[y, x, :3] for x, y in ((5, 4), (61, 16), (19, 46))]  # about the corners' colours
    assert np.abs(np.array(lit) / np.array(lit).max() - colors[:, :3]).max() < 0.05
    order = [0, 2, 1]
    from luxel.raster.frame import see
    from luxel.raster.materials import GOURAUD
    from luxel.raster.render import prepare

    prepared = prepare(scene, "hardware")
    assert prepared.materials.flags[0] & GOURAUD
    words = float24.from_float(see(prepared, camera, SIZE, None, 1).geometry.colors[order, :3].astype(float))
    drawn = interpolator.draw(corners[order], words, *SIZE)
    expected = np.zeros((50, 70, 3), np.float32)
    expected[drawn.y, drawn.x] = float24.to_float(drawn.colors)
    assert np.array_equal(picture.linear[..., :3], np.maximum(expected, 0))
    assert (picture.triangle >= 0).sum() == len(drawn.x) > 500


def test_it_is_linear_on_the_screen():
    """A floor seen at a slant: perspective-correct colours differ from these, and at corners they meet."""
    soft, hard = (luxel.render(cornell_box(), size=(90, 90), shading=name, outputs=("linear", "triangle")) for name in ("gouraud", "hardware"))
    assert np.array_equal(soft.triangle, hard.triangle)
    assert 1e-3 < np.abs(soft.linear - hard.linear).max() < 0.1


def test_clipped_triangles_are_shaded():
    camera = luxel.Camera.look_at(eye=(0.2, 0.1, 0.9), target=(0, 0, 0), yfov=1.6, near=0.25)
    soft, hard = (luxel.render(ball(), camera, SIZE, shading=name, outputs=("color", "triangle")) for name in ("gouraud", "hardware"))
    assert np.array_equal(soft.triangle, hard.triangle)
    seen = soft.triangle >= 0
    assert seen.any()
    assert np.abs(soft.color.astype(int) - hard.color)[seen].mean() < 6


def test_alpha_blends_in_a_channel_of_its_own():
    scene = ball(alpha_mode="BLEND")
    scene.materials[0].base_color = (0.8, 0.5, 0.3, 0.4)
    soft, hard = (luxel.render(scene, FLAT, SIZE, shading=name, outputs=("linear",)) for name in ("gouraud", "hardware"))
    assert 0.3 < hard.linear[25, 35, 3] < 0.9
    assert np.abs(soft.linear - hard.linear).max() < 4 * float(bounds().color)


def test_the_same_bytes_for_any_tile_and_thread():
    pictures = [luxel.render(ball(), size=SIZE, shading="hardware", samples=4, tile=tile, threads=threads)
                for tile, threads in ((64, 1), (64, 2), (8, 1))]  # fmt: skip
    assert all(np.array_equal(pictures[0].color, picture.color) for picture in pictures)


def test_views_files_and_lowpass(tmp_path):
    from luxel.raster.render import render_to_png

    prepared = luxel.prepare(ball(), "hardware")
    direct = luxel.render(ball(), FLAT, SIZE, shading="hardware").color
    assert np.array_equal(luxel.render(prepared, FLAT, SIZE).color, direct)
    render_to_png(tmp_path / "ball.png", ball(), FLAT, SIZE, shading="hardware")
    from PIL import Image

    assert np.array_equal(np.asarray(Image.open(tmp_path / "ball.png")), direct)
    assert luxel.render(prepared, FLAT, SIZE, ssaa=2, filter="lowpass").color.shape == (50, 70, 4)
    assert luxel.render(luxel.Scene(), FLAT, SIZE, shading="hardware").color.max() == 0


def test_textures_are_left_out_and_that_is_said():
    scene = ball(name="painted")
    scene.textures.append(luxel.scene.Texture(np.full((2, 2, 4), 99, np.uint8)))
    scene.materials[0].base_color_texture = luxel.scene.TextureRef(0)
    with pytest.warns(LuxelWarning, match="no textures; left out: those of painted"):
        textured = luxel.render(scene, FLAT, SIZE, shading="hardware").color
    assert np.array_equal(textured, luxel.render(ball(), FLAT, SIZE, shading="hardware").color)
    with pytest.raises(InputError, match="hardware; got 'toon'"):
        luxel.render(scene, shading="toon")


def test_the_command(tmp_path, capsys):
    luxel.save(ball(), tmp_path / "ball.glb")
    assert main(["render", str(tmp_path / "ball.glb"), "-o", str(tmp_path / "ball.png"), "--size", "40", "--shading", "hardware", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["size"] == [40, 40]
    assert (tmp_path / "ball.png").stat().st_size > 500
