"""`luxel hardware verilog` and `synth`: what is written, and bad options refused before any work."""

import json
import re

import pytest

pytest.importorskip("amaranth", reason="the extra hdl is not installed")

from luxel.cli import main
from luxel.hardware.synthesis import tools

needs_yosys = pytest.mark.skipif(not tools.available("yosys"), reason="Yosys is not installed (the extra hdl)")

needs_nextpnr = pytest.mark.skipif(not tools.available("nextpnr-ecp5"), reason="nextpnr-ecp5 is not installed (the extra hdl)")


@pytest.fixture
def idle(monkeypatch):
    """No program may run: what is wrong is to be found before."""

    def run(tool, *rest):
        raise AssertionError(f"{tool} was run")

    monkeypatch.setattr(tools, "run", run)


def error_of(capsys, words):
    code = main(["hardware", *words.split()])
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    assert err.startswith("luxel: error: ")
    assert err.count("\n") == 1
    return err


@needs_yosys
def test_verilog_is_a_file_a_module_and_a_list(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["hardware", "verilog", "-o", "new/rtl", "--module", "reciprocal", "--json"]) == 0
    files = json.loads(capsys.readouterr().out)["files"]
    folder = tmp_path / "new" / "rtl"
    assert {tmp_path / name for name in files} == set(folder.iterdir())
    listed = (folder / "reciprocal.f").read_text().split()
    assert files == [f"new/rtl/{name}" for name in [*listed, "reciprocal.f"]]
    texts = {name: (folder / name).read_text() for name in listed}
    assert all(re.findall(r"^module (\w+)", text, re.M) == [name.removesuffix(".v")] for name, text in texts.items())
    top = texts["reciprocal.v"]
    assert all(re.search(rf"^\s*(in|out)put .*\b{port}\b", top, re.M) for port in ("clk", "rst", "i__valid", "i__ready", "o__valid", "o__ready"))
    if tools.available("iverilog"):
        tools.run("iverilog", ["-g2005", "-s", "reciprocal", "-o", "a.out", "-c", "reciprocal.f"], folder)


def test_verilog_refuses_what_is_no_folder(tmp_path, monkeypatch, capsys, idle):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("kept")
    assert "file: --output: expected a folder, found a file" in error_of(capsys, "verilog -o file --module reciprocal")
    assert "file/rtl: Not a directory" in error_of(capsys, "verilog -o file/rtl --module reciprocal")
    assert (tmp_path / "file").read_text() == "kept"
    assert "expected one of area, reciprocal" in error_of(capsys, "verilog -o new --module colour")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert "-o" in error_of(capsys, "verilog")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("-o out.xyz", "--output: expected a file name that ends in one of .png, .jpg, .jpeg, .exr, .npz, got 'out.xyz'"),
        ("-o none/out.png", "none/out.png: cannot write: there is no folder 'none'"),
        ("-o out.png --size 20x", "--size: expected WIDTHxHEIGHT in pixels, such as 1280x720, got '20x'"),
        ("-o out.png --size 5000x20", "size: expected at most 4096 pixels a side, got 5000 x 20"),
        ("-o out.png --simulator cx", "simulator: expected auto, cxx, amaranth; got cx"),
        ("-o out.png none.ply", "unexpected extra argument"),
    ],
)
def test_render_refuses(tmp_path, monkeypatch, capsys, idle, options, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert said in error_of(capsys, f"render one.obj {options}")
    assert [path.name for path in tmp_path.iterdir()] == ["one.obj"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--module colour", "module: expected one of area, reciprocal, scan, barycentrics, color, whole; got colour"),
        ("--seeds 0", "--seeds: expected a whole number of at least 1, got '0'"),
        ("--seeds many", "--seeds: expected a whole number of at least 1, got 'many'"),
        ("--jobs 0", "--jobs: expected a whole number of at least 1, got '0'"),
        ("--speed 9", "--speed: expected a whole number from 6 to 8, got '9'"),
        ("--speed 6", "--speed: expected 8, the only one of um5g-45k, got '6'"),
        ("--device um5g-46k", "--device: expected one of 12k, 25k, 45k, 85k"),
        ("--liberty none.lib", "none.lib: cannot be read: No such file or directory"),
        ("--liberty empty.lib", "empty.lib: expected a Liberty file of standard cells, found no buffer in it"),
        ("--keep empty.lib", "empty.lib: --keep: expected a folder, found a file"),
        ("--seed 3", "No such option --seed. Did you mean "),
    ],
)
def test_synth_refuses(tmp_path, monkeypatch, capsys, idle, options, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.lib").write_text("library (empty) {}\n")
    assert said in error_of(capsys, f"synth {'' if '--module' in options else '--module reciprocal '}{options}")
    assert [path.name for path in tmp_path.iterdir()] == ["empty.lib"]


@needs_yosys
@needs_nextpnr
def test_synth_places_and_routes(tmp_path, capsys):
    """The area module on an ECP5, whole: mapped, placed, routed, reported."""
    keep = tmp_path / "kept"
    assert main(["hardware", "synth", "--module", "area", "--seeds", "1", "--keep", str(keep), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["paper_MHz"] == 222.2
    (row,) = said["modules"]
    assert row["MHz, least"] == row["MHz"] == row["MHz, most"] == row["M a second"] > 150
    assert (row["seeds"], row["of"]) == (1, "triangles")
    assert row["multipliers"] == 6  # two products of 22 x 22 bits, of which 5 x 5 are logic
    assert 500 < row["LUTs"] < 2000 > row["registers"] > 500
    assert row["memory, bits"] == 64 * 8  # 32 bits a result, sixteen deep at most
    assert " to " in row["slowest path"]
    report = json.loads((keep / "area" / "report-um5g-45k-8-1.json").read_text())
    assert [clock["achieved"] for clock in report["fmax"].values()] == [row["MHz"]]
    netlist = json.loads((keep / "area" / "mapped.json").read_text())
    kinds = [cell["type"] for cell in netlist["modules"]["area"]["cells"].values()]
    assert kinds.count("MULT18X18D") == 6
