"""Form factors between surfaces: the catalogue's exact values, closure, reciprocity, obstacles, bad input."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

import luxel
from luxel import Mesh
from luxel.errors import InputError, LuxelWarning
from luxel.radiosity.form_factors import FormFactors, form_factors
from luxel.radiosity.merge import merge
from luxel.radiosity.surfaces import polygons_of
from luxel.radiosity.transfer import polygon_factor

PATHS = [pytest.param(False, 5e-3, id="default"), pytest.param(True, 5e-4, id="reference")]


def quad(a, b, c, d):
    return Mesh(np.array([a, b, c, d], np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def rectangle(width, depth, z, up=True):
    """Centred on the z axis."""
    x, y = width / 2, depth / 2
    corners = [(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)]
    return quad(*(corners if up else corners[::-1]))


def ring(radius, z, n, up=True):
    """A regular polygon with the area of a disc, cut from its centre."""
    radius *= math.sqrt(2 * math.pi / n / math.sin(2 * math.pi / n))
    angle = np.arange(n) * (2 * np.pi / n)
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, z)], 1)
    k = np.arange(n)
    faces = np.stack([np.full(n, n), k, (k + 1) % n], 1)
    return Mesh(np.concatenate([rim, [[0, 0, z]]]).astype(np.float32), faces if up else faces[:, ::-1])


def parallel(x, y):
    a, b = 1 + x * x, 1 + y * y
    return (2 / (math.pi * x * y)) * (
        math.log(math.sqrt(a * b / (a + y * y))) + x * math.sqrt(b) * math.atan(x / math.sqrt(b)) + y * math.sqrt(a) * math.atan(y / math.sqrt(a))
        - x * math.atan(x) - y * math.atan(y)
    )  # fmt: skip


def walls(low, high, inward=True):
    """The six sides of a box."""
    sides = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            corners = np.empty((4, 3))
            corners[:, axis] = (low, high)[side][axis]
            corners[:, u], corners[:, v] = np.array([low[u], high[u], high[u], low[u]]), np.array([low[v], low[v], high[v], high[v]])
            sides.append(quad(*(corners if (side == 0) == inward else corners[::-1])))
    return sides


def patches(mesh, n):
    """A quadrilateral cut into n x n surfaces."""
    a, b, c, d = (p.astype(float) for p in mesh.positions)

    def at(i, j):
        u, v = i / n, j / n
        return (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d

    return [quad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)) for i in range(n) for j in range(n)]


@pytest.mark.parametrize(("reference", "within"), PATHS)
def test_the_catalogue(reference, within):
    def factor(a, b):
        return form_factors([a, b], reference=reference)[0, 1]

    known = (1, 1, 0.199824895698), (2, 2, 0.415253283577), (0.5, 0.5, 0.0685895888186), (1, 2, 0.285875384851), (10, 10, 0.826994522397)
    for x, y, value in known:
        assert parallel(x, y) == pytest.approx(value, rel=1e-11)
        assert factor(rectangle(x, y, 0), rectangle(x, y, 1, False)) == pytest.approx(value, rel=within)
    for x in (100.0, 0.01):  # all but touching, and far
        assert factor(rectangle(x, x, 0), rectangle(x, x, 1, False)) == pytest.approx(parallel(x, x), rel=within)
    for h, w, value in ((1, 1, 0.200043776075), (2, 1, 0.232852602795), (1, 2, 0.116426301398), (0.5, 1, 0.146186679106)):
        floor, wall = quad((0, 0, 0), (w, 0, 0), (w, 1, 0), (0, 1, 0)), quad((0, 0, 0), (0, 1, 0), (0, 1, h), (0, 0, h))
        assert factor(floor, wall) == pytest.approx(value, rel=within)
    for r1, r2, value in ((1, 1, 0.381966011250), (0.5, 0.5, 0.171572875254), (0.5, 1, 0.468871125851)):
        assert factor(ring(r1, 0, 64), ring(r2, 1, 64, False)) == pytest.approx(value, rel=within)


@pytest.mark.parametrize(("reference", "within"), PATHS)
def test_partly_hidden_pairs(reference, within):
    for side, value in ((0.25, 0.169474204912), (0.5, 0.0995062945990)):
        factors = form_factors([rectangle(1, 1, 0), rectangle(1, 1, 1, False), rectangle(side, side, 0.5)], reference=reference)
        assert factors[0, 1] == pytest.approx(value, rel=within)
    # The screen cut into patches, the squares into patches, and all of it turned: the same sum.
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    cut = [*patches(rectangle(1, 1, 0), 2), *patches(rectangle(1, 1, 1, False), 3), *patches(rectangle(0.5, 0.5, 0.5), 2)]
    turned = [Mesh(m.positions @ turn.T.astype(np.float32), m.triangles) for m in cut]
    factors = form_factors(turned, reference=reference)
    assert factors[:4, 4:13].sum() / 4 == pytest.approx(0.0995062945990, rel=within)


@pytest.mark.parametrize(("reference", "within"), PATHS)
def test_a_cube_is_closed(reference, within):
    factors = form_factors(walls((0, 0, 0), (1, 1, 1)), one_sided=True, reference=reference)
    assert isinstance(factors, FormFactors)
    assert sparse.issparse(factors)
    assert factors.shape == (6, 6)
    assert np.allclose(factors.row_sums, 1, atol=within / 10)
    assert factors[0, 1] == pytest.approx(0.199824895698, rel=within)
    assert factors[0, 2] == pytest.approx(0.200043776075, rel=within)
    assert factors.diagonal().max() == 0
    assert np.all(factors.errors < within)
    assert np.allclose(factors.areas, 1)
    both = form_factors(walls((0, 0, 0), (1, 1, 1), inward=False), reference=reference)  # two-sided: the winding does not matter
    assert np.allclose(both.toarray(), factors.toarray(), rtol=within / 10)
    assert form_factors(walls((0, 0, 0), (1, 1, 1), inward=False), one_sided=True).nnz == 0


def test_surfaces_of_many_triangles_are_the_same_surface():
    """Cut finely, one triangle at a time or with a bent part, a surface has the same factors."""
    whole = form_factors([rectangle(1, 1, 0), rectangle(1, 1, 1, False)])[0, 1]
    fine = patches(rectangle(1, 1, 0), 8)
    positions, triangles = np.concatenate([m.positions for m in fine]), np.concatenate([m.triangles + 4 * k for k, m in enumerate(fine)])
    assert len(polygons_of([Mesh(positions, triangles)]).area) == 1
    assert form_factors([Mesh(positions, triangles), rectangle(1, 1, 1, False)])[0, 1] == pytest.approx(whole, rel=1e-6)
    halves = [Mesh(rectangle(1, 1, 0).positions, t[None]) for t in rectangle(1, 1, 0).triangles]
    factors = form_factors([*halves, rectangle(1, 1, 1, False)])
    assert factors[2, :2].sum() == pytest.approx(whole, rel=1e-3)
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]], np.float32)
    groove = Mesh(corners, [[0, 1, 2], [0, 2, 3], [0, 3, 5], [0, 5, 4]])
    assert form_factors([groove])[0, 0] == pytest.approx(0.200043776075, rel=1e-3)  # it sees itself


@st.composite
def closed_scenes(draw):
    """A room cut into patches with boxes in it that stand free."""
    size = np.array([draw(st.floats(1, 5)) for _ in range(3)])
    scene = [p for wall in walls((0, 0, 0), size) for p in patches(wall, draw(st.integers(1, 2)))]
    for k in range(draw(st.integers(1, 2))):
        low = np.array([draw(st.floats(0.1, 0.25)) for _ in range(3)]) + np.array([0.45 * k, 0, 0])
        high = low + [draw(st.floats(0.05, 0.2)) for _ in range(3)]
        scene += walls(low * size, high * size, inward=False)
    turn = np.linalg.qr(np.random.default_rng(draw(st.integers(0, 99))).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    return [Mesh((m.positions @ turn.T).astype(np.float32), m.triangles) for m in scene]


@settings(max_examples=10, deadline=None)
@given(closed_scenes())
def test_closed_scenes_close_and_reciprocate(scene):
    factors = form_factors(scene, one_sided=True)
    exchange = factors.toarray() * factors.areas[:, None]
    assert np.allclose(exchange, exchange.T, rtol=1e-12, atol=0)
    assert np.abs(factors.row_sums - 1).max() < 5e-3
    assert factors.data.min() > 0
    assert np.array_equal(factors.row_sums, factors.sum(axis=1))


def test_a_small_surface_beside_a_large_one():
    """Two coarse sums of this wall's and this face's contours agree within 0.01 %, though both are 5 % too large."""
    wall = quad((0, 0, 0), (2, 0, 0), (2, 2.547, 0), (0, 2.547, 0))
    face = quad((1.275, 0.452, 0.142), (1.275, 0.581, 0.142), (1.275, 0.581, 0.281), (1.275, 0.452, 0.281))
    factors = form_factors([wall, face])
    assert factors[1, 0] == pytest.approx(by_points(face, wall), rel=1e-4)
    assert abs(factors[1, 0] - by_points(face, wall)) < factors.errors[1]


def by_points(a, b, n=24):
    """The form factor from a quadrilateral to another that it sees all of from either side, by Lambert's formula at n x n Gauss points."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    corners, target = a.positions.astype(float), b.positions.astype(float)
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    total = 0.0
    for x, wx in zip((nodes + 1) / 2, weights / 2):
        for y, wy in zip((nodes + 1) / 2, weights / 2):
            p = corners[0] + x * u + y * v
            total += wx * wy * sum(abs(polygon_factor(*p, *side, target, 4)) for side in (normal, -normal))
    return total


