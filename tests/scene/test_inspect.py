"""Inspection: each oddity is planted and found, and a sound mesh has none."""

import json

import numpy as np
import pytest

from luxel.errors import InputError
from luxel.scene import Instance, Material, Mesh, Scene, Texture, TextureRef
from luxel.scene.builtin import box, bumpy_sphere, cornell_box, icosphere, quad, sphere, torus, two_triangles
from luxel.scene.inspect import inspect
from luxel.scene.transforms import scaling, translation


def oddities(mesh_or_scene):
    scene = mesh_or_scene if isinstance(mesh_or_scene, Scene) else Scene.from_mesh(mesh_or_scene)
    return {oddity.kind: oddity.count for oddity in inspect(scene).oddities}


@pytest.mark.parametrize("mesh", [box(), sphere(), icosphere(), torus()], ids=lambda m: m.name)
def test_a_sound_mesh_has_no_oddities(mesh):
    report = inspect(Scene.from_mesh(mesh))
    assert report.oddities == []
    assert report.meshes[0].closed


def test_counts_and_bounds():
    scene = Scene(name="pair")
    scene.add(box((2, 2, 2)), Material(name="red"), name="first")
    scene.instances.append(Instance(0, translation((10, 0, 0)), 1))
    report = inspect(scene)
    assert (report.triangles, report.vertices, report.instances, report.objects) == (24, 48, 2, 2)
    assert report.bounds == [[-1, -1, -1], [11, 1, 1]]
    assert report.extent == [12, 2, 2]
    assert report.meshes[0].instances == 2
    assert report.meshes[0].material == "red"
    assert report.meshes[0].attributes == ["normals", "texcoords"]


def test_bumpy_sphere_is_closed_but_for_its_poles():
    assert oddities(bumpy_sphere(20)) == {"degenerate triangles": 80}


def test_open_edges():
    assert oddities(quad()) == {"open edges": 4}
    assert not inspect(Scene.from_mesh(quad())).meshes[0].closed


def soup(*triangles):
    p = np.array(triangles, np.float32).reshape(-1, 3)
    return Mesh(p, np.arange(len(p)).reshape(-1, 3))


A, B, C, D = (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)


def test_triangles_that_have_no_area():
    assert oddities(soup((A, A, B), (A, B, (2, 0, 0)), (A, B, C)))["degenerate triangles"] == 2


def test_duplicate_triangles_are_found_in_any_order():
    assert oddities(soup((A, B, C), (B, C, A), (B, A, C), (A, B, D)))["duplicate triangles"] == 2


def test_duplicate_and_unreferenced_vertices():
    mesh = Mesh(np.array([A, B, C, C, D], np.float32), np.array([[0, 1, 2]]))
    found = oddities(mesh)
    assert found["duplicate vertices"] == 1
    assert found["unreferenced vertices"] == 2
    seam = Mesh(mesh.positions[:4], np.array([[0, 1, 2]]), texcoords=np.eye(4, 2))
    assert "duplicate vertices" in oddities(Mesh(seam.positions, seam.triangles))
    seam.texcoords[3] = 0.5
    assert "duplicate vertices" not in oddities(seam)  # a seam of the texture is as it should be


def test_winding():
    mesh = box()
    mesh.triangles[0] = mesh.triangles[0, ::-1]
    assert oddities(mesh)["inconsistent winding"] == 3
    assert oddities(mesh)["flipped normals"] == 1
    outside_in = Mesh(box().positions, box().triangles[:, ::-1])
    assert oddities(outside_in)["inside out"] == 1
    assert "inside out" not in oddities(box())


def test_non_manifold_edge():
    found = oddities(soup((A, B, C), (B, A, D), (A, B, (0, -1, 0))))
    assert found["non-manifold edges"] == 1


def test_normals_and_texture_coordinates():
    mesh = quad()
    mesh.normals[0] = 0
    mesh.normals[1] *= 2
    mesh.texcoords[2] = 3, 0
    mesh.texcoords1 = np.full((4, 2), -1, np.float32)
    found = oddities(mesh)
    assert found["zero-length normals"] == 1
    assert found["normals not of unit length"] == 1
    assert found["texture coordinates outside 0..1"] == 1
    assert found["lightmap coordinates outside 0..1"] == 4


