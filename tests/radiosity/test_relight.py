import itertools
import math

import numpy as np
import pytest
from closed import box, matte

from luxel import FileError, InputError, Light, Transport
from luxel.radiosity.bake import bake
from luxel.radiosity.quality import QUALITIES
from luxel.scene.transforms import look_at

ALIKE = QUALITIES["normal"]._replace(unlike=math.inf)
"""Without the closer look of the last bounce, which what is kept does not have."""


@pytest.fixture(scope="module")
def baked():
    scene = box([matte((0.6, 0.1, 0.1)), matte(0.5), matte(0.5), matte(0.7, (0.3, 0.2, 0.1)), matte(0.5), matte((0.1, 0.6, 0.1))])
    box(matte(0.4, (0.0, 0.0, 0.2)), (0.3, 0.0, 0.3), (0.6, 0.4, 0.6), scene, inward=False, skip=(2,))
    scene.lights.append(Light("point", (1, 1, 1), 0.2, look_at((0.8, 0.8, 0.8), (0, 0, 0)), name="bulb"))
    return bake(scene, density=20, quality=ALIKE, transport=True, layers=True)


def test_it_gives_what_the_bake_gave(baked):
    error = baked.transport.solve() - baked.irradiance
    assert np.sqrt((error[baked.valid] ** 2).mean()) < 0.005 * baked.irradiance[baked.valid].mean()


def test_light_is_linear(baked):
    transport = baked.transport
    assert (transport.solve() >= 0).all()
    twice = transport.solve(transport.emission * 2, still=2.0)
    np.testing.assert_allclose(twice, 2 * transport.solve(), rtol=1e-4, atol=1e-6)
    assert not transport.solve(np.zeros_like(transport.emission), still=0.0).any()


def test_layers_sum_to_the_whole(baked):
    assert len(baked.layers) == 7  # the ceiling, five sides of the block, the bulb
    np.testing.assert_allclose(sum(baked.layers.values()), baked.irradiance, rtol=1e-5)


def test_without_reflection_only_direct_light_is_left(baked):
    black = baked.transport.solve(albedo=np.zeros_like(baked.transport.albedo))
    np.testing.assert_allclose(black[baked.valid], baked.direct[baked.valid], rtol=1e-4, atol=1e-6)


def test_other_colours_give_what_a_bake_with_them_gives(baked):
    scene = box([matte(0.3), matte(0.3), matte(0.3), matte(0.3, (0.3, 0.2, 0.1)), matte(0.3), matte(0.3)])
    box(matte(0.3, (0.0, 0.0, 0.2)), (0.3, 0.0, 0.3), (0.6, 0.4, 0.6), scene, inward=False, skip=(2,))
    scene.lights.append(Light("point", (1, 1, 1), 0.2, look_at((0.8, 0.8, 0.8), (0, 0, 0))))
    other = bake(scene, density=20, quality=ALIKE)
    relit = baked.transport.solve(albedo=np.full_like(baked.transport.albedo, 0.3))
    error = (relit - other.irradiance)[other.valid]
    assert np.sqrt((error**2).mean()) < 0.005 * other.irradiance[other.valid].mean()


def test_a_surface_that_did_not_shine_may_shine(baked):
    emission = np.zeros_like(baked.transport.emission)
    wall = baked.luxels.position[:, 0] < 1e-6
    emission[wall] = 1.0
    lit = baked.transport.solve(emission, still=0.0)
    opposite = (baked.luxels.position[:, 0] > 1 - 1e-6) & baked.valid
    direct = baked.transport.solve(emission, np.zeros_like(emission), still=0.0)
    area = baked.luxels.area[opposite]
    assert np.average(direct[opposite, 0], weights=area) < 0.1999  # the exact factor of opposite faces, less the block's shadow
    assert np.average(direct[opposite, 0], weights=area) > 0.15
    assert (lit[opposite] > direct[opposite]).all()


def test_it_is_the_same_for_any_number_of_threads_and_from_a_file(baked, tmp_path):
    path = tmp_path / "room.transport"
    baked.transport.save(path)
    kept = Transport.load(path)
    assert baked.transport.solve(threads=1).tobytes() == kept.solve(threads=2).tobytes()


@pytest.mark.parametrize(("name", "wrong"), [
    *itertools.product(["still"], [-1.0, math.nan, math.inf]), *itertools.product(["tolerance"], [0.0, -1.0, math.nan]),
])  # fmt: skip
def test_wrong_numbers_are_named(baked, name, wrong):
    with pytest.raises(InputError, match=f"{name}: expected"):
        baked.transport.solve(**{name: wrong})


def test_wrong_values_and_files_are_named(baked, tmp_path):
    with pytest.raises(InputError, match="emission"):
        baked.transport.solve(-np.ones_like(baked.transport.emission))
    with pytest.raises(InputError, match="albedo"):
        baked.transport.solve(albedo=np.ones_like(baked.transport.albedo))
    with pytest.raises(InputError, match="emission"):
        baked.transport.solve(np.ones((3, 3)))
    broken = tmp_path / "broken"
    broken.write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(FileError, match="expected a kept transport"):
        Transport.load(broken)
    with pytest.raises(FileError):
        Transport.load(tmp_path / "none")
