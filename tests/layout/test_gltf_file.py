"""glTF files laid out: what is drawn is the same, posed and morphed; what is not geometry is byte for byte what it was."""

import json

import numpy as np
import pytest
from gltf_samples import Builder, everything, grid
from hypothesis import given, settings
from hypothesis import strategies as st

import luxel
from luxel.io.gltf.document import Document
from luxel.layout.files import DifferenceError, optimize_file
from luxel.layout.gltf_file import contents, rest_differs
from luxel.layout.gltf_pack import Package, dense
from luxel.layout.optimize import Options
from luxel.layout.same import difference, soups_of

pytestmark = pytest.mark.filterwarnings("ignore::luxel.errors.LuxelWarning")  # readers tell of lines and animations
LEAN = Options("tipsify", weld=True, drop_degenerate=True, drop_duplicates=True, drop_unused=True, overdraw=1.2)


def laid(source, target, options=Options("tipsify")):  # noqa: B008
    report, _ = optimize_file(source, target, options, check=True)
    return report


def posed(path):
    """Meshes as luxel draws them: morph targets and skins applied, which no code of the layout does."""
    return soups_of(luxel.load(path, normals=False))


@pytest.mark.parametrize("names", [("a.glb", "b.glb"), ("a.gltf", "b.gltf"), ("a.glb", "b.gltf"), ("a.gltf", "b.glb"), ("a.glb", "a.glb")])
@pytest.mark.parametrize("options", [Options("tipsify"), LEAN], ids=["plain", "lean"])
def test_everything_stays(tmp_path, names, options):
    source = everything().save(tmp_path / names[0])
    before, old = posed(source), Document(source)
    report = laid(source, tmp_path / names[1], options)
    after = posed(tmp_path / names[1])
    assert difference(before, after, options.drop_degenerate, options.drop_duplicates) is None
    assert report.after.acmr[12] < 0.8 * report.before.acmr[12]
    new = Document(tmp_path / names[1])
    for key in ("nodes", "skins", "animations", "scenes", "materials"):
        assert old.data[key] == new.data[key]
    assert new.view(new.data["images"][0]["bufferView"], "")[0].tobytes() == b"not really a picture"


def test_shared_vertices_stay_shared_and_interleaved(tmp_path):
    source = everything().save(tmp_path / "a.glb")
    laid(source, tmp_path / "b.glb")
    old, new = Document(source).data, Document(tmp_path / "b.glb").data
    assert len(new["accessors"]) == len(old["accessors"]) + 1  # the primitive without indices has some now
    primitives = new["meshes"][0]["primitives"]
    assert all(primitive["attributes"] == old["meshes"][0]["primitives"][0]["attributes"] for primitive in primitives)
    used = [new["accessors"][i] for i in primitives[0]["attributes"].values()]
    assert len({accessor["bufferView"] for accessor in used}) == 1
    assert new["bufferViews"][used[0]["bufferView"]]["byteStride"] == 64
    assert len(new["bufferViews"]) == len(old["bufferViews"]) + 1
    assert (tmp_path / "b.glb").stat().st_size < (tmp_path / "a.glb").stat().st_size + 600


def test_every_attribute_of_a_vertex_goes_with_it(tmp_path):
    """By hand: the vertex at each place has its joints, heat and targets, also the sparse ones."""
    source = everything().save(tmp_path / "a.glb")
    laid(source, tmp_path / "b.glb")

    def rows(path):
        document = Document(path)
        primitive = document.data["meshes"][0]["primitives"][0]
        indices = [*primitive["attributes"].values(), *(i for target in primitive["targets"] for i in target.values())]
        return np.concatenate([dense(document, i, "") for i in indices], 1)

    a, b = rows(source), rows(tmp_path / "b.glb")
    assert not np.array_equal(a, b)
    assert sorted(map(bytes, a)) == sorted(map(bytes, b))
    sparse = Document(tmp_path / "b.glb").data["accessors"]
    assert sum("sparse" in accessor for accessor in sparse) == 2  # not spelt out


