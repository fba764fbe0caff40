"""Lamps of about a luxel or less: their light leaves from what they are made of."""

import numpy as np
import pytest
from closed import box, matte

import luxel
from luxel import Mesh, Scene
from luxel.clock import Clock
from luxel.radiosity import prepare
from luxel.radiosity.bake import bake
from luxel.radiosity.element import AREA, GX, PX, UX, VX
from luxel.radiosity.facets import facets_of
from luxel.radiosity.labour import Labour
from luxel.radiosity.luxels import find_luxels
from luxel.radiosity.quality import QUALITIES
from luxel.radiosity.unwrap import unwrap
from luxel.raster.geometry import flatten
from luxel.scene.builtin.shapes import sphere

WATTS = 96.0  # the walls of the room have 6 x 16 m2: their mean is 1 W/m2
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]], np.int32
)


def cube(side):
    return Mesh((CORNERS * side / 2).astype(np.float32), FACES)


def ball(diameter):
    return sphere(diameter / 2, 24)


def area_of(mesh):
    a, b, c = mesh.positions[mesh.triangles].astype(float).transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def placed(turn=(0, 0, 0), mirrored=False, at=(0, 0, 0)):
    matrix = np.eye(4)
    for axis, angle in enumerate(turn):
        c, s, turned = np.cos(angle), np.sin(angle), np.eye(4)
        i, j = (k for k in range(3) if k != axis)
        turned[i, i], turned[i, j], turned[j, i], turned[j, j] = c, -s, s, c
        matrix = turned @ matrix
    if mirrored:
        matrix[:, 0] *= -1
    matrix[:3, 3] = at
    return matrix


def room(lamp, matrix=None):
    """A black room of 4 m with a lamp about its middle."""
    scene = box(matte(0.0), (-2, -2, -2), (2, 2, 2))
    scene.add(lamp, matte(0.0, WATTS / np.pi / area_of(lamp)), np.eye(4) if matrix is None else matrix)
    return scene


