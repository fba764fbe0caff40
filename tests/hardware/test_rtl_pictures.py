"""Whole pictures through the circuit: the bytes of the model's."""

import json

import numpy as np
import pytest

pytest.importorskip("amaranth", reason="the extra hdl is not installed")

import circuits

import luxel
from luxel.cli import main
from luxel.errors import InputError
from luxel.hardware import float24, interpolator, scan
from luxel.hardware.rtl import cxx, draw
from luxel.scene.builtin import bumpy_sphere_scene
from luxel.studies.hardware import pictures

compiled = pytest.mark.skipif(draw.simulator() != "cxx", reason="no C++ compiler or no Yosys: CXXRTL cannot be compiled")
SIZES = {"cxx": 160, "amaranth": 24}


def through_circuit(corners, colors, size, using):
    picture = np.full((size, size, 3), pictures._GREY)
    found = draw.draw(corners, float24.from_float(colors), size, size, using)
    picture[found.y, found.x] = float24.to_float(found.colors)
    return picture, found


@pytest.mark.parametrize("using", [pytest.param("cxx", marks=compiled), "amaranth"])
@pytest.mark.parametrize("made", [pictures.triangle, pictures.cube])
def test_the_papers_pictures(made, using):
    size = SIZES[using]
    corners, colors = made(size)
    picture, found = through_circuit(corners, colors, size, using)
    assert np.array_equal(picture, pictures.drawn(corners, colors, size))
    assert len(np.unique(found.triangle)) == len(corners)


@compiled
def test_a_fragment_a_clock_in_a_picture():
    """But for the first block, at the triangle's tip: its eight rows take eight clocks, however few fragments they have, and nothing is ahead."""
    corners, colors = pictures.triangle(160)
    _, found = through_circuit(corners, colors, 160, "cxx")
    assert 0 <= found.clocks - found.first - len(found.x) <= 8


@compiled
@pytest.mark.parametrize(("offered", "taken"), [(1, 1), (0.6, 0.7)])
def test_thousands_of_random_triangles(offered, taken):
    """Every module at once, on tens of thousands of fragments, with stalls at both ends."""
    rng = np.random.default_rng(3)
    corners, colors = circuits.triangles(rng, 6000), circuits.colors(rng, 6000)
    found = cxx.Program().draw(corners, colors, 60, 45, offered, taken)
    parts = [scan.scan(each, 60, 45) for each in corners]
    there = [k for k, part in enumerate(parts) if len(part.x)]
    x, y = (np.concatenate([getattr(parts[k], name) for k in there]) for name in "xy")
    triangle = np.repeat(there, [len(parts[k].x) for k in there])
    assert len(x) > 40000
    assert np.array_equal(np.array(there)[found.triangle], triangle)
    assert np.array_equal(np.stack([found.x, found.y]), np.stack([x, y]))
    expected = interpolator.shade(corners, colors, x * 256 + scan.CENTRE, y * 256 + scan.CENTRE, triangle)
    assert np.array_equal(found.colors, expected)
    stalls = found.clocks - found.first
    assert stalls >= len(x) / taken * 0.98


@compiled
def test_the_program_is_kept(tmp_path, monkeypatch):
    """What the circuit is made from says which program it is; a new one says that it is compiled."""
    kept = cxx.Program().path
    assert kept.exists()
    assert cxx.Program().path == kept
    monkeypatch.setattr(cxx, "_digest", lambda: "another")
    made = []
    monkeypatch.setattr(cxx, "_compile", lambda units, driver, path: made.append((len(units), path.name)))
    cxx.Program(compiling=lambda: made.append("compiling"))
    assert made == ["compiling", (made[1][0], "interpolator-21-another")]
    assert made[1][0] > 20


@compiled
def test_simulators_agree():
    corners, colors = pictures.cube(20)
    one, two = (draw.draw(corners, float24.from_float(colors), 20, 20, using) for using in draw.SIMULATORS)
    for name in ("triangle", "x", "y", "colors"):
        assert np.array_equal(getattr(one, name), getattr(two, name))


@compiled
def test_scene_is_that_of_the_model():
    scene = bumpy_sphere_scene()
    picture, found = draw.render(scene, size=(64, 48), using="cxx")
    assert np.array_equal(picture.color, luxel.render(scene, size=(64, 48), shading="hardware").color)
    assert len(found.x) > 1000


@compiled
def test_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    luxel.save(bumpy_sphere_scene(), "ball.glb")
    assert main(["hardware", "render", "ball.glb", "-o", "circuit.png", "--size", "48x36", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["simulator"] == "cxx"
    assert said["clocks"] > said["fragments"] > 500
    assert main(["render", "ball.glb", "-o", "model.png", "--size", "48x36", "--shading", "hardware", "--aa", "none", "-q"]) == 0
    assert main(["diff", "circuit.png", "model.png", "-q"]) == 0


def test_unknown_simulator_and_large_picture():
    with pytest.raises(InputError, match="expected auto, cxx, amaranth; got verilator"):
        draw.simulator("verilator")
    with pytest.raises(InputError, match="at most 4096 pixels"):
        draw.draw(np.zeros((0, 3, 2), np.int64), np.zeros((0, 3, 3), np.uint32), 5000, 10)
