"""What is left behind when ranks die, are stopped, or never were ranks."""

import errno
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from test_ranks import MPIEXEC, needs_mpi

import luxel
from luxel.cluster import comm as comm_of
from luxel.cluster import ply_share
from luxel.cluster.agree import agree, files_of
from luxel.cluster.comm import Comm
from luxel.cluster.ply_table import Table
from luxel.cluster.slices import check_count
from luxel.cluster.spill import Spill
from luxel.errors import FileError, InputError
from luxel.io.ply import read_header
from luxel.scene.builtin import bumpy_sphere, cornell_box

# Rank 0 comes to the end of a file and waits there; then rank 1 ends, in the way that is asked for.
WRITING = """
import os, pathlib, signal, sys, threading, time
from luxel.cluster.comm import world
from luxel.radiosity import bake
mark, how = pathlib.Path(sys.argv.pop(1)), sys.argv.pop(1)

def wait(path, mode):
    if str(path).endswith(".part"):
        mark.write_text(str(os.getppid()))
        time.sleep(60)

def end():
    while not mark.exists():
        time.sleep(0.01)
    {"exit": lambda: os._exit(3), "kill": lambda: os.kill(os.getpid(), signal.SIGKILL), "abort": os.abort, "none": time.time}[how]()

if world().rank == 0:
    os.chmod, bake._SAVE_EVERY = wait, 0
else:
    threading.Thread(target=end, daemon=True).start()
sys.exit(__import__("luxel.cli").cli.main())
"""
SAID = {"exit": "rank 1 of 2: left with exit code 3", "kill": "rank 1 of 2: killed by SIGKILL", "abort": "rank 1 of 2: killed by SIGABRT"}
WORDS = {
    "picture": ["render", "ball.ply", "-o", "out.png", "--size", "64x64"],
    "mesh": ["optimize", "ball.glb", "-o", "out.glb"],
    "checkpoint": ["bake", "box.glb", "-o", "out.glb", "--density", "16", "--quality", "draft"],
}


def until(condition, seconds=60):
    for _ in range(int(20 * seconds)):
        if condition():
            return True
        time.sleep(0.05)
    return False


def started(folder, how, words):
    """A job that writes a file that it does not finish."""
    luxel.save(bumpy_sphere(10), folder / "ball.ply")
    luxel.save(bumpy_sphere(10), folder / "ball.glb")
    luxel.save(cornell_box(), folder / "box.glb")
    line = [MPIEXEC, "-n", "2", sys.executable, "-c", WRITING, folder / "mark", how, *words]
    job = subprocess.Popen(list(map(str, line)), stderr=subprocess.PIPE, text=True, cwd=folder, env={**os.environ, "LUXEL_THREADS": "1"})
    assert until((folder / "mark").exists)
    return job


def left(folder):
    return sorted(path.name for path in folder.iterdir() if path.name not in ("ball.ply", "ball.glb", "box.glb", "mark"))


@needs_mpi
@pytest.mark.skipif(not Path("/proc").exists(), reason="finds in /proc how a rank has ended")
@pytest.mark.parametrize(("what", "how"), [("picture", "exit"), ("picture", "abort"), ("mesh", "kill"), ("checkpoint", "exit")])
def test_nothing_is_left_of_what_rank_0_writes_when_another_dies(tmp_path, what, how):
    job = started(tmp_path, how, WORDS[what])
    _, err = job.communicate(timeout=30)
    assert job.returncode != 0
    assert SAID[how] in err
    assert until(lambda: not left(tmp_path), 10), left(tmp_path)  # the witness comes after the rank


@needs_mpi
@pytest.mark.parametrize("what", ["picture", "mesh"])
def test_sigterm_ends_as_ctrl_c_does(tmp_path, what):
    job = started(tmp_path, "none", WORDS[what])
    assert left(tmp_path)
    job.send_signal(signal.SIGTERM)
    _, err = job.communicate(timeout=30)
    assert job.returncode != 0
    assert "Traceback" not in err
    assert until(lambda: not left(tmp_path), 10), left(tmp_path)


class Two(Comm):
    """A rank whose neighbour says something else."""

    def __init__(self, change):
        super().__init__()
        self.change = change

    def gather(self, value):
        return [value, self.change(value)]


def test_inputs_that_differ_are_named(tmp_path):
    """Also what only one of them has."""
    path = tmp_path / "a.ply"
    path.write_bytes(b"1")
    agree(Two(lambda told: dict(told)), (path,), size=1)
    with pytest.raises(InputError, match="ranks differ in size: 1 on rank 0, 2 on rank 1"):
        agree(Two(lambda told: told | {"size": "2"}), (path,), size=1)
    with pytest.raises(InputError, match="ranks differ in size: 1 on rank 0, nothing on rank 1"):
        agree(Two(lambda told: {name: value for name, value in told.items() if name != "size"}), (path,), size=1)
    with pytest.raises(InputError, match="ranks differ in more: nothing on rank 0, 3 on rank 1"):
        agree(Two(lambda told: told | {"more": "3"}), (path,), size=1)


def test_files_that_a_file_names(tmp_path):
    (tmp_path / "a.gltf").write_text('{"buffers": [{"uri": "my%20data.bin"}, {"uri": "data:,x"}, {}], "images": [{"uri": "wood.png"}]}')
    assert [path.name for path in files_of(tmp_path / "a.gltf")] == ["a.gltf", "my data.bin", "wood.png"]
    (tmp_path / "a.obj").write_text("# x\nmtllib one two.mtl\nmtllib\nv 0 0 0\n")
    (tmp_path / "one two.mtl").write_text("newmtl a\nmap_Kd -s 2 2 2 stone.png\nKd 1 1 1\n")
    assert [path.name for path in files_of(tmp_path / "a.obj")][:3] == ["a.obj", "one two.mtl", "stone.png"]
    (tmp_path / "bad.gltf").write_text("no JSON")
    assert files_of(tmp_path / "bad.gltf") == [tmp_path / "bad.gltf"]


