"""Shapes against closed forms and topology; scenes against what they promise."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.scene.builtin import (
    SCENES,
    box,
    bumpy_sphere,
    cone,
    cornell_box,
    cylinder,
    icosphere,
    lathe,
    merged,
    plane,
    quad,
    sphere,
    superellipsoid,
    surface,
    to_bake,
    torus,
    transformed,
    tube,
    two_triangles,
)
from luxel.scene.inspect import inspect
from luxel.scene.scene import Scene
from luxel.scene.transforms import rotation, scaling, translation

_T = np.linspace(0, 2 * np.pi, 41)
_RING = np.stack([np.cos(_T), 0.7 * np.sin(_T), 0.3 * np.sin(2 * _T)], 1)
_RING[-1] = _RING[0]
CLOSED = {
    "box": box((1, 2, 3)),
    "bevelled box": box((1, 2, 3), 0.2, 3),
    "fully rounded box": box((1, 1, 2), 0.5, 4),
    "ellipsoid": superellipsoid((1, 2, 3), 0.0),
    "cushion": superellipsoid((0.5, 0.2, 0.5), 0.7, crown=0.2),
    "sphere": sphere(),
    "cylinder": cylinder(),
    "cone": cone(),
    "cut cone": cone(top=0.2),
    "torus": torus(),
    "icosphere": icosphere(),
    "vase": lathe([(0, 0), (0.2, 0), (0.3, 0.5), (0.28, 0.5), (0.18, 0.02), (0, 0.02)]),
    "tube": tube([(0, 0, 0), (0, 1, 0), (0.3, 1.6, 0), (0.9, 2, 0.4)], [0.1, 0.2, 0.1, 0.05]),
    "ring": tube(_RING, 0.1),
    "merged": merged([sphere(), transformed(box(), translation((3, 0, 0)))]),
    "mirrored": transformed(cone(), scaling((-1, 2, 1))),
}
OPEN = {
    "quad": quad(2, 3),
    "plane": plane(2, 3, 4, 5),
    "curtain": surface(np.stack(np.broadcast_arrays(_T, np.arange(5.0)[:, None], np.sin(_T)), -1)),
}


def volume(mesh):
    p = mesh.positions.astype(float)[mesh.triangles]
    return np.einsum("ij,ij->", p[:, 0], np.cross(p[:, 1], p[:, 2])) / 6


def area(mesh):
    p = mesh.positions.astype(float)[mesh.triangles]
    return np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2


@pytest.mark.parametrize("name", CLOSED)
def test_closed_shapes_are_watertight_and_outward(name):
    mesh = CLOSED[name]
    report = inspect(Scene.from_mesh(mesh))
    assert report.meshes[0].closed  # by bits, not by tolerance
    assert volume(mesh) > 0
    assert {o.kind for o in report.oddities} <= {"duplicate vertices"}


@pytest.mark.parametrize("name", [*CLOSED, *OPEN])
def test_normals_are_unit_and_near_the_face(name):
    mesh = (CLOSED | OPEN)[name]
    p = mesh.positions.astype(float)[mesh.triangles]
    facing = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    cosine = np.einsum("tkj,tj->tk", mesh.normals[mesh.triangles], facing)
    assert cosine.min() > 0.5
    assert mesh.texcoords.min() >= -1e-6
    assert mesh.texcoords.max() <= 1 + 1e-6


@pytest.mark.parametrize(
    ("mesh", "exact"),
    [
        (sphere(0.5, 200), np.pi / 6),
        (icosphere(0.5, 5), np.pi / 6),
        (superellipsoid((1, 2, 3), 0.0, 60), np.pi),
        (cylinder(0.5, 2, 400), np.pi / 2),
        (cone(0.5, 3, 400), np.pi / 4),
        (cone(0.5, 3, 400, top=0.25), np.pi * (0.25 + 0.125 + 0.0625)),
        (torus(0.4, 0.1, 200, 200), 2 * np.pi**2 * 0.4 * 0.01),
        (box((1, 2, 3)), 6.0),
        (box((2, 2, 2), 1.0, 60), 4 / 3 * np.pi),
        (tube([(0, 0, 0), (0, 0, 2)], 0.5, 400), np.pi / 2),
        (tube(_RING[:2], 0.5, 400), np.pi / 4 * np.linalg.norm(_RING[1] - _RING[0])),
    ],
    ids=lambda v: getattr(v, "name", None),
)
def test_volumes(mesh, exact):
    assert volume(mesh) == pytest.approx(exact, rel=2e-3)


def test_exact_counts_and_sizes():
    assert len(box().triangles) == 12
    assert len(icosphere(subdivisions=2).triangles) == 320
    assert len(icosphere(subdivisions=2).positions) == 162
    assert area(plane(2, 3, 4, 5)) == pytest.approx(6)
    np.testing.assert_allclose(box((1, 2, 3), 0.2).bounds(), [[-0.5, -1, -1.5], [0.5, 1, 1.5]], atol=1e-6)
    np.testing.assert_allclose(superellipsoid((1, 2, 3), 0.6).bounds(), [[-0.5, -1, -1.5], [0.5, 1, 1.5]], atol=1e-6)
    np.testing.assert_array_equal(quad().normals, [[0, 0, 1]] * 4)
    np.testing.assert_array_equal(plane().normals, [[0, 1, 0]] * 4)
    assert quad().texcoords[0].tolist() == [0, 1]  # the lower left corner shows the picture's lower left


def test_superellipsoid_lies_on_its_equation():
    mesh = superellipsoid((2, 2, 2), 0.5, 8)
    np.testing.assert_allclose((np.abs(mesh.positions.astype(float)) ** 4).sum(1), 1, rtol=1e-5)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_transformed_keeps_the_outside_out(seed):
    rng = np.random.default_rng(seed)
    matrix = translation(rng.normal(size=3)) @ rotation(rng.normal(size=3), rng.uniform(0, 6))
    matrix = matrix @ scaling(rng.uniform(0.3, 2, 3) * rng.choice([-1, 1], 3))
    mesh = transformed(torus(segments=16, sides=12), matrix)
    expected = volume(torus(segments=16, sides=12)) * abs(np.linalg.det(matrix))
    assert volume(mesh) == pytest.approx(expected, rel=1e-3)
    p = mesh.positions.astype(float)[mesh.triangles]
    facing = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert (np.einsum("tkj,tj->tk", mesh.normals[mesh.triangles], facing) > 0).all()


def test_bumpy_sphere_is_its_formula():
    n = 30
    mesh = bumpy_sphere(n)
    assert mesh.triangles.shape == (4 * n * n, 3)
    p = mesh.positions.astype(float)
    r = np.linalg.norm(p, axis=1)
    polar, azimuth = np.arccos(np.clip(p[:, 1] / r, -1, 1)), np.arctan2(p[:, 2], p[:, 0])
    np.testing.assert_allclose(r, 1 + 0.1 * np.sin(9 * polar) * np.sin(9 * azimuth), atol=1e-5)
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi, rel=0.02)


def test_bumpy_sphere_normals_are_those_of_the_surface():
    coarse, fine = bumpy_sphere(20), bumpy_sphere(320)
    p = fine.positions.astype(float).reshape(321, 641, 3)
    east, south = np.gradient(p, axis=1), np.gradient(p, axis=0)
    by_differences = np.cross(east, south)[16:-16:16, 16:-16:16]
    by_differences /= np.linalg.norm(by_differences, axis=-1, keepdims=True)
    exact = coarse.normals.reshape(21, 41, 3)[1:-1, 1:-1]
    assert (by_differences * exact).sum(-1).min() > 0.999


def test_two_triangles_are_the_papers():
    scene = two_triangles()
    assert [m.positions.tolist() for m in scene.meshes] == [
        [[2, 0, -2], [0, 2, -2], [-2, 0, -2]],
        [[3.5, -1, -5], [2.5, 1.5, -5], [-1, 0.5, -5]],
    ]
    encoded = [1.055 * m.colors[0, :3].astype(float) ** (1 / 2.4) - 0.055 for m in scene.meshes]
    assert np.round(255 * np.array(encoded)).tolist() == [[217, 238, 185], [185, 217, 238]]
    camera = scene.cameras[0]
    assert (camera.eye.tolist(), camera.near, camera.far) == ([0, 0, 5], 0.1, 50)
    assert camera.yfov == pytest.approx(np.pi / 4)


def test_cornell_box_faces_its_inside():
    scene = cornell_box()
    middle = scene.bounds().mean(0)
    for mesh in scene.meshes:
        p = mesh.positions.astype(float)[mesh.triangles]
        facing = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        np.testing.assert_allclose(
            facing / np.linalg.norm(facing, axis=1, keepdims=True), mesh.normals[mesh.triangles[:, 0]], atol=2e-2
        )
        outwards = -1 if "block" in mesh.name else 1
        inner = mesh.bounds().mean(0) if "block" in mesh.name else middle
        assert (outwards * np.einsum("tj,tj->t", inner - p[:, 0], facing) > 0).all()
    emitters = [m for m in scene.meshes if any(scene.materials[m.material].emissive)]
    assert [area(m) for m in emitters] == pytest.approx([0.13 * 0.105])
    ceiling = next(m for m in scene.meshes if m.name == "ceiling")
    assert area(ceiling) + area(emitters[0]) == pytest.approx(0.556 * 0.5592)  # a hole, not an overlap
    heights = {m.name: m.bounds()[1, 1] for m in scene.meshes if "block" in m.name}
    assert heights == pytest.approx({"short block": 0.165, "tall block": 0.33})


@pytest.mark.parametrize("name", SCENES)
def test_scenes_are_sound(name):
    scene = SCENES[name]()
    scene.check()
    assert scene.name == name
    assert scene.cameras
    kinds = {o.kind for o in inspect(scene).oddities if o.where or o.kind == "no triangles"}
    allowed = {"open edges", "duplicate vertices", "texture coordinates outside 0..1"}
    if name == "bumpy-sphere":
        allowed.add("degenerate triangles")
    if name in ("room-simple", "room-complex"):
        allowed.add("non-manifold edges")  # blocks that stand on or beside each other
    assert kinds <= allowed


def test_room_is_closed_and_holds_its_furniture():
    scene = SCENES["room"]()
    assert 20_000 <= scene.triangle_count <= 100_000
    low, high = scene.bounds()
    np.testing.assert_allclose([low, high], [[-3.14, 0, -2.5], [3, 2.8, 2.5]], atol=1e-6)
    eye = scene.cameras[0].eye
    assert (low < eye).all()
    assert (eye < high).all()
    assert {m.alpha_mode for m in scene.materials} == {"OPAQUE", "MASK", "BLEND"}
    assert any(any(m.emissive) for m in scene.materials)
    assert {light.kind for light in scene.lights} == {"spot", "point"}


@pytest.mark.parametrize("name", SCENES)
def test_what_is_to_be_baked_shines_by_itself(name):
    """And the scene that is drawn without a bake stays as it is."""
    scene, again = SCENES[name](), SCENES[name]()
    made = to_bake(scene)
    assert not made.lights
    assert made.ambient is scene.ambient
    assert [m.emissive for m in scene.materials] == [m.emissive for m in again.materials]
    assert len(scene.lights) == len(again.lights)
    for baked, drawn in zip(made.materials, scene.materials, strict=True):
        assert any(baked.emissive) == any(drawn.emissive)
        assert all(a >= b for a, b in zip(baked.emissive, drawn.emissive, strict=True))
    if name == "room":
        window = next(m for m in made.materials if m.name == "daylight")
        assert max(window.emissive) > 10  # much brighter than a picture's white


def test_room_has_no_hole():
    """Every ray from its middle ends on a surface: the solid angle of all that faces the middle is at least 4 pi."""
    scene = SCENES["room"]()
    names = {"floor", "ceiling", "back wall", "front wall", "left wall", "right wall", "reveal", "daylight"}
    total = 0.0
    for mesh in scene.meshes:
        if mesh.name in names:
            a, b, c = (mesh.positions.astype(float)[mesh.triangles[:, k]] - (0.1, 1.2, -0.2) for k in range(3))
            la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
            triple = np.einsum("ij,ij->i", a, np.cross(b, c))
            rest = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
            total += 2 * np.arctan2(triple, rest).sum()  # Van Oosterom and Strackee
    assert abs(total) == pytest.approx(4 * np.pi, abs=1e-4)


def test_no_numba_is_needed():
    code = "import sys, luxel.scene.builtin as b; [f() for f in b.SCENES.values()]; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: box((1, 1, 1), 0.6), "bevel"),
        (lambda: box((1, 1)), r"size: expected \(3,\)"),
        (lambda: lathe([(1, 0)]), "2 points"),
        (lambda: lathe([(-1, 0), (1, 1)]), "radius >= 0"),
        (lambda: lathe([(1, 0), (1, 0), (1, 1)]), "point 0 and the next"),
        (lambda: torus(0.1, 0.2), "tube_radius"),
        (lambda: superellipsoid(squareness=1.0), "squareness"),
        (lambda: tube([(0, 0, 0)]), "2 points"),
        (lambda: surface(np.zeros((1, 3, 3))), "2 rows"),
        (lambda: bumpy_sphere(1), "n >= 2"),
    ],
)
def test_wrong_values_are_named(make, message):
    with pytest.raises(InputError, match=message):
        make()
