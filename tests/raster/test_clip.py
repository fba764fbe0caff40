"""Clipping: pieces that make up exactly the visible part of their source."""

import numpy as np
import pytest
from pipeline import drawn, jittered_grid, pixel_camera, view_of

from luxel.raster.bin import NO_CLIPPED
from luxel.raster.clip import clip
from luxel.raster.constants import GUARD_HIGH, GUARD_LOW
from luxel.raster.project import Window, project
from luxel.scene.camera import Camera

SIZE = 64, 48


def cameras():
    for seed in range(8):
        rng = np.random.default_rng(seed)
        eye = rng.normal(size=3)
        far = rng.choice([2.5, np.inf])
        yield Camera.look_at(eye, eye + rng.normal(size=3), yfov=rng.choice([0.02, 1.0, 2.5]), near=rng.choice([0.01, 0.3]), far=far)
    yield Camera.look_at([0.1, 0.2, 0.3], [0, 0, 0], yfov=None, height=3e-4, near=-0.4, far=0.6)


def triangles_around(seed, count=300):
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(3 * count, 3)).astype(np.float32) * rng.choice([0.5, 3.0], (3 * count, 1)).astype(np.float32)
    return positions, np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def area(points):
    """Areas of triangles (k, 3, d) by Heron-free Gram determinant."""
    u, v = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    return 0.5 * np.sqrt(np.maximum((u * u).sum(1) * (v * v).sum(1) - (u * v).sum(1) ** 2, 0))


def planes(camera, size=SIZE):
    """Rows whose product with a clip-space position is >= 0 within the six planes."""
    left, right, bottom, top = Window(0, 0, *size, *size).guard()
    least = view_of(camera, size).least_depth
    return np.array([[0, 0, -1, 1], [0, 0, 1, -least], [1, 0, 0, -left], [-1, 0, 0, right], [0, 1, 0, -bottom], [0, -1, 0, top]])


def clipped_area(corners, inside):
    """Area of a triangle's part within planes over its own barycentric coordinates, by cutting a polygon of doubles: (3, planes)."""
    polygon = [np.array(p, float) for p in ((0, 0), (1, 0), (0, 1))]
    for plane in inside:  # distance = plane . (1 - u - v, u, v)
        value = [plane @ (1 - p[0] - p[1], p[0], p[1]) for p in polygon]
        cut = []
        for i, p in enumerate(polygon):
            j = (i + 1) % len(polygon)
            if value[i] >= 0:
                cut.append(p)
            if (value[i] >= 0) != (value[j] >= 0):
                cut.append(p + value[i] / (value[i] - value[j]) * (polygon[j] - p))
        polygon = cut
        if len(polygon) < 3:
            return 0.0
    x, y = np.array(polygon).T
    return abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@pytest.mark.parametrize("number", range(9))
def test_pieces_partition_their_source(number):
    """Their areas in the source's barycentric coordinates sum to that of the visible part, and they do not turn round."""
    camera = list(cameras())[number]
    positions, triangles = triangles_around(number)
    found = drawn(positions, triangles, camera, SIZE)
    matrix, inside = camera.clip_from_world(SIZE), planes(camera)
    pieces = found.clipped.corners.astype(np.float64)
    assert len(pieces) > 20
    assert np.allclose(pieces.sum(-1), 1, atol=1e-6)
    assert pieces.min() >= -1e-6
    u, v = pieces[:, 1, 1:] - pieces[:, 0, 1:], pieces[:, 2, 1:] - pieces[:, 0, 1:]
    signed = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    assert signed.min() >= -1e-6
    have = np.bincount(found.clipped.source, signed, len(triangles))
    clip_space = np.concatenate([positions, np.ones((len(positions), 1))], 1) @ matrix.T
    unsafe = np.setdiff1d(np.arange(len(triangles)), found.source[: len(found.source) - len(pieces)])
    want = np.zeros(len(triangles))
    for t in unsafe:
        want[t] = clipped_area(None, inside @ clip_space[triangles[t]].T)
    # Triangles wholly beyond one side of the picture are left out, whatever of them is within the guard band.
    sides = np.array([[1, 0, 0, 1], [-1, 0, 0, 1], [0, 1, 0, 1], [0, -1, 0, 1]])
    beyond = ((sides @ clip_space[triangles].transpose(0, 2, 1)) < 0).all(-1).any(-1)
    assert np.allclose(have[~beyond], want[~beyond], atol=2e-6)
    assert (have[~beyond] > 0).sum() > 5


