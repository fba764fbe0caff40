"""Real models, where they are at hand."""

import warnings

import numpy as np
import pytest

import luxel.io

EXPECTED = {  # meshes, triangles, materials, textures
    "armadillo.obj": (1, 86482, 0, 0),
    "beetle.off": (1, 38656, 0, 0),
    "boat.obj": (1, 32416, 0, 0),
    "dragon_vrip.ply": (1, 871414, 0, 0),
    "fandisk.obj": (1, 12946, 0, 0),
    "horse.ply": (1, 96966, 0, 0),
    "stanford-bunny.obj": (1, 69451, 0, 0),
    "teapot.obj": (1, 6320, 0, 0),
    "scenes/CornellBox-Original.obj": (8, 36, 8, 0),
    "scenes/DamagedHelmet/DamagedHelmet.gltf": (1, 15452, 1, 5),
    "scenes/lightmap/scene.gltf": (3, 78, 3, 0),
    "scenes/living_room.glb": (7, 5088, 7, 0),
    "scenes/zdm2.glb": (1, 58772, 1, 0),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_loads_without_a_warning(meshes, name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = luxel.io.load(meshes / name)
    assert (len(scene.meshes), scene.triangle_count, len(scene.materials), len(scene.textures)) == EXPECTED[name]
    for mesh in scene.meshes:
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=2e-3)


def test_cornell_box_walls_are_where_they_belong(meshes):
    """Its faces count from their own line backwards."""
    scene = luxel.io.load(meshes / "scenes/CornellBox-Original.obj")
    names = [material.name for material in scene.materials]
    boxes = {names[mesh.material]: mesh.bounds() for mesh in scene.meshes}
    assert np.allclose(boxes["floor"][:, 1], 0)
    assert np.allclose(boxes["ceiling"][:, 1], 1.99)
    assert boxes["leftWall"][1, 0] < boxes["rightWall"][0, 0]
    lit = scene.materials[names.index("light")]
    assert lit.emissive == (17, 12, 4)


def test_normals_of_a_sharp_part_and_of_a_scan(meshes):
    """A crease splits the edges of a part made by machine, and few vertices of a scan."""
    counts = {}
    for name in ("fandisk.obj", "stanford-bunny.obj"):
        smooth = luxel.io.load(meshes / name, normals=False).meshes[0]
        counts[name] = len(luxel.io.load(meshes / name).meshes[0].positions) / len(smooth.positions)
    assert counts["fandisk.obj"] > 1.05
    assert counts["stanford-bunny.obj"] < 1.05


def test_helmet_survives_glb(meshes, tmp_path):
    scene = luxel.io.load(meshes / "scenes/DamagedHelmet/DamagedHelmet.gltf")
    luxel.io.save(scene, tmp_path / "x.glb")
    back = luxel.io.load(tmp_path / "x.glb")
    for texture, other in zip(scene.textures, back.textures, strict=True):
        assert np.array_equal(texture.image, other.image)
        assert (texture.srgb, texture.wrap, texture.filter) == (other.srgb, other.wrap, other.filter)
    for name in ("positions", "triangles", "normals", "texcoords"):
        assert np.array_equal(getattr(scene.meshes[0], name), getattr(back.meshes[0], name))
