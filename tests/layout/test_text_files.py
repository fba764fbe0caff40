"""OBJ, PLY and the rest laid out: statements, properties and elements stay; files are whole or not there."""

import json
import os

import numpy as np
import pytest
from gltf_samples import grid
from hypothesis import given, settings
from hypothesis import strategies as st

import luxel
from luxel.layout import obj_file, ply_file
from luxel.layout.clean import vertex_rows
from luxel.layout.files import DifferenceError, optimize_file
from luxel.layout.optimize import Options
from luxel.layout.same import Soup, difference, soups_of
from luxel.scene.builtin import torus

LEAN = Options("tipsify", weld=True, drop_degenerate=True, drop_duplicates=True, drop_unused=True)


def laid(source, target, options=Options("tipsify")):  # noqa: B008
    report, _ = optimize_file(source, target, options, check=True)
    return report


def loaded(path):
    return soups_of(luxel.load(path, normals=False))


# OBJ

OBJ = """\
# made by hand
mtllib lib.mtl
o first
v 0 0 0 1 0 0
v 1 0 0 0 1 0
v 1 1 0 0 0 1 # corner
v 0 1 0 1 1 1
vt 0 0
vt 1 0
vt 1 1
vn 0 0 1
usemtl red
s 1
f 1/1/1 2/2/1 3/3/1
f -4/-3 -2/-1 -1
g top
usemtl blue
f 4 3 2 1
v 5 5 5
v 6 5 5
v 6 6 5
f -3//1 -2//1 -1//1
f 5 6 7
l 5 6 -1
p 4
"""


def write(path, text):
    path.write_bytes(text.encode())
    return path


def test_obj_keeps_groups_materials_comments_and_lines(tmp_path):
    source = write(tmp_path / "a.obj", OBJ)
    with pytest.warns(luxel.LuxelWarning, match="1 polygons"):
        laid(source, tmp_path / "b.obj", Options("random"))
    text = (tmp_path / "b.obj").read_text().splitlines()
    statements = [line for line in text if line.split()[0] not in ("v", "vt", "vn", "f", "l", "p")]
    assert statements == ["# made by hand", "mtllib lib.mtl", "o first", "usemtl red", "s 1", "g top", "usemtl blue"]
    blue = text.index("usemtl blue")
    assert sum(line.startswith("f ") for line in text[:blue]) == 2
    assert sum(line.startswith("f ") for line in text[blue:]) == 4
    assert "v 1 1 0 0 0 1 # corner" in text  # as it was written
    assert text[-2].startswith("l ")
    assert len([line for line in text if line.startswith("v ")]) == 7


@pytest.mark.filterwarnings("ignore::luxel.errors.LuxelWarning")
@pytest.mark.parametrize("options", [Options("random"), LEAN], ids=["plain", "lean"])
def test_obj_vertices_come_before_the_faces_that_name_them(tmp_path, options):
    laid(write(tmp_path / "a.obj", OBJ), tmp_path / "b.obj", options)
    seen = {"v": 0, "vt": 0, "vn": 0}
    for line in (tmp_path / "b.obj").read_text().splitlines():
        key, *words = line.split()
        if key in seen:
            seen[key] += 1
        elif key in ("f", "l", "p"):
            for word in words:
                for name, number in zip(seen, word.split("/"), strict=False):
                    assert not number or 1 <= int(number) <= seen[name]


@pytest.mark.filterwarnings("ignore::luxel.errors.LuxelWarning")
def test_obj_draws_the_same(tmp_path):
    laid(write(tmp_path / "a.obj", OBJ), tmp_path / "b.obj")
    assert difference(loaded(tmp_path / "a.obj"), loaded(tmp_path / "b.obj")) is None


def test_obj_line_ends_and_continuations(tmp_path):
    source = write(tmp_path / "a.obj", "v 0 0 0\r\nv 1 0 0\r\nv 0 \\\r\n 1 0\r\nf 1 2 \\\r\n3\r\n")
    laid(source, tmp_path / "b.obj")
    data = (tmp_path / "b.obj").read_bytes()
    assert data.count(b"\r\n") == data.count(b"\n") == 4
    assert luxel.load(tmp_path / "b.obj").triangle_count == 1


def test_obj_welding_drops_lines_that_nothing_names_any_more(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.0 0 0\nv 1 0 0\nv 0 0 1\nv 9 9 9\nf 1 2 3\nf 4 5 6\n"
    report = laid(write(tmp_path / "a.obj", text), tmp_path / "b.obj", Options("file", weld=True))
    assert report.welded == 2
    lines = (tmp_path / "b.obj").read_text().splitlines()
    assert lines == ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "v 9 9 9", "f 1 2 3", "f 1 2 4"]
    laid(tmp_path / "a.obj", tmp_path / "c.obj", Options("file", weld=True, drop_unused=True))
    assert "v 9 9 9" not in (tmp_path / "c.obj").read_text()


