import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laid import laid_out, rectangle

from luxel import Instance, LuxelWarning, Material, Mesh, Scene, Texture, TextureRef
from luxel.radiosity import texture_space
from luxel.radiosity.edges import _chart_edges
from luxel.radiosity.luxels import find_luxels, surface_areas
from luxel.radiosity.unwrap import Atlas, unwrap
from luxel.raster.geometry import flatten
from luxel.scene.builtin import SCENES

GREY = Material((0.5, 0.25, 0.125, 1.0))


@pytest.mark.parametrize(("x", "y", "width", "height", "size"), [
    (0, 0, 1, 1, (16, 16)), (2, 3, 7, 5, (16, 16)), (0, 0, 97, 61, (97, 61)), (3, 1, 1, 40, (60, 44)),
])  # fmt: skip
def test_a_rectangle_of_whole_texels_has_as_many_luxels(x, y, width, height, size):
    luxels = find_luxels(laid_out([rectangle(x, y, width, height)], size))
    rows, columns = np.mgrid[y : y + height, x : x + width]
    assert luxels.shape == (1, size[1], size[0])
    assert np.array_equal(luxels.texel, np.stack([0 * rows, rows, columns], -1).reshape(-1, 3))
    assert np.array_equal(luxels.coverage, np.ones(width * height))
    assert np.allclose(luxels.area, 0.25, rtol=1e-6)
    assert np.allclose(luxels.position, np.stack([columns + 0.5, -rows - 0.5, 0 * rows], -1).reshape(-1, 3) * 0.5, atol=1e-5)
    assert np.array_equal(luxels.face_normal, np.tile([0, 0, 1], (width * height, 1)))
    assert np.array_equal(luxels.normal, luxels.face_normal)


def cut(polygon, axis, at, sign):
    """Exact: the part of a polygon of Fractions on one side."""
    out = []
    for here, there in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        di, dj = sign * (here[axis] - at), sign * (there[axis] - at)
        if di >= 0:
            out.append(here)
        if di * dj < 0:
            f = di / (di - dj)
            out.append(tuple(a + f * (b - a) for a, b in zip(here, there, strict=True)))
    return out


def exact_parts(corners, size):
    """{(row, column): (area, centroid x, y)} of a triangle with corners in 1/256 texel."""
    parts = {}
    for row in range(size[1]):
        for column in range(size[0]):
            polygon = [tuple(Fraction(int(v), 256) for v in corner) for corner in corners]
            for axis, at, sign in ((0, column, 1), (0, column + 1, -1), (1, row, 1), (1, row + 1, -1)):
                polygon = cut(polygon, axis, at, sign)
            area = mx = my = Fraction(0)
            for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
                cross = a[0] * b[1] - a[1] * b[0]
                area, mx, my = area + cross / 2, mx + cross * (a[0] + b[0]) / 6, my + cross * (a[1] + b[1]) / 6
            if area:
                parts[row, column] = abs(area), mx / area, my / area
    return parts


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 6 * 256), st.integers(0, 6 * 256)), min_size=3, max_size=3))
def test_every_texel_touched_is_a_luxel_with_its_exact_part(corners):
    size, places = (6, 6), np.array(corners) / 256
    area2 = np.linalg.det(np.c_[places, np.ones(3)])
    positions = np.c_[places[:, 0] * 3, -places[:, 1] * 2, np.zeros(3)]  # stretched: 6 m2 a square texel
    luxels = find_luxels(laid_out([(positions, [[0, 1, 2]], places, 0)], size)) if abs(area2) > 1e-9 else None
    parts = exact_parts(corners, size)
    if luxels is None:
        assert not parts
        return
    assert {(int(r), int(c)) for _, r, c in luxels.texel} == set(parts)
    for (_, row, column), coverage, area, position in zip(luxels.texel, luxels.coverage, luxels.area, luxels.position, strict=True):
        share, x, y = (float(v) for v in parts[int(row), int(column)])
        assert math.isclose(coverage, share, rel_tol=1e-5)
        assert math.isclose(area, 6 * share, rel_tol=1e-5)
        assert np.allclose(position, [3 * x, -2 * y, 0], atol=2e-4)