def test_strips_and_fans_become_lists(tmp_path):
    source = everything().save(tmp_path / "a.glb")
    laid(source, tmp_path / "b.glb")
    for primitive in Document(tmp_path / "b.glb").data["meshes"][1]["primitives"]:
        assert "mode" not in primitive
    assert len(posed(tmp_path / "b.glb")["mesh 2"].triangles) == len(posed(source)["mesh 2"].triangles) > 0


def test_min_and_max_follow_what_is_left(tmp_path):
    b = Builder()
    points = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9]])
    b.mesh({"attributes": {"POSITION": b.accessor(points, bounds=True)}, "indices": b.accessor(np.uint16([0, 1, 2]))})
    laid(b.save(tmp_path / "a.glb"), tmp_path / "b.glb", Options(drop_unused=True))
    accessor = Document(tmp_path / "b.glb").data["accessors"][0]
    assert (accessor["count"], accessor["min"], accessor["max"]) == (3, [0, 0, 0], [1, 1, 0])


@pytest.mark.parametrize("why", ["extension", "points", "animation", "counts"])
def test_vertices_that_others_number_stay(tmp_path, why):
    b = Builder()
    points, faces = grid()
    position = b.accessor(points, bounds=True)
    primitive = {"attributes": {"POSITION": position}, "indices": b.accessor(faces.ravel().astype(np.uint16))}
    b.mesh(primitive)
    if why == "extension":
        primitive["extensions"] = {"VENDOR_outline": {"edges": [0, 1]}}
    elif why == "points":
        b.mesh({"attributes": {"POSITION": position}, "mode": 0})
    elif why == "animation":
        b.json["animations"] = [{"channels": [], "samplers": [{"input": b.accessor(np.float32([0])), "output": position}]}]
    else:
        b.mesh({"attributes": {"POSITION": b.accessor(points[:20], view=b.json["accessors"][position]["bufferView"])}})
    source = b.save(tmp_path / "a.glb")
    with pytest.warns(luxel.LuxelWarning, match="keep their numbers"):
        report = laid(source, tmp_path / "b.glb", Options("tipsify", weld=True))
    assert np.array_equal(dense(Document(tmp_path / "b.glb"), position, ""), points.view(np.uint8).reshape(len(points), 12))
    assert report.after.acmr[12] < 0.6 * report.before.acmr[12]


def test_one_list_of_indices_over_two_sets_of_vertices(tmp_path):
    b, (points, faces) = Builder(), grid()
    indices = b.accessor(faces.ravel().astype(np.uint16))
    for moved in (points, points[::-1] * 2):
        b.mesh({"attributes": {"POSITION": b.accessor(np.ascontiguousarray(moved), bounds=True)}, "indices": indices})
    laid(b.save(tmp_path / "a.glb"), tmp_path / "b.glb", Options("morton"))
    meshes = Document(tmp_path / "b.glb").data["meshes"]
    assert meshes[0]["primitives"][0]["indices"] != meshes[1]["primitives"][0]["indices"]


def test_one_geometry_with_two_materials_stays_one(tmp_path):
    b, (points, faces) = Builder(), grid()
    b.json["materials"] = [{}, {}]
    shared = {"attributes": {"POSITION": b.accessor(points, bounds=True)}, "indices": b.accessor(faces.ravel().astype(np.uint16))}
    b.mesh({**shared, "material": 0}, {**shared, "material": 1})
    laid(b.save(tmp_path / "a.glb"), tmp_path / "b.glb")
    first, second = Document(tmp_path / "b.glb").data["meshes"][0]["primitives"]
    assert first["indices"] == second["indices"]


def test_accessors_that_name_the_same_bytes(tmp_path):
    b, (points, faces) = Builder(), grid()
    view = b.view(points.tobytes(), target=34962)
    for part in (faces[:60], faces[60:]):
        b.mesh({"attributes": {"POSITION": b.accessor(points, view, bounds=True)}, "indices": b.accessor(part.ravel().astype(np.uint16))})
    laid(b.save(tmp_path / "a.glb"), tmp_path / "b.glb")
    places = [(a["bufferView"], a["byteOffset"]) for a in Document(tmp_path / "b.glb").data["accessors"][:4:2]]
    assert places[0] == places[1]


