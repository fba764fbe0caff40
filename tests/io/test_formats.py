"""STL and OFF, plain data, trimesh objects, and `load` itself."""

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from io_samples import FACES, OFF, STL_ASCII, TETRAHEDRON, png, stl_binary

import luxel.io
from luxel.errors import FileError, InputError, LuxelWarning, UnsupportedError
from luxel.io.files import atomic_write
from luxel.scene import Mesh, Scene
from luxel.scene.colour import linear_from_srgb


@pytest.fixture
def load(tmp_path):
    def write_and_load(name, data, **options):
        path = tmp_path / name
        path.write_bytes(data)
        return luxel.io.load(path, **options)

    return write_and_load


def test_binary_stl_is_joined_again(load):
    mesh = load("x.stl", stl_binary(), normals=False).meshes[0]
    assert len(mesh.positions) == 4
    assert np.array_equal(mesh.positions[mesh.triangles], TETRAHEDRON[FACES])


def test_stl_has_creases(load):
    mesh = load("x.stl", stl_binary()).meshes[0]
    assert len(mesh.positions) == 12  # no two faces of a tetrahedron are within 50 degrees


def test_a_binary_stl_that_begins_with_solid(load):
    data = b"solid".ljust(80) + stl_binary()[80:]
    assert load("x.stl", data).triangle_count == 4


def test_ascii_stl_of_several_solids(load):
    scene = load("x.STL", STL_ASCII + STL_ASCII.replace(b"sample", b"other").upper())
    assert [(m.name, len(m.triangles)) for m in scene.meshes] == [("sample", 1), ("OTHER", 1)]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (stl_binary()[:-1], "the header says 4 triangles, the file holds 3"),
        (b"abc", "3 bytes are too few"),
        (STL_ASCII.replace(b"1 0 0", b"1 0"), "1 facets need 9 coordinates, got 8"),
        (STL_ASCII.replace(b"1 0 0", b"1 0 z"), "a vertex: expected numbers, got '1 0 z'"),
        (STL_ASCII[:-16], "does not end with endsolid"),
    ],
)
def test_stl_faults_are_named(load, data, message):
    with pytest.raises(FileError, match=message):
        load("x.stl", data)


def test_stl_with_bytes_after_its_end(load):
    with pytest.warns(LuxelWarning, match="7 bytes after the last triangle are ignored"):
        assert load("x.stl", stl_binary() + b"1234567").triangle_count == 4


def test_off_with_colors_polygons_and_comments(load):
    with pytest.warns(LuxelWarning, match="colours of faces are ignored"):
        mesh = load("x.off", OFF).meshes[0]
    assert len(mesh.triangles) == 4
    assert np.allclose(mesh.colors[0], [1, 0, 0, 1])


def test_off_variants(load):
    plain = b"OFF 3 1 0\n0 0 0\n1 0 0\n\n0 1 0\n3 0 1 2"
    assert load("x.off", plain).triangle_count == 1
    normal = b"NOFF\n3 1 0\n0 0 0 0 1 0\n1 0 0 0 1 0\n0 1 0 0 1 0\n3 0 1 2\n"
    assert np.allclose(load("x.off", normal).meshes[0].normals, [0, 1, 0])
    floats = b"COFF\n3 1 0\n0 0 0 0.5 0.5 0.5 1\n1 0 0 0 0 0 0.5\n0 1 0 1 1 1 1\n3 0 1 2\n"
    colors = load("x.off", floats).meshes[0].colors
    assert np.allclose(colors, [[*[linear_from_srgb(np.float32(0.5))] * 3, 1], [0, 0, 0, 0.5], [1, 1, 1, 1]])
    textured = b"STOFF\n3 1 0\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    assert np.allclose(load("x.off", textured).meshes[0].texcoords, [[0, 1], [1, 1], [0, 0]])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"FOO\n", "expected a file that begins with OFF"),
        (b"OFF\nx y\n", "expected counts of vertices and faces, got 'x y'"),
        (b"OFF\n2 1 0\n0 0 0\n", "2 vertices and 1 faces need 3 lines, 1 are left"),
        (b"OFF\n1 1 0\n0 0\n3 0 0 0\n", "vertex 0: expected 3 numbers, got 2"),
        (b"OFF\n1 1 0\n0 0 0\n9 0 0 0\n", "face 0: a count of 9 and 3 numbers after it"),
        (b"OFF\n1 1 0\n0 0 0\n3 0 b 0\n", "expected numbers, got '3 0 b 0'"),
    ],
)
def test_off_faults_are_named(load, data, message):
    with pytest.raises(FileError, match=message):
        load("x.off", data)


@pytest.mark.parametrize("data", [b"4OFF\n1 0 0\n", b"OFF BINARY\n1 0 0\n", b"nOFF\n4\n1 0 0\n"])
def test_off_that_is_not_supported(load, data):
    with pytest.raises(UnsupportedError, match="OFF"):
        load("x.off", data)


def test_data_at_hand_is_not_copied():
    mesh = Mesh(TETRAHEDRON, FACES)
    scene = luxel.io.load(mesh)
    assert scene.meshes[0] is mesh
    assert luxel.io.load(scene) is scene
    made = luxel.io.load((TETRAHEDRON, FACES), normals=False).meshes[0]
    assert made.positions is TETRAHEDRON
    assert made.triangles is FACES
    assert luxel.io.load([TETRAHEDRON.tolist(), FACES.tolist()]).triangle_count == 4


@pytest.mark.parametrize("source", [None, 3, [1, 2, 3], (TETRAHEDRON,), open, {}])
def test_other_sources_are_refused(source):
    with pytest.raises(InputError, match="load: expected a path, a Mesh, a Scene"):
        luxel.io.load(source)


