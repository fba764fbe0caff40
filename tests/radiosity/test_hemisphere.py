import numpy as np
import pytest
from closed import box, matte

from luxel.radiosity.hemicube import frames_of
from luxel.radiosity.hemisphere import see_hemisphere
from luxel.radiosity.nearest import nearest
from luxel.radiosity.occlusion import prepare
from luxel.raster.geometry import flatten

SIZE = 64


def divided(positions, triangles):
    """Each triangle as four."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    corners = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], 1).reshape(-1, 3)
    return corners.astype(np.float32), np.arange(len(corners), dtype=np.int32).reshape(-1, 3)


@pytest.fixture(scope="module")
def errors():
    """The share of pixels that show something else than the ray through them meets, for a room cut finer and finer."""
    scene = box(matte(), (-1, -1, -1), (1, 1, 1))
    box(matte(), (-0.2, -0.3, 0.1), (0.5, 0.3, 0.6), scene, inward=False)
    geometry = flatten(scene, "none")
    positions, triangles = geometry.positions, geometry.triangles
    face = np.arange(len(triangles)) // 2
    center, frames = np.array([[0.1, -0.05, -0.999]], np.float32), frames_of(np.array([[0.0, 0.0, 1.0]]))
    at = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
    x, y = np.meshgrid(at, -at)
    inside = x**2 + y**2 < 0.95
    rays = prepare(positions, triangles)
    ways = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], -1)[inside] @ frames[0].astype(np.float64)
    truth = np.array([face[nearest(rays, *map(float, center[0]), *map(float, 10 * way))[0]] for way in ways])
    found = []
    for _ in range(6):
        ids, _ = see_hemisphere(np.ascontiguousarray(positions.T), triangles, center, frames, SIZE, 1e-4, 2)
        found.append(np.mean(np.where(ids[0][inside] >= 0, face[ids[0][inside]], -1) != truth))
        positions, triangles = divided(positions, triangles)
        face = np.repeat(face, 4)
    return found


def test_large_triangles_are_seen_wrong(errors):
    assert errors[0] > 0.1


def test_the_error_falls_as_triangles_get_smaller(errors):
    assert errors[0] > errors[1] > errors[2] > errors[3]
    assert errors[5] < 0.003


def test_it_is_the_same_for_any_number_of_threads():
    rng = np.random.default_rng(0)
    positions, triangles = rng.normal(size=(300, 3)).astype(np.float32), np.arange(300, dtype=np.int32).reshape(-1, 3)
    centers, frames = rng.normal(size=(5, 3)).astype(np.float32), frames_of(np.tile([0.0, 1.0, 0.0], (5, 1)))
    one, two = (see_hemisphere(np.ascontiguousarray(positions.T), triangles, centers, frames, 32, 1e-4, n) for n in (1, 2))
    assert one[0].tobytes() == two[0].tobytes()
    assert one[1].tobytes() == two[1].tobytes()
