import struct
import tracemalloc

import numpy as np
import pytest
from io_samples import FACES, TETRAHEDRON, ply, png

import luxel.io
from luxel.errors import FileError, LuxelWarning
from luxel.scene import Mesh
from luxel.scene.colour import linear_from_srgb


@pytest.fixture
def load(tmp_path):
    def write_and_load(data, **options):
        path = tmp_path / "sample.ply"
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        return luxel.io.load(path, **options)

    return write_and_load


def body(vertex_properties, vertices, rest="", elements=""):
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}", *vertex_properties, *elements.splitlines()]
    return "\n".join([*lines, "end_header", *vertices]) + "\n" + rest


XYZ = [f"property float {c}" for c in "xyz"]
ONE = "element face 1\nproperty list uchar int vertex_indices"


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize("dtype", ["float", "double"])
def test_all_encodings_hold_the_same(load, order, dtype):
    mesh = load(ply(order, dtype=dtype), normals=False).meshes[0]
    assert np.array_equal(mesh.positions, TETRAHEDRON)
    assert np.array_equal(mesh.triangles, FACES)
    assert np.allclose(mesh.colors, [*linear_from_srgb(np.uint8([255, 128, 0])), 1])
    assert mesh.triangles.dtype == np.int32
    assert mesh.triangles.flags.writeable


@pytest.mark.parametrize("order", ["", "<", ">"])
def test_mixed_polygons(load, order):
    square = [[0, 1, 2, 3], [0, 1, 2], [1, 2], [3, 2, 1, 0], [0, 2, 3]]
    with pytest.warns(LuxelWarning, match="1 faces with fewer than 3 corners are dropped"):
        mesh = load(ply(order, square), normals=False).meshes[0]
    assert len(mesh.triangles) == 2 + 1 + 2 + 1
    assert mesh.triangles[2].tolist() == [0, 1, 2]
    assert mesh.triangles[-1].tolist() == [0, 2, 3]


def test_several_lists_of_any_length_in_a_row(load):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n" + "\n".join(XYZ)
    head += "\nelement face 2\nproperty list ushort float weights\nproperty list uchar uint vertex_index\nproperty uchar flag\nend_header\n"
    rows = struct.pack("<H2fB3IB", 2, 1, 2, 3, 0, 1, 2, 9) + struct.pack("<H1fB3IB", 1, 1, 3, 2, 1, 0, 9)
    mesh = load(head.encode() + TETRAHEDRON[:3].tobytes() + rows, normals=False).meshes[0]
    assert mesh.triangles.tolist() == [[0, 1, 2], [2, 1, 0]]


def test_elements_between_and_after(load):
    extra = "element other 2\nproperty int a\nproperty list uchar int b\n" + ONE + "\nelement edge 1\nproperty int from"
    mesh = load(body(XYZ, ["0 0 0", "1 0 0", "0 1 0"], "5 1 7\n6 2 8 9\n3 0 1 2\n4\n", extra), normals=False).meshes[0]
    assert mesh.triangles.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
def test_texture_coordinates_are_turned(load, names):
    data = body([*XYZ, *(f"property float {n}" for n in names)], ["0 0 0 0 0", "1 0 0 1 0.25", "0 1 0 0 1"], "3 0 1 2\n", ONE)
    assert np.allclose(load(data).meshes[0].texcoords, [[0, 1], [1, 0.75], [0, 0]])


def test_texture_coordinates_of_corners_and_the_texture_file(load, tmp_path):
    (tmp_path / "a b.png").write_bytes(png())
    faces = "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord"
    rows = "3 0 1 2 6 0 0 1 0 0 1\n3 2 1 3 6 0 1 0.5 0 1 1\n"
    data = body(XYZ, ["0 0 0", "1 0 0", "0 1 0", "1 1 0"], rows, faces).replace("ascii 1.0\n", "ascii 1.0\ncomment TextureFile a b.png\n")
    scene = load(data, crease_angle=np.pi)
    mesh = scene.meshes[0]
    assert len(mesh.positions) == 5  # vertex 1 has two texture coordinates, vertex 2 one
    assert np.allclose(mesh.texcoords[mesh.triangles], [[[0, 1], [1, 1], [0, 0]], [[0, 0], [0.5, 1], [1, 0]]])
    assert scene.textures[scene.materials[mesh.material].base_color_texture.texture].image.shape == (2, 2, 3)


