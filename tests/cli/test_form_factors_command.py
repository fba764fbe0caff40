"""luxel form-factors: files to a matrix."""

import json

import numpy as np
import pytest
from scipy import sparse

from luxel.cli import main

ROOM = """\
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1
"""


@pytest.fixture
def room(tmp_path):
    """A unit cube, its front inside."""
    path = tmp_path / "room.obj"
    path.write_text(ROOM)
    return path


def test_a_matrix_for_scipy(room, tmp_path, capsys):
    out = tmp_path / "factors.npz"
    assert main(["form-factors", str(room), "--triangles", "--one-sided", "-o", str(out)]) == 0
    assert "12 surfaces" in capsys.readouterr().out
    factors = sparse.load_npz(out)
    assert factors.shape == (12, 12)
    assert factors.sum(axis=1) == pytest.approx(np.ones(12), rel=2e-3)
    assert np.load(out)["areas"] == pytest.approx(np.full(12, 0.5))


def test_json(room, capsys):
    assert main(["form-factors", str(room), "--json", "--one-sided", "--threads", "1"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["surfaces"] == 1
    assert data["areas"] == [pytest.approx(6)]
    assert data["factors"] == [[0, 0, pytest.approx(1, rel=2e-3)]]


def test_wrong_words(room, tmp_path, capsys):
    assert main(["form-factors", str(room), "-o", str(tmp_path / "factors.txt")]) == 2
    assert ".npz" in capsys.readouterr().err
    assert main(["form-factors", str(room), "--threads", "0"]) == 2
    assert "--threads" in capsys.readouterr().err
