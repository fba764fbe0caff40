"""Run by test_simulator.py: pictures by the kernels themselves, in Numba's simulator, which has to be switched on before numba.cuda is imported."""

import sys

import numpy as np
from gpu_drawing import EVERYTHING, assert_same, both, camera, plain, textured

import luxel
from luxel.cuda.device import gpu

SIZE = 12, 9


def opaque():
    scene = textured(1, (0, 3), 5)
    assert_same(*both(gpu(), scene, [camera(5), camera(0.5)], SIZE, samples=2, split=(6, 8), outputs=EVERYTHING, previous=camera(4)))


def masked_and_blended():
    assert_same(*both(gpu(), textured(2, (1, 2), 5), [camera(3)], SIZE, split=(6, 8), filter="tent", outputs=("color", "linear")))


def pieces():
    """Triangles of every mode that are clipped."""
    assert_same(*both(gpu(), textured(3, (0, 1, 2), 4), [camera(0.1)], SIZE, outputs=("triangle", "depth", "color")))


def lit_at_vertices():
    assert_same(*both(gpu(), plain(4, 6), [camera(4), camera(3)], SIZE, shading="gouraud", ssaa=2))


def by_render():
    scene, views = plain(5, 6), [camera(4), camera(3)]
    prepared = luxel.prepare(scene, device="cuda")
    ours, theirs = luxel.render_views(scene, views, SIZE), luxel.render_views(prepared, views, SIZE)
    assert_same(list(ours), list(theirs))
    kept = luxel.render(prepared, views[0], SIZE, on_device=True)
    assert_same([luxel.render(prepared, views[0], SIZE, device="cpu")], [kept])
    np.testing.assert_array_equal(np.from_dlpack(kept.color), np.asarray(kept.color))


def relit():
    from luxel.radiosity.bake import bake
    from luxel.scene.builtin import cornell_box

    transport = bake(cornell_box(), density=2, transport=True).transport
    light = transport.solve(device="cuda", tolerance=1e-3)
    np.testing.assert_allclose(light, transport.solve(tolerance=1e-5), rtol=5e-3, atol=5e-3 * light.max())


def baked():
    """Looked around, lit by a lamp, a light and a sky, gathered; and the brightest patches first."""
    from luxel.cuda import labour
    from luxel.radiosity.bake import bake
    from luxel.radiosity.quality import Quality
    from luxel.scene.builtin import cornell_box

    scene = cornell_box()
    scene.lights = [luxel.Light("directional", intensity=0.3)]
    looking = Quality(2, 16, 1, 4, 4, tolerance=0.1)
    shooting = Quality(2, 16, 0, 0, 0, tolerance=0.5, patch=40, resolution=16)
    for number, quality in enumerate((looking, looking._replace(gathered=0, unlike=1.0), shooting)):
        labour._FEW_TRIANGLES, sky = (1000, 0.5) if number == 0 else (0, None)  # first by warps
        ours, theirs = (bake(scene, density=1.2, sky=sky, quality=quality, device=device) for device in ("cpu", "cuda"))
        np.testing.assert_allclose(theirs.irradiance, ours.irradiance, rtol=1e-5, atol=1e-5 * ours.irradiance.max())
        assert len(theirs.ledger) == len(ours.ledger)


def form_factors():
    """With pairs that something stands between."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    meshes = [luxel.Mesh(corners * size + (0, 0, z), np.array([[0, 1, 2]], np.int32)) for size, z in ((1, 0), (0.5, 0.5), (1, 1))]
    ours, theirs = (luxel.form_factors(meshes, tolerance=0.5, device=device) for device in ("cpu", "cuda"))
    alone = luxel.form_factors([meshes[0], meshes[2]], tolerance=0.5)
    assert 0 < ours[0, 2] < 0.9 * alone[0, 1]  # hidden in part
    np.testing.assert_array_equal(ours.indices, theirs.indices)
    np.testing.assert_allclose(theirs.data, ours.data, rtol=1e-12)


if __name__ == "__main__":
    with np.errstate(all="ignore"):
        globals()[sys.argv[1]]()
    print("same")
