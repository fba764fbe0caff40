"""What is left behind when ranks die, are stopped, or never were ranks."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_ranks import MPIEXEC, needs_mpi

import luxel
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
    assert SAID[how] in err or "rank 1 of 2: was killed, or left without a word" in err
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
