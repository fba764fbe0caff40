"""The same bytes for ids and depth whatever the machine does: through the whole renderer, and with Numba switched off."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import UNLIT, around, room

import luxel
from luxel import Material, Mesh, Scene

NAMES = ("triangle", "depth", "object", "material")
CAMERAS = {
    "outside": around(1.0), "inside": around(2.0, 0.3, near=0.05, far=3.0), "orthographic": around(0.2, yfov=None, height=3.0, far=9.0),
}  # fmt: skip


def digest(picture):
    total = hashlib.sha256()
    for name in NAMES:
        total.update(np.ascontiguousarray(getattr(picture, name)).tobytes())
    return total.hexdigest()


def random_scene(count=4000, seed=0):
    rng = np.random.default_rng(seed)
    centre = rng.normal(size=(count, 1, 3))
    size = 10.0 ** rng.uniform(-3, -0.3, (count, 1, 1))
    positions = (centre + size * rng.normal(size=(count, 3, 3))).reshape(-1, 3)
    return Scene.from_mesh(Mesh(positions, np.arange(3 * count).reshape(-1, 3)), Material(**UNLIT))


@pytest.mark.parametrize("samples", [1, 2, 4, 8, 16])
@pytest.mark.parametrize("camera", CAMERAS)
def test_tiles_and_threads(samples, camera):
    camera = CAMERAS[camera]
    scene, found = luxel.prepare(random_scene()), set()
    for tile in (8, 16, 32, 64, 128):
        for threads in (1, 2):
            found.add(digest(luxel.render(scene, camera, (97, 81), samples=samples, tile=tile, threads=threads, outputs=NAMES)))
    assert len(found) == 1


@pytest.mark.parametrize("samples", [1, 8])
def test_order_of_triangles_vertices_and_meshes(samples):
    """Any order of triangles, of vertices and of the parts of a scene shows the same triangle at every sample (all depths differ)."""
    base, camera = random_scene(1500, 1), around(0.7)
    mesh = base.meshes[0]
    want = luxel.render(base, camera, (90, 70), samples=samples, outputs=("triangle", "depth"))
    assert len(np.unique(want.triangle)) > 100
    rng = np.random.default_rng(2)
    for _ in range(3):
        order, vertices = rng.permutation(len(mesh.triangles)), rng.permutation(len(mesh.positions))
        place = np.empty(len(vertices), np.int32)
        place[vertices] = np.arange(len(vertices))
        triangles = place[mesh.triangles[order]]
        cuts = np.sort(rng.integers(1, len(order), 3))
        scene = Scene()
        for part in np.split(triangles, cuts):
            scene.add(Mesh(mesh.positions[vertices], part), base.materials[0])
        have = luxel.render(scene, camera, (90, 70), samples=samples, outputs=("triangle", "depth"), threads=2)
        assert np.array_equal(have.depth.view(np.int32), want.depth.view(np.int32))
        assert np.array_equal(np.append(order, -1)[have.triangle], want.triangle)


def test_ids_do_not_depend_on_what_is_asked_for():
    """Nor on whether colour is drawn, by which shading, or with which filter."""
    scene, camera = room(2), around()
    want = luxel.render(scene, camera, (80, 60), samples=4, outputs=NAMES)
    for options in ({}, {"outputs": ("linear", "motion", "normal", *NAMES)}, {"filter": "tent"}, {"shading": "unlit"}, {"shading": "gouraud"}):
        assert digest(luxel.render(scene, camera, (80, 60), samples=4, **{"outputs": ("color", *NAMES), **options})) == digest(want)
    for name in NAMES:
        alone = getattr(luxel.render(scene, camera, (80, 60), samples=4, outputs=name), name)
        assert np.array_equal(alone.view(np.int32), getattr(want, name).view(np.int32))


def test_a_moved_window_of_samples():
    """SSAA's ids come from its first sample, as those of a pattern that has only that one."""
    scene, camera = luxel.prepare(random_scene(800, 4)), around()
    want = luxel.render(scene, camera, (60, 50), ssaa=4, outputs=NAMES)
    large = luxel.render(scene, camera, (240, 200), outputs=("triangle",)).triangle[::4, ::4]
    assert (large == want.triangle).mean() > 0.98  # the larger picture's corners snap four times as finely


CODE = """
import sys
sys.path.insert(0, {folder!r})
import luxel
from luxel import jit
from test_invariance import NAMES, digest, random_scene
from scenes import around, room
assert jit.DISABLED == {disabled}
camera = around(1.0, 2.0, near=0.5)
picture = luxel.render(random_scene(60, 3), camera, (20, 17), samples=4, tile=8, threads=2, outputs=("color", *NAMES))
print(digest(picture), picture.color.tobytes().hex())
print(digest(luxel.render(room(1), around(0.3, 2.0, near=1.0), (12, 10), samples=2, tile=8, outputs=NAMES)))
"""


def test_without_compiled_kernels():
    """Plain Python gives the same bytes, near-plane clipping and masks included."""
    found = []
    for disabled in (False, True):
        environment = os.environ | {"NUMBA_DISABLE_JIT": str(int(disabled))}
        code = CODE.format(folder=str(Path(__file__).parent), disabled=disabled)
        done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr[-3000:]
        found.append(done.stdout.split())
    assert len(found[0]) == 3
    assert found[0] == found[1]