def test_nothing_left_to_draw(tmp_path):
    b = Builder()
    b.mesh({"attributes": {"POSITION": b.accessor(np.zeros((3, 3), np.float32), bounds=True)}, "indices": b.accessor(np.uint8([0, 1, 2, 1, 1, 2]))})
    report = laid(b.save(tmp_path / "a.glb"), tmp_path / "b.glb", LEAN)
    assert report.degenerate == 2
    luxel.load(tmp_path / "b.glb")


def test_a_folder_of_its_own(tmp_path):
    """.gltf to another folder: buffers and pictures come along; into a .glb they go in."""
    b = everything()
    b.json["images"] = [{"uri": "textures/wood%20oak.png"}, {"uri": "missing.png"}]
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures" / "wood oak.png").write_bytes(b"png")
    source = b.save(tmp_path / "a.gltf")
    (tmp_path / "out").mkdir()
    with pytest.warns(luxel.LuxelWarning, match="cannot be brought along"):
        laid(source, tmp_path / "out" / "b.gltf")
    assert {p.relative_to(tmp_path / "out").as_posix() for p in (tmp_path / "out").rglob("*")} == {
        "b.gltf", "b.bin", "textures", "textures/wood oak.png"}  # fmt: skip
    laid(source, tmp_path / "out" / "c.glb")
    document = Document(tmp_path / "out" / "c.glb")
    image = document.data["images"][0]
    assert image["mimeType"] == "image/png"
    assert document.view(image["bufferView"], "")[0].tobytes() == b"png"
    laid(source, tmp_path / "b.gltf")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a data.bin", "a.gltf", "b.bin", "b.gltf", "out", "textures"]


def with_chunk(path, kind, data):
    """Append a chunk to a GLB."""
    raw = bytearray(path.read_bytes())
    raw += len(data).to_bytes(4, "little") + kind + data + b"\0" * (-len(data) % 4)
    raw[8:12] = len(raw).to_bytes(4, "little")
    path.write_bytes(raw)
    return path


def test_chunks_that_luxel_does_not_know_stay(tmp_path):
    a = with_chunk(with_chunk(everything().save(tmp_path / "a.glb"), b"XTRA", b"keep me"), b"MORE", b"")
    laid(a, tmp_path / "b.glb")
    kept = [(kind.to_bytes(4, "little"), data.tobytes()) for kind, data in Document(tmp_path / "b.glb").chunks]
    assert kept == [(b"XTRA", b"keep me"), (b"MORE", b"")]
    assert "chunks" in rest_differs(a, everything().save(tmp_path / "c.glb"))
    with pytest.warns(luxel.LuxelWarning, match="only a .glb can hold are dropped: 'XTRA', 'MORE'"):
        laid(a, tmp_path / "d.gltf")


def test_bytes_that_no_view_names_are_told(tmp_path):
    b = everything()
    b.data.extend(b"\0\0\0secret")
    with pytest.warns(luxel.LuxelWarning, match="9 bytes of buffer 0 that no buffer view names are dropped"):
        laid(b.save(tmp_path / "a.glb"), tmp_path / "b.glb")


@pytest.mark.parametrize("name", ["b.gltf", "b.glb"])
def test_a_buffer_that_no_view_names(tmp_path, recwarn, name):
    """It stays as a file; a .glb has no place for it."""
    path = everything().save(tmp_path / "a.gltf")
    data = json.loads(path.read_text())
    data["buffers"].insert(0, {"uri": "unknown.bin", "byteLength": 7})
    (tmp_path / "unknown.bin").write_bytes(b"unknown")
    for view in data["bufferViews"]:
        view["buffer"] = 1
    path.write_text(json.dumps(data))
    laid(path, tmp_path / name)
    told = [str(warning.message) for warning in recwarn]
    if name == "b.glb":
        assert any("7 bytes of buffer 0 that no buffer view names are dropped" in text for text in told)
    else:
        assert Document(tmp_path / name).buffer(0, "")[:7].tobytes() == b"unknown"
        assert not any("dropped" in text for text in told)


