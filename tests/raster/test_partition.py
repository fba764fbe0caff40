"""Triangulations hit every sample inside exactly once, through projection, clipping and every sample pattern."""

import numpy as np
import pytest
from covering import PATTERNS, draw
from hypothesis import given, settings
from hypothesis import strategies as st
from pipeline import drawn, jittered_grid, pixel_camera, signed_hits
from scipy.spatial import Delaunay

from luxel.raster.constants import GUARD_HIGH, GUARD_LOW
from luxel.raster.project import Window
from luxel.raster.reference import covers
from luxel.scene.builtin.shapes import sphere
from luxel.scene.camera import Camera
from luxel.scene.transforms import look_at

SIZE = 31, 23
FEW = {name: PATTERNS[name] for name in ("standard-1", "standard-4", "standard-16", "grid-4", "ssaa-3")}


def inside(outline, pattern, size=SIZE):
    """(s, h, w) bool: what the oracle finds in the convex polygon `outline`, cut into a fan."""
    have = np.zeros((len(pattern), size[1], size[0]), np.int64)
    for place in np.ndindex(have.shape):
        s, y, x = place
        at = x * 256 + int(pattern[s, 0]), y * 256 + int(pattern[s, 1])
        have[place] = sum(covers([outline[0], outline[k], outline[k + 1]], at) for k in range(1, len(outline) - 1))
    return have


def quad(corners):
    return np.array([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]])


def reversed_quad(corners):
    """The other diagonal and winding."""
    return np.array([[corners[3], corners[1], corners[0]], [corners[3], corners[2], corners[1]]])


# dEQP's fill rules: a quad of two triangles, turned


def turned(angle, half, centre=(16.03, 11.41)):
    way = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * half
    spin = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return [tuple(int(v) for v in corner) for corner in np.round((way @ spin.T + centre) * 256)]


@pytest.mark.parametrize("case", ["BASIC", "REVERSED", "CLIPPED_FULL", "CLIPPED_PARTIAL"])
@pytest.mark.parametrize("name", PATTERNS)
def test_quads(case, name):
    half = {"CLIPPED_FULL": 500, "CLIPPED_PARTIAL": 14}.get(case, 8)
    cut = reversed_quad if case == "REVERSED" else quad
    for angle in np.linspace(0, np.pi / 2, 4 if len(PATTERNS[name]) > 4 else 9):
        corners = turned(angle, half)
        hits = sum((draw(t[None], np.ones((1, 3), np.float32), PATTERNS[name], *SIZE)[0] >= 0).astype(int) for t in cut(corners))
        assert hits.max() == 1
        if case == "CLIPPED_FULL":
            assert hits.min() == 1
        elif len(PATTERNS[name]) <= 4:
            assert np.array_equal(hits, inside(corners, PATTERNS[name]))


# Random triangulations in the plane, exact corners


def delaunay(points, size):
    """Triangles (m, 3, 2) over the points and the corners of a rectangle somewhat in the picture, 1/256 pixel."""
    low, high = np.array([700, 333]), np.array(size) * 256 - [451, 997]
    frame = np.array([low, [low[0], high[1]], high, [high[0], low[1]]])
    points = np.concatenate([frame, np.clip(points, low + 1, high - 1)])
    corners = points[Delaunay(points).simplices]
    return corners, frame


@pytest.mark.parametrize("name", FEW)
@pytest.mark.parametrize("count", [3, 40, 250])
def test_delaunay(name, count):
    rng = np.random.default_rng(count)
    corners, frame = delaunay(rng.integers(0, np.array(SIZE) * 256, (count, 2)), SIZE)
    hits = signed_hits(corners, PATTERNS[name], SIZE)
    assert np.array_equal(np.abs(hits), inside([tuple(p) for p in frame.tolist()], PATTERNS[name]))


