"""Plain surfaces have a loop of their own: the bytes are those of the loops that it stands for."""

import numpy as np
import pytest
from scenes import around

import luxel
from luxel import Ambient, Light, Material, Mesh, Scene
from luxel.raster import frame, shade
from luxel.raster.plain import is_plain
from luxel.scene.builtin import shapes

DULL = {"specular": (0.0, 0.0, 0.0), "shading": "phong"}


def scene(materials=3, **rest):
    """Diffuse shapes of several colours, fine and coarse, some of them mirrored, under a sky and one directional light."""
    rng = np.random.default_rng(5)
    made = Scene(ambient=Ambient((0.2, 0.3, 0.5), (0.1, 0.05, 0.02)), lights=[Light(intensity=2.0, color=(1.0, 0.8, 0.6))])
    for i, mesh in enumerate((shapes.sphere(0.6, 96), shapes.box(), shapes.torus(0.7, 0.2, 24, 12), shapes.plane(1.5, 1.5, 3, 3))):
        turn = np.eye(4)
        turn[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn[:3, 3] = rng.uniform(-0.8, 0.8, 3)
        color = rng.random(3) if i % materials else (0.9, 0.9, 0.9)
        made.add(Mesh(mesh.positions, mesh.triangles, mesh.normals), Material((*color, 1.0), double_sided=True, **{**DULL, **rest}), turn)
    return made


def plainly(drawn, camera):
    prepared = luxel.prepare(drawn)
    seen = frame.see(prepared, camera, (64, 64), None, 1)
    return is_plain(prepared.geometry, prepared.materials, seen.lights, seen.features)


@pytest.mark.parametrize("samples", [1, 2, 4, 8, 16])
@pytest.mark.parametrize("materials", [1, 3])
def test_the_same_bytes_as_the_general_loops(samples, materials, monkeypatch):
    drawn, camera = scene(materials), around(0.4, 2.6, near=0.3)
    assert plainly(drawn, camera)
    for options in ({}, {"background": (0.2, 0.1, 0.4, 0.5), "exposure": 0.7, "tile": 16, "threads": 2}):
        have = luxel.render(drawn, camera, (150, 110), samples=samples, **options).color
        with monkeypatch.context() as patch:
            patch.setattr(shade, "is_plain", lambda *_: False)
            want = luxel.render(drawn, camera, (150, 110), samples=samples, **options).color
        assert np.array_equal(have, want)
        assert len(np.unique(have.reshape(-1, 4), axis=0)) > 500


@pytest.mark.parametrize(
    "other",
    [{"specular": (0.2, 0.2, 0.2)}, {"emissive": (1.0, 0.0, 0.0)}, *({"shading": name} for name in ("flat", "unlit", "gouraud", "pbr"))],
    ids=lambda other: "_".join(map(str, [*other, *other.values()])),
)
def test_what_is_not_plain(other):
    assert not plainly(scene(**other), around(0.4))


def test_lights_that_are_not_plain():
    for lights in ([], [Light("point")], [Light(), Light()]):
        made = scene()
        made.lights[:] = lights
        assert not plainly(made, around(0.4))