def test_slivers_are_found_along_their_whole_length():
    """A part 1/128 texel high, which no sample of any pattern hits, crosses 30 texels."""
    places = np.array([[1.0, 5 + 1 / 256], [31, 5 + 1 / 256], [31, 5 + 3 / 256], [1, 5 + 3 / 256]])
    luxels = find_luxels(laid_out([(np.c_[places, np.zeros(4)], [[0, 1, 2], [0, 2, 3]], places, 0)], (32, 8)))
    assert luxels.texel[:, 2].tolist() == list(range(1, 31))
    assert np.allclose(luxels.coverage, 1 / 128, rtol=1e-5)
    assert np.allclose(luxels.position[:, 1], 5 + 2 / 256, atol=1e-6)


@pytest.mark.parametrize("name", ["cornell-box", "room"])
def test_areas_sum_to_the_surface(name):
    scene = SCENES[name]()
    for material in scene.materials:
        material.alpha_mode, material.base_color, material.base_color_texture = "OPAQUE", (0.5,) * 4, None  # no holes, nothing too bright
    atlas = unwrap(scene, 12.0)
    luxels, geometry = find_luxels(atlas), flatten(atlas.scene, "none")
    surface = surface_areas(geometry)
    own = np.bincount(atlas.chart, surface)
    kept = np.bincount(luxels.chart, luxels.area.astype(np.float64), len(own))
    assert np.abs(kept - own).max() <= 1e-6 * own.max()
    assert np.allclose(kept, own, rtol=1e-6, atol=0)
    assert not len(luxels.lost)
    assert not len(luxels.contested)
    places = np.ravel_multi_index(luxels.texel.T, luxels.shape)
    assert (np.diff(places) > 0).all()