def test_normals_of_the_file_are_kept_at_unit_length(load):
    data = body([*XYZ, *(f"property float {n}" for n in ("nx", "ny", "nz"))], ["0 0 0 0 0 2", "1 0 0 0 3 4", "0 1 0 0 0 0"], "3 0 1 2\n", ONE)
    with pytest.warns(LuxelWarning, match="1 normals have no direction and are made anew"):
        mesh = load(data).meshes[0]
    assert np.allclose(mesh.normals, [[0, 0, 1], [0, 0.6, 0.8], [0, 0, 1]])


def test_triangle_strips(load):
    strips = "element tristrips 1\nproperty list int int vertex_indices"
    mesh = load(body(XYZ, ["0 0 0", "1 0 0", "0 1 0", "1 1 0"], "8 0 1 2 3 -1 2 1 3\n", strips), normals=False).meshes[0]
    assert mesh.triangles.tolist() == [[0, 1, 2], [1, 3, 2], [2, 1, 3]]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("solid x", "expected a PLY header"),
        ("ply\nformat ascii 1.0\n", "expected a PLY header"),
        ("ply\nelement vertex 1\nend_header\n", "the header has no format line"),
        ("ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "line 3: expected format, element"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty quaternion x\nend_header\n", "line 4: expected `property TYPE NAME`"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty int x\nend_header\n", "line 5: property 'x' comes twice"),
        (body(XYZ[:2], ["0 0"]), "element vertex: expected rows with the properties x, y and z"),
        (body(XYZ, ["0 0 0", "1 0 zero"]), "line 9: expected numbers, got '1 0 zero'"),
        (body(XYZ, ["0 0 0"], "", ONE.replace("face 1", "face 7")), "element face: 7 rows take at least 7 numbers, 0 are left"),
        (body(XYZ, ["0 0 0"] * 3, "5 0 1 2\n", ONE), "element face, row 0: the file ends"),
        (body(XYZ, ["0 0 0"] * 3, "3 0 1 2\n", ONE.replace("uchar int", "float int")), "the length of a list cannot be a float"),
    ],
)
def test_faults_are_named(load, data, message):
    with pytest.raises(FileError, match=message) as caught:
        load(data)
    assert str(caught.value).startswith("sample.ply")


def test_a_file_of_points_is_an_empty_mesh(load):
    assert load(body(XYZ, ["0 0 0", "1 1 1"])).triangle_count == 0


def test_large_binary_files_load_without_copies_piling_up(tmp_path):
    n = 400
    grid = np.stack(np.meshgrid(np.arange(n), np.arange(n), [0]), -1).reshape(-1, 3).astype(np.float32)
    i = (np.arange(n * (n - 1)).reshape(n - 1, n)[:, :-1]).reshape(-1)
    triangles = np.concatenate([np.stack([i, i + 1, i + n], 1), np.stack([i + 1, i + n + 1, i + n], 1)]).astype(np.int32)
    luxel.io.save(Mesh(grid, triangles), tmp_path / "large.ply")
    luxel.io.load(tmp_path / "large.ply", normals=False)  # imports
    tracemalloc.start()
    mesh = luxel.io.load(tmp_path / "large.ply", normals=False).meshes[0]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    arrays = mesh.positions.nbytes + mesh.triangles.nbytes
    file = (tmp_path / "large.ply").stat().st_size
    assert np.array_equal(mesh.triangles, triangles)
    assert peak < arrays + 1.2 * file  # here the whole file is one part; a larger one is read part by part
