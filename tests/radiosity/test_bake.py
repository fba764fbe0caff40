import itertools
import re
import warnings

import numpy as np
import pytest
from closed import box, face, matte
from hypothesis import given, settings
from hypothesis import strategies as st

import luxel
from luxel import Camera, InputError, Light, LuxelWarning, Mesh, Scene
from luxel.errors import DarkError
from luxel.radiosity.bake import bake
from luxel.radiosity.diagnosis import estimate
from luxel.radiosity.solve import State
from luxel.radiosity.unwrap import expected_luxels
from luxel.scene.builtin.shapes import sphere
from luxel.scene.transforms import look_at

GLOW = 1 / np.pi  # radiance of a surface that emits 1 W/m2


def mean(baked, chosen=slice(None)):
    area = baked.luxels.area[chosen].astype(np.float64)
    return (baked.irradiance[chosen] * area[:, None]).sum(0) / area.sum()


@pytest.fixture(scope="module")
def furnace():
    return bake(box(matte(0.5, GLOW)), density=16)


def test_every_luxel_of_a_furnace_has_the_same_light(furnace):
    """B = E / (1 - rho) everywhere, and the irradiance in a closed scene of equal radiosity is that radiosity."""
    np.testing.assert_allclose(furnace.irradiance, 2.0, rtol=0.006)
    np.testing.assert_allclose(mean(furnace), 2.0, rtol=1e-3)
    np.testing.assert_allclose(furnace.direct, 1.0, rtol=0.005)


def test_a_furnace_of_one_mesh_without_normals_has_the_same_light():
    """Normals that are made stay sharp at a cube's edges: bent ones would send light to where the surface does not."""
    corners = np.array(list(itertools.product((0, 1), repeat=3)), np.float32)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    scene = Scene()
    scene.add(Mesh(corners, np.array([t for a, b, c, d in sides for t in ((a, c, b), (a, d, c))])), matte(0.5, GLOW))
    inward = bake(scene, density=16)
    np.testing.assert_allclose(inward.irradiance, 2.0, rtol=0.01)


def test_a_furnace_whose_normals_are_averaged_at_its_corners_has_the_same_light():
    """Normals of the file that lean over right angles are for shading only."""
    corners = np.array(list(itertools.product((0, 1), repeat=3)), np.float32)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([t for a, b, c, d in sides for t in ((a, c, b), (a, d, c))])
    scene = Scene()
    scene.add(Mesh(corners, triangles, normals=((0.5 - corners) * np.float32(2 / np.sqrt(3))).astype(np.float32)), matte(0.5, GLOW))
    inward = bake(scene, density=16)
    np.testing.assert_allclose(inward.irradiance, 2.0, rtol=0.01)
    np.testing.assert_allclose(mean(inward), 2.0, rtol=0.002)


def check_ledger(baked, escaped=1e-9):
    """It adds up at every step, and what escapes is below a share: in closed scenes, of patches whose hemicube and luxels disagree a lot."""
    for step in baked.ledger:
        whole = step.absorbed + step.escaped + step.unshot
        np.testing.assert_allclose(whole, step.emitted, rtol=2e-6)
        assert np.abs(step.escaped).max() <= escaped * step.emitted.max()
    unshot = [step.unshot_fraction for step in baked.ledger]
    assert all(later < earlier for earlier, later in itertools.pairwise(unshot))


def test_the_ledger_of_a_furnace_holds_at_every_step(furnace):
    check_ledger(furnace)
    assert furnace.finished
    assert furnace.ledger[-1].unshot_fraction <= 1e-3


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_ledger_of_random_closed_scenes_holds(seed):
    rng = np.random.default_rng(seed)
    materials = [matte(rng.uniform(0, 0.9, 3), rng.uniform(0, 1, 3) * (rng.random() < 0.5)) for _ in range(12)]
    materials[5] = matte(0.5, 1.0)
    scene = box(materials[:6], (0, 0, 0), rng.uniform(0.7, 2, 3))
    low = rng.uniform(0.1, 0.3, 3)
    box(materials[6:], low, low + rng.uniform(0.1, 0.3, 3), scene, inward=False)
    check_ledger(bake(scene, density=10, quality="draft"), escaped=0.01)


