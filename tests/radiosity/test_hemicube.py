import numpy as np
import pytest

from luxel.radiosity.hemicube import RESOLUTIONS, delta_form_factors, frames_of, see
from luxel.radiosity.nearest import nearest
from luxel.radiosity.occlusion import prepare


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_form_factors_of_the_pixels_sum_to_one(resolution):
    deltas = delta_form_factors(resolution)
    assert deltas.sum() == pytest.approx(1, abs=1e-12)
    assert (deltas >= 0).all()
    assert not deltas[1:, resolution // 2 :].any()


def test_the_middle_pixel_has_its_own_form_factor():
    n = 64
    side = 2 / n
    assert delta_form_factors(n)[0, n // 2, n // 2] == pytest.approx(side * side / np.pi, rel=2e-3)


def test_frames_are_orthonormal_and_right_handed():
    normals = np.random.default_rng(0).normal(size=(1000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    frames = frames_of(np.concatenate([normals, [[0, 0, 1], [0, 0, -1]]])).astype(np.float64)
    assert np.abs(frames @ frames.transpose(0, 2, 1) - np.eye(3)).max() < 1e-6
    assert np.linalg.det(frames) == pytest.approx(1, abs=1e-6)


def directions(resolution):
    """(5, r, r, 3): through the pixels' centres, in the shooter's frame, one unit along the face's axis."""
    at = (np.arange(resolution) + 0.5) / resolution * 2 - 1
    u, v = np.meshgrid(at, -at)
    one = np.ones_like(u)
    faces = [(u, v, one), (one, u, v), (-one, u, v), (u, one, v), (u, -one, v)]
    return np.stack([np.stack(face, -1) for face in faces])


def soup(rng, n):
    """Triangles about the origin, some of them very large."""
    centers = rng.normal(size=(n, 1, 3)) * 3
    corners = centers + rng.normal(size=(n, 3, 3)) * rng.choice([0.2, 1.0, 10.0], size=(n, 1, 1))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * n, dtype=np.int32).reshape(-1, 3)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_a_hemicube_sees_what_rays_through_its_pixels_meet(resolution):
    rng = np.random.default_rng(resolution)
    positions, triangles = soup(rng, 60)
    normals = rng.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    frames, near = frames_of(normals), 1e-4
    seen = see(np.ascontiguousarray(positions.T), triangles, np.zeros((4, 3), np.float32), frames, np.full(4, resolution), near, 2)
    scene, wrong, count = prepare(positions, triangles), 0, 0
    local = directions(resolution)
    for s in range(4):
        size = slice(seen.start[s], seen.start[s + 1])
        ids, depth = seen.ids[size].reshape(5, resolution, resolution), seen.depth[size].reshape(5, resolution, resolution)
        for face in range(5):
            high = resolution if face == 0 else resolution // 2
            for i in range(0, high, max(1, resolution // 8)):
                for j in range(resolution):
                    d = local[face, i, j] @ frames[s] * 1000.0
                    hit, _, _ = nearest(scene, 0.0, 0.0, 0.0, *map(float, d))
                    count += 1
                    wrong += hit != ids[face, i, j]
                    if hit >= 0 and hit == ids[face, i, j]:
                        a, b, c = positions[triangles[hit]].astype(np.float64)
                        normal = np.cross(b - a, c - a)
                        along = normal @ a / (normal @ (d / 1000))
                        if along < 50 and abs(normal @ d) > 20 * np.linalg.norm(normal):  # not edge-on, where a snapped corner moves the plane
                            assert near / depth[face, i, j] == pytest.approx(along, rel=0.1)
    assert wrong <= 0.03 * count  # pixels on borders: corners are snapped to 1/256 pixel


def test_it_is_the_same_for_any_number_of_threads():
    positions, triangles = soup(np.random.default_rng(1), 200)
    centers = np.random.default_rng(2).normal(size=(9, 3)).astype(np.float32)
    frames = frames_of(np.tile([0.0, 0.0, 1.0], (9, 1)))
    drawn = [see(np.ascontiguousarray(positions.T), triangles, centers, frames, np.full(9, 32), 1e-4, n) for n in (1, 2, 4)]
    end = drawn[0].start[-1]
    first = drawn[0].depth[:end].tobytes(), drawn[0].ids[:end].tobytes()
    assert all((d.depth[:end].tobytes(), d.ids[:end].tobytes()) == first for d in drawn)
