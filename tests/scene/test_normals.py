import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.scene import Mesh, normals
from luxel.scene.normals import vertex_normals, weld, with_normals

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]],
    np.int32,
)  # fmt: skip


def sphere(n=24):
    """A mesh whose vertices lie on the unit sphere, without a seam."""
    rng = np.random.default_rng(n)
    points = rng.normal(size=(n * n, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    from scipy.spatial import ConvexHull

    faces = ConvexHull(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return points.astype(np.float32), faces.astype(np.int32)


def direct(positions, triangles):
    """The definition, corner by corner."""
    sums = np.zeros((len(positions), 3))
    for triangle in triangles:
        a, b, c = positions[triangle].astype(np.float64)
        area = np.cross(b - a, c - a)
        for k in range(3):
            p, q, r = np.roll(positions[triangle].astype(np.float64), -k, 0)
            u, v = q - p, r - p
            angle = np.arccos(np.clip(u @ v / np.sqrt((u @ u) * (v @ v)), -1, 1))
            sums[triangle[k]] += area * angle
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


def test_equal_to_the_definition():
    positions, triangles = sphere()
    assert np.allclose(vertex_normals(positions, triangles), direct(positions, triangles), atol=1e-6)


def test_sphere_normals_are_its_radii():
    positions, triangles = sphere(40)
    made = vertex_normals(positions, triangles)
    assert np.einsum("ij,ij->i", made, positions).min() > 0.99


def test_cube_corners_are_symmetric_however_its_faces_are_cut():
    assert np.allclose(vertex_normals(CUBE, CUBE_FACES), (CUBE - 0.5) * 2 / np.sqrt(3), atol=1e-6)


def test_a_soup_is_as_smooth_as_the_mesh():
    positions, triangles = sphere()
    soup = positions[triangles].reshape(-1, 3)
    made = vertex_normals(soup, np.arange(len(soup), dtype=np.int32).reshape(-1, 3))
    assert np.allclose(made, vertex_normals(positions, triangles)[triangles.reshape(-1)], atol=1e-6)


def test_chunks_do_not_show(monkeypatch):
    positions, triangles = sphere()
    whole = vertex_normals(positions, triangles)
    monkeypatch.setattr(normals, "_CHUNK", 7)
    assert np.allclose(vertex_normals(positions, triangles), whole, atol=1e-6)


@pytest.mark.parametrize("scale", [1e-18, 1e-6, 1e12, 1e18])
def test_any_size_of_mesh(scale):
    positions, triangles = sphere(12)
    assert np.allclose(vertex_normals(positions * np.float32(scale), triangles), vertex_normals(positions, triangles), atol=1e-5)


def test_degenerate_triangles_and_lone_vertices():
    positions = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5], [2, 0, 0]])
    made = vertex_normals(positions, np.int32([[0, 1, 2], [0, 1, 4], [3, 3, 3]]))
    assert np.array_equal(made, np.tile(np.float32([0, 0, 1]), (5, 1)))
    assert vertex_normals(np.zeros((0, 3)), np.zeros((0, 3), int)).shape == (0, 3)


def test_crease_splits_a_cube_into_flat_faces():
    made = with_normals(Mesh(CUBE, CUBE_FACES), np.radians(60))
    assert len(made.positions) == 24
    corners = made.positions[made.triangles]
    assert np.array_equal(corners, CUBE[CUBE_FACES])
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.allclose(made.normals[made.triangles], flat[:, None], atol=1e-6)


def test_crease_wider_than_the_cubes_edges_keeps_its_vertices():
    mesh = Mesh(CUBE, CUBE_FACES)
    made = with_normals(mesh, np.radians(100))
    assert np.array_equal(made.triangles, CUBE_FACES)
    assert made.positions is mesh.positions
    assert np.allclose(made.normals, vertex_normals(CUBE, CUBE_FACES))