@pytest.mark.parametrize("side", [0.005, 0.02, 0.1])
def test_a_back_in_a_closed_room_takes_light_and_gives_none(side):
    """What a lamp sees of the back of something one-sided is lost: a little, and never less than nothing."""
    scene = box([matte(0.5)] * 3 + [matte(0.7, (0.3, 0.3, 0.3))] + [matte(0.5)] * 2)
    corners = np.array([[0.3, 0.5, 0.3], [0.3 + side, 0.5, 0.3], [0.3 + side, 0.5, 0.3 + side], [0.3, 0.5, 0.3 + side]])
    scene.add(Mesh(corners, [[0, 1, 2], [0, 2, 3]]), matte(0.5))
    for quality in ("draft", "normal"):
        for step in bake(scene, density=20, quality=quality).ledger:
            assert (step.escaped >= -1e-9 * step.emitted).all()
            assert (step.escaped <= (1e-3 + 2 * side**2) * step.emitted).all()


def test_in_a_sphere_light_is_the_same_everywhere():
    """F_ij = A_j / A in a sphere, so H = <E> / (1 - <rho>), whatever emits and reflects."""
    ball = sphere(1.0)
    scene = Scene()
    z = ball.positions[ball.triangles][:, :, 1].mean(1)
    inside = ball.triangles[:, ::-1]
    for chosen, material in ((z > 0.5, matte(0.3, GLOW)), (z <= 0.5, matte(0.7))):
        scene.add(Mesh(ball.positions, np.ascontiguousarray(inside[chosen]), -ball.normals), material)
    baked = bake(scene, density=10)
    area = baked.luxels.area.astype(np.float64)
    emission, albedo = (np.average(values[:, 0], weights=area) for values in (baked.luxels.emission, baked.luxels.albedo))
    expected = emission / (1 - albedo)
    np.testing.assert_allclose(mean(baked)[0], expected, rtol=0.01)
    assert np.sqrt(((baked.irradiance[:, 0] - expected) ** 2).mean()) < 0.03 * expected  # a ball of flat faces is no sphere


@pytest.fixture(scope="module")
def lamp_room():
    scene = box([matte((0.6, 0.1, 0.1)), matte(0.5), matte(0.5), matte(0.7, (0.3, 0.2, 0.1)), matte(0.5), matte((0.1, 0.6, 0.1))])
    box(matte(0.4), (0.3, 0.0, 0.3), (0.6, 0.4, 0.6), scene, inward=False, skip=(2,))
    return scene


def test_the_same_bytes_for_any_number_of_threads(lamp_room):
    one, two, four = (bake(lamp_room, density=20, quality="draft", threads=n) for n in (1, 2, 4))
    assert one.irradiance.tobytes() == two.irradiance.tobytes() == four.irradiance.tobytes()
    assert one.pages.tobytes() == two.pages.tobytes()


def test_an_interrupted_bake_resumes_to_the_same_bytes(lamp_room, tmp_path):
    state = tmp_path / "state"
    whole = bake(lamp_room, density=20, quality="draft")

    def stop(unshot, progress):
        if len(progress.state.ledger) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bake(lamp_room, density=20, quality="draft", checkpoint=state, progress=stop)
    resumed = bake(lamp_room, density=20, quality="draft", checkpoint=state, resume=True, threads=1)
    assert resumed.irradiance.tobytes() == whole.irradiance.tobytes()
    assert len(resumed.ledger) == len(whole.ledger)
    with pytest.raises(InputError, match="another scene or other settings"):
        bake(lamp_room, density=21, quality="draft", checkpoint=state, resume=True)


