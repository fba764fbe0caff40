"""piglit's multisample accuracy: coverage against a reference of 16 x 16 samples a pixel, and against exact areas."""

from itertools import pairwise

import numpy as np
import pytest
from pipeline import pixel_camera

import luxel
from luxel import Material, Mesh, Scene

SIZE = 96, 72
WHITE = Material(base_color=(1, 1, 1, 1), shading="unlit", double_sided=True)
LIMIT = {n: 0.333 * 0.62 ** np.log2(n) for n in (1, 2, 4, 8, 16)}


def flat(points, triangles):
    """A white scene of points (n, 2) in pixels, y down, and a camera that shows them as they are."""
    points = np.asarray(points, float)
    positions = np.stack([points[:, 0], SIZE[1] - points[:, 1], 0 * points[:, 0]], 1)
    return Scene.from_mesh(Mesh(positions, np.asarray(triangles)), WHITE), pixel_camera(SIZE)


def star(seed):
    """A star of thin and fat triangles, as in piglit's test: edges at all angles."""
    rng = np.random.default_rng(seed)
    count = 24
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    radius = np.where(np.arange(count) % 2, rng.uniform(4, 12, count), rng.uniform(20, 46, count))
    points = np.stack([np.cos(angle), np.sin(angle)], 1) * radius[:, None] * [1, 0.72] + np.array(SIZE) / 2
    points = np.concatenate([[np.array(SIZE) / 2], points])
    return flat(points, [[0, 1 + k, 1 + (k + 1) % count] for k in range(count)])


def coverage(scene, camera, **options):
    return luxel.render(scene, camera, SIZE, outputs=("linear",), **options).linear[..., 3].astype(np.float64)


def reference(scene, camera):
    """16 x 16 samples a pixel: a picture 16 times as large, averaged."""
    large = luxel.render(scene, camera, (SIZE[0] * 16, SIZE[1] * 16), outputs=("linear",)).linear[..., 3]
    return large.reshape(SIZE[1], 16, SIZE[0], 16).mean((1, 3), dtype=np.float64)


def errors(have, want):
    edge = (want > 0) & (want < 1)
    return np.sqrt(np.mean((have - want)[edge] ** 2)), np.sqrt(np.mean((have - want)[~edge] ** 2)), edge.sum()


@pytest.mark.parametrize("samples", LIMIT)
def test_error_is_within_piglits_limits(samples):
    for seed in range(3):
        scene, camera = star(seed)
        at_edges, elsewhere, count = errors(coverage(scene, camera, samples=samples), reference(scene, camera))
        assert count > 400
        assert at_edges <= LIMIT[samples]
        assert elsewhere <= LIMIT[samples] / 10


def test_error_falls_with_every_doubling():
    scene, camera = star(7)
    want = reference(scene, camera)
    found = [errors(coverage(scene, camera, samples=n), want)[0] for n in LIMIT]
    assert all(b < 0.8 * a for a, b in pairwise(found))
    assert errors(coverage(scene, camera, ssaa=8), want)[0] < found[-1]
    assert errors(coverage(scene, camera, samples=4, pattern="grid"), want)[0] < found[1]


def area_below(slope, height, x, y):
    """Area of the unit pixel at (x, y) that lies below (at larger y than) the line `height + slope * x`, by fine integration over x."""
    steps = (np.arange(4000) + 0.5) / 4000
    return np.clip(y + 1 - (height + slope * (x + steps)), 0, 1).mean()


@pytest.mark.parametrize("samples", [1, 4, 16])
def test_a_half_plane_has_its_exact_area(samples):
    slope, height = 0.37, 20.3
    scene, camera = flat([[-50, height - 50 * slope], [150, height + 150 * slope], [150, 400], [-50, 400]], [[0, 2, 1], [0, 3, 2]])
    have = coverage(scene, camera, samples=samples)
    want = np.array([[area_below(slope, height, x, y) for x in range(SIZE[0])] for y in range(SIZE[1])])
    edge = (want > 0) & (want < 1)
    assert np.array_equal(have[~edge], want[~edge])
    assert np.abs(have - want)[edge].max() <= {1: 0.51, 4: 0.26, 16: 0.1}[samples]
    assert abs(have.sum() - want.sum()) < 0.02 * edge.sum() * 4 / np.sqrt(samples)


@pytest.mark.parametrize("samples", [2, 4, 8, 16])
def test_adjacent_triangles_leave_no_seam(samples):
    """Alpha is whole inside a fan, at every pixel that its inner edges cross."""
    scene, camera = star(1)
    fan = luxel.render(scene, camera, SIZE, outputs=("linear",), samples=samples).linear
    want = reference(scene, camera)
    assert (fan[want == 1] == 1).all()
    assert set(np.unique(np.round(fan[..., 3] * samples, 4))) <= set(range(samples + 1))


@pytest.mark.parametrize("n", [2, 4, 8])
def test_supersampling_equals_a_larger_picture_averaged(n):
    """Corners at multiples of 1/16 pixel, which both pictures hold exactly."""
    rng = np.random.default_rng(n)
    points = rng.integers(-40, np.array(SIZE) * 16 + 40, (90, 2)) / 16
    scene, camera = flat(points, np.arange(90).reshape(-1, 3))
    mesh = scene.meshes[0]
    mesh.positions[:, 2] = rng.uniform(-0.9, 0.9, 90)
    mesh.colors = np.concatenate([np.repeat(rng.random((30, 3), np.float32), 3, 0), np.ones((90, 1), np.float32)], 1)
    have = luxel.render(scene, camera, SIZE, outputs=("linear",), ssaa=n, background=(0.2, 0.1, 0.4)).linear
    large = luxel.render(scene, camera, (SIZE[0] * n, SIZE[1] * n), outputs=("linear",), background=(0.2, 0.1, 0.4)).linear
    want = large.reshape(SIZE[1], n, SIZE[0], n, 4).mean((1, 3), dtype=np.float64)
    assert np.allclose(have, want, atol=2e-6)