def test_faulty_arrays_are_refused():
    with pytest.raises(InputError, match=r"positions: expected \(n, 3\) float32"):
        luxel.io.load((np.zeros((3, 2)), FACES))
    with pytest.raises(InputError, match="positions: 1 of 4 are not finite"):
        luxel.io.load((np.where(TETRAHEDRON == 1, np.nan, TETRAHEDRON)[[0, 1, 0, 0]], FACES))
    with pytest.raises(InputError, match="vertex 3 of a mesh with 3"):
        luxel.io.load((TETRAHEDRON[:3], FACES))


def test_trimesh_objects():
    trimesh = pytest.importorskip("trimesh")
    from PIL import Image

    box = trimesh.creation.box()
    box.visual.vertex_colors = np.tile([255, 0, 0, 128], (8, 1))
    scene = luxel.io.load(box)
    assert scene.triangle_count == 12
    assert np.allclose(scene.meshes[0].colors, [1, 0, 0, 128 / 255])
    quad = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    picture = Image.new("RGB", (2, 3), (9, 8, 7))
    material = trimesh.visual.material.PBRMaterial(
        name="m", baseColorTexture=picture, metallicFactor=0.25, alphaMode="MASK", emissiveFactor=[1, 0, 0]
    )
    quad.visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [0, 1]], material=material)
    whole = trimesh.Scene()
    whole.add_geometry(quad, node_name="a")
    whole.add_geometry(quad, node_name="b", geom_name="geometry_0", transform=trimesh.transformations.translation_matrix([1, 2, 3]))
    scene = luxel.io.load(whole)
    placed = {i.name: i for i in scene.instances}
    assert np.allclose(placed["b"].world_from_mesh[:3, 3], [1, 2, 3])
    mesh = scene.meshes[placed["a"].mesh]
    assert np.allclose(mesh.texcoords, [[0, 1], [1, 1], [0, 0]])
    made = scene.materials[mesh.material]
    assert (made.name, made.metallic, made.alpha_mode, made.emissive, made.shading) == ("m", 0.25, "MASK", (1, 0, 0), "pbr")
    assert (scene.textures[made.base_color_texture.texture].image == [9, 8, 7]).all()
    simple = quad.copy()
    simple.visual = trimesh.visual.TextureVisuals(
        uv=[[0, 0], [1, 0], [0, 1]], material=trimesh.visual.material.SimpleMaterial(diffuse=[255, 0, 0, 255], image=picture)
    )
    made = luxel.io.load(simple)
    assert made.materials[0].base_color == (1, 0, 0, 1)
    assert made.materials[0].shading is None


def test_extensions(tmp_path):
    for name in ("model.fbx", "model", "model.ply.gz"):
        with pytest.raises(FileError, match=r"expected one of the extensions .ply, .obj, .stl, .off, .gltf, .glb, got"):
            luxel.io.load(tmp_path / name)
        with pytest.raises(FileError, match="expected one of the extensions"):
            luxel.io.save(Scene(), tmp_path / name)


def test_what_is_not_a_file(tmp_path):
    with pytest.raises(FileError, match=r"none.obj: .*No such file"):
        luxel.io.load(tmp_path / "none.obj")
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(FileError, match=r"folder.ply"):
        luxel.io.load(tmp_path / "folder.ply")
    for name in ("pipe.obj", "pipe.ply", "pipe.gltf"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(FileError, match="not a plain file"):
            luxel.io.load(tmp_path / name)
    with pytest.raises(FileError, match="null"):
        luxel.io.load("a\0b.obj")


def test_atomic_write_leaves_no_halves(tmp_path):
    path = tmp_path / "out.txt"
    path.write_text("before")
    path.chmod(0o640)
    with pytest.raises(ZeroDivisionError), atomic_write(path) as file:
        file.write(b"%d" % (file.write(b"half") // 0))
    assert path.read_text() == "before"
    with atomic_write(path) as file:
        file.write(b"after")
        assert path.read_text() == "before"
    assert path.read_text() == "after"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert os.listdir(tmp_path) == ["out.txt"]
    with pytest.raises(FileError, match="cannot write: No such file or directory"), atomic_write(tmp_path / "no" / "out.txt"):
        pass


def test_files_load_in_threads(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "a.png").write_bytes(png())
    counts = []

    def work():
        counts.extend(luxel.io.load(tmp_path / "a.obj").triangle_count for _ in range(50))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counts == [1] * 200


def test_import_is_light(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    code = (
        "import sys, luxel.io; luxel.io.load(sys.argv[1]);"
        "print([m for m in ('numba', 'trimesh', 'pygltflib', 'PIL', 'scipy', 'OpenEXR', 'meshoptimizer') if m in sys.modules])"
    )
    path = Path(luxel.io.__file__).parents[2]
    out = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a.obj")], capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": str(path)}
    )
    assert out.stdout.strip() == "[]"


def test_warnings_point_at_the_caller(tmp_path):
    points = tmp_path / "x.off"
    points.write_text("OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n2 0 1\n")
    with pytest.warns(LuxelWarning, match="fewer than 3 corners") as caught:
        luxel.io.load(points)
    assert [warning.filename for warning in caught] == [__file__]


def test_a_missing_file_is_named_once(tmp_path):
    with pytest.raises(FileError, match=r"^\S*none.obj: cannot read: No such file"):
        luxel.io.load(tmp_path / "none.obj")


def test_what_is_no_glb_is_said(load):
    with pytest.raises(FileError, match=r"x.glb: neither a GLB \(it begins with b'hell'"):
        load("x.glb", b"hello, world")