@pytest.mark.parametrize(("quality", "when"), [("draft", 1), ("draft", 3), ("progressive", 1), ("progressive", 4)])
@pytest.mark.parametrize("after", [False, True])
def test_who_is_interrupted_within_a_step_resumes_to_the_same_bytes(lamp_room, tmp_path, monkeypatch, quality, when, after):
    """The state is half changed then, and is not kept; what was kept before it is."""
    state, take_in, calls = tmp_path / "state", State.take_in, []
    options = {"density": 10, "quality": quality, "checkpoint": state}
    whole = bake(lamp_room, density=10, quality=quality)

    def interrupted(*arguments, **more):
        calls.append(1)
        if len(calls) == when + 1 and not after:
            raise KeyboardInterrupt
        take_in(*arguments, **more)
        if len(calls) == when + 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(State, "take_in", interrupted)
    monkeypatch.setattr("luxel.radiosity.bake._SAVE_EVERY", -1.0)  # after each step
    with pytest.raises(KeyboardInterrupt):
        bake(lamp_room, **options)
    monkeypatch.setattr(State, "take_in", take_in)
    resumed = bake(lamp_room, resume=True, **options)
    assert resumed.irradiance.tobytes() == whole.irradiance.tobytes()
    assert len(resumed.ledger) == len(whole.ledger)


def test_a_checkpoint_that_cannot_be_written_does_not_lose_the_light(lamp_room, tmp_path):
    whole = bake(lamp_room, density=20, quality="draft")
    with pytest.warns(LuxelWarning, match="the bake goes on"):
        kept = bake(lamp_room, density=20, quality="draft", checkpoint=tmp_path / "no folder" / "state")
    assert kept.finished
    assert kept.irradiance.tobytes() == whole.irradiance.tobytes()


def test_a_room_turned_inside_out_is_said_to_be():
    scene = box(matte(0.5), inward=False)
    box(matte(0.5, 1.0), (0.4, 0.4, 0.4), (0.6, 0.6, 0.6), scene, inward=False)
    with pytest.raises(DarkError, match=r"nothing shines: all .* normals .* inverted"):
        bake(scene, density=10, quality="draft")


def test_what_is_done_before_there_is_light_is_told():
    heard = []
    bake(box(matte(0.5, GLOW)), density=4, quality="draft", preparing=lambda *told: heard.append(told), progress=lambda *_: heard.append(None))
    before = heard[: heard.index(None)]
    assert None not in before
    assert all(0 <= share <= 1 for share, _ in before)
    stages = list(dict.fromkeys(doing for _, doing in before))
    assert stages == ["reading", "laying out the lightmap", "finding luxels", "finding luxels in solids", "cutting patches"]
    assert all(told is None for told in heard[len(before) :])


def test_what_takes_light_away_is_named():
    """Whether or not something else shines."""
    scene = box([matte(0.5, 1.0)] * 3 + [matte(0.5, (0.1, -0.2, 0.0), name="hole")] + [matte(0.5)] * 2)
    with pytest.raises(InputError, match=r"bake: material \d \('hole'\): expected emissive of at least 0, got \(0.1, -0.2, 0.0\)"):
        bake(scene, density=10, quality="draft")
    scene = box(matte(0.5, 1.0))
    for dark in (Light("point", intensity=-2.0), Light("point", (0.5, -0.5, 0.5), 1.0)):
        scene.lights = [dark]
        with pytest.raises(InputError, match="bake: light 0: expected an intensity and a color of at least 0, got intensity "):
            bake(scene, density=10, quality="draft")