@needs_mpi
@pytest.mark.parametrize(("words", "said"), [
    ((["--crease-angle", "10"], ["--crease-angle", "20"]), "ranks differ in crease_angle: 10.0 on rank 0, 20.0 on rank 1"),
    ((["--azimuth", "10"], ["--elevation", "20"]), "ranks differ in camera:"),
    (([], []), r"ranks differ in ball.bin: \d+ bytes, \w+ on rank 0, \d+ bytes, \w+ on rank 1"),
])  # fmt: skip
def test_ranks_that_are_given_different_things(tmp_path, words, said):
    """The last ones differ in nothing but the buffers that a .gltf file names."""
    line = [MPIEXEC]
    for k in range(2):
        folder = tmp_path / str(k)
        folder.mkdir()
        mesh = bumpy_sphere(6)
        luxel.save(luxel.Mesh(mesh.positions * (1 + k * (not words[0])), mesh.triangles, mesh.normals), folder / "ball.gltf")
        if k:
            (folder / "ball.gltf").write_bytes((tmp_path / "0" / "ball.gltf").read_bytes())
        line += [":"] * k + ["-wdir", folder, "-n", "1", sys.executable, "-m", "luxel", "render", "ball.gltf", "-o", tmp_path / "out.png", *words[k]]
    done = subprocess.run(list(map(str, line)), check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode != 0
    assert re.search(said, done.stderr), done.stderr
    assert not (tmp_path / "out.png").exists()


@needs_mpi
@pytest.mark.parametrize("name", ["SLURM_STEP_NUM_TASKS", "OMPI_COMM_WORLD_SIZE"])
def test_processes_that_mpi_takes_for_the_only_one_are_refused(tmp_path, name):
    """srun without its PMI, or another MPI's launcher: each of them would write the file."""
    luxel.save(bumpy_sphere(4), tmp_path / "ball.ply")
    words = [sys.executable, "-m", "luxel", "render", "ball.ply", "-o", "out.png", "--size", "8"]
    env = {key: value for key, value in os.environ.items() if not key.startswith(("PMI", "SLURM", "OMPI"))}
    done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=60, cwd=tmp_path, env={**env, name: "4"})
    assert done.returncode == 2
    assert "this is one of 4 processes" in done.stderr
    assert ("srun --mpi=pmi2" in done.stderr) == name.startswith("SLURM")
    assert not (tmp_path / "out.png").exists()
    done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=60, cwd=tmp_path, env={**env, name: "1"})
    assert done.returncode == 0, done.stderr


def test_more_triangles_than_have_numbers_are_refused_before_they_are_read(tmp_path):
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    for faces, said in ((700_000_000, "700,000,000 triangles are too many for one rank: expected at least 3 that share them"),
                        (1 << 31, "expected fewer than 2^31 in one scene")):
        path = tmp_path / f"{faces}.ply"
        path.write_text(f"{header}element face {faces}\nproperty list uchar int vertex_indices\nend_header\n")
        os.truncate(path, path.stat().st_size + 72 + 13 * faces)  # of holes
        with pytest.raises(InputError, match=re.escape(said)):
            ply_share.load_share(path, Comm())
    ply_share._check_counts(path, (1 << 31) - 1, 9)
    check_count("a scene", (1 << 31) - 1)


def failing(number):
    def fail(*_, **__):
        raise OSError(number, os.strerror(number))
    return fail


def test_a_disk_is_named_by_what_failed(tmp_path, monkeypatch):
    """What is laid aside by its folder, and what is read by its file."""
    with pytest.raises(FileError, match=r"a file without a name in '.*nowhere': cannot lay parts aside: No such file"):
        Spill(tmp_path / "nowhere")
    if Path("/dev/full").exists():
        spill = Spill(tmp_path)
        spill._file.close()
        spill._file = open("/dev/full", "r+b", buffering=0)  # noqa: SIM115
        with pytest.raises(FileError, match=f"in '{tmp_path}': cannot lay parts aside: No space left on device"):
            spill.put("a", np.zeros(1 << 16, np.uint8))
        spill.close()
    luxel.save(bumpy_sphere(4), tmp_path / "ball.ply")
    with (tmp_path / "ball.ply").open("rb") as file:
        vertex = Table(read_header(file, "ball.ply")[1][0], file.tell())
        monkeypatch.setattr("luxel.cluster.ply_table.np.fromfile", failing(errno.EIO))
        monkeypatch.setattr("luxel.cluster.ply_table.mmap.mmap", failing(errno.EIO))
        for read in (lambda: list(vertex.read(file, 0, 3)), lambda: vertex.take(file, np.arange(3))):
            with pytest.raises(FileError, match=r"ball.ply, element vertex: cannot read: Input/output error"):
                read()


def test_long_arrays_go_in_pieces(monkeypatch):
    monkeypatch.setattr(comm_of, "_MOST_BYTES", 20)
    array = np.arange(12).reshape(3, 4)
    pieces = comm_of._pieces(array)
    assert [piece.nbytes for piece in pieces] == [16] * 6
    assert np.array_equal(np.concatenate(pieces), np.arange(12))
