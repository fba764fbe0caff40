"""Rooms whose light comes off something small and bright."""

import math

import numpy as np
import pytest
from closed import box, matte
from scipy.spatial import KDTree

from luxel import InputError, Light, Mesh, Scene, Transport
from luxel.radiosity.bake import bake
from luxel.radiosity.quality import QUALITIES
from luxel.radiosity.spots import bright, most_spot_rows
from luxel.scene.builtin import cornell_box, sphere
from luxel.scene.transforms import look_at, translation

UP = (0, 0, 1)
ALIKE = QUALITIES["normal"]._replace(unlike=math.inf)
"""Without the closer look of the last bounce, which what is kept does not have."""


def beam(at, to, watts=1.0, cone=0.12):
    return Light("spot", (1.0, 0.9, 0.8), watts, look_at(at, to, UP), inner_cone=cone / 2, outer_cone=cone, name="beam")


def lit_ceiling():
    """A room with a block, lit by what a beam throws on its ceiling and on a wall."""
    scene = box([matte((0.6, 0.1, 0.1)), matte(0.5), matte(0.5), matte(0.7), matte(0.5), matte((0.1, 0.6, 0.1))])
    box(matte(0.4), (0.3, 0.0, 0.3), (0.6, 0.4, 0.6), scene, inward=False, skip=(2,))
    scene.lights += [beam((0.7, 0.45, 0.7), (0.7, 1.0, 0.7)), beam((0.5, 0.5, 0.8), (0.0, 0.5, 0.8), 0.1)]
    return scene


def without(quality):
    return QUALITIES[quality]._replace(spot_points=0)


@pytest.fixture(scope="module")
def kept():
    return bake(lit_ceiling(), density=20, quality=ALIKE, transport=True, layers=True)


@pytest.fixture(scope="module")
def ball():
    """A sphere from the inside, with a beam that falls on a three-hundredth of it."""
    shape, scene = sphere(1.0), Scene()
    scene.add(Mesh(shape.positions, np.ascontiguousarray(shape.triangles[:, ::-1]), -shape.normals), matte(0.6))
    scene.lights.append(beam((0, 0, 0), (0.3, 1, 0.2)))
    return scene


@pytest.mark.parametrize(("quality", "most", "fold"), [("draft", 0.02, 30), ("normal", 0.01, 20), ("final", 0.01, 10)])
def test_in_a_sphere_what_a_spot_sends_on_is_the_same_everywhere(ball, quality, most, fold):
    """F_ij = A_j / A in a sphere: what comes off the spot is rho Phi / (A (1 - rho)) on every luxel. Rays alone err many times as much."""

    def error(quality):
        baked = bake(ball, density=20, quality=quality)
        area = baked.luxels.area.astype(np.float64)
        expected = 0.6 / 0.4 * (area @ baked.direct) / area.sum()
        return float(np.sqrt(((baked.irradiance - baked.direct - expected) ** 2).mean()) / expected.mean())

    found = error(quality)
    assert found < most
    assert error(without(quality)) > fold * found


def test_a_scene_without_spots_is_baked_as_if_there_were_none():
    scene = box([matte(0.5)] * 3 + [matte(0.7, 0.3)] + [matte(0.5)] * 2)
    for quality in ("draft", "normal"):
        one, other = (bake(scene, density=20, quality=q) for q in (quality, without(quality)))
        assert one.irradiance.tobytes() == other.irradiance.tobytes()


def test_spots_are_what_is_few_and_far_brighter_than_where_it_is_seen():
    area, around, radiosity = np.ones(1000, np.float32), np.ones(1000), np.ones(1000)
    assert not len(bright(radiosity, around, area))
    radiosity[[7, 500]] = 1000.0
    np.testing.assert_array_equal(bright(radiosity, around, area), [7, 500])
    radiosity[100:115] = 2000.0  # no more than a hundredth of all surface
    np.testing.assert_array_equal(bright(radiosity, around, area), np.arange(100, 110))
    around[100:115] = 1000.0  # where it is bright
    np.testing.assert_array_equal(bright(radiosity, around, area), [7, 500])
    around[7] = 0.0  # where nobody sees it
    np.testing.assert_array_equal(bright(radiosity, around, area), [500])


