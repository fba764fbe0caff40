"""Pictures by ranks of MPI: one process's bytes, for any number of ranks, division and composition; and faults, each with one message."""

import os
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from test_ranks import MPIEXEC, mpi, needs_mpi

import luxel
from luxel.cluster.composite import COMPOSITIONS, merge, pack, radices, regions
from luxel.cluster.layers import below, lay_over, layered
from luxel.cluster.plan import Plan, cut
from luxel.cluster.shares import group_count
from luxel.cluster.slices import sliced
from luxel.cluster.sort_first import boxes
from luxel.scene.builtin import bumpy_sphere

MESHES = Path(os.environ.get("LUXEL_MESHES", Path(__file__).resolve().parents[3] / "shared" / "meshes"))
DRAWING = Path(__file__).with_name("drawing.py")


@needs_mpi
@pytest.mark.parametrize("ranks", [1, 2, 3, 4, 5, 7])
def test_pictures_are_those_of_one_process(ranks):
    """Real models among them, where there are some."""
    more = {2: ",samplings", 3: ",few,windows", 4: ",samplings,learning", 7: ",few"}
    models = [path for name in ("fandisk.obj", "teapot.obj") if (path := MESHES / name).exists()]
    done = mpi(ranks, DRAWING, "modes,compositions,matrix" + more.get(ranks, ""), *models, timeout=240)
    assert done.returncode == 0, done.stderr
    assert f"{ranks} ranks agree" in done.stdout


@needs_mpi
def test_files_in_parts(tmp_path, meshes):
    mesh = bumpy_sphere(40)
    luxel.save(mesh, tmp_path / "sphere.ply")
    long = luxel.Mesh(mesh.positions, mesh.triangles)
    long.normals = mesh.normals * np.float32(2)  # made unit by all ranks, or by none
    (tmp_path / "long.ply").write_bytes(ply_with(long))
    order = np.random.default_rng(4).permutation(len(mesh.triangles))  # neighbours are far from each other in the file
    luxel.save(luxel.Mesh(mesh.positions, mesh.triangles[order]), tmp_path / "bare.ply")
    corners = mesh.positions[mesh.triangles[order]].reshape(-1, 3)
    luxel.save(luxel.Mesh(corners, np.arange(len(corners)).reshape(-1, 3)), tmp_path / "soup.ply")
    cut = np.clip(mesh.positions, -0.6, 0.6)  # flat sides, with edges
    luxel.save(luxel.Mesh(cut, mesh.triangles[order]), tmp_path / "edges.ply")
    for name in ("horse.ply", "fandisk.obj"):
        (tmp_path / name).symlink_to(meshes / name)
    for ranks, what in ((1, "bare"), (2, "files,bare,streamed,units"), (3, "bare,units"), (4, "streamed"), (5, "files,units"), (7, "bare,streamed")):
        done = mpi(ranks, DRAWING, what, tmp_path)
        assert done.returncode == 0, done.stderr


def ply_with(mesh):
    rows = np.concatenate([mesh.positions, mesh.normals], 1).astype("<f4")
    faces = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{names}element face {len(faces)}\n"
    return (head + "property list uchar int vertex_indices\nend_header\n").encode() + rows.tobytes() + faces.tobytes()


@needs_mpi
@pytest.mark.parametrize(("what", "said"), [
    ("dies", r"luxel: rank 1 of 3: killed by SIGKILL \(out of memory\?\)"),
    ("starves", r"luxel: rank 1 of 3: not enough memory: Unable to allocate 9 EiB"),
    ("all_fail", "luxel: rank [012] of 3: all of us"),
    ("differ", r"luxel: rank [012] of 3: ranks differ in one: 0 on rank 0, 1 on rank 1"),
])  # fmt: skip
def test_a_fault_is_said_once_and_ends_all(what, said):
    start = time.monotonic()
    done = mpi(3, DRAWING, what, timeout=30)
    assert done.returncode != 0
    assert time.monotonic() - start < 20
    assert len(re.findall(r"luxel: rank \d of 3", done.stderr)) == 1
    assert re.search(said, done.stderr), done.stderr


@needs_mpi
def test_the_command_and_its_interruption(tmp_path):
    luxel.save(bumpy_sphere(100), tmp_path / "sphere.ply")
    for divide in ("screen", "both"):
        out = tmp_path / f"{divide}.png"
        done = mpi(3, "-m", "luxel", "render", tmp_path / "sphere.ply", "-o", out, "--size", "200x100", "--divide", divide, "-q")
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tmp_path / "screen.png").read_bytes() == (tmp_path / "both.png").read_bytes()
    line = [MPIEXEC, "-n", "2", sys.executable, "-m", "luxel", "render", tmp_path / "sphere.ply", "-o", tmp_path / "turn.png", "--turntable", "5000"]
    job = subprocess.Popen(list(map(str, line)), stderr=subprocess.PIPE, text=True, env={**os.environ, "LUXEL_THREADS": "1"})
    for _ in range(600):
        if (tmp_path / "turn_0002.png").exists():
            break
        time.sleep(0.1)
    job.send_signal(signal.SIGINT)
    _, err = job.communicate(timeout=30)
    assert job.returncode != 0
    assert "Traceback" not in err
    assert not list(tmp_path.glob(".*part"))
    assert all(path.read_bytes()[-8:-4] == b"IEND" for path in tmp_path.glob("turn_*.png"))


