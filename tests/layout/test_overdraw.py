"""Overdraw: the counting loop against a slow oracle and meshoptimizer's analyser; what sorting clusters may cost and must bring."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel import InputError
from luxel.layout import acmr, misses, order
from luxel.layout.occlusion import sort_clusters
from luxel.layout.overdraw import _counted, _parts, directions, meshoptimizer_overdraw, overdraw
from luxel.raster.project import Window
from luxel.raster.reference import Plane, covers
from luxel.scene.builtin import bumpy_sphere, icosphere, torus

LAYERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)


def oracle(corners, depths, size, cull):
    """Fragments that pass and pixels covered, sample by sample in plain Python; corners (m, 3, 2) in 1/256 pixel, depths (m, 3)."""
    nearest, shaded = {}, 0
    for triangle, z in zip(corners.tolist(), depths, strict=True):
        a, b, c = (tuple(point) for point in triangle)
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0 or (cull and area > 0):
            continue
        plane = Plane((a, b, c), z)
        for y in range(size):
            for x in range(size):
                sample = (256 * x + 128, 256 * y + 128)
                if covers((a, b, c), sample) and plane.at(sample) >= nearest.get((x, y), -1):
                    nearest[x, y] = plane.at(sample)
                    shaded += 1
    return shaded, len(nearest)


def counted(corners, depths, size, cull, threads=1):
    screen = np.zeros((3 * len(corners), 4), np.int32)
    screen[:, :2] = np.reshape(corners, (-1, 2))
    screen.view(np.float32)[:, 2] = np.reshape(depths, -1)
    faces = np.arange(len(screen), dtype=np.int32).reshape(-1, 3)
    return _counted(faces, screen, _parts(cull, len(faces)), Window(0, 0, size, size, size, size), threads)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 7, 20]), st.booleans())
def test_the_count_is_the_oracles(seed, size, cull):
    rng = np.random.default_rng(seed)
    corners = rng.integers(-256, (size + 1) * 256, (8, 3, 2))
    corners[4:] = corners[4:] // 128 * 128  # on samples and pixel borders
    depths = rng.integers(0, 4, (8, 3)).astype(np.float32) / 4  # so that many are equally near
    assert counted(corners, depths, size, cull) == oracle(corners, depths, size, cull)


def test_wide_triangles_and_many_tiles():
    rng = np.random.default_rng(3)
    corners, depths = rng.integers(-9000, 40000, (6, 3, 2)), rng.random((6, 3), np.float32)
    assert counted(corners, depths, 130, False) == counted(corners, depths, 130, False, threads=3) == oracle(corners, depths, 130, False)


def layers(depths, outwards=True):
    """Squares that face +z at these depths, in this order: positions and triangles."""
    positions = np.concatenate([np.column_stack([LAYERS, np.full(4, z)]) for z in depths]).astype(np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]])[:, :: 1 if outwards else -1]
    return positions, np.concatenate([faces + 4 * k for k in range(len(depths))]).astype(np.int32)


def test_back_to_front_is_worst_and_front_to_back_best():
    views = {name: overdraw(*layers(z)[::-1], views=0) for name, z in (("behind", [0, 0.1, 0.2]), ("before", [0.2, 0.1, 0]))}
    assert views["behind"].worst == 3  # seen along z
    assert views["before"].worst == 1
    assert views["behind"].shaded == 3 * views["behind"].covered
    both = overdraw(*layers([0, 0.1, 0.2])[::-1], views=0, cull=False)
    assert both.worst == 3
    assert both.mean == pytest.approx(2)  # 3 from the front, 1 from behind; edge on there is nothing to see


def test_back_faces_count_as_the_caller_says():
    positions, faces = layers([0, 0.1], outwards=False)
    shown = overdraw(faces, positions, views=0, cull=np.array([True, True, False, False]))
    assert shown.covered > overdraw(faces, positions, views=0).covered


def test_threads_do_not_matter():
    mesh = bumpy_sphere(24)
    assert overdraw(mesh.triangles, mesh.positions, 3, threads=1) == overdraw(mesh.triangles, mesh.positions, 3, threads=3)


def test_a_convex_mesh_has_none_when_it_is_culled():
    mesh = icosphere(subdivisions=3)
    assert overdraw(mesh.triangles, mesh.positions).mean == 1
    assert overdraw(mesh.triangles, mesh.positions, cull=False).mean > 1.2


def test_scale_and_place_do_not_matter():
    mesh = bumpy_sphere(24)
    here = overdraw(mesh.triangles, mesh.positions, 4)
    for moved in (mesh.positions * np.float32(1024), mesh.positions + np.float32(64)):
        there = overdraw(mesh.triangles, moved, 4)
        assert there.mean == pytest.approx(here.mean, rel=0.01)


@pytest.mark.parametrize("scale", [1e-37, 1e-20, 1e20, 3e37])
def test_any_size_has_a_figure(scale):
    mesh = torus(segments=16, sides=8)
    points = mesh.positions * np.float32(scale)
    assert 1 <= overdraw(mesh.triangles, points, 2).mean < 2
    assert 1 <= meshoptimizer_overdraw(mesh.triangles, points).mean < 2
    assert sort_clusters(mesh.triangles, points, limit=1.3).gain >= 1


def test_directions_are_even():
    d = directions(200)
    assert np.allclose((d * d).sum(1), 1)
    assert np.abs(d.sum(0)).max() < 1
    assert (d[6:] @ d[6:].T - 2 * np.eye(200)).max(1).max() < np.cos(0.1)


def test_odd_meshes():
    assert overdraw(np.zeros((3, 3), np.int32), np.zeros((1, 3), np.float32)).covered == 0  # no area
    with pytest.raises(InputError, match="at least one triangle"):
        overdraw(np.zeros((0, 3), np.int32), np.zeros((1, 3), np.float32))
    with pytest.raises(InputError, match="names vertex 7"):
        overdraw([[0, 1, 7]], np.zeros((3, 3), np.float32))
    with pytest.raises(InputError, match="not finite"):
        overdraw([[0, 1, 2]], [[0, 0, 0], [1, 0, np.nan], [0, 1, 0]])
    used = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [np.nan, 0, 0]], np.float32)
    assert overdraw([[0, 1, 2]], used).covered > 0  # nobody uses the last


# meshoptimizer's definition


class _Statistics(ctypes.Structure):
    _fields_ = [("covered", ctypes.c_uint), ("shaded", ctypes.c_uint), ("overdraw", ctypes.c_float)]


@pytest.fixture(scope="module")
def analyser():
    """meshopt_analyzeOverdraw of the installed package."""
    package = pytest.importorskip("meshoptimizer", reason="meshoptimizer is not installed")
    libraries = [path for path in Path(package.__file__).parent.rglob("*") if path.suffix in (".so", ".pyd", ".dylib")]
    for path in libraries:
        function = getattr(ctypes.CDLL(str(path)), "meshopt_analyzeOverdraw", None)
        if function is not None:
            function.restype = _Statistics
            function.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_size_t]

            def analyse(faces, points, function=function):
                indices, points = np.ascontiguousarray(faces, np.uint32), np.ascontiguousarray(points, np.float32)
                found = function(indices.ctypes.data, indices.size, points.ctypes.data, len(points), 12)
                return found.shaded, found.covered

            return analyse
    pytest.skip("the installed meshoptimizer does not export meshopt_analyzeOverdraw")


@pytest.mark.parametrize("seed", range(5))
def test_meshoptimizer_counts_the_same(analyser, seed):
    """Digit for digit on what is parallel to the axes; elsewhere the wheel interpolates depth by a wrong gradient."""
    rng = np.random.default_rng(seed)
    positions = [np.zeros((1, 3)), np.ones((1, 3))]
    for axis in range(3):
        corners = rng.random((40, 3, 3))
        corners[:, :, axis] = rng.integers(1, 9, (40, 1)) / 9
        positions.append(corners.reshape(-1, 3))
    points = np.concatenate(positions).astype(np.float32)
    faces = np.arange(2, len(points), dtype=np.int32).reshape(-1, 3)[rng.permutation(120)]
    ours = meshoptimizer_overdraw(faces, points)
    assert (ours.shaded, ours.covered) == analyser(faces, points)
    assert ours.mean == ours.shaded / ours.covered > 1.5


def test_meshoptimizer_counts_nearly_the_same_on_a_model(analyser, meshes):
    from luxel import load

    mesh = load(meshes / "stanford-bunny.obj", normals=False).meshes[0]
    ours, (shaded, covered) = meshoptimizer_overdraw(mesh.triangles, mesh.positions), analyser(mesh.triangles, mesh.positions)
    assert ours.covered == pytest.approx(covered, rel=2e-4)
    assert ours.shaded == pytest.approx(shaded, rel=1e-3)


# Sorting clusters


def is_rearranged(result, faces):
    assert sorted(result.source.tolist()) == list(range(len(faces)))
    return (result.triangles == faces[result.source]).all()


@pytest.mark.parametrize("target", [{"cache": 12}, {"cache": 24, "policy": "lru"}, {"profile": "amd"}])
def test_sorting_keeps_its_limit_and_brings_less(target):
    mesh = torus(segments=90, sides=50)
    faces = order(mesh.triangles, len(mesh.positions), "lin-yu", **target).triangles  # which leaves overdraw to chance
    found = sort_clusters(faces, mesh.positions, limit=1.12, **target)
    assert is_rearranged(found, faces)
    assert 1 <= found.cost <= 1.12
    assert found.clusters > 10
    assert found.gain > 1.02
    assert overdraw(found.triangles, mesh.positions).mean < overdraw(faces, mesh.positions).mean
    if "cache" in target:
        count = [int(misses(f, **target).sum()) for f in (found.triangles, faces)]
        assert count[0] / count[1] == pytest.approx(found.cost)


def test_a_wider_limit_brings_no_less():
    mesh = bumpy_sphere(60)
    faces = order(mesh.triangles, len(mesh.positions), "tipsify").triangles
    tight, wide = (sort_clusters(faces, mesh.positions, limit=limit) for limit in (1.0, 1.2))
    assert tight.cost == 1
    assert acmr(tight.triangles) == acmr(faces)
    assert wide.gain >= tight.gain >= 1


def test_what_cannot_get_better_stays():
    mesh = icosphere(subdivisions=3)
    found = sort_clusters(mesh.triangles, mesh.positions)
    assert (found.triangles == mesh.triangles).all()
    assert (found.clusters, found.cost, found.gain) == (1, 1, 1)


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 60), st.integers(3, 20), st.integers(0, 2**32 - 1))
def test_any_soup_is_only_rearranged(count, vertices, seed):
    rng = np.random.default_rng(seed)
    faces, points = rng.integers(0, vertices, (count, 3)).astype(np.int32), rng.random((vertices, 3), np.float32)
    found = sort_clusters(faces, points, limit=1.5)
    assert is_rearranged(found, faces)
    assert found.cost <= 1.5
    assert found.gain >= 1


def test_sorting_refuses_what_it_cannot_do():
    mesh = icosphere(subdivisions=1)
    with pytest.raises(InputError, match=r"at least 1, got 0\.9"):
        sort_clusters(mesh.triangles, mesh.positions, limit=0.9)
    with pytest.raises(InputError, match="expected one of nvidia"):
        sort_clusters(mesh.triangles, mesh.positions, profile="voodoo")