def test_leaves_about_a_lamp_do_not_take_more_rows_than_there_is_room_for():
    """Each of them would be a patch of its own."""
    rng = np.random.default_rng(3)
    way = rng.normal(size=(2000, 1, 3))
    middle = 0.5 + way / np.linalg.norm(way, axis=2, keepdims=True) * (0.01 + 0.2 * rng.random((2000, 1, 1)))
    scene = box(matte(0.5))
    scene.add(Mesh((middle + rng.normal(size=(2000, 3, 3)) * 0.004).reshape(-1, 3), np.arange(6000).reshape(-1, 3)), matte(0.8, double_sided=True))
    scene.lights.append(Light("point", intensity=1.0, world_from_light=translation((0.5, 0.5, 0.5))))
    baked = bake(scene, density=10, quality="draft", transport=True)
    spots = len(baked.transport.spot_starts) - 1
    assert 100 < spots <= most_spot_rows(len(baked.transport.area), QUALITIES["draft"]) == 192
    luxels = baked.luxels
    sides = (luxels.area * (1 + luxels.two_sided))[:, None] * (1 - luxels.albedo) * baked.irradiance
    assert sides.sum() / 3 == pytest.approx(4 * np.pi, rel=0.06)  # all is absorbed that the lamp gives; backs have the light of fronts, on the mean


def test_a_brighter_room_elsewhere_takes_no_spots_from_a_dim_one():
    """A closed room, alone and beside a closed one that is a thousand times as bright."""
    scene = lit_ceiling()
    alone = bake(scene, density=20)
    box([matte(0.5)] * 3 + [matte(0.7, 5.0)] + [matte(0.5)] * 2, (3, 0, 0), (4, 1, 1), scene)
    both = bake(scene, density=20)
    place = [np.c_[baked.luxels.position, baked.luxels.face_normal] for baked in (alone, both)]  # charts may lie otherwise
    apart, same = KDTree(place[1]).query(place[0])
    chosen = alone.valid & (apart < 0.01)
    assert chosen.mean() > 0.9
    truth, found = alone.irradiance[chosen], both.irradiance[same[chosen]]
    assert np.sqrt(((found - truth) ** 2).mean()) < 0.03 * truth.mean()
    assert abs(found.mean() / truth.mean() - 1) < 0.005


def test_the_ledger_holds(kept):
    assert len(kept.transport.spot_element)
    for step in kept.ledger:
        np.testing.assert_allclose(step.absorbed + step.escaped + step.unshot, step.emitted, rtol=1e-6)
        assert (np.abs(step.escaped) < 1e-3 * step.emitted).all()
    assert kept.finished


def test_the_same_bytes_for_any_number_of_threads():
    one, two, four = (bake(lit_ceiling(), density=16, quality="normal", threads=n) for n in (1, 2, 4))
    assert one.irradiance.tobytes() == two.irradiance.tobytes() == four.irradiance.tobytes()


def test_an_interrupted_bake_resumes_to_the_same_bytes(tmp_path):
    state, options = tmp_path / "state", {"density": 16, "quality": "normal"}

    def stop(unshot, progress):
        if len(progress.state.ledger) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bake(lit_ceiling(), checkpoint=state, progress=stop, **options)
    resumed = bake(lit_ceiling(), checkpoint=state, resume=True, **options)
    assert resumed.irradiance.tobytes() == bake(lit_ceiling(), **options).irradiance.tobytes()


def test_what_is_kept_gives_what_the_bake_gave(kept, tmp_path):
    error = (kept.transport.solve(tolerance=1e-5) - kept.irradiance)[kept.valid]
    assert np.sqrt((error**2).mean()) < 0.005 * kept.irradiance[kept.valid].mean()
    kept.transport.save(tmp_path / "kept.npz")
    np.testing.assert_array_equal(Transport.load(tmp_path / "kept.npz").solve(), kept.transport.solve())


def test_layers_sum_to_the_whole(kept):
    assert list(kept.layers) == ["beam", "beam 2"]
    np.testing.assert_allclose(sum(kept.layers.values()), kept.irradiance, rtol=1e-5)


def test_other_colours_give_what_a_bake_with_them_gives(kept):
    scene = lit_ceiling()
    for material in scene.materials:
        material.base_color = (0.3, 0.3, 0.3, 1.0)
    other = bake(scene, density=20, quality=ALIKE)
    relit = kept.transport.solve(albedo=np.full_like(kept.transport.albedo, 0.3))
    error = (relit - other.irradiance)[other.valid]
    assert np.sqrt((error**2).mean()) < 0.005 * other.irradiance[other.valid].mean()


@pytest.mark.parametrize("change", [{"light_resolution": 256}, {"resolution": 7}, {"light_resolution": 0}])
def test_what_the_rasteriser_cannot_draw_a_hemicube_with_is_named(change):
    with pytest.raises(InputError, match=f"quality: expected an even {next(iter(change))} from 2 to 128, got {next(iter(change.values()))}"):
        bake(cornell_box(), density=5, quality=QUALITIES["draft"]._replace(**change))