def test_near_pairs_of_any_size():
    """Parallelograms in general position, far smaller, larger and nearer than each other: none is off by more than is asked or estimated."""
    rng = np.random.default_rng(11)
    for _ in range(60):
        pair = []
        for _ in range(2):
            turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] * 10 ** rng.uniform(-1, 0.5)
            pair.append(np.array([0 * turn[0], turn[0], turn[0] + turn[1], turn[1]]) - (turn[0] + turn[1]) / 2)
        small, large = sorted(pair, key=lambda c: np.abs(c).max())
        normal = np.cross(large[1] - large[0], large[3] - large[0])
        small += normal / np.linalg.norm(normal) * (np.linalg.norm(small[2]) * rng.uniform(1.3, 3)) + rng.uniform(-1, 1) * large[1]
        small, large = quad(*small), quad(*large)
        factors, exact = form_factors([small, large]), by_points(small, large)
        assert factors[0, 1] == pytest.approx(exact, rel=2e-3)


def test_a_box_that_all_but_stands_on_the_floor():
    """Each floor patch under it is half hidden from the walls, with a step where the box begins; from the walls that is smooth."""
    room = [p for wall in walls((0, 0, 0), (3, 2, 3)) for p in patches(wall, 3)] + walls((0.35, 0.02, 0.45), (1.4, 0.8, 1.3), inward=False)
    factors = form_factors(room, one_sided=True)
    assert np.abs(factors.row_sums - 1).max() < 5e-4