def test_obj_with_free_form_geometry_keeps_its_numbers(tmp_path):
    text = OBJ.replace("1/1/1", "3/3/1", 1) + "cstype bezier\ndeg 3\ncurv 0 1 1 2 3 4\nend\n"
    with pytest.warns(luxel.LuxelWarning):
        laid(write(tmp_path / "a.obj", text), tmp_path / "b.obj", LEAN)
    before, after = ([line for line in (tmp_path / name).read_text().splitlines() if line[:2] in ("v ", "cu")] for name in ("a.obj", "b.obj"))
    assert before == after


def test_obj_brings_its_libraries_along(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "maps").mkdir()
    write(tmp_path / "lib.mtl", "newmtl red\nKd 1 0 0\nmap_Kd -clamp on maps/wood oak.png\nnewmtl blue\n")
    write(tmp_path / "maps" / "wood oak.png", "png")
    with pytest.warns(luxel.LuxelWarning):
        laid(write(tmp_path / "a.obj", OBJ), tmp_path / "out" / "b.obj")
    assert {p.relative_to(tmp_path / "out").as_posix() for p in (tmp_path / "out").rglob("*") if p.is_file()} == {
        "b.obj", "lib.mtl", "maps/wood oak.png"}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nv 1 0 0\nf 1 2 3\n", "line 3.*names v 3 of 2"), ("v 0 0 0\nf 1 1 -2\n", "line 2.*v -2 of 1"),
        ("v 0 0\nf 1 1 1\n", "line 1.*needs 3"),
        ("v 0 0 0\nf 0 1 1\n", "line 2.*v 0 of 1"), ("v 0 0 0\nf 1 x 1\n", "line 2"), ("v 0 0 0\nl 1 5\n", "line 2.*v 5 of 1"),
        ("v 0 0 0\nf 1/2 1/1 1/1\n", "line 2.*vt 2 of 0"), ("v 0 0 0\np one\n", "line 2"), ("v a b c\nf 1 1 1\n", "line 1"),
    ],
)  # fmt: skip
def test_obj_faults_are_named(tmp_path, text, message):
    with pytest.raises(luxel.FileError, match=f"a.obj.*{message}"):
        optimize_file(write(tmp_path / "a.obj", text), tmp_path / "b.obj", Options(), measures=False)
    assert os.listdir(tmp_path) == ["a.obj"]


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.sampled_from([Options("random"), LEAN]))
@pytest.mark.filterwarnings("ignore::luxel.errors.LuxelWarning")
def test_any_obj_stays_the_same(tmp_path_factory, seed, options):
    """Random statements between vertices and faces of all forms, absolute and relative."""
    rng, lines, counts = np.random.default_rng(seed), [], [0, 0, 0]
    for _ in range(rng.integers(1, 40)):
        kind = rng.choice(["v", "v", "v", "vt", "vn", "f", "f", "f", "g", "usemtl", "o", "s", "#", "l"])
        if kind in ("v", "vt", "vn"):
            k = ["v", "vt", "vn"].index(kind)
            counts[k] += 1
            lines.append(f"{kind} " + " ".join(map(str, rng.integers(0, 3, 2 if kind == "vt" else 3))))
        elif kind in ("f", "l") and counts[0]:
            form = [True, bool(counts[1]) and rng.random() < 0.5, bool(counts[2]) and kind == "f" and rng.random() < 0.5]
            words = []
            for _ in range(rng.choice([3, 3, 4, 5])):
                numbers = [str(rng.integers(1, n + 1) if rng.random() < 0.5 else -rng.integers(1, n + 1)) if use else ""
                           for n, use in zip(counts, form, strict=True)]  # fmt: skip
                words.append("/".join(numbers).rstrip("/"))
            lines.append(f"{kind} " + " ".join(words))
        elif kind not in ("f", "l"):
            lines.append(f"{kind} n{rng.integers(3)}")
    folder = tmp_path_factory.mktemp("any")
    lines += ["v 0 0 0", "f -1 1 -1"]
    source = write(folder / "a.obj", "\n".join(lines) + "\n")
    optimize_file(source, folder / "b.obj", options, measures=False, check=True)
    if options is not LEAN:  # without its degenerate triangles a mesh may have no corner with a normal, which the reader tells apart
        scenes = [luxel.load(path, normals=False) for path in (source, folder / "b.obj")]
        for mesh in [mesh for scene in scenes for mesh in scene.meshes]:
            mesh.normals = None  # made for corners without one, by sums in the order of the triangles
        assert difference(*map(soups_of, scenes)) is None


# PLY