def test_what_is_not_finite_is_said_and_left_out():
    """In a file's words; and what is baked without it can be written."""
    scene, whole = box(matte(0.5, GLOW)), box(matte(0.5, GLOW))
    broken = scene.meshes[2]
    broken.positions = np.concatenate([broken.positions, [[np.nan, 0, 0]]]).astype(np.float32)
    broken.triangles = np.concatenate([broken.triangles, [[0, 1, 4]]]).astype(np.int32)
    with pytest.warns(LuxelWarning, match="y0: 1 vertices are not finite; 1 triangles that use them are dropped"):
        baked = bake(scene, density=10, quality="draft")
    assert all(np.isfinite(mesh.positions).all() for mesh in baked.atlas.scene.meshes)
    assert baked.irradiance.tobytes() == bake(whole, density=10, quality="draft").irradiance.tobytes()
    assert len(broken.positions) == 5  # the scene that is given stays


def test_a_broken_checkpoint_is_named(lamp_room, tmp_path):
    state = tmp_path / "state"
    state.write_bytes(b"nonsense")
    with pytest.raises(luxel.FileError, match="state: expected a checkpoint"):
        bake(lamp_room, density=10, quality="draft", checkpoint=state, resume=True)


def test_what_does_not_fit_in_memory_is_refused_before_it_is_laid_out(lamp_room, monkeypatch):
    monkeypatch.setattr("luxel.radiosity.diagnosis.free_bytes", lambda: 1 << 30)
    monkeypatch.setattr("luxel.radiosity.prepare.unwrap", lambda *_: pytest.fail("laid out"))
    with pytest.raises(InputError, match=r"luxels would take about .* GB, and 1\.1 GB are free: a density of [0-9.]+ would do") as told:
        bake(lamp_room, density=3000)
    fits = float(re.search(r"density of ([0-9.e+]+)", str(told.value))[1])
    wanted = expected_luxels(lamp_room, fits)
    assert 0.8 * (1 << 30) < estimate(int(wanted), 0)[0] < 1.1 * (1 << 30)


def test_what_lies_in_a_solid_takes_no_part(lamp_room):
    baked = bake(lamp_room, density=20, quality="draft")
    p = baked.luxels.position
    floor = (p[:, 1] < 1e-6) & (p[:, 0] > 0.33) & (p[:, 0] < 0.57) & (p[:, 2] > 0.33) & (p[:, 2] < 0.57)
    assert floor.any()
    assert not baked.valid[floor].any()
    outside = (p[:, 1] < 1e-6) & ((p[:, 0] < 0.25) | (p[:, 0] > 0.65))
    assert baked.valid[outside].all()


def test_no_light_and_no_surface_are_errors():
    with pytest.raises(DarkError, match="nothing shines"):
        bake(box(matte(0.5)), density=4)
    with pytest.raises(InputError, match=r"no surface|no triangles|surface"):
        bake(Scene(lights=[Light()]), density=4)


@pytest.mark.parametrize(("given", "said"), [({"quality": "best"}, "draft, normal, final"), ({"tolerance": 2.0}, "between 0 and 1")])
def test_wrong_values_are_named(given, said):
    with pytest.raises(InputError, match=said):
        bake(box(matte(0.5, 1.0)), density=4, **given)


@pytest.mark.parametrize("sky", ["blue", [1, "2", 3], [[1, 2], [3]], [1, 2], np.zeros((0, 4, 3)), None.__class__])
def test_what_is_no_sky_is_named(sky):
    with pytest.raises(InputError, match=r"sky: expected a number of W/\(m2 sr\), \(3,\), or a picture \(h, w, 3\), got "):
        bake(box(matte(0.5, 1.0)), density=4, sky=sky)


def test_inverted_normals_are_said():
    with pytest.warns(LuxelWarning, match="100% of the light .* normals inverted"):
        bake(box(matte(0.5, 1.0), inward=False), density=4)
    nested = Scene()
    for gap in (0.0, 0.1, 0.2, 0.25):
        box(matte(0.5, 1.0), (gap,) * 3, (1 - gap,) * 3, nested, inward=False)
    with pytest.warns(LuxelWarning) as said:
        bake(nested, density=10)
    assert any("of the luxels see hardly anything but backs" in str(warning.message) for warning in said)