def walls(baked):
    """(6,) W/m2: means over the walls x0 x1 y0 y1 z0 z1."""
    luxels, means = baked.luxels, []
    for k in range(6):
        own = np.abs(luxels.position[:, k // 2] - (4 * (k % 2) - 2)) < 1e-4
        own &= luxels.emission.sum(1) == 0
        means.append(baked.irradiance[own, 0].astype(float) @ luxels.area[own] / 16)
    return np.array(means)


@pytest.mark.filterwarnings("ignore:most of the surface is black")
@pytest.mark.parametrize("density", [5, 10, 20])
@pytest.mark.parametrize("lamp", [cube(0.02), cube(0.1), ball(0.04), ball(0.1)], ids=["cube 2 cm", "cube 10 cm", "ball 4 cm", "ball 10 cm"])
def test_a_small_lamp_lights_all_walls_alike(lamp, density):
    np.testing.assert_allclose(walls(bake(room(lamp), density=density)), 1.0, rtol=0.02)


@pytest.mark.filterwarnings("ignore:most of the surface is black")
@pytest.mark.parametrize("quality", ["draft", "final"])
def test_so_it_does_at_any_quality(quality):
    np.testing.assert_allclose(walls(bake(room(cube(0.03)), density=8, quality=quality)), 1.0, rtol=0.02)


@pytest.mark.filterwarnings("ignore:most of the surface is black")
@pytest.mark.parametrize(
    ("lamp", "matrix"),
    [(cube(0.03), placed((0, np.pi / 2, 0), True)), (ball(0.05), placed((0.4, 1.1, 0.2))), (ball(0.05), placed((0.4, 1.1, 0.2), True))],
    ids=["cube, mirrored", "ball, turned", "ball, turned and mirrored"],
)
def test_so_it_does_turned_and_mirrored(lamp, matrix):
    np.testing.assert_allclose(walls(bake(room(lamp, matrix), density=8)), 1.0, rtol=0.02)


@pytest.mark.filterwarnings("ignore:most of the surface is black")
def test_walls_a_turned_cube_faces_are_the_brighter():
    """By 45 degrees about y: cos 45 degrees of two faces on x and z, one face on y."""
    angle = np.pi / 4
    coarse, fine = (walls(bake(room(cube(0.1), placed((0, angle, 0))), density=density)) for density in (4, 40))
    np.testing.assert_allclose(coarse, fine, rtol=0.01)
    np.testing.assert_allclose(coarse.mean(), 1.0, rtol=0.005)


@pytest.mark.filterwarnings("ignore:most of the surface is black")
def test_where_on_the_wall_its_light_falls():
    baked = bake(room(ball(0.04)), density=8)
    x, y, z = baked.luxels.position.astype(float).T
    wall = np.abs(x - 2) < 1e-4
    exact = WATTS / (4 * np.pi) * 2 / (4 + y[wall] ** 2 + z[wall] ** 2) ** 1.5
    np.testing.assert_allclose(baked.irradiance[wall, 0], exact, rtol=0.03)


def prepared(scene, density):
    labour = Labour(1)
    _, atlas = prepare.laid_out(scene, None, QUALITIES["normal"], density, 1024, labour, Clock(), lambda share, text: None)
    return prepare.prepare(atlas, QUALITIES["normal"], lambda count, triangles: None, labour, Clock(), lambda share, text: None)


def facets(scene, density, points=256):
    atlas = unwrap(scene, density)
    luxels, geometry = find_luxels(atlas), flatten(atlas.scene, "none")
    chosen = np.flatnonzero(luxels.emission.sum(1) > 0).astype(np.int32)
    return luxels, chosen, facets_of(luxels, chosen, geometry, atlas.chart, None, points, 1)


@pytest.mark.filterwarnings("ignore:most of the surface is black")
def test_the_facets_of_a_cube_are_its_faces():
    _, chosen, found = facets(room(cube(0.02), placed((0.3, 0.2, 0.1), at=(0.5, 0, 0))), 5)
    turned = placed((0.3, 0.2, 0.1))[:3, :3]
    assert len(chosen) == 1
    assert found.bent.tolist() == [True]
    assert found.luxel.tolist() == [0] * 6
    numbers = found.numbers.astype(float)
    np.testing.assert_allclose(numbers[AREA], 4e-4, rtol=1e-4)
    local = turned.T @ numbers[GX : GX + 3]
    np.testing.assert_allclose(np.sort(np.abs(local), 0), [[0] * 6, [0] * 6, [1] * 6], atol=1e-5)
    np.testing.assert_allclose(turned.T @ (numbers[PX : PX + 3] - [[0.5], [0], [0]]), 0.01 * local, atol=1e-6)
    for row in (UX, VX):
        np.testing.assert_allclose(np.sort(np.abs(turned.T @ numbers[row : row + 3]), 0), [[0] * 6, [0] * 6, [0.02] * 6], atol=1e-5)


@pytest.mark.parametrize("density", [4, 30])
def test_what_is_flat_has_no_facets(density):
    scene = box(matte(0.5, 1.0))
    corners = np.array([[0.2, 0.5, 0.2], [0.2, 0.5, 0.8], [0.8, 0.5, 0.8], [0.8, 0.5, 0.2]], np.float32)
    scene.add(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), matte(0.5, 2.0))
    _, chosen, found = facets(scene, density)
    assert len(chosen)
    assert not found.bent.any()
    assert found.numbers.shape == (17, 0)


@pytest.mark.filterwarnings("ignore:most of the surface is black")
@pytest.mark.parametrize("points", [1, 64, 4096])
@pytest.mark.parametrize("density", [5, 30, 200])
def test_facets_are_few_and_have_the_area_of_their_luxels(points, density):
    luxels, chosen, found = facets(room(ball(0.2)), density, points)
    count = np.bincount(found.luxel, minlength=len(chosen))
    assert ((count > 0) == found.bent).all()
    assert (np.diff(found.luxel) >= 0).all()
    assert count.max() <= 64
    assert count.sum() <= max(4 * points, 6 * found.bent.sum())
    area = np.bincount(found.luxel, found.numbers[AREA].astype(float), len(chosen))
    np.testing.assert_allclose(area[found.bent], luxels.area[chosen[found.bent]], rtol=1e-5)
    place, normal = found.numbers[PX : PX + 3], found.numbers[GX : GX + 3]
    np.testing.assert_allclose(np.linalg.norm(place, axis=0), 0.1, rtol=0.02)  # on the ball
    assert (place * normal).sum(0).min() > 0.05


@pytest.mark.filterwarnings("ignore:most of the surface is black")
def test_it_is_lit_anew_and_the_same_on_any_number_of_threads():
    one, two = (bake(room(cube(0.05)), density=8, threads=threads, transport=threads == 1) for threads in (1, 2))
    assert one.irradiance.tobytes() == two.irradiance.tobytes()
    again = one.transport.solve()
    np.testing.assert_allclose(again, one.irradiance, rtol=0.01, atol=0.01)
    np.testing.assert_allclose(one.transport.solve(2 * one.luxels.emission), 2 * again, rtol=1e-3, atol=1e-3)
    assert one.transport.solve(0 * one.luxels.emission).max() == 0


def cone(low, high, sides=48):
    """Open, about the y axis: (radius, height) below and above."""
    angle = np.arange(sides) * 2 * np.pi / sides
    rings = [np.stack([r * np.cos(angle), np.full(sides, y), r * np.sin(angle)], 1) for r, y in (low, high)]
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    triangles = [np.stack([i, j, sides + j], 1), np.stack([i, sides + j, sides + i], 1)]
    return Mesh(np.concatenate(rings).astype(np.float32), np.concatenate(triangles).astype(np.int32))


def past_the_shade(low, high, radius, rays=400_000):
    """W/m2 on the walls by rays from a ball in such a cone."""
    rng = np.random.default_rng(1)
    normal, way = (v / np.linalg.norm(v, axis=1)[:, None] for v in rng.normal(size=(2, rays, 3)))
    o, d = radius * normal, normal + way
    slope = (high[0] - low[0]) / (high[1] - low[1])
    at = low[0] + slope * (o[:, 1] - low[1])  # |o + t d| in x and z is at + slope t d_y where the cone is met
    a = d[:, 0] ** 2 + d[:, 2] ** 2 - (slope * d[:, 1]) ** 2
    b = 2 * (o[:, 0] * d[:, 0] + o[:, 2] * d[:, 2] - at * slope * d[:, 1])
    c = o[:, 0] ** 2 + o[:, 2] ** 2 - at**2
    root = b * b - 4 * a * c
    met = np.zeros(rays, bool)
    for sign in (-1, 1):
        t = (-b + sign * np.sqrt(np.maximum(root, 0))) / (2 * a)
        y = o[:, 1] + t * d[:, 1]
        met |= (root > 0) & (t > 0) & (y >= low[1]) & (y <= high[1])
    o, d = o[~met], d[~met]
    sides = [(2 * sign - o[:, k]) / d[:, k] for k in range(3) for sign in (-1, 1)]
    first = np.where(np.array(sides) > 0, sides, np.inf).argmin(0)
    light = np.bincount(first, minlength=6) * WATTS / 16 / rays
    light[[0, 1, 4, 5]] = light[[0, 1, 4, 5]].mean()
    return light


@pytest.mark.filterwarnings("ignore:most of the surface is black")
@pytest.mark.parametrize("density", [4, 8, 16])
def test_a_bulb_in_a_shade(density):
    low, high = (0.16, -0.1), (0.06, 0.1)
    scene = room(ball(0.1))
    scene.add(cone(low, high), luxel.Material((0, 0, 0, 1), roughness=1.0, specular=(0, 0, 0), double_sided=True))
    np.testing.assert_allclose(walls(bake(scene, density=density)), past_the_shade(low, high, 0.05), rtol=0.03)


@pytest.mark.filterwarnings("ignore:most of the surface is black")
@pytest.mark.parametrize(("height", "shines"), [(0.985, 5 / 6), (1.012, 1 / 6 + 4 / 6 / 4)])
def test_what_of_a_lamp_is_in_a_ceiling_does_not_shine(height, shines):
    """Its top, then all but its bottom and the lowest of four rows of samples of its sides."""
    scene = room(cube(0.04), placed(at=(0, height, 0)))
    box(matte(0.0), (-1, 1, -1), (1, 1.5, 1), scene, inward=False)
    problem = prepared(scene, 10).cut.problem
    assert len(np.unique(problem.point_luxel)) == 1
    points = problem.lights.numbers.astype(float)
    np.testing.assert_allclose(points[AREA].sum(), shines * 6 * 0.04**2, rtol=1e-3)
    assert points[GX + 1].max() < 0.1
    assert points[PX + 1].min() < height - 0.019
    np.testing.assert_allclose(points[AREA, points[GX + 1] < -0.9].sum(), 0.04**2, rtol=1e-3)


def test_lamps_of_several_charts_keep_to_them():
    scene = Scene()
    for x in range(3):
        scene.add(cube(0.02), matte(0.5, 1.0), placed(at=(x, 0, 0)))
    luxels, chosen, found = facets(scene, 5)
    assert len(chosen) == 3
    assert np.bincount(found.luxel).tolist() == [6, 6, 6]
    middle = luxels.position[chosen][found.luxel]
    assert np.abs(found.numbers[PX : PX + 3].T - middle).max() < 0.03
