"""Bakes by ranks of MPI: one process's bytes, for any number of ranks; resumed by another number; and faults, each with one message."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_ranks import MPIEXEC, mpi, needs_mpi

import luxel
from luxel.scene.builtin import cornell_box

BAKING = Path(__file__).with_name("baking.py")
CASES = {
    1: ("cornell:final",),
    2: ("beam:draft", "cornell:draft", "cornell:final", "cornell:progressive", "lamps:draft", "lamps:normal", "sky:normal"),
    3: ("beam:normal", "cornell:normal", "cornell:final", "lamps:progressive", "sky:draft", "sky:progressive"),
    4: ("cornell:progressive", "lamps:draft"),
    5: ("cornell:draft", "sky:final"),
    7: ("beam:draft", "cornell:final", "lamps:draft"),
}


@needs_mpi
@pytest.mark.parametrize("ranks", CASES)
def test_the_light_is_that_of_one_process(ranks):
    more = {2: ",dealing", 3: ",occlusion,pictures", 7: ",few,dealing"}
    done = mpi(ranks, BAKING, "light" + more.get(ranks, ""), *CASES[ranks], timeout=240)
    assert done.returncode == 0, done.stderr
    assert f"{ranks} ranks agree" in done.stdout


@needs_mpi
def test_a_bake_goes_on_with_another_number_of_ranks(tmp_path):
    for ranks, what in ((1, "stops"), (3, "goes_on,stops"), (2, "goes_on")):
        done = mpi(ranks, BAKING, what, tmp_path, timeout=240)
        assert done.returncode == 0, (ranks, what, done.stderr)


@needs_mpi
@pytest.mark.parametrize(("what", "said"), [
    ("dies", r"luxel: rank 1 of 3: killed by SIGKILL \(out of memory\?\)"),
    ("starves", "luxel: rank 1 of 3: not enough memory: Unable to allocate 9 EiB"),
    ("dark", "luxel: rank 0 of 3: bake: nothing shines"),
    ("unreadable", r"luxel: rank 0 of 3: .*nothing.glb: cannot read: No such file"),
])  # fmt: skip
def test_a_fault_is_said_once_and_ends_all(tmp_path, what, said):
    start = time.monotonic()
    done = mpi(3, BAKING, what, tmp_path, timeout=60)
    assert done.returncode != 0
    assert time.monotonic() - start < 30
    assert len(re.findall(r"luxel: rank \d of 3", done.stderr)) == 1, done.stderr
    assert re.search(said, done.stderr), done.stderr
    assert not list(tmp_path.glob("*.part"))


def command(ranks, *words):
    line = [MPIEXEC, "-n", ranks, sys.executable, "-m", "luxel", "bake", *words]
    return list(map(str, line))


@needs_mpi
def test_the_command(tmp_path):
    box, lit, three = (tmp_path / name for name in ("box.glb", "lit.glb", "three.glb"))
    luxel.save(cornell_box(), box)
    quiet = {"check": True, "capture_output": True, "text": True, "env": {**os.environ, "LUXEL_THREADS": "1"}}
    few = ["--density", 16, "--quality", "final", "--ao", 0.3]
    subprocess.run([sys.executable, "-m", "luxel", "bake", *map(str, [box, "-o", lit, *few])], **quiet)
    told = json.loads(subprocess.run(command(3, box, "-o", three, *few, "--json"), **quiet).stdout)
    assert three.read_bytes() == lit.read_bytes()
    assert [set(rank) for rank in told["ranks"]] == [{"sent", "waited", "peak"}] * 3
    assert all(rank["sent"] > 0 for rank in told["ranks"])
    assert not list(tmp_path.glob("*.state*"))


@needs_mpi
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interruption_keeps_the_state(tmp_path, number):
    box, again = tmp_path / "box.glb", tmp_path / "again.glb"
    luxel.save(cornell_box(), box)
    long = [box, "-o", again, "--density", 60, "--quality", "progressive", "--tolerance", 1e-9, "--preview", tmp_path / "seen.png"]
    job = subprocess.Popen(command(2, *long), stderr=subprocess.PIPE, text=True, env={**os.environ, "LUXEL_THREADS": "1"})
    for _ in range(600):
        if (tmp_path / "seen.png").exists():
            break
        time.sleep(0.1)
    job.send_signal(number)
    _, err = job.communicate(timeout=30)
    assert job.returncode != 0
    assert "Traceback" not in err
    assert "interrupted" in err
    assert "--resume goes on" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again.glb.state", "box.glb", "seen.png"]


@needs_mpi
def test_ranks_that_were_given_different_words_are_told(tmp_path):
    luxel.save(cornell_box(), tmp_path / "box.glb")
    one = [sys.executable, "-m", "luxel", "bake", str(tmp_path / "box.glb"), "--quality"]
    line = [MPIEXEC, "-n", "1", *one, "draft", ":", "-n", "1", *one, "final"]
    done = subprocess.run(line, check=False, capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert done.returncode != 0
    assert re.search("luxel: rank [01] of 2: ranks differ in quality: 'draft' on rank 0, 'final' on rank 1", done.stderr)
    assert [path.name for path in tmp_path.iterdir()] == ["box.glb"]