def test_not_finite():
    mesh = box()
    mesh.positions[0, 1] = np.nan
    mesh.positions[1, 1] = np.inf
    mesh.normals[2] = np.nan
    report = inspect(Scene.from_mesh(mesh))
    found = {o.kind: o.count for o in report.oddities}
    assert found["positions not finite"] == 2
    assert found["normals not finite"] == 1
    assert np.isfinite(report.bounds).all()
    json.dumps(report.as_dict(), allow_nan=False)


@pytest.mark.parametrize(("factor", "kind"), [(1e-5, "tiny extent"), (1e6, "huge extent")])
def test_extent(factor, kind):
    scene = Scene()
    scene.add(box(), world_from_mesh=scaling([factor] * 3))
    assert kind in oddities(scene)


def test_transforms_and_what_is_unused():
    scene = Scene(textures=[Texture(np.zeros((2, 2, 3), np.uint8))] * 2)
    scene.add(box(), Material(base_color_texture=TextureRef(1)), scaling((1, 1, -1)))
    scene.add(box(), None, scaling((1, 0, 1)))
    scene.materials.append(Material())
    scene.meshes.append(box())
    found = oddities(scene)
    assert found["mirroring transform"] == 1
    assert found["flattening transform"] == 1
    assert found["unused materials"] == 1
    assert found["unused textures"] == 1
    assert found["meshes never placed"] == 1
    scene.meshes[0].material = 7
    with pytest.raises(InputError, match="material 7"):
        inspect(scene)


def test_far_away_and_nothing_at_all():
    scene = Scene()
    scene.add(box(), world_from_mesh=translation((1e6, 0, 0)))
    assert "far from the origin" in oddities(scene)
    assert oddities(Scene()) == {"no triangles": 1}
    assert oddities(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))) == {"no triangles": 1}


@pytest.mark.parametrize("scene", [cornell_box(), two_triangles()], ids=lambda s: s.name)
def test_report_goes_to_json(scene):
    back = json.loads(json.dumps(inspect(scene).as_dict(), allow_nan=False))
    assert back["triangles"] == scene.triangle_count
    assert len(back["cameras"]) == 1


def coincidences(scene):
    return [(o.count, o.where) for o in inspect(scene).oddities if o.kind == "coincident objects"]


def test_instances_of_one_mesh_at_one_place():
    scene = Scene(meshes=[torus()], instances=[Instance(0, translation((x, 0, 0)), i, name) for i, (x, name) in enumerate(
        [(0, "a"), (1, ""), (0, "c"), (1, "d"), (1, "e"), (2, "f")])])  # fmt: skip
    assert sorted(coincidences(scene)) == [(1, "a, c"), (2, "instance 1, d and 1 more")]


def test_equal_triangles_in_other_meshes_in_another_order_through_other_matrices():
    a = icosphere()
    rng = np.random.default_rng(0)
    order, triangles = rng.permutation(len(a.positions)), rng.permutation(len(a.triangles))
    b = Mesh(a.positions[order] * np.float32(4), np.roll(np.argsort(order)[a.triangles][triangles], 1, 1))
    place = translation((1, 2, 3)) @ scaling([0.7] * 3)
    scene = Scene()
    scene.add(a, world_from_mesh=place, name="a")
    scene.add(b, world_from_mesh=place @ scaling([0.25] * 3), name="b")
    assert coincidences(scene) == [(1, "a, b")]


def test_what_is_near_or_alike_is_not_coincident():
    scene = Scene()
    scene.add(box())
    scene.add(box(), world_from_mesh=translation((1e-4, 0, 0)))
    scene.add(box(), world_from_mesh=scaling([1.001] * 3))
    other = box()
    other.triangles[0] = other.triangles[1]  # as many triangles
    scene.add(other)
    assert coincidences(scene) == []
    scene.instances[3].mesh = 0
    assert coincidences(scene) == [(1, "box, box")]


def test_coincidence_with_positions_that_are_not_finite():
    mesh = Mesh([[0, 0, 0], [np.nan, 0, 0], [0, np.inf, 0]], [[0, 1, 2]])
    assert coincidences(Scene(meshes=[mesh], instances=[Instance(0), Instance(0)])) == [(1, "instance 0, instance 1")]


def test_many_placements_of_a_mesh_are_told_apart_by_their_middles(monkeypatch):
    monkeypatch.setattr("luxel.scene.coincidence._signature", lambda *a: pytest.fail("no triangle needs to be looked at"))
    scene = Scene(meshes=[torus()], instances=[Instance(0, translation((i, 0, 0)), i) for i in range(100)])
    assert coincidences(scene) == []
