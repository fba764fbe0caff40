"""Files laid out by ranks of MPI: the same bytes for any number of them, and nothing is left behind when one dies."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from test_ranks import MPIEXEC, mpi, needs_mpi

import luxel
from luxel.cluster.cells import cell_of, cells
from luxel.cluster.comm import Comm
from luxel.cluster.directory import Directory
from luxel.cluster.ply_table import compact
from luxel.scene.builtin import bumpy_sphere

ORDERING = Path(__file__).with_name("ordering.py")


@needs_mpi
@pytest.mark.parametrize("ranks", [1, 2, 3, 5])
def test_orders_are_those_of_one_rank(ranks, tmp_path):
    what = {1: "one_cell,cost", 2: "one_cell,cells,whole,proof,cost", 3: "cells,whole", 5: "one_cell"}[ranks]
    done = mpi(ranks, ORDERING, what, tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"{ranks} ranks agree" in done.stdout


@needs_mpi
def test_the_command(tmp_path):
    luxel.save(bumpy_sphere(60), tmp_path / "in.ply")
    one = subprocess.run([sys.executable, "-m", "luxel", "optimize", tmp_path / "in.ply", "-o", tmp_path / "one.ply", "-q"], check=True)
    done = mpi(3, "-m", "luxel", "optimize", tmp_path / "in.ply", "-o", tmp_path / "three.ply", "--check", "--json")
    assert (one.returncode, done.returncode) == (0, 0), done.stderr
    assert (tmp_path / "one.ply").read_bytes() == (tmp_path / "three.ply").read_bytes()
    told = json.loads(done.stdout)
    assert told["checked"]
    assert told["after"]["acmr"]["12"] < 0.62 < 1.9 < told["before"]["acmr"]["12"]
    done = mpi(2, "-m", "luxel", "optimize", tmp_path / "in.ply", "--ordr", "greedy")
    assert done.returncode == 2
    assert done.stderr.count("Did you mean --order or") == 1
    (tmp_path / "short.ply").write_bytes((tmp_path / "in.ply").read_bytes()[:-5])
    done = mpi(2, "-m", "luxel", "optimize", tmp_path / "short.ply", "-o", tmp_path / "out.ply")
    assert done.returncode != 0
    assert "short.ply" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.glob(".*"))


@needs_mpi
@pytest.mark.skipif(not Path("/proc").exists(), reason="finds the ranks in /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_nothing_is_left_of_a_file_whose_writers_die(tmp_path, number):
    """Whoever of the ranks it is, and though rank 0 is stopped with it."""
    luxel.save(bumpy_sphere(20), tmp_path / "in.ply")
    text = (
        "import sys, time, pathlib\n"
        "from luxel.cluster import layout\n"
        "folder = sys.argv[1]\n"
        "def wait(self, *_):\n"
        "    pathlib.Path(folder, f'writing{self.comm.rank}').write_text(str(__import__('os').getpid()))\n"
        "    time.sleep(60)\n"
        "layout.Layout.write = wait\n"
        "from luxel.cli import main\n"
        "sys.argv = ['luxel', 'optimize', sys.argv[1] + '/in.ply', '-o', sys.argv[1] + '/out.ply']\n"
        "main()\n"
    )
    line = [MPIEXEC, "-n", "2", sys.executable, "-c", text, tmp_path]
    job = subprocess.Popen(list(map(str, line)), stderr=subprocess.PIPE, text=True, env={**os.environ, "LUXEL_THREADS": "1"})
    marks = [tmp_path / f"writing{rank}" for rank in range(2)]
    for _ in range(600):
        if all(mark.exists() and mark.read_text() for mark in marks):
            break
        time.sleep(0.1)
    assert list(tmp_path.glob(".out.ply.*.part"))
    if number == signal.SIGKILL:
        os.kill(int(marks[1].read_text()), number)
    else:
        job.send_signal(number)
    _, err = job.communicate(timeout=30)
    assert job.returncode != 0
    assert "Traceback" not in err
    for _ in range(100):  # the witness comes after the rank
        if not list(tmp_path.glob(".*")):
            break
        time.sleep(0.1)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.ply", "writing0", "writing1"]


def test_cells_have_their_share_of_the_points():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(5000, 3)).astype(np.float32) * np.float32([5, 1, 0.1])
    for count in (1, 2, 3, 7, 64):
        found = cell_of(cells(points, count), points)
        sizes = np.bincount(found, minlength=count)
        assert len(sizes) == count
        assert abs(sizes - 5000 / count).max() < 5
    alike = np.ones((10, 3), np.float32)
    assert len(np.unique(cell_of(cells(alike, 4), alike))) == 1
    assert cell_of(cells(alike[:0], 4), np.full((2, 3), np.nan, np.float32)).tolist() == [3, 3]


def test_a_directory_of_one_rank():
    directory = Directory(Comm(), 10, 7)
    directory.put(np.array([3, 9]), np.array([5, 8]), least=True)
    assert directory.get(np.array([9, 3, 0])).tolist() == [7, 5, 7]
    directory.put(np.array([9]), np.array([8]))
    assert directory.get(np.array([9])).tolist() == [8]
    assert Directory(Comm(), 4).values.tolist() == [0, 1, 2, 3]


def test_compact():
    for numbers in (np.array([[5, 9], [5, 6]]), np.array([[5, 10**9], [7, 5]])):
        used, local = compact(numbers)
        assert np.array_equal(used, np.unique(numbers))
        assert np.array_equal(used[local], numbers)
    assert [array.size for array in compact(np.zeros((0, 3), np.int32))] == [0, 0]
