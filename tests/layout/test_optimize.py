"""`luxel.optimize`: whatever goes in comes out as the same thing, with the same triangles and everything at their corners."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import luxel
from luxel import InputError, Mesh, Scene
from luxel.layout import acmr
from luxel.layout.clean import vertex_rows
from luxel.layout.measure import Draw, measure
from luxel.layout.optimize import Options, Report, lay_out
from luxel.layout.same import Soup, difference, soups_of
from luxel.scene.builtin import bumpy_sphere, room, torus

TORUS = torus(segments=40, sides=24)


def decorated(mesh, seed=0):
    """The mesh with every attribute there is, all random."""
    rng, n = np.random.default_rng(seed), len(mesh.positions)
    normals = rng.normal(size=(n, 3))
    return Mesh(mesh.positions, mesh.triangles, (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
                rng.random((n, 2), np.float32), rng.random((n, 2), np.float32), rng.random((n, 4), np.float32),
                rng.random((n, 4), np.float32), name="decorated")  # fmt: skip


def shuffled(mesh, seed=0):
    from dataclasses import replace

    return replace(mesh, triangles=mesh.triangles[np.random.default_rng(seed).permutation(len(mesh.triangles))])


def same(a, b, **dropped):
    return difference(soups_of(luxel.load(a, normals=False)), soups_of(luxel.load(b, normals=False)), **dropped)


def test_a_mesh_keeps_everything():
    mesh = shuffled(decorated(TORUS))
    result, report = luxel.optimize(mesh)
    assert isinstance(result, Mesh)
    assert result.name == "decorated"
    assert same(mesh, result) is None
    assert report.after.acmr[12] < 0.8 < report.before.acmr[12]
    (source,) = report.vertex_source
    assert (result.colors == mesh.colors[source]).all()
    (triangles,) = report.triangle_source
    assert (np.sort(result.triangles, 1) == np.sort(np.argsort(source)[mesh.triangles[triangles]], 1)).all()


@settings(deadline=None, max_examples=60)
@given(
    st.integers(1, 80), st.integers(1, 30), st.integers(0, 2**32 - 1), st.sampled_from(["auto", "file", "random", "morton", "tipsify"]),
    st.booleans(), st.booleans(), st.booleans(), st.booleans(), st.sampled_from([None, 1.0, 1.5]),
)  # fmt: skip
def test_any_soup_stays_the_same(count, vertices, seed, order, weld, degenerate, duplicates, unused, overdraw):
    """Random, non-manifold, degenerate, disconnected: coordinates repeat, so that welding and dropping find something."""
    rng = np.random.default_rng(seed)
    positions, faces = rng.integers(0, 3, (vertices, 3)).astype(np.float32), rng.integers(0, vertices, (count, 3)).astype(np.int32)
    mesh = Mesh(positions, faces, colors=rng.integers(0, 2, (vertices, 4)).astype(np.float32))
    result, report = luxel.optimize(mesh, order, weld=weld, drop_degenerate=degenerate, drop_duplicates=duplicates, drop_unused=unused,
                                    overdraw=overdraw, measures=False)  # fmt: skip
    assert same(mesh, result, dropped_degenerate=degenerate, dropped_duplicates=duplicates) is None
    assert len(result.triangles) == count - report.degenerate - report.duplicates
    assert len(result.positions) == vertices - report.welded - report.unused
    assert report.before is None
    if weld:
        rows = vertex_rows([result.positions, result.colors])
        assert len(np.unique(rows, axis=0)) == len(rows)
    if degenerate:
        corners = result.positions[result.triangles]
        assert all((corners[:, i] != corners[:, (i + 1) % 3]).any(1).all() for i in range(3))


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(3, 40), st.sampled_from(["fifo", "lru"]))
def test_auto_is_never_worse_than_the_input(seed, cache, policy):
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, 30, (50, 3)).astype(np.int32)
    (_, result), _ = luxel.optimize((rng.random((30, 3)), faces), cache=cache, policy=policy, measures=False)
    assert acmr(result, cache, policy) <= acmr(faces, cache, policy)


def test_a_scene_keeps_its_rest():
    scene = room()
    result, report = luxel.optimize(scene, "tipsify")
    assert isinstance(result, Scene)
    assert result is not scene
    assert result.materials is scene.materials
    assert result.instances is scene.instances
    assert [m.material for m in result.meshes] == [m.material for m in scene.meshes]
    assert same(scene, result) is None
    assert len(report.orders) == len(report.vertex_source) == len(scene.meshes)
    assert report.before.triangles == report.after.triangles == sum(len(mesh.triangles) for mesh in scene.meshes)
    small = luxel.render(result, size=(96, 64)).color.astype(int) - luxel.render(scene, size=(96, 64)).color
    assert (np.abs(small) > 2).mean() < 0.002  # ids, and so ties, are others


def test_the_input_is_not_changed():
    mesh = decorated(TORUS)
    before = {name: value.copy() for name, value in vars(mesh).items() if isinstance(value, np.ndarray)}
    luxel.optimize(mesh, "random", weld=True)
    assert all((getattr(mesh, name) == value).all() for name, value in before.items())


@pytest.mark.parametrize("dtypes", [(np.float64, np.int64), (np.float32, np.uint32), (np.float32, np.uint16)])
def test_arrays_come_back_as_arrays(dtypes):
    positions, faces = TORUS.positions.astype(dtypes[0]), TORUS.triangles.astype(dtypes[1])
    (points, triangles), report = luxel.optimize((positions, faces), "tipsify", profile="nvidia")
    assert (points.dtype, triangles.dtype) == dtypes
    assert (points == positions[report.vertex_source[0]]).all()
    assert same((positions, faces), (points, triangles)) is None
    assert report.target == "nvidia"


def test_vertices_are_numbered_by_first_use():
    (_, triangles), _ = luxel.optimize((TORUS.positions, TORUS.triangles), "tipsify")
    flat = triangles.ravel()
    first = flat[np.sort(np.unique(flat, return_index=True)[1])]
    assert (first == np.arange(len(first))).all()


def test_welding_compares_all_attributes():
    positions = np.zeros((4, 3), np.float32)
    positions[2] = 1, 0, 0
    positions[3] = 0, 1, 0
    faces = np.array([[0, 2, 3], [1, 3, 2]], np.int32)
    plain, report = luxel.optimize(Mesh(positions, faces), weld=True)
    assert len(plain.positions) == 3
    assert report.welded == 1
    texcoords = np.array([[0, 0], [0, 0.5], [0, 0], [0, 0]], np.float32)
    kept, report = luxel.optimize(Mesh(positions, faces, texcoords=texcoords), weld=True)
    assert len(kept.positions) == 4
    assert report.welded == 0


def test_welding_a_soup_makes_a_mesh():
    corners = TORUS.positions[TORUS.triangles].reshape(-1, 3)
    soup = Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    result, report = luxel.optimize(soup, weld=True)
    assert report.before.acmr[12] == 3
    assert report.after.acmr[12] < 0.85
    assert same(soup, result) is None


def test_lists_that_share_vertices_stay_apart():
    """The primitives of a glTF mesh: each is ordered alone, their vertices are numbered once."""
    half = len(TORUS.triangles) // 2
    lists = [TORUS.triangles[:half], TORUS.triangles[half:], TORUS.triangles[:0]]
    laid = lay_out(lists, len(TORUS.positions), Options("tipsify"), Report(""), TORUS.positions)
    assert [len(part) for part in laid.triangles] == [half, len(TORUS.triangles) - half, 0]
    rows = vertex_rows([TORUS.positions])
    for before, after, source in zip(lists, laid.triangles, laid.triangle_source, strict=True):
        assert difference({"": Soup(before, rows)}, {"": Soup(after, rows[laid.vertex_source])}) is None
        assert sorted(source.tolist()) == list(range(len(before)))
    assert (laid.vertex_target[laid.vertex_source] == np.arange(len(rows))).all()
    fixed = lay_out(lists, len(TORUS.positions), Options("tipsify"), Report(""), TORUS.positions, renumbered=False)
    assert (fixed.vertex_source == np.arange(len(rows))).all()
    assert difference({"": Soup(lists[0], rows)}, {"": Soup(fixed.triangles[0], rows)}) is None


def test_the_overdraw_limit_holds():
    mesh = shuffled(bumpy_sphere(60))
    plain, a = luxel.optimize(mesh, "tipsify")
    less, b = luxel.optimize(mesh, "tipsify", overdraw=1.03)
    assert b.after.acmr[12] <= 1.03 * a.after.acmr[12]
    assert b.after.overdraw < a.after.overdraw
    assert same(plain, less) is None


def test_measures_of_two_draws_are_those_of_both():
    lone = measure([Draw(TORUS.triangles, len(TORUS.positions), 12)])
    flat = np.zeros((5, 3), np.int32)
    twice = measure([Draw(TORUS.triangles, len(TORUS.positions), 12)] * 2 + [Draw(flat[:0], 3, 12)])
    assert (twice.triangles, twice.vertices) == (2 * lone.triangles, 2 * lone.vertices)
    assert (twice.acmr, twice.atvr) == (lone.acmr, lone.atvr)
    assert twice.overfetch == pytest.approx(lone.overfetch)
    assert twice.edge_span == pytest.approx(lone.edge_span)
    assert lone.edge_span > 1
    assert lone.acmr[12] == pytest.approx(acmr(TORUS.triangles, 12))
    assert lone.overdraw is None
    assert measure([Draw(flat, 1, 12)]).edge_span == 1
    assert measure([]).triangles == 0


def test_the_report_is_plain_for_json():
    _, report = luxel.optimize(TORUS, "tipsify", overdraw=1.05, weld=True)
    data = json.loads(json.dumps(report.as_dict(), allow_nan=False))
    assert data["target"] == "FIFO 12"
    assert data["orders"] == ["tipsify"]
    assert set(data["after"]["atvr"]) == {"nvidia", "amd", "intel", "mobile"}
    assert {"clean", "order", "overdraw", "renumber", "measure"} <= set(data["seconds"])
    assert "vertex_source" not in data


def test_progress_rises_to_one():
    told = []
    luxel.optimize(room(), "tipsify", measures=False, progress=told.append)
    assert told == sorted(told)
    assert 0 <= told[0] < told[-1] == pytest.approx(1)


def test_files_are_read_as_scenes(tmp_path):
    luxel.save(TORUS, tmp_path / "torus.ply")
    result, report = luxel.optimize(tmp_path / "torus.ply", "tipsify")
    assert isinstance(result, Scene)
    assert report.after.triangles == len(TORUS.triangles)


@pytest.mark.parametrize("visual", ["plain", "vertex", "face", "texture"])
def test_trimesh_objects(visual):
    trimesh = pytest.importorskip("trimesh")
    rng = np.random.default_rng(1)
    mesh = trimesh.Trimesh(TORUS.positions, TORUS.triangles, process=False, metadata={"name": "ring"})
    n, m = len(mesh.vertices), len(mesh.faces)
    mesh.vertex_attributes["heat"], mesh.face_attributes["part"] = rng.random(n), rng.integers(0, 9, m)
    if visual == "vertex":
        mesh.visual.vertex_colors = rng.integers(0, 255, (n, 4), np.uint8)
    elif visual == "face":
        mesh.visual.face_colors = rng.integers(0, 255, (m, 4), np.uint8)
    elif visual == "texture":
        mesh.visual = trimesh.visual.TextureVisuals(uv=rng.random((n, 2)))
    result, report = luxel.optimize(mesh, "tipsify")
    (v,), (f,) = report.vertex_source, report.triangle_source
    assert isinstance(result, trimesh.Trimesh)
    assert (result.vertices == mesh.vertices[v]).all()
    assert (np.sort(v[result.faces], 1) == np.sort(mesh.faces[f], 1)).all()
    assert np.allclose(result.face_normals, mesh.face_normals[f], atol=1e-12)
    assert (result.vertex_attributes["heat"] == mesh.vertex_attributes["heat"][v]).all()
    assert (result.face_attributes["part"] == mesh.face_attributes["part"][f]).all()
    assert result.metadata["name"] == "ring"
    assert result.visual.kind == mesh.visual.kind
    if visual == "vertex":
        assert (result.visual.vertex_colors == mesh.visual.vertex_colors[v]).all()
    elif visual == "face":
        assert (result.visual.face_colors == mesh.visual.face_colors[f]).all()
    elif visual == "texture":
        assert (result.visual.uv == mesh.visual.uv[v]).all()


def test_trimesh_scenes():
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene({"ring": trimesh.Trimesh(TORUS.positions, TORUS.triangles, process=False), "path": trimesh.load_path([[0, 0], [1, 1]])})
    result, report = luxel.optimize(scene, "tipsify")
    assert isinstance(result, trimesh.Scene)
    assert set(result.geometry) == {"ring", "path"}
    assert (result.geometry["ring"].vertices == TORUS.positions[report.vertex_source[0]]).all()
    assert report.after.triangles == len(TORUS.triangles)


def test_nothing_to_order_is_an_error():
    empty = Mesh(np.zeros((2, 3), np.float32), np.zeros((0, 3), np.int32))
    for source in (empty, Scene(), (empty.positions, empty.triangles)):
        with pytest.raises(luxel.InputError, match="at least one triangle to order, got none"):
            luxel.optimize(source)


def test_an_empty_mesh_among_others():
    empty = Mesh(np.zeros((2, 3), np.float32), np.zeros((0, 3), np.int32))
    scene = Scene(meshes=[empty, TORUS])
    result, report = luxel.optimize(scene, "tipsify", drop_unused=True)
    assert [len(mesh.positions) for mesh in result.meshes] == [0, len(TORUS.positions)]
    assert report.orders == ["empty", "tipsify"]


def test_everything_dropped():
    point = Mesh(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32))
    result, report = luxel.optimize(point, drop_degenerate=True, drop_unused=True)
    assert (len(result.triangles), len(result.positions), report.degenerate) == (0, 0, 1)
    assert report.after.triangles == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_positions_that_are_not_finite_are_named(bad):
    points = np.array([[0, 0, 0], [bad, 0, 0], [1, 0, 0], [0, 1, 0], [0, bad, 0]], np.float32)
    with pytest.raises(luxel.InputError, match=r"positions: expected finite numbers, got .* at vertex 4"):
        luxel.optimize((points, np.array([[2, 3, 4], [0, 2, 3]])))
    luxel.optimize((points, np.array([[0, 2, 3]])))  # no triangle asks where the others are


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"order": "tipsfy"}, "order"), ({"cache": 2}, "cache"), ({"policy": "plru"}, "policy"), ({"profile": "voodoo"}, "profile"),
        ({"overdraw": 0.5}, "overdraw"), ({"overdraw": float("nan")}, "overdraw"), ({"threads": 0}, "threads"), ({"seconds": -1}, "seconds"),
    ],
)  # fmt: skip
def test_wrong_options_are_named(options, word):
    with pytest.raises(InputError, match=word):
        luxel.optimize(TORUS, **options)


def test_wrong_arrays_are_named():
    with pytest.raises(InputError, match="vertex 9 of a mesh with 4"):
        luxel.optimize((np.zeros((4, 3)), [[0, 1, 2], [3, 2, 9]]))
    with pytest.raises(InputError, match="positions"):
        luxel.optimize((np.zeros((4, 2)), [[0, 1, 2]]))
    with pytest.raises(InputError, match="expected a path"):
        luxel.optimize(12)
    with pytest.raises(luxel.FileError, match="nowhere"):
        luxel.optimize("nowhere.ply")