@pytest.mark.parametrize("composition", COMPOSITIONS)
@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 60])
def test_regions_are_a_partition(composition, size):
    slots = np.arange(5, 105, 3)
    shares = regions(slots, size, composition)
    assert len(shares) == size
    assert np.array_equal(np.sort(np.concatenate(shares)), slots)
    steps = radices(size, composition)
    assert np.prod(steps) == size or (composition == "swap" and np.prod(steps) * 2 > size)


def test_pack_and_merge():
    rng = np.random.default_rng(0)
    ids = np.where(rng.random((6, 40)) < 0.4, rng.integers(0, 9, (6, 40)), -1).astype(np.int32)
    ids[4] = -1
    depths = np.where(ids >= 0, rng.integers(0, 3, (6, 40)), -1).astype(np.float32)
    words = pack(np.arange(6), 40, ids, depths)
    into, nearness = np.full(ids.shape, -1, np.int32), np.full(ids.shape, -1, np.float32)
    assert merge(words, into, nearness) == (ids >= 0).sum()
    assert np.array_equal(into, ids)
    assert np.array_equal(nearness, depths)
    merge(pack(np.arange(6), 40, np.where(ids >= 0, ids + 1, -1).astype(np.int32), depths), into, nearness)
    assert np.array_equal(into, ids)  # as near, and later


def test_cuts_of_equal_cost():
    for parts in (1, 2, 3, 10):
        costs = np.random.default_rng(parts).random(97) ** 4
        cuts = cut(costs, np.ones(parts))
        assert (cuts[0], cuts[-1], len(cuts)) == (0, 97, parts + 1)
        assert (np.diff(cuts) >= 0).all()
        sums = np.add.reduceat(costs, cuts[:-1])
        assert sums.max() <= costs.sum() / parts + costs.max()
    few = cut(np.ones(2), np.ones(5)).tolist()
    assert few == sorted(few)
    assert cut(np.ones(100), np.array([3, 2])).tolist() == [0, 60, 100]  # groups of three ranks and of two


def test_a_plan_learns_what_its_parts_took():
    plan, costs = Plan(), np.ones(100)
    first = plan.cuts(lambda: costs, "window", 100, np.ones(2))
    assert first.tolist() == [0, 50, 100]
    plan.learn(np.array([3.0, 1.0]))
    assert 35 < plan.cuts(lambda: costs, "window", 100, np.ones(2))[1] < 45
    assert Plan("static").cuts(lambda: 1 / 0, "window", 100, np.ones(4)).tolist() == [0, 25, 50, 75, 100]


def test_boxes_cover_the_tiles():
    for first, last in ((0, 12), (1, 3), (2, 7), (5, 5), (3, 11), (4, 8)):
        seen = np.zeros((25, 35), int)
        for x0, y0, x1, y1 in boxes(first, last, 4, 10, (0, 0, 35, 25)):
            seen[y0:y1, x0:x1] += 1
        tile = np.arange(25)[:, None] // 10 * 4 + np.arange(35) // 10
        assert np.array_equal(seen, ((tile >= first) & (tile < last)).astype(int))


def test_layers_are_laid_from_far_to_near():
    """Of equally near ones the higher id lies below."""
    words = np.zeros((4, 3), np.int32)
    words[:, 0], words[:, 2] = (0, 0, 0, 1), (5, 9, 1, 7)
    words.view(np.float32)[:, 1] = 0.5, 0.5, 0.75, 0.1
    order, layer = layered(words)
    assert order.tolist() == [1, 0, 2, 3]
    assert layer.tolist() == [1, 0, 2, 0]
    found = np.array([[2, 0, 0, 0.5], [1, 0, 0, 0.5], [4, 0, 0, 0.5], [8, 0, 0, 1]], np.float32)
    colors = np.full((1, 8), 1, np.float32)
    lay_over(order, 2, words[:, 0], found, colors)
    assert colors[0, :2].tolist() == [((1 * 0.5 + 1) * 0.5 + 2) * 0.5 + 4, 8]


def test_ids_of_others_come_before_and_after_the_own():
    ids = np.array([-1, 0, 9, 10, 19, 20, 50], np.int32)
    assert below(ids, 10, 10, 3).tolist() == [-1, -1, -1, 0, 9, 13, 13]


def test_slices_of_a_scene_are_the_scene():
    scene = luxel.Scene()
    for k in (4, 6):
        scene.add(luxel.Mesh(bumpy_sphere(k).positions, bumpy_sphere(k).triangles))
    whole = luxel.prepare(scene).geometry
    count = scene.triangle_count
    for cuts in ((0, 1, count), (0, 50, 130, count)):
        parts = [luxel.prepare(sliced(scene, a, b)).geometry for a, b in pairwise(cuts)]
        for name in ("positions", "normals"):
            corners = np.concatenate([getattr(part, name)[part.triangles] for part in parts])
            assert np.array_equal(corners, getattr(whole, name)[whole.triangles])
    assert [group_count(n) for n in (1, 2, 3, 4, 5, 8, 9, 16)] == [1, 1, 1, 2, 2, 2, 3, 4]