def test_too_bright_surfaces_are_clamped_and_said():
    with pytest.warns(LuxelWarning, match=r"0\.99"):
        baked = bake(box([matte(1.0)] * 5 + [matte(0.2, 1.0)]), density=6, quality="draft")
    assert np.isfinite(baked.irradiance).all()


def test_an_open_scene_loses_its_light():
    baked = bake(box([matte(0.5)] * 3 + [matte(0.5, GLOW), matte(0.5)], skip=(5,)), density=10)
    check_ledger(baked, escaped=1.0)
    assert (baked.ledger[-1].escaped > 0.1 * baked.ledger[-1].emitted).all()


def floor(double_sided=False, height=0.0):
    corners = np.array([[-1, height, 1], [1, height, 1], [1, height, -1], [-1, height, -1]], np.float32)
    scene = Scene()
    scene.add(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), matte(0.5, double_sided=double_sided))
    return scene


def test_a_point_light_falls_off_with_the_square():
    scene = floor()
    scene.lights.append(Light("point", (1.0, 0.5, 0.25), 10.0, look_at((0, 2, 0), (0, 0, 0), (0, 0, 1))))
    baked = bake(scene, density=16)
    p = baked.luxels.position.astype(np.float64)
    r2 = (p**2).sum(1) + 4.0
    np.testing.assert_allclose(baked.irradiance, 10 * 2 / r2[:, None] ** 1.5 * [1, 0.5, 0.25], rtol=2e-3)


def test_the_sun_shines_on_one_side_and_the_sky_on_both():
    scene = floor(double_sided=True)
    scene.lights.append(Light("directional", (1, 1, 1), 2.0, look_at((0, 1, 1), (0, 0, 0), (1, 0, 0))))
    np.testing.assert_allclose(bake(scene, density=8).irradiance, 2 / np.sqrt(2), rtol=1e-4)
    np.testing.assert_allclose(bake(floor(), density=8, sky=0.5).irradiance, 0.5 * np.pi, rtol=2e-3)
    picture = np.zeros((16, 32, 3), np.float32)
    picture[:8] = 0.5  # only the upper half is bright
    np.testing.assert_allclose(bake(floor(), density=8, sky=picture).irradiance, 0.5 * np.pi, rtol=0.02)


def test_a_screen_casts_its_shadow():
    scene = floor()
    corners = np.array([[-0.5, 1, 0.5], [0.5, 1, 0.5], [0.5, 1, -0.5], [-0.5, 1, -0.5]], np.float32)
    scene.add(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), matte(0.0, double_sided=True))
    scene.lights.append(Light("directional", (1, 1, 1), 1.0, look_at((0, 5, 0), (0, 0, 0), (0, 0, 1))))
    baked = bake(scene, density=16)
    p = baked.luxels.position
    ground, reach = p[:, 1] < 0.5, np.abs(p[:, [0, 2]]).max(1)
    assert not baked.irradiance[ground & (reach < 0.45)].any()
    np.testing.assert_allclose(baked.irradiance[ground & (reach > 0.55)], 1.0, rtol=1e-5)


def test_holes_of_a_mask_let_light_through():
    from luxel import Material, Texture, TextureRef

    scene = floor()
    image = np.zeros((2, 2, 4), np.uint8)
    image[:, 0] = 255  # the left half is solid
    scene.textures.append(Texture(image, filter="nearest", wrap=("clamp", "clamp")))
    corners = np.array([[-1, 0.5, 1], [1, 0.5, 1], [1, 0.5, -1], [-1, 0.5, -1]], np.float32)
    texcoords = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    leaf = Material((0, 0, 0, 1.0), alpha_mode="MASK", double_sided=True, base_color_texture=TextureRef(0))
    scene.add(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), texcoords=texcoords), leaf)
    scene.lights.append(Light("directional", (1, 1, 1), 1.0, look_at((0, 5, 0), (0, 0, 0), (0, 0, 1))))
    baked = bake(scene, density=16)
    p = baked.luxels.position
    ground = p[:, 1] < 0.1
    assert not baked.irradiance[ground & (p[:, 0] < -0.1)].any()
    np.testing.assert_allclose(baked.irradiance[ground & (p[:, 0] > 0.1)], 1.0, rtol=1e-5)


