"""Lights as many points (decision 20): what they send, their shadows, what is near them, and what lies on luxels."""

import itertools

import numpy as np
import pytest
from closed import box, matte

import luxel
from luxel import Mesh, Scene
from luxel.radiosity import element, shining, sky
from luxel.radiosity.bake import bake
from luxel.radiosity.element import AREA, FREE, GX, PX, SAMPLES, UX, VX, find_free
from luxel.radiosity.occlusion import prepare
from luxel.radiosity.quality import Quality
from luxel.radiosity.transfer import polygon_factor
from luxel.scene.builtin.shapes import sphere

GLOW = 1 / np.pi


def sheet(corner, u, v):
    """A rectangle from a corner, facing u x v."""
    a, u, v = (np.array(x, float) for x in (corner, u, v))
    return Mesh(np.array([a, a + u, a + u + v, a + v], np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def ball():
    scene = Scene()
    mesh = sphere(1.0, 32)
    scene.add(Mesh(mesh.positions, mesh.triangles[:, ::-1].copy()), matte(0.5, GLOW))
    return scene


@pytest.mark.parametrize("quality", ["draft", "normal", "final"])
@pytest.mark.parametrize("scene", [box(matte(0.5, GLOW)), ball()], ids=["box", "ball"])
def test_what_was_to_be_sent_is_emitted(scene, quality):
    """Nothing scales a light's row: that all it sends arrives in a closed scene is to be true by itself."""
    baked = bake(scene, density=8, quality=quality)
    whole = (baked.luxels.emission * baked.luxels.area[:, None]).sum(0, dtype=np.float64)
    np.testing.assert_allclose(baked.ledger[-1].emitted, whole, rtol=0.02)


@pytest.mark.parametrize("quality", ["draft", "normal"])
def test_a_small_lamp_just_above_a_large_luxel_gives_it_no_more_than_all(quality):
    scene = Scene()
    scene.add(sheet((-0.5, 0, -0.5), (0, 0, 1), (1, 0, 0)), matte(0.5))
    scene.add(sheet((0.045, 0.01, 0.045), (0.01, 0, 0), (0, 0, 0.01)), matte(0.05, 100.0))
    baked = bake(scene, density=10, quality=quality)
    whole = (baked.luxels.emission * baked.luxels.area[:, None]).sum(0, dtype=np.float64)
    assert (baked.direct * baked.luxels.area[:, None]).max(0)[0] <= 1.01 * whole[0]


def visible_factor(x, z):
    """From a point of the floor: a lamp, x and z from -1 to 1, 2 m above, less what a bar along z hides, 1.5 m above, x from -0.1 to 0.1."""
    low, high = (x + (edge - x) / 0.75 for edge in (-0.1, 0.1))
    strips = [(-1.0, min(max(low, -1.0), 1.0)), (min(max(high, -1.0), 1.0), 1.0)]
    corners = (np.array([[a, 2.0, -1.0], [b, 2.0, -1.0], [b, 2.0, 1.0], [a, 2.0, 1.0]]) for a, b in strips if b > a)
    return sum(abs(polygon_factor(x, 0.0, z, 0.0, 1.0, 0.0, c, 4)) for c in corners)


def test_the_shadow_of_a_bar_parallel_to_a_lamp_has_no_steps():
    scene = Scene()
    scene.add(sheet((-1, 0, -0.5), (0, 0, 1), (2, 0, 0)), matte(0.05))
    scene.add(sheet((-1, 2, -1), (2, 0, 0), (0, 0, 2)), matte(0.05, GLOW))
    for up in (False, True):
        sides = ((0.2, 0, 0), (0, 0, 20)) if not up else ((0, 0, 20), (0.2, 0, 0))
        scene.add(sheet((-0.1, 1.5, -10), *sides), matte(0.05))
    baked = bake(scene, density=16)
    floor = np.flatnonzero(baked.luxels.position[:, 1] < 1e-6)
    exact = np.array([visible_factor(float(x), float(z)) for x, _, z in baked.luxels.position[floor]])
    assert exact.min() < 0.9 * exact.max()
    np.testing.assert_allclose(baked.direct[floor, 0], exact, atol=0.03 * exact.max())


@pytest.mark.filterwarnings("ignore:100% of the light meets nothing")
def test_points_of_lights_lie_in_their_patches_and_not_in_rows(monkeypatch):
    made = []
    scattered = shining._scattered
    monkeypatch.setattr(shining, "_scattered", lambda *given: made.append((given[0], scattered(*given))) or made[-1][1])
    scene = Scene()
    scene.add(sheet((0, 0, 0), (0, 0, 1), (1, 0, 0)), matte(0.05, GLOW))
    bake(scene, density=16)
    tree, points = made[0]
    place = tree.place[tree.patches]
    assert len(points) > 100
    assert (np.linalg.norm(points - place[:, :3], axis=1) <= place[:, 3] + np.sqrt(0.5) / 16).all()
    for axis in (0, 2):
        assert np.diff(np.sort(points[:, axis])).min() > 1e-5


def light_below_bars(bars):
    """W/m2 of luxels 20 cm below a lamp of 1 x 1 m, half-way behind bars of 5 cm that hide half of it, or behind a picture of such bars."""
    scene = Scene()
    scene.add(sheet((0, 0, 0), (0, 0, 1), (1, 0, 0)), matte(0.05))
    scene.add(sheet((0, 0.2, 0), (1, 0, 0), (0, 0, 1)), matte(0.05, GLOW))
    dark = luxel.Material((0.05, 0.05, 0.05, 1), double_sided=True)
    if bars == "holes":
        alpha = np.zeros((1, 20, 4), np.uint8)
        alpha[0, ::2] = 255
        scene.textures.append(luxel.Texture(alpha))
        dark = luxel.Material(base_color_texture=luxel.TextureRef(0), alpha_mode="MASK", double_sided=True)
        mesh = sheet((0, 0.1, 0), (1, 0, 0), (0, 0, 1))
        mesh.texcoords = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
        scene.add(mesh, dark)
    if bars == "bars":
        for x in np.arange(0, 1, 0.1):
            scene.add(sheet((x, 0.1, 0), (0.05, 0, 0), (0, 0, 1)), dark)
    baked = bake(scene, density=10)
    floor = (baked.luxels.position[:, 1] < 1e-6) & (np.abs(baked.luxels.position[:, [0, 2]] - 0.5).max(1) < 0.3)
    return baked.direct[floor, 0]


def test_what_is_near_a_lamp_is_seen_by_rays():
    whole, bars, holes = map(light_below_bars, ("none", "bars", "holes"))
    np.testing.assert_allclose(bars, whole / 2, rtol=0.15)  # four spots a luxel
    np.testing.assert_allclose(bars.mean(), whole.mean() / 2, rtol=0.02)
    np.testing.assert_allclose(holes, bars, rtol=0.05)


def test_the_largest_rectangle_of_open_spots():
    rng = np.random.default_rng(1)
    for bits in [0, 1, (1 << SAMPLES) - 1, *(int(b) for b in rng.integers(0, 1 << SAMPLES, 300))]:
        open_ = np.array([[bits >> (4 * r + c) & 1 for c in range(4)] for r in range(4)], bool)
        best = max(((right - left) * (low - top) for left, right in itertools.combinations(range(5), 2)
                    for top, low in itertools.combinations(range(5), 2) if open_[top:low, left:right].all()), default=0)  # fmt: skip
        left, right, top, low = element._largest.py_func(bits)
        assert (right - left) * (low - top) == best
        assert open_[top:low, left:right].all()


def lying(covered, own=False):
    """An element, 1 m a side, of a floor facing +y, u along +x, after a sheet 2 cm above it covers that part of it from the left."""
    floor, above = sheet((-2, 0, -2), (0, 0, 4), (4, 0, 0)), sheet((-0.5, 0.02, -2), (covered, 0, 0), (0, 0, 4))
    meshes = [floor, *([above] if covered else [])]
    positions = np.concatenate([mesh.positions for mesh in meshes])
    triangles = np.concatenate([mesh.triangles + 4 * k for k, mesh in enumerate(meshes)]).astype(np.int32)
    numbers = np.zeros((17, 1), np.float32)
    numbers[GX + 1], numbers[GX - 2], numbers[AREA], numbers[UX], numbers[VX + 2] = 1, 1, 1, 1, 1
    charts = np.array([0, 0, 0 if own else 1, 0 if own else 1][: len(triangles)], np.int32)
    find_free(prepare(positions, triangles), charts, np.zeros(1, np.int32), numbers, 1)
    return numbers[:, 0]


@pytest.mark.parametrize(("covered", "open_"), [(0.7, 0.25), (0.55, 0.5)])
def test_what_lies_on_an_element_leaves_the_rest(covered, open_):
    cropped = lying(covered)
    np.testing.assert_allclose(cropped[PX : PX + 3], [0.5 - open_ / 2, 0, 0], atol=1e-6)
    np.testing.assert_allclose([cropped[AREA], cropped[UX], cropped[VX + 2]], [open_, open_, 1.0])
    assert cropped[FREE] == (1 << SAMPLES) - 1


def test_elements_are_looked_at_some_at_a_time(monkeypatch):
    """Who interrupts it waits for some of them; what is found is the same."""
    corners = np.random.default_rng(2).random((300, 1, 3)) + np.random.default_rng(3).normal(size=(300, 3, 3)) * 0.05
    positions, triangles = corners.reshape(-1, 3).astype(np.float32), np.arange(900, dtype=np.int32).reshape(-1, 3)
    numbers = np.zeros((17, 300), np.float32)
    numbers[PX : PX + 3], numbers[GX + 2], numbers[AREA], numbers[UX], numbers[VX + 1] = corners.mean(1).T, 1, 0.01, 0.1, 0.1
    charts, found = np.arange(300, dtype=np.int32), []
    for some in (1 << 16, 64):
        monkeypatch.setattr(element, "_AT_ONCE", some)
        found.append(numbers.copy())
        find_free(prepare(positions, triangles), charts, charts, found[-1], 2)
    assert len(np.unique(found[0][FREE])) > 10
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("given", [(0.0, False), (0.7, True), (1.0, False)])
def test_elements_that_are_open_or_wholly_covered_stay_as_they_are(given):
    same = lying(*given)
    np.testing.assert_allclose(same[PX : PX + 3], 0)
    np.testing.assert_allclose([same[AREA], same[UX], same[VX + 2]], 1.0)


def test_beside_a_rug_the_floor_is_as_light_as_elsewhere():
    def floor(rug):
        scene = Scene()
        scene.add(sheet((-1, 0, -1), (0, 0, 2), (2, 0, 0)), matte(0.05))
        if rug:
            scene.add(sheet((-0.57, 0.002, -0.57), (0, 0, 1.14), (1.14, 0, 0)), luxel.Material((0.05, 0.05, 0.05, 1), double_sided=True))
        baked = bake(scene, density=10, sky=1.0)
        where, light = baked.luxels.position, baked.irradiance
        edge = (where[:, 1] < 1e-6) & (np.abs(np.abs(where[:, 0]) - 0.55) < 1e-3) & (np.abs(where[:, 2]) < 0.4)
        assert edge.sum() == 16
        return light[edge]

    np.testing.assert_allclose(floor(True), floor(False), rtol=0.02)


def test_parts_of_cells_and_spots_are_an_orthogonal_array():
    spots = np.array([sky._sample_of_part.py_func(part, 4) for part in range(16)])
    four = np.stack([np.arange(16) % 4, np.arange(16) // 4, spots % 4, spots // 4])
    for a, b in itertools.combinations(four, 2):
        assert len(set(zip(a, b, strict=True))) == 16
    few = np.array([sky._sample_of_part.py_func(part, 2) for part in range(4)])
    assert len(set(few)) == 4
    assert (few % 4).mean() == (few // 4).mean() == 1.5


def test_a_bake_with_many_batches_of_lights_is_resumed_among_them(tmp_path):
    quality, scene = Quality(600, 32, 4, 32, 0), box(matte(0.5, GLOW))
    whole = bake(scene, density=16, quality=quality)
    state = tmp_path / "state"

    class Stopped(Exception):
        pass

    def stop(unshot, told):
        if unshot < 1.0:
            raise Stopped

    with pytest.raises(Stopped):
        bake(scene, density=16, quality=quality, checkpoint=state, progress=stop)
    resumed = bake(scene, density=16, quality=quality, checkpoint=state, resume=True)
    assert resumed.irradiance.tobytes() == whole.irradiance.tobytes()
    assert (resumed.ledger[-1].emitted == whole.ledger[-1].emitted).all()
