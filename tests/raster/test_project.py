"""Projection against exact fractions."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pipeline import pixel_camera, view_of

from luxel.raster.constants import OUT_BOTTOM, OUT_FAR, OUT_LEFT, OUT_NAN, OUT_NEAR, OUT_RIGHT, OUT_TOP, SAFE_HIGH, SAFE_LOW, UNSAFE
from luxel.raster.project import View, Window, project
from luxel.scene.camera import Camera

SIZE = 640, 480


def window(size=SIZE, x=0, y=0):
    return Window(x, y, size[0] - x, size[1] - y, *size)


def place(positions, camera, size=SIZE, part=None, threads=1):
    positions = np.atleast_2d(np.asarray(positions, np.float32))
    screen, unsafe = project(positions, view_of(camera, size), part or window(size), threads)
    return screen[:, :2], screen.view(np.float32)[:, 2:], unsafe


def exact(position, matrix, size):
    """x, y in pixels, depth and 1 / w, as fractions."""
    vector = [Fraction(float(v)) for v in position] + [Fraction(1)]
    x, y, z, w = (sum(Fraction(float(m)) * v for m, v in zip(row, vector, strict=True)) for row in matrix)
    return (x / w + 1) * size[0] / 2, (1 - y / w) * size[1] / 2, z / w, 1 / w


def test_places_are_rounded_to_the_nearest_256th():
    rng = np.random.default_rng(0)
    camera = Camera.look_at([3, 2, 5], [0, 0.5, 0], yfov=0.8, near=0.1, far=50.0)
    points = rng.normal(size=(200, 3)).astype(np.float32)
    places, values, unsafe = place(points, camera)
    assert unsafe == 0
    for point, at, (depth, weight) in zip(points, places.tolist(), values, strict=True):
        x, y, z, w = exact(point, camera.clip_from_world(SIZE), SIZE)
        assert abs(Fraction(at[0], 256) - x) <= Fraction(1, 512) + Fraction(1, 10**9)
        assert abs(Fraction(at[1], 256) - y) <= Fraction(1, 512) + Fraction(1, 10**9)
        assert depth == np.float32(float(z))
        assert weight == np.float32(float(w))


@pytest.mark.parametrize("far_away", [1e4, 1e6])
def test_far_from_the_origin_nothing_is_lost(far_away):
    """Positions are float32; the matrix is applied in float64, so what a picture shows is as exact as they are."""
    where = np.array([far_away, -far_away, 2 * far_away])
    camera = Camera.look_at(where + np.array([0, 0, 4]), where)
    points = (where + np.random.default_rng(1).uniform(-1, 1, (50, 3))).astype(np.float32)
    at = place(points, camera)[0]
    same = place((points.astype(np.float64) - where).astype(np.float32), Camera.look_at([0, 0, 4], [0, 0, 0]))[0]
    assert np.abs(at - same).max() <= 1


def test_depth_is_near_over_distance():
    camera = Camera(near=0.5)
    distances = np.array([0.5, 1, 2, 1000], np.float32)
    _, values, _ = place(np.stack([distances * 0.1, distances * 0, -distances], 1), camera)
    assert np.array_equal(values[:, 0], np.float32(0.5) / distances)
    assert np.array_equal(values[:, 1], 1 / distances)


def test_orthographic_depth_falls_from_one_to_zero():
    _, values, unsafe = place([[0, 0, 1], [3, 2, 0], [9, 9, -3]], pixel_camera(SIZE, near=-1, far=3))
    assert unsafe == 0
    assert np.allclose(values, [[1, 1], [0.75, 1], [0, 1]])


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.integers(0, 256 * 640), st.integers(0, 256 * 480), st.integers(0, 600), st.integers(0, 400))
def test_exact_positions_stay_exact_in_every_window(x, y, left, top):
    """Moving the window moves the place by whole pixels, bit for bit."""
    point = [x / 256, 480 - y / 256, 0]
    camera = pixel_camera(SIZE)
    assert np.array_equal(place(point, camera)[0], [[x, y]])
    assert np.array_equal(place(point, camera, part=window(x=left, y=top))[0], [[x - left * 256, y - top * 256]])


@pytest.mark.parametrize("axis", [0, 1])
def test_guard_band(axis):
    size = SIZE
    for fixed, safe in ((SAFE_LOW, True), (SAFE_HIGH, True), (SAFE_LOW - 1, False), (SAFE_HIGH + 1, False)):
        point = [10.0, 10.0, 0.0]
        point[axis] = fixed / 256 if axis == 0 else size[1] - fixed / 256
        places, _, unsafe = place(point, pixel_camera(size))
        assert unsafe == (not safe)
        assert (places[0, 0] == UNSAFE) == (not safe)
        if safe:
            assert places[0, axis] == fixed


def test_why_a_vertex_is_unsafe():
    camera = Camera(yfov=np.pi / 2, near=1.0, far=10.0)
    cases = {
        (0, 0, -0.5): OUT_NEAR, (0, 0, -11): OUT_FAR, (0, 0, 3): OUT_NEAR | OUT_LEFT | OUT_RIGHT | OUT_TOP | OUT_BOTTOM,
        (-1e6, 0, -2): OUT_LEFT, (1e6, 0, -2): OUT_RIGHT, (0, 1e6, -2): OUT_TOP, (0, -1e6, -2): OUT_BOTTOM, (0, 0, 0): OUT_NEAR,
        (np.nan, 0, -2): OUT_NAN, (0, np.inf, -2): OUT_NAN, (0, 0, -np.inf): OUT_NAN,
    }  # fmt: skip
    places, values, unsafe = place(list(cases), camera, (400, 400))
    assert unsafe == len(cases)
    assert (places[:, 0] == UNSAFE).all()
    codes = dict(zip(cases, places[:, 1].tolist(), strict=True))
    assert {point: code & ~OUT_FAR if point == (0, 0, 3) else code for point, code in codes.items()} == cases
    assert np.isfinite(values).all()


def test_any_number_of_threads():
    points = np.random.default_rng(2).normal(size=(100_003, 3)).astype(np.float32) * 3
    camera = Camera.look_at([1, 2, 3], [0, 0, 0])
    view = view_of(camera, SIZE)
    want, unsafe = project(points, view, window(), 1)
    for threads in (2, 3):
        have, count = project(points, view, window(), threads)
        assert np.array_equal(have, want)
        assert count == unsafe > 0


def test_no_vertices():
    screen, unsafe = project(np.zeros((0, 3), np.float32), View(np.eye(4), 0.0), window(), 2)
    assert screen.shape == (0, 4)
    assert unsafe == 0
