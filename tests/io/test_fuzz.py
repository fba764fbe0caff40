"""Whatever a file holds, `load` gives a scene, perhaps with a LuxelWarning, or a FileError that names the file; it never does worse."""

import copy
import json
import struct
import tracemalloc
import warnings

import numpy as np
import pytest
from io_samples import FACES, OBJ, TETRAHEDRON, Gltf, full_gltf, glb, ply, stl_binary, write_all

import luxel.io
from luxel.errors import FileError, LuxelWarning
from luxel.scene import Scene


def attempt(path) -> Scene | FileError:
    """Load `path` and check that the outcome is one of those allowed."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", LuxelWarning)
        try:
            scene = luxel.io.load(path)
        except FileError as error:
            scene = error
    if isinstance(scene, FileError):
        assert path.name in str(scene) or "sample.mtl" in str(scene)
        assert "\n" not in str(scene)
        return scene
    scene.check()
    for mesh in scene.meshes:
        for name in ("positions", "normals", "texcoords", "texcoords1", "colors", "tangents"):
            value = getattr(mesh, name)
            assert value is None or np.isfinite(value).all()
        assert mesh.normals is not None
    for instance in scene.instances:
        assert np.isfinite(instance.world_from_mesh).all()
    return scene


SAMPLES = ["ascii.ply", "little.ply", "big.ply", "mixed.ply", "mixed_ascii.ply", "sample.obj", "ascii.stl", "binary.stl", "sample.off"]
SAMPLES += ["full.gltf", "full.glb"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    write_all(folder)
    return folder


@pytest.mark.parametrize("name", SAMPLES)
def test_samples_load_whole(folder, name):
    assert isinstance(attempt(folder / name), Scene)


@pytest.mark.parametrize("name", SAMPLES)
def test_truncated_at_every_length(folder, name):
    data = (folder / name).read_bytes()
    path = folder / f"cut_{name}"
    outcomes = []
    step = 1 if len(data) < 2000 else 3
    for length in range(0, len(data), step):
        path.write_bytes(data[:length])
        outcomes.append(attempt(path))
    assert isinstance(outcomes[0], FileError) or path.suffix == ".obj"  # an empty OBJ file is an empty scene


@pytest.mark.parametrize("name", SAMPLES)
def test_flipped_bytes(folder, name):
    data = np.frombuffer((folder / name).read_bytes(), np.uint8)
    path = folder / f"flip_{name}"
    rng = np.random.default_rng(sum(name.encode()))
    for trial in range(300):
        broken = data.copy()
        at = rng.integers(0, len(data), 1 + trial % 4)
        broken[at] = rng.integers(0, 256, len(at)) if trial % 2 else broken[at] ^ (1 << rng.integers(0, 8, len(at)))
        path.write_bytes(broken.tobytes())
        attempt(path)


@pytest.mark.parametrize("name", SAMPLES)
def test_pieces_cut_out_repeated_and_joined(folder, name):
    data = (folder / name).read_bytes()
    path = folder / f"cutout_{name}"
    rng = np.random.default_rng(7 + sum(name.encode()))
    for _ in range(150):
        a, b = sorted(rng.integers(0, len(data), 2).tolist())
        path.write_bytes(data[:a] + data[b:] if rng.random() < 0.5 else data[:b] + data[a:])
        attempt(path)


WRONG = [None, True, -1, 0, 1, 3, 2**31, 2**64, 1e30, 0.5, "x", "", [], [0], ["x"], [[]], {}, {"index": 0}, [1e999], [-5, 1e38, 0]]


def _places(value, path=()):
    """The paths of all values inside a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*path, key)
        yield from _places(inner, (*path, key))


def test_gltf_with_every_value_replaced(tmp_path):
    g = full_gltf()
    g.write(tmp_path / "whole.gltf")
    whole = g.json
    path = tmp_path / "wrong.gltf"
    places = list(_places(whole))
    assert len(places) > 150
    for number, place in enumerate(places):
        for wrong in WRONG[number % 2 :: 2]:
            broken = copy.deepcopy(whole)
            target = broken
            for key in place[:-1]:
                target = target[key]
            target[place[-1]] = wrong
            path.write_text(json.dumps(broken))
            attempt(path)
        broken = copy.deepcopy(whole)
        target = broken
        for key in place[:-1]:
            target = target[key]
        del target[place[-1]]
        path.write_text(json.dumps(broken))
        attempt(path)


def _peak(path) -> float:
    """Bytes that an attempt takes at most."""
    tracemalloc.start()
    try:
        attempt(path)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


HUGE = [
    ("vertices.ply", ply("<").replace(b"vertex 4", b"vertex 4294967295")),
    ("vertices_ascii.ply", ply().replace(b"vertex 4", b"vertex 4294967295")),
    ("faces.ply", ply(">").replace(b"face 4", b"face 99999999999999")),
    ("list.ply", ply("<")[: -13 * 4].replace(b"list uchar", b"list uint") + struct.pack("<I", 2**32 - 1) * 20),
    ("wide.ply", ply().replace(b"\n3 0", b"\n4000000000 0")),
    ("empty.ply", b"ply\nformat ascii 1.0\nelement vertex 4294967295\nend_header\n"),
    ("count.stl", stl_binary()[:80] + struct.pack("<I", 2**32 - 1) + stl_binary()[84:]),
    ("count.off", b"OFF\n4294967295 4294967295 0\n0 0 0\n"),
    ("index.obj", OBJ.replace(b"f 1/1/1", b"f 9999999999/1/1").replace(b"-1 1 2", b"-99999999999999 1 2")),
    ("length.glb", glb(b'{"asset":{"version":"2.0"}}', b"")[:12] + struct.pack("<I4s", 2**32 - 1, b"JSON") + b"{}"),
    ("deep.gltf", b"[" * 200_000),
    ("deep_object.gltf", b'{"asset":' * 100_000),
    ("digits.gltf", b'{"asset":{"version":"2.0"},"scene":' + b"9" * 10_000 + b"}"),
]