def ply(path, kind, quads=False, extra=True):
    """A grid with properties and elements of its own, ASCII or binary."""
    points, faces = grid(8)
    rng, n = np.random.default_rng(0), len(points)
    order = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}[kind]
    fields = [(name, order + "f4") for name in ("x", "y", "z", "quality")] + [("label", order + "i2")]
    vertex = np.zeros(n, fields + [(name, "u1") for name in ("red", "green", "blue")])
    for k, name in enumerate("xyz"):
        vertex[name] = points[:, k]
    vertex["quality"], vertex["label"] = rng.random(n), rng.integers(-9, 9, n)
    size = 4 if quads else 3
    if quads:
        faces = np.stack([a := np.arange(n - 9), a + 1, a + 9, a + 8], 1)
    m = len(faces)
    fields = [("count", "u1"), ("v", order + "i4", size), ("flags", order + "u2"), ("n", "u1"), ("uv", order + "f4", 2 * size)]
    face = np.zeros(m, fields)
    face["count"], face["v"], face["flags"], face["n"] = size, faces, rng.integers(0, 9, m), 2 * size
    face["uv"] = rng.random((m, 2 * size))
    edge = np.zeros(5, [("vertex1", order + "i4"), ("vertex2", order + "i4"), ("weight", order + "f8")])
    edge["vertex1"], edge["vertex2"], edge["weight"] = [0, 1, 2, 3, 63], [1, 2, 3, 4, 0], rng.random(5)
    tables = [vertex, face, edge]
    head = f"""ply
format {kind} 1.0
comment kept as it is
obj_info also kept
element vertex {n}
property float x
property float y
property float z
property float quality
property short label
property uchar red
property uchar green
property uchar blue
element face {m}
property list uchar int vertex_indices
property ushort flags
property list uchar float texcoord
element edge 5
property int vertex1
property int vertex2
property double weight
end_header
"""
    if kind == "ascii":
        def words(row):
            return " ".join(" ".join(map(str, np.atleast_1d(cell).tolist())) for cell in row)

        body = "".join(words(row) + "\n" for table in tables for row in table).encode()
    else:
        body = b"".join(table.tobytes() for table in tables)
    path.write_bytes(head.encode() + body)
    return path


KINDS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("quads", [False, True])
@pytest.mark.parametrize("options", [Options("random"), LEAN], ids=["plain", "lean"])
@pytest.mark.filterwarnings("ignore:.*polygons")
def test_ply_keeps_properties_and_elements(tmp_path, kind, quads, options):
    source = ply(tmp_path / "a.ply", kind, quads)
    laid(source, tmp_path / "b.ply", options)
    old, new = ply_file.Content(source), ply_file.Content(tmp_path / "b.ply")
    assert [line for line in old.header if "face" not in line] == [line for line in new.header if "face" not in line]
    assert old.order == new.order
    edges = []
    for content in (old, new):
        rows, edge = content.rows(), content.columns["edge"]
        edges.append([(rows[a].tobytes(), rows[b].tobytes(), w) for a, b, w in zip(edge["vertex1"], edge["vertex2"], edge["weight"], strict=True)])
    assert edges[0] == edges[1]
    assert difference(loaded(source), loaded(tmp_path / "b.ply")) is None  # with texture coordinates of corners