@pytest.mark.parametrize("number", range(9))
def test_corners_lie_where_the_source_has_them(number):
    """Each piece's place, depth and weight are those of the source's point with its barycentric coordinates."""
    camera = list(cameras())[number]
    positions, triangles = triangles_around(number)
    clipped = drawn(positions, triangles, camera, SIZE).clipped
    points = np.einsum("kcj,kjd->kcd", clipped.corners.astype(np.float64), positions[triangles[clipped.source]].astype(np.float64))
    x, y, z, w = np.moveaxis(np.concatenate([points, np.ones((*points.shape[:2], 1))], -1) @ camera.clip_from_world(SIZE).T, -1, 0)
    floats = clipped.screen.view(np.float32)
    fine = w > 0.05 if camera.yfov else w > 0  # closer, float32 barycentric coordinates say too little
    assert fine.sum() > 20
    assert np.allclose(floats[..., 3][fine], 1 / w[fine], rtol=1e-3)
    assert np.allclose(floats[..., 2][fine], z[fine] / w[fine], rtol=1e-3, atol=1e-4)
    scale = 64 if camera.yfov == 0.02 or camera.yfov is None else 2
    at = np.stack([(x / w + 1) * SIZE[0] / 2, (1 - y / w) * SIZE[1] / 2], -1)
    assert np.allclose(clipped.screen[..., :2][fine] / 256, at[fine], rtol=1e-3, atol=scale)
    assert clipped.screen[..., :2].min() >= GUARD_LOW
    assert clipped.screen[..., :2].max() <= GUARD_HIGH
    assert floats[..., 2].min() >= 0
    assert floats[..., 2].max() <= 1


def test_sources_ascend_and_threads_change_nothing():
    camera = Camera.look_at([0, 0, 0], [1, 0.2, 0.1], near=0.3)
    positions, triangles = triangles_around(1, 5000)
    one, three = (drawn(positions, triangles, camera, SIZE, threads=n).clipped for n in (1, 3))
    assert (np.diff(one.source) >= 0).all()
    assert all(np.array_equal(a, b) for a, b in zip(one, three, strict=True))


@pytest.mark.parametrize("size", [1, 65535, 65536, 65537])
def test_meshes_around_the_size_of_a_chunk(size):
    """The last triangle alone is unsafe."""
    positions = np.array([[0, 0, -2], [1, 0, -2], [0, 1, -2], [0, 0, 5]], np.float32)
    triangles = np.tile(np.array([[0, 1, 2]], np.int32), (size, 1))
    triangles[-1] = 0, 1, 3
    found = drawn(positions, triangles, Camera(), SIZE, threads=2)
    assert set(found.clipped.source.tolist()) == {size - 1}


def test_what_cannot_be_seen_makes_no_pieces():
    camera = Camera(near=0.5, far=20.0)
    behind = [[0, 0, 1], [1, 0, 1], [0, 1, 3]]
    beyond = [[0, 0, -30], [1, 0, -30], [0, 1, -60]]
    too_near = [[0, 0, -0.1], [1, 0, -0.2], [0, 1, -0.4]]
    beside = [[9e5, 0, -1], [9e5, 1, -1], [8e5, 1, -1]]
    for triangle in (behind, beyond, too_near, beside):
        assert len(drawn(triangle, [[0, 1, 2]], camera, SIZE).source) == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 3e38])
def test_triangles_with_impossible_vertices_are_dropped(bad):
    """Or, where the coordinate is merely enormous, drawn without harm."""
    for axis in range(3):
        positions = np.array([[0, 0, -2], [1, 0, -2], [0, 1, -2], [0, 0, -3]], np.float32)
        positions[3, axis] = bad
        found = drawn(positions, [[0, 1, 2], [0, 1, 3], [3, 2, 1]], Camera(), SIZE)
        assert (found.source == 0).sum() == 1
        if not np.isfinite(bad):
            assert len(found.source) == 1
        assert np.isfinite(found.depths).all()
        assert np.abs(found.corners).max() <= GUARD_HIGH


def test_a_plane_exactly_at_the_far_or_the_near_one_stays_whole():
    points, triangles = jittered_grid(np.random.default_rng(0), 3, 3)
    for camera, z in ((pixel_camera(SIZE), 1), (pixel_camera(SIZE), -1), (Camera(near=1.0, far=2.0), -1), (Camera(near=1.0, far=2.0), -2)):
        positions = np.concatenate([points, np.full((len(points), 1), z)], 1)
        found = drawn(positions, triangles, camera, SIZE)
        assert found.unsafe == 0
        assert len(found.source) == len(triangles)


def test_cutting_at_the_near_plane_leaves_a_triangle_or_a_quad():
    camera = Camera(near=1.0)
    one = drawn([[0, 0, -3], [1, 0, -3], [0, 0, 1]], [[0, 1, 2]], camera, SIZE)
    two = drawn([[0, 0, -3], [1, 0, 1], [0, 0, 1]], [[0, 1, 2]], camera, SIZE)
    assert [len(one.source), len(two.source)] == [2, 1]
    assert np.isclose(two.depths.max(), 1)
    assert one.unsafe == 1


def test_nothing_to_cut():
    positions, triangles = np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32)
    camera = Camera(near=0.5)
    positions[:, 2] = -2
    view, window = view_of(camera, SIZE), Window(0, 0, *SIZE, *SIZE)
    assert clip(positions, triangles, project(positions, view, window, 1)[0], view, window, 2) is NO_CLIPPED
