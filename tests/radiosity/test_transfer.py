"""Transfer from a shooter to a point: exact values against quadrature to many digits, the horizon, and how far the value from afar may be off."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.radiosity.share import FLAT
from luxel.radiosity.transfer import polygon_factor, spread_factor

NODES, WEIGHTS = (a / 2 for a in np.polynomial.legendre.leggauss(24))
NODES = NODES + 0.5


def quadrature(point, normal, corners, cells=1):
    """The form factor by Gauss-Legendre over the bilinear patch of 3 or 4 corners; only the part above the horizon counts."""
    a, b, c, d = corners[0], corners[1], corners[2], corners[-1]
    places = ((np.arange(cells)[:, None] + NODES) / cells).ravel()
    weights = np.tile(WEIGHTS / cells, cells)
    u, v = np.meshgrid(places, places)
    u, v = u[..., None], v[..., None]
    x = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    du, dv = (1 - v) * (b - a) + v * (c - d), (1 - u) * (d - a) + u * (c - b)
    facing = np.cross(du, dv)
    line = x - point
    kernel = np.maximum(line @ normal, 0) * -(line * facing).sum(-1) / (np.pi * (line * line).sum(-1) ** 2)
    return float(weights @ kernel @ weights)


def polygon(point, normal, corners):
    return polygon_factor(*map(float, point), *map(float, normal), np.array(corners, float), len(corners))


def unit(v):
    return np.asarray(v, float) / np.linalg.norm(v)


vectors = st.tuples(*[st.floats(-1, 1)] * 3)
directions = vectors.filter(lambda v: math.hypot(*v) > 0.1).map(unit)


@st.composite
def shooters(draw):
    """A triangle or parallelogram that is no needle: its corners, unit normal and area."""
    a, b = draw(directions), draw(directions)
    normal = np.cross(a, b)
    if np.linalg.norm(normal) < 0.2:
        b = np.roll(a, 1) * (1, -1, 0.5)
        normal = np.cross(a, b)
    a, b = a * draw(st.floats(0.2, 1)), b * draw(st.floats(0.2, 1))
    quad = draw(st.booleans())
    corners = np.array([np.zeros(3), a, a + b, b] if quad else [np.zeros(3), a, b])
    return corners - corners.mean(0), unit(np.cross(a, b)), float(np.linalg.norm(np.cross(a, b))) * (1 if quad else 0.5)


def test_known_values():
    up = (0, 0, 1)
    assert polygon((0, 0, 0), up, [(0, 0, 1), (0, 1, 1), (1, 0, 1)]) == pytest.approx(0.0962250448649, rel=1e-12)
    assert polygon((0, 0, 0), up, [(0, 0, 1), (0, 1, 1), (1, 1, 1), (1, 0, 1)]) == pytest.approx(0.138531605995, rel=1e-11)
    square = [(-0.5, -0.5, 1), (-0.5, 0.5, 1), (0.5, 0.5, 1), (0.5, -0.5, 1)]
    assert polygon((0, 0, 0), up, square) == pytest.approx(0.239456470461, rel=1e-11)
    assert polygon((0, 0, 0), up, square[::-1]) == pytest.approx(-0.239456470461, rel=1e-11)
    assert polygon((0, 0, 0), (0, 0, -1), square) == 0


def test_a_wall_seen_from_its_foot_is_half_the_view():
    wall = [(0, -100, -1), (0, 100, -1), (0, 100, 100), (0, -100, 100)]  # reaches below the horizon
    assert polygon((1e-6, 0, 0), (0, 0, 1), wall) == pytest.approx(0.5, abs=1e-4)
    upright = [(0, -100, 0), (0, 100, 0), (0, 100, 100), (0, -100, 100)]
    assert polygon((1e-6, 0, 0), (0, 0, 1), upright) == pytest.approx(0.5, abs=1e-4)
    assert polygon((0, 0, 0), (0, 0, 1), [(0, 1, 0), (0, 2, 0), (0, 2, 1)]) == 0  # in the polygon's own plane


@settings(deadline=None)  # the first call compiles
@given(shooters(), directions, directions, st.floats(0.8, 30))
def test_the_polygon_is_exact(shooter, toward, normal, distance):
    corners, _, _ = shooter
    point = toward * distance
    if np.min((corners - point) @ normal) < 0:
        normal = unit(-toward + 0.2 * normal)
    if np.min((corners - point) @ normal) < 0:
        return
    assert polygon(point, normal, corners) == pytest.approx(quadrature(point, normal, corners, 2), abs=3e-15, rel=1e-9)


@settings(deadline=None)  # the first call compiles
@given(shooters(), directions, directions, st.floats(1, 5))
def test_the_horizon_cuts_exactly(shooter, toward, normal, distance):
    """What is above and below a horizon adds up: F(n) + F(-n), as a vector along n, is the unclipped sum."""
    corners, _, _ = shooter
    point = toward * distance
    r = corners - point
    edges = [(r[i], r[(i + 1) % len(r)]) for i in range(len(r))]
    crosses = [np.cross(a, b) for a, b in edges]
    angles = [math.atan2(np.linalg.norm(c), a @ b) for c, (a, b) in zip(crosses, edges)]
    whole = -sum(t * unit(c) for t, c in zip(angles, crosses)) / (2 * np.pi)
    assert polygon(point, normal, corners) - polygon(point, -normal, corners) == pytest.approx(whole @ normal, abs=1e-13)


def test_a_closed_box_fills_the_view():
    rng = np.random.default_rng(5)
    low, high = np.zeros(3), np.array([2.0, 3.0, 1.0])
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            quad = np.zeros((4, 3))
            quad[:, axis] = (low, high)[side][axis]
            quad[[1, 2], u], quad[[2, 3], v] = high[u], high[v]
            faces.append(quad if side == 0 else quad[::-1])
    for _ in range(50):
        point, normal = rng.uniform(low + 1e-3, high - 1e-3), unit(rng.normal(size=3))
        assert sum(polygon(point, normal, f) for f in faces) == pytest.approx(1, abs=1e-13)


@settings(deadline=None)  # the first call compiles
@given(directions, directions, directions, directions, st.floats(1.0, 30.0))
def test_from_afar_a_square_is_as_good_as_its_middle_and_spread(normal, side, toward, facing, times):
    """From as near as an element is taken so. Where the horizon cuts it, the error falls with the distance, else with its square."""
    a = np.cross(normal, side)
    if np.linalg.norm(a) < 0.1 or min(abs(toward @ normal), abs(toward @ facing)) < 1e-4:  # who lies in the other's plane sees none of it
        return
    a = unit(a)
    b = np.cross(normal, a)
    corners = 0.5 * np.array([-a - b, a - b, a + b, b - a])
    toward, distance = toward if toward @ normal > 0 else -toward, times * math.sqrt(FLAT)
    point, facing = toward * distance, facing if facing @ toward < 0 else -facing
    terms = [facing @ -point, normal @ point, facing @ normal, distance**2, 1.0, 1 / 12]
    far, exact = float(spread_factor.py_func(*map(np.float32, terms))), abs(polygon(point, facing, corners))
    if np.min((corners - point) @ facing) > 0:
        assert far == pytest.approx(exact, rel=0.031 / times**2 + 1e-5)
    assert far == pytest.approx(exact, abs=0.042 / times / (math.pi * distance**2))