def test_ply_text_is_as_short_as_it_was(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty double z\nelement face 1\n"
    rows = ["0.1 1 0.123456789012345", "2.5e-08 0 0", "0 -1 1e+20", "3 0 1 2"]
    source = write(tmp_path / "a.ply", "\n".join([head + "property list uchar int vertex_indices\nend_header", *rows, ""]))
    laid(source, tmp_path / "b.ply", Options("file"))
    assert (tmp_path / "b.ply").read_text().splitlines()[-4:] == rows


def test_ply_strips_become_faces(tmp_path):
    points, _ = grid(4)
    head = "ply\nformat ascii 1.0\nelement vertex 16\nproperty float x\nproperty float y\nproperty float z\n"
    body = "".join(" ".join(map(str, row)) + "\n" for row in points.tolist())
    source = write(tmp_path / "a.ply", f"{head}element tristrips 1\nproperty list int int vertex_indices\nend_header\n{body}9 0 4 1 5 -1 8 12 9 13\n")
    laid(source, tmp_path / "b.ply")
    assert "element face 4" in (tmp_path / "b.ply").read_text()
    assert difference(loaded(source), loaded(tmp_path / "b.ply")) is None


def test_ply_rows_of_different_lengths_in_binary(tmp_path):
    """Faces are all triangles afterwards; another element's lists may still differ in length."""
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
    head += b"property list uchar int vertex_indices\nelement group 2\nproperty list uchar short members\nend_header\n"
    body = np.random.default_rng(0).random((4, 3), np.float32).tobytes()
    body += b"\x03" + np.int32([3, 2, 1]).tobytes() + b"\x04" + np.int32([0, 1, 2, 3]).tobytes()
    groups = b"\x01" + np.int16([7]).tobytes() + b"\x02" + np.int16([8, 9]).tobytes()
    (tmp_path / "a.ply").write_bytes(head + body + groups)
    with pytest.warns(luxel.LuxelWarning, match="1 polygons"):
        laid(tmp_path / "a.ply", tmp_path / "b.ply")
    assert (tmp_path / "b.ply").read_bytes().endswith(groups)


@pytest.mark.parametrize("name", ["obj", "ply"])
def test_files_without_a_triangle(tmp_path, name):
    header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    texts = {"obj": "v 0 0 0\n", "ply": header + "0 0 0\n"}
    with pytest.raises(luxel.FileError, match=f"a.{name}: triangles: expected at least one"):
        laid(write(tmp_path / f"a.{name}", texts[name]), tmp_path / f"b.{name}")
    assert os.listdir(tmp_path) == [f"a.{name}"]


def test_ply_faults_are_named(tmp_path):
    source = ply(tmp_path / "a.ply", "ascii")
    text = source.read_text()
    write(source, text.replace("\n3 ", "\n3 99", 1))
    with pytest.raises(luxel.FileError, match="names vertex 99"):
        optimize_file(source, tmp_path / "b.ply", Options(), measures=False)
    write(source, text[: len(text) // 2])
    with pytest.raises(luxel.FileError, match=r"a\.ply"):
        optimize_file(source, tmp_path / "b.ply", Options(), measures=False)
    assert os.listdir(tmp_path) == ["a.ply"]


# Any format to any other, and what surrounds the files


@pytest.mark.parametrize("before", ["stl", "off", "obj", "ply", "glb"])
@pytest.mark.parametrize("after", ["stl", "off", "obj", "ply", "glb", "gltf"])
@pytest.mark.filterwarnings("ignore::luxel.errors.LuxelWarning")
def test_any_format_to_any_other(tmp_path, before, after):
    mesh = torus(segments=16, sides=8)
    luxel.save((mesh.positions, mesh.triangles[np.random.default_rng(0).permutation(len(mesh.triangles))]), tmp_path / f"a.{before}")
    report = laid(tmp_path / f"a.{before}", tmp_path / f"b.{after}")
    result = luxel.load(tmp_path / f"b.{after}", normals=False).meshes[0]
    assert len(result.triangles) == report.after.triangles == len(mesh.triangles)
    soups = [{"": Soup(m.triangles, vertex_rows([m.positions]))} for m in (mesh, result)]
    assert difference(*soups) is None
    if after != "stl":
        assert report.after.acmr[12] < report.before.acmr[12]


@pytest.mark.parametrize("name", ["b.ply", "b.glb"])
@pytest.mark.filterwarnings("ignore::luxel.errors.LuxelWarning")
def test_progress_rises_to_one(tmp_path, name):
    told = []
    optimize_file(ply(tmp_path / "a.ply", "ascii"), tmp_path / name, Options("tipsify"), check=True, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1
    assert len(told) > 3


def test_in_place_and_without_output(tmp_path):
    source = ply(tmp_path / "a.ply", "ascii")
    text = source.read_text()
    os.chmod(source, 0o640)
    report, scenes = optimize_file(source, None, Options("tipsify"))
    assert len(scenes) == 2
    assert report.after.acmr[12] < report.before.acmr[12]
    assert source.read_text() == text
    laid(source, source)
    assert source.read_text() != text
    assert os.stat(source).st_mode & 0o777 == 0o640
    assert os.listdir(tmp_path) == ["a.ply"]


@pytest.mark.parametrize(("module", "name"), [(ply_file, "a.ply"), (obj_file, "a.obj")])
def test_a_difference_is_found_and_nothing_is_written(tmp_path, monkeypatch, module, name):
    source = ply(tmp_path / name, "ascii") if name.endswith("ply") else write(tmp_path / name, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    lay_out = module.lay_out

    def wrong(*words, **more):
        found = lay_out(*words, **more)
        return found._replace(triangles=[np.ascontiguousarray(faces[:, ::-1]) for faces in found.triangles])

    monkeypatch.setattr(module, "lay_out", wrong)
    before = source.read_bytes()
    with pytest.raises(DifferenceError, match="not written"):
        laid(source, source)
    assert source.read_bytes() == before
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("name", ["stanford-bunny.obj", "horse.ply", "koala.obj", "scenes/CornellBox-Original.obj"])
@pytest.mark.filterwarnings("ignore:.*polygons", "ignore:.*material library")
def test_real_files(tmp_path, meshes, name):
    target = tmp_path / f"b{(meshes / name).suffix}"
    report = laid(meshes / name, target)
    assert report.after.acmr[12] <= report.before.acmr[12]
    json.dumps(report.as_dict(), allow_nan=False)
