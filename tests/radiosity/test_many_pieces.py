"""Very many small pieces: charts of a texel, and lights."""

import numpy as np
import pytest
from closed import box, matte

from luxel import Light, LuxelWarning, Mesh, Scene
from luxel.radiosity.bake import bake
from luxel.radiosity.inside import seen_backs
from luxel.scene.transforms import translation


@pytest.fixture(scope="module")
def lamp_room():
    scene = box([matte((0.6, 0.1, 0.1)), matte(0.5), matte(0.5), matte(0.7, (0.3, 0.2, 0.1)), matte(0.5), matte((0.1, 0.6, 0.1))])
    box(matte(0.4), (0.3, 0.0, 0.3), (0.6, 0.4, 0.6), scene, inward=False, skip=(2,))
    return scene


def test_thousands_of_tiny_charts_are_lit_like_any_other():
    """Loose triangles much smaller than a luxel: each has one, and what it sees of an even sky is between nothing and all."""
    rng = np.random.default_rng(5)
    corners = rng.random((2000, 1, 3)) + rng.normal(size=(2000, 3, 3)) * 0.01
    scene = Scene()
    scene.add(Mesh(corners.reshape(-1, 3), np.arange(6000).reshape(-1, 3)), matte(0.5))
    baked = bake(scene, quality="draft", density=15, sky=1.0)
    assert baked.finished
    assert len(baked.luxels.area) >= 2000
    light = baked.irradiance[baked.valid]
    assert light.min() >= 0
    assert light.max() <= np.pi * 1.01  # what is passed on is scaled, by tenths of a per cent, so that none is lost
    assert 0.4 * np.pi < light.mean() < np.pi  # the soup is thin


def test_each_of_tens_of_thousands_of_tiny_charts_has_its_own_light(monkeypatch):
    """Confetti about a lamp in a black room: each piece has a texel of its own, and in it, if no other is before it, I cos / d^2."""
    monkeypatch.setattr("luxel.radiosity.prepare.seen_backs", lambda *given: (asked.append(len(given[2])), seen_backs(*given))[1])
    monkeypatch.setattr("luxel.radiosity.charts.MOST_CHARTED", 10_000)
    rng, count, asked, lamp = np.random.default_rng(6), 20_000, [], np.array([0.5, 1.0, 2.0])
    middle = rng.uniform(-1, 1, (count, 1, 3))
    corners = (middle + rng.normal(size=(count, 3, 3)) * 0.001).astype(np.float32)
    scene = box(matte(0.0), (-3, -3, -3), (3, 3, 3))
    scene.add(Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)), matte(0.5, double_sided=True))
    scene.lights.append(Light("point", intensity=5.0, world_from_light=translation(lamp)))
    with pytest.warns(LuxelWarning) as told:
        baked = bake(scene, quality="draft", density=4, page=256)
    words = sorted(str(warning.message) for warning in told)
    assert len(words) == 2
    assert "20,000 separate pieces are smaller than a texel: each gets one luxel" in words[0]
    assert "most of the surface is black" in words[1]

    luxels, tiny = baked.luxels, baked.luxels.two_sided
    charts = np.bincount(luxels.chart[tiny])
    assert tiny.sum() == count == (charts == 1).sum() == (charts > 0).sum()
    assert len(np.unique(luxels.texel, axis=0)) == len(luxels.texel) == count + 6 * 24 * 24
    assert not len(luxels.contested)
    assert not len(luxels.lost)
    assert baked.atlas.pages == 3  # a texel and two free ones between, and the walls
    assert asked == [6 * 24 * 24]  # what has two sides is in no solid

    light, direct = baked.irradiance, baked.direct[tiny, 0].astype(np.float64)
    assert np.isfinite(light).all()
    assert light.min() >= 0
    assert np.isfinite(baked.pages).all()
    way = lamp - luxels.position[tiny].astype(np.float64)
    distance = np.linalg.norm(way, axis=1)
    cosine = (luxels.face_normal[tiny] * way).sum(1) / distance
    faces = cosine > 0.05  # at a more grazing angle rounding tells
    assert 0.46 * count < faces.sum() < 0.49 * count
    quarters = 4 * direct[faces] / (5.0 * cosine / distance**2)[faces]  # of each piece the lamp shines on so many
    np.testing.assert_allclose(quarters, np.round(quarters), atol=0.04)
    assert 0.97 < (quarters > 3.96).mean() < 1
    assert not direct[cosine < -0.001].any()
    np.testing.assert_allclose(light[tiny].mean(), direct.mean(), rtol=0.01)  # the room sends nothing back, and they but little


def test_very_many_small_lights_are_said(lamp_room, recwarn):
    """And a lamp of one piece is not."""
    rng = np.random.default_rng(4)
    corners = 0.2 + 0.6 * rng.random((2700, 1, 3)) + rng.normal(size=(2700, 3, 3)) * 0.003
    scene = Scene()
    scene.add(Mesh(corners.reshape(-1, 3), np.arange(8100).reshape(-1, 3)), matte(0.5, 1.0))
    with pytest.warns(LuxelWarning, match=r"2,[67][0-9]{2} small surfaces glow apart from each other, and each shoots its light for itself"):
        baked = bake(box(matte(0.5), scene=scene), quality="draft", density=4)
    assert baked.ledger[-1].shots >= 2600
    assert baked.irradiance.mean() > 0
    recwarn.clear()
    bake(lamp_room, quality="draft", density=4)
    assert not len(recwarn)
