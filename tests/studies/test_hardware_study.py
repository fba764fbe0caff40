"""The study of the hardware interpolator: its data says what the model's tests say, and its report has every part."""

import json

import numpy as np
import pytest

from luxel.errors import ExtraMissingError
from luxel.hardware.interpolator import LUXEL, PAPER
from luxel.hardware.reciprocal import SMALL, WIDE
from luxel.hardware.synthesis import designs, tools
from luxel.studies import find
from luxel.studies.hardware import accuracy, circuit, pictures, tables
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder, patch, done = tmp_path_factory.mktemp("study"), pytest.MonkeyPatch(), []
    patch.setattr(accuracy, "_count", lambda context: 4000)
    patch.setattr(tables, "_QUICK", ((16, (4, 5)), (23, (6,))))
    study = find("hardware")
    report = Report(folder, study, quick=True)
    with np.errstate(all="raise", under="ignore"):
        study.run(Context(quick=True, progress=done.append), report)
    patch.undo()
    assert done[-1] == 1
    return folder, json.loads((folder / "results.json").read_text())["tables"]


def test_every_part_is_there(results):
    folder, data = results
    assert {"formats", "reciprocal", "table_bits", "widths", "errors", "area", "blocks", "pictures"} <= set(data)
    assert all(row["source"] == HERE for name in ("reciprocal", "widths", "errors") for row in data[name])
    for name in ("table_bits", "errors", "area", "triangle", "cube"):
        assert (folder / f"{name}.png").stat().st_size > 5000
        assert f"({name}.png)" in (folder / "README.md").read_text()


def test_the_smallest_tables(results):
    rows = {(row["fraction n"], row["segments m"]): row for row in results[1]["reciprocal"]}
    assert rows[16, 4]["C + B + A"] == rows[23, 6]["C + B + A"] == "none"
    assert rows[16, 4]["best"] == 1.5
    assert rows[16, 5]["table bits"] == SMALL.bits == 1088
    assert rows[23, 7]["table bits"] == WIDE.bits == 6400
    assert all(0.9 < rows[key]["largest error, ulp"] < 1 for key in ((16, 5), (23, 7)))
    fronts = [row for row in results[1]["table_bits"] if row["segments m"] == 5]
    bits, errors = ([row[name] for row in fronts] for name in ("table bits", "largest error, ulp"))
    assert len(bits) > 3
    assert (np.diff(bits) > 0).all()
    assert (np.diff(errors) < 0).all()


def test_nothing_found_is_beyond_its_bound(results):
    for row in results[1]["widths"]:
        for what in ("beta, gamma", "alpha", "colour"):
            assert 0.2 * row[f"{what}: bound"] < row[f"{what}: found"] <= row[f"{what}: bound"]
        assert row["weights within 2^-16"] == ("yes" if row["beta, gamma: bound"] < 1 else "no")
    sure = {(row["table"], row["edge"], row["1 / area"]): row["weights within 2^-16"] for row in results[1]["widths"]}
    assert sure[23, LUXEL.edge, LUXEL.reciprocal] == "yes"
    assert sure[23, PAPER.edge, PAPER.reciprocal] == "no"
    for row in results[1]["errors"]:
        assert row["median"] <= row["99 %"] <= row["99.99 %"] <= row["largest"] <= row["bound"]
    worst = next(row for row in results[1]["errors"] if row["triangles"] == "searched" and row["error of"] == "beta, gamma")
    assert worst["largest"] > 0.95 * worst["bound"]


def test_slivers_need_an_exact_area(results):
    thin, thick = results[1]["area"][0], results[1]["area"][-1]
    assert thin["float32: off by more than 2^-16, %"] > 50 > thick["float32: off by more than 2^-16, %"]
    assert all(row["exact sum: largest error of 1 / area"] < 2.0**-18 for row in results[1]["area"])


