import numpy as np
import pytest
from io_samples import MTL, OBJ, png

import luxel.io
from luxel.errors import FileError, LuxelWarning
from luxel.scene.colour import linear_from_srgb


@pytest.fixture
def load(tmp_path):
    def write_and_load(text, **options):
        path = tmp_path / "sample.obj"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return luxel.io.load(path, **options)

    return write_and_load


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def area(mesh):
    a, b, c = mesh.positions[mesh.triangles].transpose(1, 0, 2)
    return np.cross(b - a, c - a)[:, 2].sum() / 2


def test_materials_and_objects(load, tmp_path):
    (tmp_path / "sample.mtl").write_bytes(MTL)
    (tmp_path / "sample.png").write_bytes(png())
    with pytest.warns(LuxelWarning, match="points and lines are dropped"):
        scene = load(OBJ)
    assert [(m.name, len(m.triangles), m.material) for m in scene.meshes] == [("first", 2, 0), ("first", 1, 1)]
    red, shiny = scene.materials
    assert (red.name, red.base_color, red.specular, red.shininess, red.shading) == ("red", (1, 0, 0, 1), (0.5,) * 3, 20, None)
    assert (shiny.base_color, shiny.alpha_mode) == ((0.1, 0.2, 0.3, 0.5), "BLEND")
    assert red.base_color_texture.scale == (2, 2)
    assert red.base_color_texture.offset == (0, -1)  # v runs the other way
    assert [i.object for i in scene.instances] == [0, 0]
    assert np.allclose(scene.meshes[1].colors[:, :3].max(0), 1)


def test_missing_texture_coordinates_are_filled_not_dropped(load):
    mesh = load(SQUARE + "vt 0.5 0.5\nvt 1 1\nf 1/1 2/2 3\nf 1/1 3/2 4//\n", crease_angle=np.pi).meshes[0]
    assert np.allclose(mesh.texcoords[mesh.triangles][0], [[0.5, 0.5], [1, 0], [0, 1]])


@pytest.mark.parametrize("faces", ["f 1 2 3 4", "f -4 -3 -2 -1", "f 1/1 2/1 3/1 4/1", "f 1//1 2//1 3//1 4//1", "f 1/1/1 2/1/1 3/1/1 4/1/1",
                                   "f -4/-1/-1 -3/-1/-1 -2/-1/-1 -1/-1/-1", "f 1/1 2//1 3 4/1/1", "f 1/ 2/ 3/ 4/", "f 1 2 3\nf 1 3 4",
                                   "f 1 2 \\\n 3 4", "  f 1 2 3 4 # a comment", "f\t1\t2\t3\t4\r"])  # fmt: skip
def test_notations(load, faces):
    mesh = load(SQUARE + "vt 0.5 0.5\nvn 0 0 1\n" + faces).meshes[0]
    assert len(mesh.triangles) == 2
    assert area(mesh) == 1
    assert np.allclose(mesh.normals, [0, 0, 1])


def test_relative_indices_count_from_their_line(load):
    scene = load("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 7 0 0\nv 5 2 0\nf -3 -2 -1\n", normals=False)
    mesh = scene.meshes[0]
    assert mesh.triangles.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_concave_and_large_polygons_keep_their_area(load):
    arrow = [(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)]
    n = 24
    star = [((1 + k % 2) * np.cos(2 * np.pi * k / n), (1 + k % 2) * np.sin(2 * np.pi * k / n)) for k in range(n)]
    dart = [(0, 0), (2, 1), (0, 2), (1, 1)]
    for points in (arrow, star, dart, arrow[3:] + arrow[:3], dart[1:] + dart[:1]):
        text = "".join(f"v {x} {y} 0\n" for x, y in points) + "f " + " ".join(map(str, range(1, len(points) + 1)))
        mesh = load(text, normals=False).meshes[0]
        x, y = np.array(points).T
        expected = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
        a, b, c = mesh.positions[mesh.triangles].transpose(1, 0, 2)
        doubled = np.cross(b - a, c - a)[:, 2]
        assert (doubled >= -1e-6).all()  # none is folded over
        assert np.isclose(doubled.sum() / 2, expected)
        assert len(mesh.triangles) == len(points) - 2


def test_vertices_of_a_plain_file_stay_as_they_are(load):
    mesh = load("v 9 9 9\n" + SQUARE + "f 2 3 4 5\n", normals=False).meshes[0]
    assert len(mesh.positions) == 5
    assert np.array_equal(mesh.positions[0], [9, 9, 9])


def test_corners_share_vertices_where_all_indices_agree(load):
    text = SQUARE + "vt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 1/1 3/1 4/1\nf 1/2 2/1 3/1\n"
    mesh = load(text, crease_angle=np.pi).meshes[0]
    assert len(mesh.positions) == 5