def test_threads_change_no_byte():
    scene = [p for wall in walls((0, 0, 0), (2, 1, 1)) for p in patches(wall, 3)] + walls((0.5, 0.2, 0.2), (0.9, 0.6, 0.7), inward=False)
    one, three = (form_factors(scene, one_sided=True, threads=n) for n in (1, 3))
    for name in ("data", "indices", "indptr", "areas", "row_sums", "errors"):
        assert getattr(one, name).tobytes() == getattr(three, name).tobytes(), name


def test_a_wall_hides_all_and_a_room_divided_stays_apart():
    left, right = walls((0, 0, 0), (1, 1, 1)), walls((1.5, 0, 0), (2.5, 1, 1))
    factors = form_factors([*left, *right], one_sided=True)
    assert factors[:6, 6:].nnz == 0
    screen = patches(rectangle(3, 3, 0.5), 6)  # hidden by many together
    assert form_factors([rectangle(1, 1, 0), rectangle(1, 1, 1, False), *screen])[0, 1] == 0
    crumpled = [Mesh((m.positions + np.array([0, 0, 0.02 * (k % 3)])).astype(np.float32), m.triangles) for k, m in enumerate(screen)]
    hidden = form_factors([rectangle(1, 1, 0), rectangle(1, 1, 1, False), *crumpled], reference=True)[0, 1]
    assert 0 < hidden < 0.02  # slits


def scatter(seed, count, sizes, heights):
    """Small squares in the unit cube, turned at random."""
    rng = np.random.default_rng(seed)
    spots = []
    for _ in range(count):
        half, turn = rng.uniform(*sizes) / 2, np.linalg.qr(rng.normal(size=(3, 3)))[0]
        place = np.array([*rng.uniform(0.06, 0.94, 2), rng.uniform(*heights)])
        spots.append(quad(*(np.array([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]) @ turn + place)))
    return spots


NEAR = (0.1821734, 0.1934020, 0.1928670, 0.1711269, 0.1994675, 0.1933713, 0.1918175, 0.1678425, 0.1995462, 0.1843929, 0.1751270, 0.1995997,
        0.1680018, 0.1997295, 0.1687679)  # fmt: skip
MIDDLE = (0.1646162, 0.1875664, 0.1857038, 0.1919170, 0.1905973, 0.1876113, 0.1828141, 0.1901600, 0.1900147, 0.1683714, 0.1937314, 0.1927182,
          0.1900450, 0.1905524, 0.1686122)  # fmt: skip