def test_crease_keeps_the_smooth_sides_of_a_cylinder():
    n = 40
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.stack([np.cos(angle), np.zeros(n), np.sin(angle)], 1)
    positions = np.float32(np.concatenate([ring, ring + np.array([0, 1, 0]), [[0, 1, 0]]]))
    i = np.arange(n)
    j = (i + 1) % n
    sides = np.concatenate([np.stack([i, i + n, j], 1), np.stack([j, i + n, j + n], 1)])
    cap = np.stack([np.full(n, 2 * n), j + n, i + n], 1)
    made = with_normals(Mesh(positions, np.int32(np.concatenate([sides, cap]))))
    assert len(made.positions) == len(positions) + n  # only the rim is split
    side_normals = made.normals[made.triangles[: 2 * n]]
    assert np.abs(side_normals[..., 1]).max() < 1e-6
    assert np.allclose(made.normals[made.triangles[2 * n :]], [0, 1, 0], atol=1e-6)


def test_attributes_are_carried_to_the_split_vertices():
    colors = np.arange(32, dtype=np.float32).reshape(8, 4)
    made = with_normals(Mesh(CUBE, CUBE_FACES, texcoords=CUBE[:, :2], colors=colors, material=3, name="cube"), 0.5)
    assert np.array_equal(made.colors[made.triangles], colors[CUBE_FACES])
    assert np.array_equal(made.texcoords[made.triangles], CUBE[CUBE_FACES][..., :2])
    assert (made.material, made.name) == (3, "cube")


def test_a_huge_fan_with_creases_does_not_take_its_square():
    n = 30_000
    angle = np.arange(n) * 2 * np.pi / n
    rim = np.stack([np.cos(angle), 5 * (np.arange(n) % 2), np.sin(angle)], 1)
    positions = np.float32(np.append(rim, [[0, 0, 0]], 0))
    i = np.arange(n)
    made = with_normals(Mesh(positions, np.int32(np.stack([np.full(n, n), i, (i + 1) % n], 1))), 0.1)
    assert np.allclose(np.linalg.norm(made.normals, axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("angle", [-0.1, 4.0, float("nan")])
def test_crease_angle_is_checked(angle):
    with pytest.raises(InputError, match="crease_angle"):
        with_normals(Mesh(CUBE, CUBE_FACES), angle)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 60), st.integers(0, 80), st.floats(0, 3.1))
def test_any_triangles_give_unit_normals_and_the_same_corners(seed, n, m, crease):
    rng = np.random.default_rng(seed)
    positions = rng.integers(-2, 3, (n, 3)).astype(np.float32)
    triangles = rng.integers(0, n, (m, 3)).astype(np.int32)
    made = with_normals(Mesh(positions, triangles), crease)
    assert np.array_equal(made.positions[made.triangles], positions[triangles])
    assert np.allclose(np.linalg.norm(made.normals, axis=1), 1, atol=1e-5)
    assert np.array_equal(made.positions[:n], positions)


def first_equal(positions):
    unique, inverse = np.unique(positions + np.float32(0), axis=0, return_inverse=True)
    first = np.full(len(unique), len(positions))
    np.minimum.at(first, inverse.reshape(-1), np.arange(len(positions)))
    return first[inverse.reshape(-1)]


def test_weld_is_exact(monkeypatch):
    rng = np.random.default_rng(5)
    positions = rng.integers(-3, 4, (3000, 3)).astype(np.float32)
    positions[::7] *= np.float32(-1)  # makes minus zeros
    assert np.array_equal(weld(positions), first_equal(positions))
    everything_alike = (np.arange(len(positions), dtype=np.int32), np.ones(len(positions) - 1, bool))
    monkeypatch.setattr(normals, "_neighbours", lambda _: everything_alike)  # as if all hashes were equal
    assert np.array_equal(weld(positions), first_equal(positions))
    monkeypatch.undo()
    assert weld(np.unique(positions, axis=0)) is None
    assert weld(positions[:0]) is None
