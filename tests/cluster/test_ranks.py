"""Ranks of MPI against one rank: the same numbers for 1, 2, 3 and 5 of them, and no rank is left waiting."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from luxel.cluster.comm import Comm, world
from luxel.cluster.launchers import launched
from luxel.errors import ExtraMissingError

RANKS = Path(__file__).with_name("ranks.py")
MPIEXEC = shutil.which("mpiexec", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
needs_mpi = pytest.mark.skipif(MPIEXEC is None or importlib.util.find_spec("mpi4py") is None, reason="no mpiexec or mpi4py: pip install 'luxel[mpi]'")


def mpi(ranks: int, *command: object, timeout: float = 120) -> subprocess.CompletedProcess[str]:
    line = [MPIEXEC, "-n", str(ranks), sys.executable, *map(str, command)]
    return subprocess.run(line, capture_output=True, text=True, timeout=timeout, env={**os.environ, "LUXEL_THREADS": "1"}, check=False)


@needs_mpi
@pytest.mark.parametrize("ranks", [1, 2, 3, 5])
def test_ranks_agree_with_one(ranks):
    what = "messages,pieces,transforms,filters,bands"
    done = mpi(ranks, RANKS, what)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{what}: {ranks} ranks agree\n"


@needs_mpi
@pytest.mark.parametrize("what", ["fails", "uncaught"])
def test_one_failure_ends_all(what):
    done = mpi(3, RANKS, what, timeout=60)
    assert done.returncode != 0
    assert "rank 2 of 3: the last rank has had enough of \\udcff" in done.stderr


@needs_mpi
@pytest.mark.parametrize("ranks", [1, 3])
def test_what_is_no_number_is_named_by_its_row(ranks):
    done = mpi(ranks, RANKS, "odd", timeout=60)
    assert done.returncode != 0
    assert "got nan at row 150, column 7, channel 0" in done.stderr


@needs_mpi
@pytest.mark.parametrize("options", [["--gaussian", "2"], ["--ideal", ".3", "--border", "clamp"]])
def test_pictures_on_disk_are_shared_by_the_ranks(tmp_path, options):
    """More than `--memory` holds: one rank's picture, to the rounding of a code (bands have other bounds)."""
    image = np.random.default_rng(1).integers(0, 65536, (900, 350, 1), dtype=np.uint16)
    np.save(tmp_path / "in.npy", image)
    one, three = tmp_path / "one.npy", tmp_path / "three.npy"
    for ranks, path in ((1, one), (3, three)):
        done = mpi(ranks, "-m", "luxel", "filter", tmp_path / "in.npy", "-o", path, *options, "--memory", "1", "--json")
        assert done.returncode == 0, done.stderr
        told = json.loads(done.stdout)
        assert (told["in_memory"], told["ranks"]) == (False, ranks)
    assert np.abs(np.load(one).astype(int) - np.load(three)).max() <= 1


@needs_mpi
def test_a_command_under_mpiexec_writes_one_file(tmp_path):
    from luxel.io.images import read_image, write_png

    image = np.random.default_rng(1).integers(0, 256, (50, 70, 4), dtype=np.uint8)
    write_png(tmp_path / "in.png", image)
    for options in (["--gaussian", "2"], ["--butterworth", ".2", "--order", "4"]):
        one, four = tmp_path / "one.png", tmp_path / "four.png"
        assert mpi(1, "-m", "luxel", "filter", tmp_path / "in.png", "-o", one, *options).returncode == 0
        done = mpi(4, "-m", "luxel", "filter", tmp_path / "in.png", "-o", four, *options)
        assert done.returncode == 0, done.stderr
        assert done.stdout.count("four.png") == 1
        assert np.abs(read_image(one).astype(int) - read_image(four)).max() <= 1
        four.unlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.png", "one.png"]


@needs_mpi
def test_a_wrong_word_is_told_once():
    done = mpi(3, "-m", "luxel", "filter", "in.png", "--gausian", "2")
    assert done.returncode == 2
    assert done.stderr == "luxel: error: No such option --gausian. Did you mean --gaussian?\n"


@needs_mpi
def test_a_missing_file_ends_the_command_on_every_rank(tmp_path):
    done = mpi(3, "-m", "luxel", "filter", tmp_path / "nothing.png", "-o", tmp_path / "out.png", "--gaussian", "1", timeout=60)
    assert done.returncode != 0
    assert "nothing.png" in done.stderr
    assert "Traceback" not in done.stderr


def test_one_rank_needs_no_mpi():
    assert not launched()
    comm = world()
    assert (comm.rank, comm.size) == (0, 1)
    assert type(comm) is Comm
    assert "mpi4py" not in sys.modules
    array = np.arange(3)
    assert comm.share("x") == "x"
    assert comm.share_array(array) is array
    assert comm.deal([array]) is array
    assert comm.collect(array) == [array]
    assert comm.exchange([array]) == [array]
    assert comm.share_out(7) == [(0, 7)]
    assert comm.threads(2) == 2
    assert comm.threads() >= 1
    with pytest.raises(ZeroDivisionError), comm.guard():
        raise ZeroDivisionError


def test_a_launcher_without_mpi4py_is_said(monkeypatch):
    """Each of the processes would do all of the work."""
    monkeypatch.setenv("PMI_RANK", "0")
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    world.cache_clear()
    try:
        with pytest.raises(ExtraMissingError, match=r"luxel\[mpi\]"):
            world()
    finally:
        world.cache_clear()


def test_mpi_has_one_door():
    source = Path(__file__).resolve().parents[2] / "src"
    doors = [path.name for path in source.rglob("*.py") if re.search(r"^\s*(import|from) mpi4py", path.read_text(), re.MULTILINE)]
    assert doors == ["comm.py"]