@pytest.mark.parametrize(("name", "data"), HUGE, ids=[name for name, _ in HUGE])
def test_absurd_counts_take_little_memory(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    assert _peak(path) < 40e6


@pytest.mark.parametrize("key", ["count", "byteOffset", "byteLength", "byteStride", "bufferView", "buffer", "componentType"])
@pytest.mark.parametrize("value", [2**31 - 1, 2**32 - 1, 2**53, -1, 10**400, 1e300])
def test_gltf_absurd_numbers_take_little_memory(tmp_path, key, value):
    for kind in ("accessors", "bufferViews"):
        g = full_gltf()
        g.write(tmp_path / "whole.gltf")
        for item in g.json[kind]:
            item[key] = value
        path = tmp_path / "wrong.gltf"
        path.write_text(json.dumps(g.json))
        assert _peak(path) < 40e6


def test_gltf_count_without_a_buffer_view_is_bounded(tmp_path):
    g = Gltf()
    huge = g.append("accessors", {"componentType": 5126, "type": "VEC3", "count": 2**31 - 1})
    g.node(mesh=g.mesh({"attributes": {"POSITION": huge}}))
    path = g.write(tmp_path / "zeros.gltf")
    assert _peak(path) < 40e6
    with pytest.raises(FileError, match=r"zeros.gltf, accessor 0: count 2147483647 without a buffer view"):
        luxel.io.load(path)


def test_gltf_shared_children_do_not_multiply(tmp_path):
    g = Gltf()
    g.mesh(g.primitive())
    for i in range(40):
        g.node(children=[i + 1, i + 1], mesh=0)
    g.node(mesh=0)
    path = g.write(tmp_path / "diamond.gltf")
    with pytest.warns(LuxelWarning, match="is reached twice"):
        scene = luxel.io.load(path)
    assert len(scene.instances) == 41


def test_gltf_cycle_is_named(tmp_path):
    g = Gltf()
    mesh = g.mesh(g.primitive())
    g.node(children=[1])
    g.node(children=[0], mesh=mesh)
    g.json["scenes"] = [{"nodes": [0]}]
    path = g.write(tmp_path / "cycle.gltf")
    with pytest.warns(LuxelWarning, match=r"cycle.gltf, node 0: .* its own ancestor"):
        scene = luxel.io.load(path)
    assert len(scene.instances) == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("extension", ["ply", "obj", "stl", "off", "gltf"])
def test_positions_that_are_not_finite_are_dropped_and_said(tmp_path, extension, value):
    positions = np.append(TETRAHEDRON, [[value, 0, 0]], 0)
    faces = [*FACES.tolist(), [0, 1, 4]]
    path = tmp_path / f"bad.{extension}"
    corners = [[positions[i] for i in face] for face in faces]
    lines = {
        "ply": ["ply", "format ascii 1.0", "element vertex 5", *(f"property double {c}" for c in "xyz"), "element face 5"]
        + ["property list uchar int vertex_index", "end_header", *(f"{x} {y} {z}" for x, y, z in positions)]
        + [f"3 {a} {b} {c}" for a, b, c in faces],
        "obj": [f"v {x} {y} {z}" for x, y, z in positions] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces],
        "stl": ["solid x"]
        + [f"facet normal 0 0 0\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\nendfacet".replace("[", "").replace("]", "")
           for a, b, c in corners]
        + ["endsolid x"],
        "off": ["OFF", "5 5 0", *(f"{x} {y} {z}" for x, y, z in positions), *(f"3 {a} {b} {c}" for a, b, c in faces)],
    }  # fmt: skip
    if extension == "gltf":
        g = Gltf()
        with np.errstate(over="ignore"):
            g.node(mesh=g.mesh(g.primitive(positions.astype(np.float32), faces)))
        g.write(path)
    else:
        path.write_text("\n".join(lines[extension]) + "\n")
    with pytest.warns(LuxelWarning, match=r"1 vertices are not finite; 1 triangles that use them are dropped"):
        scene = luxel.io.load(path)
    assert scene.triangle_count == 4
    assert np.isfinite(scene.bounds()).all()


@pytest.mark.parametrize("name", ["ascii.ply", "little.ply", "sample.off", "full.glb", "full.gltf", "sample.obj"])
def test_indices_out_of_range_are_dropped_and_said(tmp_path, folder, name):
    data = (folder / name).read_bytes()
    path = tmp_path / name
    if name == "little.ply":
        data = data[:-4] + struct.pack("<i", 77)
    elif name.startswith("full"):
        g = full_gltf()
        view = g.json["bufferViews"][g.json["accessors"][g.json["meshes"][0]["primitives"][0]["indices"]]["bufferView"]]
        g.data[view["byteOffset"] : view["byteOffset"] + 2] = struct.pack("<H", 9999)
        g.write(path)
        data = path.read_bytes()
    else:
        data = data.replace(b"3 1 2 3", b"3 1 2 77").replace(b"3 0 1 2\n3 0 2 3", b"3 0 1 2\n3 0 2 77").replace(b"f -1 1 2", b"f -1 1 77")
    path.write_bytes(data)
    with pytest.warns(LuxelWarning) as caught:
        scene = luxel.io.load(path)
    assert any("1 of" in str(w.message) and "are dropped" in str(w.message) for w in caught)
    assert scene.triangle_count in (2, 3)