def test_the_lit_scene_shows_its_light(furnace):
    camera = Camera.look_at((0.5, 0.5, 0.9), (0.5, 0.5, 0.0), yfov=1.0, near=0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        picture = luxel.render(furnace.scene, camera, (32, 32), outputs=("linear",))
    np.testing.assert_allclose(picture.linear[..., :3], 0.5 * 2.0 / np.pi + GLOW, rtol=0.01)  # albedo E / pi, and what it emits


def test_a_time_budget_stops_the_shooting(lamp_room):
    baked = bake(lamp_room, density=20, seconds=1e-9)
    assert not baked.finished
    check_ledger(baked, escaped=1e-4)  # at its foot the block shows its inside: it has no bottom


@pytest.mark.parametrize("height", [1.8752, 0.3301, 2.7183])
def test_a_disc_does_not_shine_on_its_own_back(height):
    """Rounding puts parts of a plane before or behind each other, and luxels at its rim overlap."""
    angle = np.arange(24) * (2 * np.pi / 24)
    rim = np.stack([0.9 * np.cos(angle) - 1.3, np.full(24, height), -0.9 * np.sin(angle) + 0.7], 1)
    triangles = np.array([[0, k, k + 1] for k in range(1, 23)], np.int32)
    scene = Scene()
    scene.add(Mesh(rim.astype(np.float32), triangles), matte(0.5, 1.0, double_sided=True))
    turn = look_at((0.3, 0.2, 0.9), (0, 0, 0))
    scene.instances[0].world_from_mesh = turn
    with pytest.warns(LuxelWarning, match="meets nothing"):
        baked = bake(scene, density=8, transport=True)
    still = baked.transport
    assert baked.ledger[-1].absorbed.max() < 1e-6 * baked.ledger[-1].emitted.max()
    assert not still.exchange.any() or np.abs(still.exchange).max() < 1e-6


def walled(lamp):
    """A floor of 192 x 96 luxels, and where columns 96 and 97 meet a wall without thickness, wider than the floor; a lamp on one side."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    scene = Scene()

    def add(origin, u, v, texel, texels, material):
        texcoords = (corners * texels + texel) / 256
        positions = np.array(origin) + corners[:, :1] * np.array(u) + corners[:, 1:] * np.array(v)
        scene.add(Mesh(positions.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32), texcoords1=texcoords.astype(np.float32)), material)

    add((0, 0, 2), (4, 0, 0), (0, 0, -2), (0, 0), (192, 96), matte(0.5))
    add((2, 0, 3), (0, 0, -4), (0, 3, 0), (0, 104), (96, 72), matte(0.5, double_sided=True))
    if lamp == "surface":
        add((0.6, 2, 0.6), (0.8, 0, 0), (0, 0, 0.8), (200, 0), (16, 16), matte(0.5, 10.0))
    else:
        scene.lights.append(Light("point", (1, 1, 1), 10.0, look_at((1, 2, 1), (1, 0, 1), (0, 0, 1))))
    return scene


@pytest.mark.parametrize("quality", ["draft", "normal"])
@pytest.mark.parametrize("lamp", ["surface", "point"])
def test_no_light_passes_below_a_wall_without_thickness(lamp, quality):
    """Though a hemicube's pixels are larger than the luxels, and some of those about a luxel behind the wall show the floor before it."""
    baked = bake(walled(lamp), page=256, quality=quality)
    assert baked.atlas.reused
    ground, x = baked.luxels.face_normal[:, 1] > 0.5, baked.luxels.position[:, 0]
    before, behind = ground & (np.abs(x - 1.98) < 0.02), ground & (x > 2)
    assert baked.irradiance[before].min() > 0.5
    assert not baked.direct[behind].any()
    assert baked.irradiance[behind].max() < 2e-3 * baked.irradiance[before].min()  # what is left unshot is spread evenly


def test_a_solid_that_is_inside_out_under_a_sky_is_said():
    """Its fronts are inside, where no light comes."""
    shape, scene = sphere(1.0), Scene()
    scene.add(Mesh(shape.positions, np.ascontiguousarray(shape.triangles[:, ::-1]), -shape.normals), matte(0.5))
    with pytest.warns(LuxelWarning, match=r"surfaces have 0\.0.% of the light .* normals inverted"):
        bake(scene, density=6, quality="draft", sky=1.0)


def test_a_room_with_a_small_window_is_no_closed_one(recwarn):
    """Nor is ground below a sheet that hangs over it in a solid, though most that it sees is the sheet's back."""
    scene = box(matte(0.5), high=(6, 3, 6), skip=(1,))
    for low, high in (((6, 0, 0), (6, 3, 2.7)), ((6, 0, 3.3), (6, 3, 6)), ((6, 0, 2.7), (6, 1, 3.3)), ((6, 1.6, 2.7), (6, 3, 3.3))):
        scene.add(face(0, 1, low, high), matte(0.5))
    bake(scene, density=4, quality="draft", sky=1.0)
    ground = Scene()
    ground.add(face(1, 0, (-6, 0, -6), (6, 1, 6)), matte(0.5))
    ground.add(face(1, 0, (-2, 1, -2), (2, 2, 2)), matte(0.5))
    baked = bake(ground, density=4, quality="draft", sky=1.0)
    assert baked.valid.all()
    p = baked.luxels.position
    below = (p[:, 1] < 0.5) & (np.abs(p[:, [0, 2]]).max(1) < 1.0)
    assert 0.01 < baked.irradiance[below].mean() < 0.5 * np.pi
    assert not recwarn.list


def test_a_scene_too_far_from_the_origin_for_single_precision_is_said():
    def at(metres):
        scene = box(matte(0.5, GLOW))
        for instance in scene.instances:
            instance.world_from_mesh = np.array([[1, 0, 0, metres], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        return bake(scene, density=10, quality="draft")

    np.testing.assert_allclose(mean(at(1e3)), 2.0, rtol=5e-3)  # without a word
    with pytest.warns(LuxelWarning, match=r"reaches 1e\+05 m from the origin, where numbers are 0\.008 m apart and luxels 0\.1 m wide"):
        at(1e5)


def test_the_ledger_has_a_line_even_if_nothing_is_sent_on():
    scene = box(matte(0.5))
    for material in scene.materials:
        material.base_color = (0.0, 0.0, 0.0, 1.0)
    scene.lights.append(Light("point", intensity=1.0, world_from_light=look_at((0.5, 0.5, 0.5), (0, 0, 0), (0, 1, 0))))
    with pytest.warns(LuxelWarning, match="black or metal"):
        baked = bake(scene, density=8, quality="draft")
    last = baked.ledger[-1]
    assert last.unshot_fraction == 0
    np.testing.assert_allclose(last.absorbed, last.emitted, rtol=1e-6)
    assert last.emitted.min() > 0


def test_a_lamp_that_shines_nowhere_is_named():
    scene = box(matte(0.5))
    scene.lights.append(Light("spot", intensity=1.0, world_from_light=np.diag([0.0, 0, 0, 1]), name="broken"))
    with pytest.raises(InputError, match=r"light 0 \('broken'\): expected a direction"):
        bake(scene, density=4)
