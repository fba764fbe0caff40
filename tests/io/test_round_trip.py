"""What is saved comes back: everything through glTF and GLB, what the others hold through them."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from io_samples import FACES, TETRAHEDRON

import luxel.io
from luxel.errors import FileError, LuxelWarning
from luxel.scene import Ambient, Camera, Instance, Light, Material, Mesh, Scene, Texture, TextureRef
from luxel.scene.transforms import rotation, scaling, translation

ARRAYS = ("positions", "triangles", "normals", "texcoords", "texcoords1", "colors", "tangents")


def full_scene() -> Scene:
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    image = rng.integers(0, 256, (5, 4, 4), dtype=np.uint8)
    textures = [
        Texture(image, True, ("clamp", "mirror"), "bilinear", "picture"),
        Texture(image, False, filter="nearest"),
        Texture(rng.integers(0, 256, (2, 2, 1), dtype=np.uint8), False),
        Texture(rng.random((3, 3, 3), np.float32) * 40, False, name="light"),
    ]
    materials = [
        Material(
            (0.1, 0.2, 0.3, 0.4), 0.5, 0.25, (4.0, 2.0, 0.0), alpha_mode="BLEND", double_sided=True, shading="pbr", name="all",
            base_color_texture=TextureRef(0, 1, (0.5, 0.25), 0.125, (2.0, 3.0)), metallic_roughness_texture=TextureRef(1),
            normal_texture=TextureRef(1), normal_scale=0.5, occlusion_texture=TextureRef(2, 1), occlusion_strength=0.75,
            emissive_texture=TextureRef(0), lightmap_texture=TextureRef(3, 1, scale=(0.5, 0.5)), lightmap_scale=2.0,
        ),
        Material(alpha_mode="MASK", alpha_cutoff=0.75, shading="unlit", name="unlit"),
        Material(specular=(0.1, 0.2, 0.3), shininess=30.0, shading="phong"),
        Material(),
    ]  # fmt: skip
    uv = rng.random((4, 2), np.float32)
    meshes = [
        Mesh(TETRAHEDRON, FACES, normals, uv, uv * 2, rng.random((4, 4), np.float32), np.tile([1, 0, 0, -1], (4, 1)), 0, "one"),
        Mesh(TETRAHEDRON + 1, FACES[:2], normals, material=1, name="two"),
        Mesh(TETRAHEDRON - 1, FACES, normals, material=2, name="three"),
    ]
    pose = translation((1, 2, 3)) @ rotation((0, 1, 0), 0.5) @ scaling((1, -2, 3))
    return Scene(
        meshes,
        [Instance(0, None, 0, "thing"), Instance(1, None, 0, "thing"), Instance(0, pose, 1, "again"), Instance(2, pose, 2, "more")],
        materials,
        textures,
        [
            Light("spot", (1.0, 0.5, 0.25), 12.0, translation((0, 5, 0)), 9.0, 0.125, 0.5, "lamp"),
            Light("point", intensity=3.0),
            Light("directional", world_from_light=rotation((1, 0, 0), -1.0)),
        ],
        [Camera.look_at((3, 2, 1), (0, 0, 0), yfov=0.75, near=0.5, far=30.0, aspect=1.5, name="front"),
         Camera(yfov=None, height=4.0, near=0.0, far=8.0, aspect=2.0)],
        Ambient((0.1, 0.2, 0.3), (0.3, 0.2, 0.1)),
        "whole",
    )  # fmt: skip


def assert_same(a, b, where=""):
    """Two dataclasses, lists or values are equal, arrays to the bit, matrices to rounding."""
    if isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        assert a.shape == b.shape, where
        assert np.allclose(a, b, rtol=1e-12, atol=1e-12) if a.dtype == np.float64 else np.array_equal(a, b), where
    elif isinstance(a, list):
        assert len(a) == len(b), where
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_same(x, y, f"{where}[{i}]")
    elif hasattr(a, "__dict__"):
        for key, value in vars(a).items():
            assert_same(value, getattr(b, key), f"{where}.{key}")
    else:
        numeric = isinstance(a, float) or (isinstance(a, tuple) and not isinstance(a[0], str))
        assert a == (pytest.approx(b, rel=1e-12) if numeric else b), where


@pytest.mark.parametrize("extension", ["gltf", "glb"])
def test_gltf_keeps_everything(tmp_path, extension):
    pytest.importorskip("OpenEXR")
    scene = full_scene()
    luxel.io.save(scene, tmp_path / f"x.{extension}")
    back = luxel.io.load(tmp_path / f"x.{extension}")
    for texture in back.textures:
        texture.name = next((t.name for t in scene.textures if np.array_equal(t.image, texture.image) and t.srgb == texture.srgb), "?")
    assert_same(_by_material(scene), _by_material(back))
    if extension == "glb":
        assert [p.name for p in tmp_path.iterdir()] == ["x.glb"]


def _by_material(scene):
    """The scene with textures in the order in which its materials name them."""
    order = []
    for material in scene.materials:
        for name, ref in vars(material).items():
            if name.endswith("_texture") and ref is not None:
                order.append(ref.texture)
    order = list(dict.fromkeys(order))
    for material in scene.materials:
        for name, ref in vars(material).items():
            if name.endswith("_texture") and ref is not None:
                ref.texture = order.index(ref.texture)
    scene.textures = [scene.textures[k] for k in order]
    return scene


@pytest.mark.parametrize("extension", ["gltf", "glb"])
def test_saving_again_writes_the_same_bytes(tmp_path, extension):
    pytest.importorskip("OpenEXR")
    luxel.io.save(full_scene(), tmp_path / f"x.{extension}")
    first = (tmp_path / f"x.{extension}").read_bytes()
    luxel.io.save(full_scene(), tmp_path / f"x.{extension}")
    assert (tmp_path / f"x.{extension}").read_bytes() == first


def test_default_material_and_empty_meshes(tmp_path):
    scene = Scene()
    scene.add(Mesh(TETRAHEDRON, FACES))
    scene.add(Mesh(TETRAHEDRON[:0], FACES[:0]))
    luxel.io.save(scene, tmp_path / "x.glb")
    back = luxel.io.load(tmp_path / "x.glb", normals=False)
    assert len(back.meshes) == 1
    assert_same(back.materials[back.meshes[0].material], Material())
    luxel.io.save(Scene(), tmp_path / "empty.gltf")
    assert luxel.io.load(tmp_path / "empty.gltf").instances == []


@pytest.mark.parametrize("extension", ["ply", "obj", "stl", "off"])
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32), st.integers(3, 40), st.booleans(), st.booleans(), st.booleans())
def test_one_mesh(tmp_path, extension, seed, n, with_uv, with_colors, with_normals):
    rng = np.random.default_rng(seed)
    positions = (rng.normal(size=(n, 3)) * 10.0 ** rng.integers(-6, 7)).astype(np.float32)
    triangles = rng.permuted(np.tile(np.arange(n, dtype=np.int32), (2 * n, 1)), axis=1)[:, :3]
    normals = rng.normal(size=(n, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    uv, colors = rng.random((n, 2), np.float32), (rng.integers(0, 256, (n, 4)) / 255).astype(np.float32)
    mesh = Mesh(positions, triangles, normals if with_normals else None, uv if with_uv else None, colors=colors if with_colors else None)
    lost = {"stl": with_uv or with_colors, "off": with_uv, "ply": False, "obj": False}[extension]
    path = tmp_path / f"x.{extension}"
    if lost:
        with pytest.warns(LuxelWarning, match="the format does not hold"):
            luxel.io.save(mesh, path)
    else:
        luxel.io.save(mesh, path)
    back = luxel.io.load(path, normals=False).meshes[0]
    assert np.array_equal(back.positions[back.triangles], positions[triangles])
    if with_normals and extension != "stl":
        assert np.array_equal(back.normals[back.triangles], normals[triangles])
    if with_uv and extension in ("ply", "obj"):
        assert np.allclose(back.texcoords[back.triangles], uv[triangles], atol=1e-7)
    if with_colors and extension in ("ply", "off"):
        assert np.allclose(back.colors[back.triangles], colors[triangles], atol=0.5 / 12)
    if with_colors and extension == "obj":
        assert np.allclose(back.colors[back.triangles][..., :3], colors[triangles][..., :3], atol=1e-5)


@pytest.mark.parametrize("extension", ["ply", "obj", "stl", "off"])
def test_instances_are_placed_in_the_world(tmp_path, extension):
    scene = full_scene()
    scene.materials, scene.textures = [], []
    for mesh in scene.meshes:
        mesh.material, mesh.texcoords, mesh.texcoords1, mesh.colors = -1, None, None, None
    luxel.io.save(scene, tmp_path / f"x.{extension}")
    back = luxel.io.load(tmp_path / f"x.{extension}", normals=False)
    assert back.triangle_count == scene.triangle_count
    matrices = [i.world_from_mesh for i in scene.instances]
    points = [scene.meshes[i.mesh].positions[scene.meshes[i.mesh].triangles].reshape(-1, 3) for i in scene.instances]
    world = np.concatenate([p @ m[:3, :3].T + m[:3, 3] for p, m in zip(points, matrices, strict=True)])
    loaded = np.concatenate([m.positions[m.triangles].reshape(-1, 3) for m in back.meshes])
    assert np.allclose(np.sort(loaded, 0), np.sort(world, 0), atol=1e-6)
    # A mirrored instance keeps its outside: the signed volume stays the sum of the absolute ones.
    pose = scene.instances[2].world_from_mesh
    volume = sum(abs(np.linalg.det(i.world_from_mesh[:3, :3])) for i in scene.instances if i.mesh in (0, 2)) / 6
    assert np.linalg.det(pose[:3, :3]) < 0
    corners = np.concatenate([m.positions[m.triangles] for m in back.meshes]).astype(np.float64)
    open_part = TETRAHEDRON[FACES[:2]] + 1  # of mesh 1
    signed = np.linalg.det(corners).sum() / 6 - np.linalg.det(open_part.astype(np.float64)).sum() / 6
    assert signed == pytest.approx(volume, rel=1e-4)


def test_obj_keeps_materials_and_textures(tmp_path):
    scene = full_scene()
    with pytest.warns(LuxelWarning):
        luxel.io.save(scene, tmp_path / "x.obj")
    back = luxel.io.load(tmp_path / "x.obj")
    assert len(back.meshes) == 4
    first = back.materials[0]
    assert (first.name, first.base_color, first.emissive, first.roughness, first.metallic) == ("all", (0.1, 0.2, 0.3, 0.4), (4, 2, 0), 0.25, 0.5)
    assert (first.base_color_texture.scale, first.base_color_texture.offset) == ((2, 3), (0.5, 0.25))
    assert np.array_equal(back.textures[first.base_color_texture.texture].image, scene.textures[0].image)
    assert (back.materials[2].specular, back.materials[2].shininess) == ((0.1, 0.2, 0.3), 30)


@pytest.mark.parametrize("extension", ["ply", "obj", "stl", "off", "gltf", "glb"])
def test_a_folder_that_is_missing(tmp_path, extension):
    with pytest.raises(FileError, match="cannot write"):
        luxel.io.save(Mesh(TETRAHEDRON, FACES), tmp_path / "none" / f"x.{extension}")