@pytest.mark.parametrize(("heights", "one_sided", "exact"), [((0.05, 0.2), False, NEAR), ((0.3, 0.7), True, MIDDLE)])
def test_more_obstacles_than_a_shaft_may_hold(heights, one_sided, exact):
    """144 small obstacles in a room. Exact is from walls cut into 8 x 8 patches, at 1e-4: few obstacles stand between two patches."""
    spots = scatter(0, 144, (0.02, 0.06), heights)
    factors = form_factors([*walls((0, 0, 0), (1, 1, 1)), *spots], one_sided=one_sided)
    assert np.abs(factors.toarray()[np.triu_indices(6, 1)] / exact - 1).max() < 2e-3
    if not one_sided:
        assert np.abs(factors.row_sums[:6] - 1).max() < 1e-3


def test_hardly_any_of_a_wall_is_hidden():
    """Of few rays between tiny obstacles too few meet one, or too many."""
    ends, spots = [rectangle(1, 1, 0), rectangle(1, 1, 1, False)], scatter(3, 144, (0.005, 0.02), (0.4, 0.6))
    spots = [Mesh(m.positions - np.array([0.5, 0.5, 0], np.float32), m.triangles) for m in spots]
    cut = [*patches(ends[0], 4), *patches(ends[1], 4)]
    exact = form_factors([*cut, *spots], one_sided=True)[:16, 16:32].sum() / 16
    assert exact == pytest.approx(0.1960319, rel=1e-3)
    assert form_factors([*ends, *spots], one_sided=True)[0, 1] == pytest.approx(exact, rel=2e-3)


def test_many_small_obstacles():
    rng = np.random.default_rng(4)
    spots = []
    for _ in range(150):
        x, y, z = rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(0.3, 0.7)
        spots.append(Mesh(rectangle(0.06, 0.06, z).positions + np.array([x, y, 0], np.float32), rectangle(1, 1, 0).triangles))
    ends = [rectangle(1, 1, 0), rectangle(1, 1, 1, False)]
    fine, factors = (form_factors([*ends, *spots], reference=r) for r in (True, False))
    fine, coarse = fine[0, 1], factors[0, 1]
    assert coarse == pytest.approx(fine, rel=2e-3)
    assert 0.05 < fine < 0.17
    assert factors.row_sums[0] < 1


def test_piercing_and_crossing_surfaces():
    """Two-sided squares that cross each other: each half sees both halves of the other."""
    cross = quad((-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)), quad((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0))
    factors = form_factors(cross)
    half = form_factors([quad((-1, 0, 0), (1, 0, 0), (1, 0, 1), (-1, 0, 1)), quad((-1, 0, 0), (1, 0, 0), (1, 1, 0), (-1, 1, 0))])[0, 1]
    assert factors[0, 1] == pytest.approx(2 * half, rel=1e-3)
    assert factors.row_sums[0] == factors[0, 1]


def test_what_comes_in():
    square = rectangle(1, 1, 0)
    assert luxel.form_factors is form_factors
    assert form_factors([]).shape == (0, 0)
    assert form_factors([square]).nnz == 0
    with pytest.raises(InputError, match=r"meshes\[1\]: expected a luxel.Mesh, got int"):
        form_factors([square, 3])
    with pytest.raises(InputError, match="tolerance"):
        form_factors([square], tolerance=0)
    broken = rectangle(1, 1, 1)
    broken.positions[0, 0] = np.nan
    with pytest.raises(InputError, match="surface 1: expected finite"):
        form_factors([square, broken])
    flat = Mesh(square.positions, [[0, 0, 1]])
    with pytest.warns(LuxelWarning, match="surface . has no area: its form factors are 0"):
        factors = form_factors([square, flat, rectangle(1, 1, 1)])
    assert factors.row_sums[1] == 0
    assert factors[0, 2] == pytest.approx(0.1998, rel=1e-3)
    told = []
    form_factors([square, rectangle(1, 1, 1)], progress=told.append)
    assert told[-1] == 1


def test_polygons_merge_to_whole_walls():
    wall = patches(rectangle(3, 2, 0), 7)
    corners = polygons_of(wall).corners
    merged = merge(corners.copy(), np.arange(49), 1e-6, across_groups=True)
    assert len(merged.corners) == 1
    assert set(merged.owner) == {0}
    assert len(merge(corners.copy(), np.arange(49), 1e-6).corners) == 49  # of different surfaces: not without being asked
    lshape = [wall[k] for k in range(49) if k % 7 < 3 or k < 21]
    found = polygons_of(lshape)
    assert found.area.sum() == pytest.approx(6 * len(lshape) / 49)
    assert len(merge(found.corners.copy(), found.surface, 1e-6, across_groups=True).corners) <= 4