def test_delaunay_of_points_on_samples():
    """Hundreds of corners exactly on samples, and edges through many more."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        corners, frame = delaunay(rng.integers(0, SIZE, (150, 2)) * 256 + 128, SIZE)
        hits = signed_hits(corners, FEW["standard-1"], SIZE)
        assert np.array_equal(np.abs(hits), inside([tuple(p) for p in frame.tolist()], FEW["standard-1"]))


half_pixels = st.tuples(st.integers(0, 62), st.integers(0, 46))


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.lists(half_pixels, min_size=1, max_size=40), st.sampled_from([128, 64, 1]), st.sampled_from(sorted(FEW)))
def test_any_points(points, step, name):
    points = np.array(points) * 128 // (128 // step) * (128 // step)
    corners, _ = delaunay(points + (step == 1) * np.arange(len(points))[:, None], SIZE)
    hits = np.abs(signed_hits(corners, PATTERNS[name], SIZE))
    assert hits.max() == 1
    assert (hits[:, 5:-5, 5:-5] == 1).all()


# Through the camera


def test_exact_pixels_through_an_orthographic_camera():
    """Corners at multiples of 1/256 pixel come through projection as they are."""
    rng = np.random.default_rng(2)
    corners, _ = delaunay(rng.integers(0, np.array(SIZE) * 256, (80, 2)), SIZE)
    world = np.concatenate([corners / 256, np.zeros((*corners.shape[:2], 1))], -1).reshape(-1, 3)
    world[:, 1] = SIZE[1] - world[:, 1]
    found = drawn(world, np.arange(len(world)).reshape(-1, 3), pixel_camera(SIZE), SIZE)
    assert np.array_equal(found.corners, corners)
    assert found.unsafe == 0


def floor_hits(camera, rng, extent, cells, pattern, size=SIZE, window=None):
    """Signed hits of a floor y = 0, -extent .. extent, in random triangles; how far inside its border (1 at the centre) each sample's ray
    meets it (nan: not in front), and what was drawn."""
    points, triangles = jittered_grid(rng, cells, cells)
    world = np.stack([points[:, 0], np.zeros(len(points)), -points[:, 1]], 1) * 2 * extent - [extent, 0, -extent]
    found = drawn(world, triangles, camera, size, window)
    part = (window.width, window.height) if window else size
    hits = signed_hits(found.corners, pattern, part)
    x, y = np.meshgrid(np.arange(part[0]), np.arange(part[1]))
    offset = (window.x, window.y) if window else (0, 0)
    place = np.stack([x, y], -1) + offset + pattern[:, None, None] / 256
    return hits, place, found


def rays(camera, place, size):
    """World directions of picture places (..., 2), as long as one metre along the axis."""
    aspect, half = size[0] / size[1], np.tan(camera.yfov / 2)
    ndc = place / size * 2 - 1
    local = np.stack([ndc[..., 0] * half * aspect, -ndc[..., 1] * half, -np.ones(ndc.shape[:-1])], -1)
    return local @ camera.world_from_camera[:3, :3].T


def check_floor(camera, rng, extent, cells, pattern, size=SIZE, window=None):
    """Exactly once where all around a sample the ray meets the floor between near and far plane, never where it meets it nowhere."""
    hits, place, found = floor_hits(camera, rng, extent, cells, pattern, size, window)
    ways = [np.zeros(2), *(np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]) / 100)]
    met = []
    with np.errstate(all="ignore"):
        for way in ways:
            ray = rays(camera, place + way, size)
            along = -camera.eye[1] / ray[..., 1]
            point = camera.eye + along[..., None] * ray
            met.append((np.abs(point[..., [0, 2]]) < extent).all(-1) & (along > camera.near) & (along < camera.far))
    seen = 1 if camera.eye[1] > 0 else -1
    assert set(np.unique(hits)) <= {0, seen}
    assert (hits[np.all(met, 0)] == seen).all()
    assert (hits[~np.any(met, 0)] == 0).all()
    return np.all(met, 0).mean(), found


@pytest.mark.parametrize("name", FEW)
def test_projected(name):
    """PROJECTED: a floor in perspective, wholly in front of the camera."""
    rng = np.random.default_rng(3)
    for angle in np.linspace(0, 6, 3):
        camera = Camera.look_at([4 * np.cos(angle), 2, 4 * np.sin(angle)], [0, 0, 0], yfov=0.7)
        share, found = check_floor(camera, rng, 1.5, 6, PATTERNS[name])
        assert share > 0.2
        assert found.unsafe == 0


@pytest.mark.parametrize("seed", range(12))
def test_standing_on_the_floor(seed):
    """Cut by the near plane, often by the guard band and the far plane."""
    rng = np.random.default_rng(seed)
    eye = np.append(rng.uniform(-3, 3, 2), 0)[[0, 2, 1]] + [0, rng.choice([1.7, 0.01, 0.001, -0.3]), 0]
    way = np.cos(seed), rng.uniform(-0.8, 0.1) * np.sign(eye[1]), np.sin(seed)
    camera = Camera.look_at(
        eye, eye + np.array(way),
        yfov=rng.choice([0.05, 0.8, 2.0]), near=rng.choice([0.001, 0.1]), far=rng.choice([5.0, np.inf]),
    )  # fmt: skip
    _, found = check_floor(camera, rng, 10.0, int(rng.choice([1, 2, 9])), FEW["standard-4"])
    assert found.unsafe > 0
    assert len(found.clipped.source) > 0


def test_standing_on_the_floor_in_a_part_of_a_large_picture():
    """A window of a picture of 30,000 pixels, where most of the floor lies beyond the guard band."""
    rng = np.random.default_rng(4)
    size = 30_000, 20_000
    for x, y in ((0, 10_000), (14_987, 12_345), (29_969, 19_977)):
        camera = Camera.look_at([0.3, 0.2, 0.1], [1, 0, 0.4], yfov=1.2, near=0.01)
        share, found = check_floor(camera, rng, 5.0, 12, PATTERNS["standard-2"], size, Window(x, y, 31, 23, *size))
        assert share > 0.9
        assert found.corners.min() >= GUARD_LOW
        assert found.corners.max() <= GUARD_HIGH


def test_neighbours_agree_on_what_is_cut_at_the_guard_band():
    """An edge from the last pixel of the guard band to the far side of the picture, between a triangle that is clipped and one that is not."""
    rng = np.random.default_rng(5)
    camera = pixel_camera(SIZE)
    wrong = cut = 0
    for _ in range(300):
        b = [GUARD_LOW / 256 + rng.uniform(-0.5, 2.5), rng.uniform(-9000, 9000), 0]
        c = [GUARD_HIGH / 256 - rng.uniform(3, 60), rng.uniform(-9000, 9000), 0]
        y = rng.uniform(0, SIZE[1])
        shift = y - (b[1] + (c[1] - b[1]) * (15 - b[0]) / (c[0] - b[0]))  # the edge crosses the picture
        b[1] += shift
        c[1] += shift
        a, d = [GUARD_LOW / 256 - 3000, b[1] - 30_000, 0], [0, 30_000, 0]
        found = drawn([a, b, c, d], [[0, 2, 1], [1, 2, 3]], camera, SIZE)
        cut += found.unsafe > 0
        hits = np.abs(signed_hits(found.corners, PATTERNS["ssaa-4"], SIZE))
        x = np.arange(SIZE[0])
        edge = SIZE[1] - (b[1] + (c[1] - b[1]) * (x - b[0]) / (c[0] - b[0]))
        rows = np.clip(np.round(edge).astype(int), 0, SIZE[1] - 1)
        wrong += (hits[:, rows, x] != 1).any()
    assert cut > 100
    assert wrong == 0


# Closed meshes from inside


def bumpy_ball(rng):
    """A closed mesh of triangles that every ray from its centre meets exactly once."""
    mesh = sphere(1.0, 8)
    keys, number = np.unique(np.round(mesh.positions, 4), axis=0, return_inverse=True)
    radius = rng.uniform(0.6, 1.5, len(keys))[number.ravel()]
    return mesh.positions * radius[:, None].astype(np.float32), mesh.triangles


@pytest.mark.parametrize("seed", range(6))
def test_a_ball_from_its_centre_has_no_holes(seed):
    rng = np.random.default_rng(seed)
    positions, triangles = bumpy_ball(rng)
    where = rng.normal(size=3) * 10
    camera = Camera(look_at(where, where + rng.normal(size=3)), yfov=rng.uniform(0.2, 2.8), near=rng.choice([1e-3, 0.02]))
    found = drawn((positions + where).astype(np.float32), triangles, camera, SIZE)
    assert (signed_hits(found.corners, FEW["standard-4"], SIZE) == -1).all()


@pytest.mark.parametrize("seed", range(6))
def test_a_room_from_anywhere_inside_has_no_holes(seed):
    """A cube of large triangles with the eye close to a wall, an edge or a corner: clipped by the near plane and the guard band."""
    rng = np.random.default_rng(seed)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))], np.int32)
    near = 10.0 ** rng.uniform(-5, -2)
    gap = 4 * near
    eye = rng.uniform(-1 + gap, 1 - gap, 3)
    eye[: seed % 4] = np.sign(eye[: seed % 4]) * (1 - gap)
    for _ in range(4):
        camera = Camera(look_at(eye, eye + rng.normal(size=3)), yfov=1.0, near=near)
        found = drawn(corners, triangles, camera, SIZE)
        assert (signed_hits(found.corners, FEW["standard-4"], SIZE) == -1).all()