def test_data_uris_stay(tmp_path):
    import base64

    b = everything()
    path = b.save(tmp_path / "a.gltf")
    data = json.loads(path.read_text())
    data["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(bytes(b.data)).decode()
    path.write_text(json.dumps(data))
    laid(path, tmp_path / "b.gltf")
    assert Document(tmp_path / "b.gltf").data["buffers"][0]["uri"].startswith("data:")
    assert not (tmp_path / "b.bin").exists()


def test_compressed_views(tmp_path):
    library = pytest.importorskip("meshoptimizer", reason="meshoptimizer is not installed")
    b, (points, faces) = Builder(), grid()
    views = []
    for mode, data, count, stride in (
        ("ATTRIBUTES", bytes(library.encode_vertex_buffer(points, len(points), 12)), len(points), 12),
        ("INDICES", bytes(library.encode_index_sequence(faces.ravel().astype(np.uint32), faces.size, len(points))), faces.size, 2),
    ):
        view = b.view(data)
        entry = b.json["bufferViews"][view]
        packed = {"buffer": 0, "byteOffset": entry["byteOffset"], "byteLength": len(data), "mode": mode, "count": count, "byteStride": stride}
        b.json["bufferViews"][view] = {"buffer": 1, "byteLength": count * stride, "extensions": {"EXT_meshopt_compression": packed}}
        views.append(view)
    b.json["extensionsUsed"] = b.json["extensionsRequired"] = ["EXT_meshopt_compression"]
    position, indices = b.accessor(points, views[0], bounds=True), b.accessor(faces.ravel().astype(np.uint16), views[1])
    b.mesh({"attributes": {"POSITION": position}, "indices": indices})
    path = b.save(tmp_path / "a.gltf")
    data = json.loads(path.read_text())
    data["buffers"].append({"byteLength": 1 << 16, "extensions": {"EXT_meshopt_compression": {"fallback": True}}})
    path.write_text(json.dumps(data))
    for name in ("b.glb", "b.gltf"):
        with pytest.warns(luxel.LuxelWarning, match="were compressed"):
            laid(path, tmp_path / name)
        new = Document(tmp_path / name).data
        assert len(new["buffers"]) == 1
        assert "extensionsRequired" not in new


@st.composite
def documents(draw):
    """Random primitives over few sets of vertices, of any mode, with and without indices, interleaved or not."""
    b, rng = Builder(), np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pools = []
    for _ in range(draw(st.integers(1, 3))):
        n = draw(st.integers(3, 25))
        arrays = {"POSITION": rng.integers(0, 3, (n, 3)).astype(np.float32), "COLOR_0": rng.integers(0, 2, (n, 4)).astype(np.uint8)}
        if draw(st.booleans()):
            pools.append((n, b.interleaved(arrays, 20)))
        else:
            pools.append((n, {"POSITION": b.accessor(arrays["POSITION"], bounds=True), "COLOR_0": b.accessor(arrays["COLOR_0"], normalized=True)}))
    known = []
    for _ in range(draw(st.integers(1, 5))):
        n, attributes = pools[draw(st.integers(0, len(pools) - 1))]
        primitive = {"attributes": attributes, "mode": draw(st.sampled_from([4, 4, 4, 5, 6, 1, 0]))}
        kind = draw(st.sampled_from(["new", "new", "again", "none"]))
        if kind == "again" and known and known[-1][1] <= n:
            primitive["indices"] = known[-1][0]
        elif kind != "none":
            count = 3 * draw(st.integers(1, 12))
            flat = rng.integers(0, n, count).astype(draw(st.sampled_from([np.uint8, np.uint16, np.uint32])))
            known.append((b.accessor(flat), int(flat.max()) + 1))
            primitive["indices"] = known[-1][0]
        b.mesh(primitive)
    return b


@settings(deadline=None, max_examples=60)
@given(documents(), st.sampled_from([Options("tipsify"), Options("random"), LEAN]), st.sampled_from(["b.glb", "b.gltf"]))
def test_any_document_stays_the_same(tmp_path_factory, builder, options, name):
    folder = tmp_path_factory.mktemp("any")
    source = builder.save(folder / "a.glb")
    if not any(len(draw.triangles) for draw in contents(source)[0]):
        with pytest.raises(luxel.FileError, match="expected at least one triangle"):
            optimize_file(source, folder / name, options)
        return
    optimize_file(source, folder / name, options, measures=False, check=True)
    before, after = posed(source), posed(folder / name)
    assert difference(before, after, options.drop_degenerate, options.drop_duplicates) is None


# Faults


def test_a_difference_is_found_and_nothing_is_written(tmp_path, monkeypatch):
    source = everything().save(tmp_path / "a.glb")
    original = source.read_bytes()

    real = Package.replace

    def wrong(self, piece):
        piece.data = np.roll(piece.data, 1, 0)
        real(self, piece)

    monkeypatch.setattr(Package, "replace", wrong)
    with pytest.raises(DifferenceError, match="not written"):
        laid(source, source)
    assert source.read_bytes() == original
    assert [p.name for p in tmp_path.iterdir()] == ["a.glb"]


def test_the_rest_is_compared(tmp_path):
    a = everything().save(tmp_path / "a.glb")
    for change in (
        lambda d: d["nodes"][1].update(name="other"), lambda d: d["meshes"][0].update(weights=[0, 0]),
        lambda d: d["animations"][0]["samplers"][0].update(input=3), lambda d: d["images"][0].update(bufferView=0),
    ):  # fmt: skip
        b = everything()
        change(b.json)
        assert rest_differs(a, b.save(tmp_path / "b.glb"))
    b = everything(seed=1)
    assert difference(contents(a)[1], contents(b.save(tmp_path / "b.glb"))[1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["meshes"][0]["primitives"][0].update(extensions={"KHR_draco_mesh_compression": {}}), "draco"),
        (lambda d: d["meshes"][0]["primitives"][0]["attributes"].update(NORMAL=99), "accessor 99"),
        (lambda d: d["accessors"][0].update(count=9000), "144 and 9000"),
        (lambda d: d["accessors"][0].update(byteOffset=9000), "needs"),
        (lambda d: d["accessors"][0].update(type="VEC9"), "VEC9"),
        (lambda d: d["meshes"][0]["primitives"][0].update(mode=9), "mode"),
    ],
)
def test_faults_are_named(tmp_path, change, message):
    b = everything()
    change(b.json)
    source = b.save(tmp_path / "a.glb")
    with pytest.raises(luxel.FileError, match=f"(?i){message}"):
        laid(source, tmp_path / "b.glb")
    assert [p.name for p in tmp_path.iterdir()] == ["a.glb"]