def test_pictures_are_within_a_byte_of_exact_ones(results):
    for row in results[1]["pictures"]:
        assert row["by at most"] <= 1
        assert 0 < row["RMS error, 2^-16"] < row["largest error, 2^-16"] < 4
    corners, colors = pictures.cube(64)
    assert len(corners) == len(colors) == 6  # three faces are seen
    ours, exact = pictures.drawn(corners, colors, 64), pictures.exactly(corners, colors, 64)
    assert np.abs(ours - exact).max() < 2.0**-14
    assert (exact != pictures._GREY).any(-1).mean() > 0.15


def test_blocks_add_up(results):
    for row in results[1]["blocks"]:
        assert row["rejected, %"] + row["accepted, %"] + row["kept in vain, %"] <= 100
        assert row["fragments a block tried"] <= row["fragments a kept block"] <= 64
    assert results[1]["blocks"][-1]["accepted, %"] > results[1]["blocks"][0]["accepted, %"] == 0


def test_a_fragment_leaves_on_every_clock_that_takes_one(results):
    """Of triangles of some pixels; small ones leave clocks unused, as one is set up every three."""
    pytest.importorskip("amaranth", reason="the extra hdl is not installed")
    rows = results[1]["throughput"]
    assert {row["receiver takes on"] for row in rows} == {"7 of 10, at random"}
    assert [row["with a fragment, %"] for row in rows if row["pixels each"] > 5] == [100, 100]
    assert 20 < rows[0]["with a fragment, %"] < 60
    assert rows[0]["pixels each"] < 1


def circuit_part(folder, quick):
    report = Report(folder, find("hardware"), quick=quick)
    circuit.modules(Context(quick=quick), report)
    return json.loads((folder / "results.json").read_text())["tables"], (folder / "README.md").read_text()


def test_a_quick_run_simulates_the_circuit_and_synthesises_nothing(tmp_path, monkeypatch):
    pytest.importorskip("amaranth", reason="the extra hdl is not installed")
    ran = []
    monkeypatch.setattr(tools, "available", lambda tool: True)
    monkeypatch.setattr(tools, "run", lambda tool, *rest: ran.append(tool))
    data, _ = circuit_part(tmp_path, quick=True)
    assert ran == []
    assert set(data) == {"circuit"}
    clocks = {row["module"]: row["latency, clocks"] for row in data["circuit"]}
    assert list(clocks) == ["area", "reciprocal", "scan", "barycentrics", "color", "whole"]
    chain = [clocks[name] for name in ("scan", "barycentrics", "color")]
    assert max(chain) < clocks["whole"] < sum(chain)  # the whole has one FIFO at the end, not three
    assert {row["module"] for row in data["circuit"] if row["takes one a clock"] == "triangle"} == {"area", "reciprocal"}


def test_what_is_recorded_says_so(tmp_path):
    """Figures of synthesis are shown as they were written down, and as nothing else."""
    report = Report(tmp_path, find("hardware"))
    circuit.recorded(Context(), report)
    data, text = json.loads((tmp_path / "results.json").read_text())["tables"], (tmp_path / "README.md").read_text()
    assert set(data) == {"recorded_ecp5", "recorded_cells"}
    assert text.count("**Recorded, not measured in this run**") == 2
    asked = {"recorded_ecp5": 200.0, "recorded_cells": 222.2}  # of all modules and the whole: on an ECP5-5G, and at the paper's own 0.13 um
    for name, rows in data.items():
        assert {row["source"] for row in rows} == {"recorded", "paper"}
        assert {"area", "reciprocal", "whole"} < {row["module"] for row in rows}
        assert rows[-1]["MHz"] == 222.2
        assert all(row["MHz"] > asked[name] for row in rows[:-1])
    for row in data["recorded_ecp5"][:-1]:
        assert row["MHz, least"] <= row["MHz"] <= row["MHz, most"]
        assert (row["MHz, least"] < row["MHz, most"]) == (row["seeds"] > 1)


def test_without_its_extra_the_circuit_is_left_out(tmp_path, monkeypatch):
    def missing(names=None):
        raise ExtraMissingError("amaranth", "hdl", "the circuit")

    monkeypatch.setattr(designs, "designs", missing)
    data, text = circuit_part(tmp_path, quick=False)
    assert data == {}
    assert "The circuit is left out: the circuit needs the package amaranth: pip install 'luxel[hdl]'." in text