def on_triangles(luxels, geometry):
    """Distance of each luxel from its triangle's plane, and its least barycentric coordinate."""
    a, b, c = (geometry.positions[geometry.triangles[luxels.triangle, k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    twice = (normal**2).sum(1)
    p = luxels.position
    least = np.min([(np.cross(w - v, p - v) * normal).sum(1) / twice for v, w in ((a, b), (b, c), (c, a))], axis=0)
    return np.abs(((p - a) * normal).sum(1)) / np.sqrt(twice), least


def test_luxels_lie_in_their_triangles_and_face_their_front():
    scene = SCENES["bumpy-sphere"]()
    mesh = scene.meshes[0]
    mesh.triangles = mesh.triangles[::7]
    mirror = np.diag([-2.0, 1, 0.5, 1])
    scene.instances = [Instance(0), Instance(0, mirror, 1)]
    atlas = unwrap(scene, 25.0)
    luxels, geometry = find_luxels(atlas), flatten(atlas.scene, "none")
    distance, least = on_triangles(luxels, geometry)
    assert distance.max() < 1e-5
    assert least.min() > -1e-3
    assert np.allclose((luxels.normal**2).sum(1), 1, atol=1e-5)
    assert np.allclose((luxels.face_normal**2).sum(1), 1, atol=1e-5)
    assert ((luxels.normal * luxels.face_normal).sum(1) > 0).all()
    assert (np.sign((luxels.position * luxels.face_normal).sum(1)) > 0).mean() > 0.99  # outwards, on both


def test_the_same_bytes_for_any_number_of_threads_and_rows_at_a_time(monkeypatch):
    scene = SCENES["room"]()
    for material in scene.materials:
        material.base_color = (0.5, 0.5, 0.5, material.base_color[3])
    atlas = unwrap(scene, 8.0)
    one = find_luxels(atlas, 1)
    monkeypatch.setattr(texture_space, "MOST_PAIRS", 5000)
    three = find_luxels(atlas, 3)
    for a, b in zip(one, three, strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


def test_the_larger_of_two_charts_in_a_texel_has_it():
    left, right = rectangle(1, 1, 4.75, 3, chart=0), rectangle(5.75, 1, 4.25, 3, chart=1)
    luxels = find_luxels(laid_out([left, right], (16, 16)))
    assert np.array_equal(luxels.contested, [[0, 1, 5], [0, 2, 5], [0, 3, 5]])
    assert (luxels.chart[luxels.texel[:, 2] == 5] == 0).all()
    assert len(luxels.chart) == 3 * 9
    assert np.isclose(luxels.area[luxels.chart == 1].sum(), 4.25 * 3 / 4, rtol=1e-6)  # what it lost is on the luxels that it kept


def test_a_chart_that_loses_all_its_texels_is_told():
    small = rectangle(2.1, 2.1, 0.2, 0.2, chart=1)
    with pytest.warns(LuxelWarning, match="1 charts have no luxel"):
        luxels = find_luxels(laid_out([rectangle(1, 1, 4, 4), small], (8, 8)))
    assert luxels.lost.tolist() == [1]
    assert (luxels.chart == 0).all()


def test_charts_that_are_points_get_the_texel_that_they_lie_in():
    """Of three triangles at one place the largest stands for all; where a texel is taken, they get none."""
    triangle = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    positions = np.concatenate([triangle, triangle * 3 + [5, 0, 0], triangle + np.array([0, 0, 7])])
    points = positions, np.arange(9).reshape(3, 3), np.full((9, 2), 4.5), 0
    luxels = find_luxels(laid_out([points], (8, 8)))
    assert luxels.texel.tolist() == [[0, 4, 4]]
    assert luxels.triangle.tolist() == [1]
    assert np.allclose(luxels.position, [[6, 1, 0]])
    assert np.isclose(luxels.area[0], 0.5 + 4.5 + 0.5)
    beside = find_luxels(laid_out([points, rectangle(4, 2, 2, 5, z=-1, chart=0)], (8, 8)))
    assert len(beside.area) == 10
    assert (beside.triangle >= 3).all()


def textured(image, **material):
    return Material((1.0, 1, 1, 1), base_color_texture=TextureRef(0), metallic=0.0, specular=(0, 0, 0), **material), Texture(image, srgb=True)


def test_albedo_is_the_texture_filtered_over_the_texel():
    """Texels of 8 x 8 texture texels: stripes become their mean in linear light; wide ones stay."""
    image = np.zeros((64, 64, 3), np.uint8)
    image[:, ::2] = 188
    image[32:] = [0, 255, 0]
    material, texture = textured(image)
    with pytest.warns(LuxelWarning, match="32 luxels have an albedo of up to 1,"):
        luxels = find_luxels(laid_out([rectangle(0, 0, 8, 8, material=0)], (8, 8), [material], [texture]))
    grid = luxels.albedo.reshape(8, 8, 3)
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    assert np.allclose(grid[:3, 1:-1], linear / 2, atol=0.01)
    assert np.allclose(grid[5:, :, 1], 0.99)  # clamped
    assert np.allclose(grid[5:, :, ::2], 0, atol=1e-6)


def test_emission_is_pi_times_the_emitted_radiance():
    image = np.full((4, 4, 3), 255, np.uint8)
    image[:, :2] = 0
    material = Material((0.5,) * 4, emissive=(3.0, 2.0, 1.0), emissive_texture=TextureRef(0), name="lamp")
    luxels = find_luxels(laid_out([rectangle(0, 0, 16, 4, material=0)], (16, 4), [material], [Texture(image, filter="nearest")]))
    grid = luxels.emission.reshape(4, 16, 3)
    assert np.allclose(grid[:, :8], 0)
    assert np.allclose(grid[:, 8:], np.pi * np.array([3, 2, 1]), rtol=1e-5)
    dark = find_luxels(laid_out([rectangle(0, 0, 2, 2, material=0)], (4, 4), [GREY]))
    assert not dark.emission.any()
    assert np.allclose(dark.albedo, [0.5 * 0.5 / 0.5, 0.25, 0.125])


def test_holes_of_alpha_masks_are_no_luxels():
    image = np.full((64, 64, 4), 128, np.uint8)
    image[:, :32, 3] = 0
    image[:, 32:36, 3] = 0  # half of the fifth column of texels
    image[:, 36:, 3] = 255
    material, texture = textured(image, alpha_mode="MASK", alpha_cutoff=0.5, double_sided=True)
    luxels = find_luxels(laid_out([rectangle(0, 0, 8, 8, material=0)], (8, 8), [material], [texture]))
    assert sorted(set(luxels.texel[:, 2].tolist())) == [4, 5, 6, 7]
    assert np.allclose(luxels.area[luxels.texel[:, 2] == 4], 0.125)
    assert np.allclose(luxels.area[luxels.texel[:, 2] > 4], 0.25)
    assert luxels.two_sided.all()


def test_vertex_colours_multiply_the_albedo():
    colors = np.tile([0.5, 1, 0.25, 1], (4, 1))
    luxels = find_luxels(laid_out([rectangle(0, 0, 4, 4, material=0, colors=colors)], (4, 4), [GREY]))
    assert np.allclose(luxels.albedo, [0.25, 0.25, 0.125 * 0.25])


def test_metals_have_no_diffuse_light():
    material = Material((0.9, 0.9, 0.9, 1), metallic=1.0, shading="pbr")
    with pytest.warns(LuxelWarning, match="most of the surface is black or metal, and gives back no diffuse light: material number 0"):
        luxels = find_luxels(laid_out([rectangle(0, 0, 4, 4, material=0)], (4, 4), [material]))
    assert not luxels.albedo.any()


def test_normals_that_lean_over_are_replaced():
    normals = np.tile([0, 0, -1.0], (4, 1))
    luxels = find_luxels(laid_out([rectangle(0, 0, 2, 2, normals=normals)], (4, 4)))
    assert np.array_equal(luxels.normal, np.tile([0, 0, 1], (4, 1)))
    slanted = find_luxels(laid_out([rectangle(0, 0, 2, 2, normals=np.tile([0.6, 0, 0.8], (4, 1)))], (4, 4)))
    assert np.allclose(slanted.normal, [0.6, 0, 0.8])


@pytest.mark.parametrize(("degrees", "kept"), [(22.5, True), (39, True), (41, False), (54.7, False)])
def test_only_normals_of_curved_surfaces_bend_the_light(degrees, kept):
    """A corner that leans as over a right angle makes its triangle flat, for luxels and for seams; an octagon's stay."""
    lean = np.radians(degrees)
    normals = np.array([[np.sin(lean), 0, np.cos(lean)]] + [[0, 0, 1.0]] * 3)
    atlas = laid_out([rectangle(0, 0, 4, 4, normals=normals)], (8, 8))
    luxels, bordering = find_luxels(atlas), _chart_edges(atlas)
    assert (luxels.normal == luxels.face_normal).all() != kept
    assert np.allclose(bordering.normal, [0, 0, 1]) != kept


def test_nothing_has_no_luxels():
    empty = Atlas(Scene(), np.zeros(0, np.int32), 1, (8, 8), np.zeros(0, np.int32), False)
    luxels = find_luxels(empty)
    assert luxels.texel.shape == (0, 3)
    assert luxels.shape == (1, 8, 8)
    flat = Mesh(np.zeros((3, 3)), [[0, 1, 2]], texcoords1=[[0, 0], [1, 0], [0, 1]])
    without_area = Atlas(Scene.from_mesh(flat), np.zeros(1, np.int32), 1, (8, 8), np.zeros(1, np.int32), False)
    assert not len(find_luxels(without_area).area)