def test_colors_and_homogeneous_coordinates(load):
    mesh = load("v 0 0 0 0.5 0.25 0\nv 1 0 0\nv 0 1 0 1 1 1\nf 1 2 3\n").meshes[0]
    assert np.allclose(mesh.colors, [[*linear_from_srgb(np.float32([0.5, 0.25, 0])), 1], [1, 1, 1, 1], [1, 1, 1, 1]])
    assert load("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n").meshes[0].colors is None


def test_library_is_found_beside_the_file(load, tmp_path):
    (tmp_path / "box.mtl").write_text("newmtl a\nKd 0.1 0.2 0.3\nnewmtl b\nKe 17 12 4\n")
    scene = load("mtllib scenes/box.mtl\n" + SQUARE + "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n")
    assert [m.base_color[:3] for m in scene.materials] == [(0.1, 0.2, 0.3), (0.8, 0.8, 0.8)]
    assert scene.materials[1].emissive == (17, 12, 4)


def test_missing_library_and_texture_are_said(load, tmp_path):
    with pytest.warns(LuxelWarning) as caught:
        scene = load("mtllib none.mtl\n" + SQUARE + "usemtl a\nf 1 2 3\n")
    assert ["'none.mtl' is not there" in str(w.message) for w in caught] == [True, False]
    assert "material 'a' is in no material library" in str(caught[1].message)
    assert scene.materials[0].name == "a"
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd none.png\nbump hills.png\n")
    with pytest.warns(LuxelWarning) as caught:
        scene = load("mtllib m.mtl\n" + SQUARE + "usemtl a\nf 1 2 3\n")
    second, first = sorted(str(w.message) for w in caught)
    assert first == "m.mtl, material a: bump is ignored"
    assert second.startswith("m.mtl, material a, map_kd: cannot read")
    assert second.endswith("none.png: No such file or directory; the texture is left out")
    assert scene.materials[0].base_color_texture is None


def test_map_options_alpha_and_further_maps(load, tmp_path):
    for name, value in (("my colour.png", 50), ("cut.png", 7), ("n.png", 128)):
        (tmp_path / name).write_bytes(png(value=value))
    lines = ["newmtl a", "Tr 0.25", "map_Kd -clamp on -o 0.5 0.25 my colour.png", "map_d cut.png", "norm n.png", "map_Ke n.png", "Pr 0.3", "Pm 1"]
    (tmp_path / "m.mtl").write_text("\n".join(lines))
    scene = load("mtllib m.mtl\n" + SQUARE + "usemtl a\nf 1 2 3\n")
    m = scene.materials[0]
    texture = scene.textures[m.base_color_texture.texture]
    assert (texture.image == [50, 50, 50, 7]).all()
    assert texture.wrap == ("clamp", "clamp")
    assert m.base_color_texture.offset == (0.5, -0.25)
    assert (m.base_color[3], m.alpha_mode, m.roughness, m.metallic, m.emissive) == (0.75, "BLEND", 0.3, 1, (1, 1, 1))
    assert scene.textures[m.normal_texture.texture].srgb is False
    assert scene.textures[m.emissive_texture.texture].srgb is True


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nv 1 x 0\n", "line 2: expected numbers, got '1 x 0'"),
        ("# one\nv 0 0 0\nvt 1\nv 1 0\n", "line 4: `v` needs 3 numbers, got 2"),
        (SQUARE + "f 1 2 a\n", "line 5: expected numbers, got '1 2 a'"),
        (SQUARE + "f 1 2 3\nf 1/1/1/1 2 3\n", "line 6: expected corners of the form"),
        (SQUARE + "f 1 2 3\nf 1-2 2 3\n", "line 6: expected numbers, got '1-2 2 3'"),
    ],
)
def test_faults_are_named(load, text, message):
    with pytest.raises(FileError, match=message) as caught:
        load(text)
    assert str(caught.value).startswith("sample.obj")


def test_indices_that_name_nothing(load):
    with pytest.warns(LuxelWarning) as caught:
        mesh = load(SQUARE + "vt 0 0\nf 1/1 2/9 3/1\nf 1 2 9\nf 0 1 2\nf -9 1 2\n", crease_angle=np.pi).meshes[0]
    assert len(mesh.triangles) == 1
    assert ["1 corners name a vt" in str(w.message) or "3 of 4 triangles name a vertex" in str(w.message) for w in caught] == [True, True]


def test_the_same_as_trimesh_on_a_plain_file(load):
    trimesh = pytest.importorskip("trimesh")
    sphere = trimesh.creation.icosphere(2)
    text = trimesh.exchange.obj.export_obj(sphere, include_normals=False, digits=9)
    mesh = load(text, normals=False).meshes[0]
    assert np.allclose(mesh.positions, sphere.vertices, atol=1e-7)
    assert np.array_equal(mesh.triangles, sphere.faces)
