"""`luxel optimize`, from the command line."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import luxel
from luxel.cli import main
from luxel.io.images import read_image
from luxel.scene.builtin import torus


@pytest.fixture
def ring(tmp_path):
    mesh = torus(segments=40, sides=24)
    order = np.random.default_rng(0).permutation(len(mesh.triangles))
    luxel.save((mesh.positions, mesh.triangles[order]), tmp_path / "ring.ply")
    return tmp_path / "ring.ply"


def error_of(capsys, *words):
    code = main(["optimize", *map(str, words)])
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    assert err.startswith("luxel: error: ")
    assert err.count("\n") == 1
    return err


def test_a_table_and_what_was_written(capsys, ring, tmp_path):
    out = tmp_path / "out.ply"
    assert main(["optimize", str(ring), "-o", str(out), "--order", "tipsify", "--check"]) == 0
    said = capsys.readouterr().out
    for row in ("ACMR, FIFO 12", "ACMR, FIFO 32", "ATVR, nvidia", "ATVR, mobile", "overdraw, mean", "overdraw, worst view", "overfetch", "edge span"):
        assert row in said
    assert "for FIFO 12: tipsify" in said
    assert "checked: the same triangles" in said
    assert said.splitlines()[-1] == f"{out}  (1,920 triangles, 1,025 vertices)"
    assert luxel.load(out).triangle_count == 1920


def test_without_output_nothing_is_written(capsys, ring, tmp_path):
    before = ring.read_bytes()
    assert main(["optimize", str(ring), "--order", "tipsify"]) == 0
    assert "stays as it is; -o OUT" in capsys.readouterr().out
    assert os.listdir(tmp_path) == ["ring.ply"]
    assert ring.read_bytes() == before


def test_json_report_and_picture(capsys, ring, tmp_path):
    files = {name: tmp_path / name for name in ("out.glb", "r.json", "p.png")}
    words = ["-o", files["out.glb"], "--report", files["r.json"], "--picture", files["p.png"], "--json", "--profile", "amd", "--order", "tipsify"]
    assert main(["optimize", str(ring), *map(str, words)]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data == json.loads(files["r.json"].read_text())
    assert data["target"] == "amd"
    assert data["output"] == str(files["out.glb"])
    assert data["after"]["acmr"]["12"] < data["before"]["acmr"]["12"]
    picture = read_image(files["p.png"])
    assert picture.shape[:2] == (1020, 1280)
    top, bottom = picture[40:500, :640, :3].reshape(-1, 3), picture[560:, :640, :3].reshape(-1, 3)
    assert len(np.unique(top, axis=0)) > len(np.unique(bottom, axis=0)) > 100


def test_quietly(capsys, ring, tmp_path):
    assert main(["optimize", str(ring), "-o", str(tmp_path / "out.ply"), "-q", "--order", "tipsify"]) == 0
    assert capsys.readouterr() == ("", "")


def test_what_went_is_said(capsys, tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nv 7 7 7\nf 1 2 3\nf 4 2 3\nf 1 1 2\n")
    words = ["--weld", "--drop-degenerate", "--drop-duplicates", "--drop-unused", "--check", "-o", tmp_path / "b.obj"]
    assert main(["optimize", str(tmp_path / "a.obj"), *map(str, words)]) == 0
    assert "1 vertices welded, 1 degenerate triangles dropped, 1 duplicate triangles dropped" in capsys.readouterr().out
    assert (tmp_path / "b.obj").read_text().splitlines() == ["v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 3"]


def test_options_reach_the_layout(capsys, ring):
    def figures(*words):
        assert main(["optimize", str(ring), "--json", *words]) == 0
        return json.loads(capsys.readouterr().out)

    plain, sorted_ = figures("--order", "tipsify"), figures("--order", "tipsify", "--overdraw", "1.2")
    assert sorted_["after"]["overdraw"] < plain["after"]["overdraw"]
    assert figures("--order", "tipsify", "--cache", "24", "--policy", "lru")["target"] == "LRU 24"
    greedy = [figures("--order", "lin-yu", "--weights", weights)["after"]["acmr"]["12"] for weights in ("1,0.5,1.3", "0,0,5")]
    assert greedy[0] != greedy[1]
    wide = [figures("--order", "look-ahead", "--width", width)["after"]["acmr"]["12"] for width in ("1", "16")]
    assert wide[1] < wide[0]
    assert figures("--order", "random", "--threads", "1")["orders"] == ["random"]


def test_mistakes_are_named(capsys, ring, tmp_path):
    assert "did you mean tipsify" in error_of(capsys, ring, "--order", "tipsfy")
    assert "did you mean nvidia" in error_of(capsys, ring, "--profile", "nvida")
    assert "--policy" in error_of(capsys, ring, "--policy", "plru")
    assert "--cache" in error_of(capsys, ring, "--cache", "2")
    assert "--overdraw" in error_of(capsys, ring, "--overdraw", "0.5")
    assert "--weights" in error_of(capsys, ring, "--weights", "1,two,3")
    assert "--width" in error_of(capsys, ring, "--width", "0")
    assert "--seconds" in error_of(capsys, ring, "--seconds", "0")
    assert "--profile" in error_of(capsys, ring, "--profile", "amd", "--cache", "12")
    assert "--output" in error_of(capsys, ring, "-o", tmp_path / "a.png")
    assert "--report" in error_of(capsys, ring, "--report", tmp_path / "a.txt")
    assert "--picture" in error_of(capsys, ring, "--picture", tmp_path / "a.txt")
    assert "nowhere.ply" in error_of(capsys, "nowhere.ply")
    assert os.listdir(tmp_path) == ["ring.ply"]


def test_a_broken_file_leaves_the_other_alone(capsys, ring, tmp_path):
    broken, out = tmp_path / "broken.ply", tmp_path / "out.ply"
    broken.write_bytes(ring.read_bytes()[:9000])
    out.write_text("mine")
    assert "broken.ply" in error_of(capsys, broken, "-o", out)
    assert out.read_text() == "mine"
    assert sorted(os.listdir(tmp_path)) == ["broken.ply", "out.ply", "ring.ply"]


def test_help_names_every_order(capsys):
    from luxel.layout import ORDERS

    assert main(["optimize", "--help"]) == 0
    words = capsys.readouterr().out.replace(",", " ").replace(":", " ").split()
    assert set(ORDERS) <= set(words)


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_interrupt_leaves_files_whole(tmp_path):
    n = 700
    y, x = np.mgrid[0:n, 0:n].astype(np.float32)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n], 1), np.stack([a + 1, a + n + 1, a + n], 1)])
    luxel.save((np.stack([x, y, 0 * x], -1).reshape(-1, 3), np.random.default_rng(0).permutation(faces)), tmp_path / "grid.ply")
    before = (tmp_path / "grid.ply").stat()
    command = [sys.executable, "-m", "luxel", "optimize", "grid.ply", "-o", "grid.ply"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (130, ""), err
    assert err.endswith("luxel: interrupted\n")
    assert os.listdir(tmp_path) == ["grid.ply"]
    assert (tmp_path / "grid.ply").stat().st_mtime_ns == before.st_mtime_ns