def test_indices_out_of_range_are_named(tmp_path):
    b = Builder()
    b.mesh({"attributes": {"POSITION": b.accessor(np.zeros((3, 3), np.float32))}, "indices": b.accessor(np.uint8([0, 1, 7]))})
    with pytest.raises(luxel.FileError, match="index 7 of 3 vertices"):
        laid(b.save(tmp_path / "a.glb"), tmp_path / "b.glb")


def test_a_file_that_luxel_cannot_draw_is_still_laid_out(tmp_path):
    b, (points, faces) = Builder(), grid()
    b.json["extensionsUsed"] = b.json["extensionsRequired"] = ["VENDOR_magic"]
    b.mesh({"attributes": {"POSITION": b.accessor(points, bounds=True)}, "indices": b.accessor(faces.ravel().astype(np.uint16))})
    report, scenes = optimize_file(b.save(tmp_path / "a.glb"), tmp_path / "b.glb", Options("tipsify"), check=True)
    assert scenes == []
    assert report.after.overdraw is None
    assert report.after.acmr[12] < report.before.acmr[12]


@pytest.mark.parametrize("name", ["living_room.glb", "zdm2.glb", "DamagedHelmet/DamagedHelmet.gltf"])
def test_real_files(tmp_path, meshes, name):
    source = meshes / "scenes" / name
    report = laid(source, tmp_path / "b.glb", Options("tipsify", weld=True))
    assert report.after.acmr[12] < report.before.acmr[12]
    assert difference(posed(source), posed(tmp_path / "b.glb")) is None
