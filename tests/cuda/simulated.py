"""Run by test_simulator.py: pictures by the kernels themselves, in Numba's simulator, which has to be switched on before numba.cuda is imported."""

import sys

import numpy as np
from drawing import EVERYTHING, assert_same, both, camera, plain, textured

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


if __name__ == "__main__":
    with np.errstate(all="ignore"):
        globals()[sys.argv[1]]()
    print("same")
