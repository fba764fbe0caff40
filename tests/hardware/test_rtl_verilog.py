"""The Verilog that is written, in Icarus and Verilator, with random stalls: the model's bits for every module and the whole."""

import numpy as np
import pytest

pytest.importorskip("amaranth", reason="the extra hdl is not installed")

import circuits

from luxel.errors import InputError
from luxel.hardware import interpolator, scan
from luxel.hardware.float24 import FLOAT24
from luxel.hardware.formats import FLOAT32
from luxel.hardware.rtl.barycentric import COLORS
from luxel.hardware.synthesis import tools
from luxel.hardware.synthesis.designs import designs

pytestmark = [
    pytest.mark.skipif(not tools.available("iverilog"), reason="Icarus Verilog is not installed (apt install iverilog)"),
    pytest.mark.skipif(not tools.available("yosys"), reason="Yosys is not installed (the extra hdl)"),
]


def design(name):
    return designs([name])[0]


WAYS = {"as written": circuits.as_written, "with hard multipliers": circuits.with_hard_multipliers, "mapped to an ECP5": circuits.mapped}


@pytest.mark.parametrize("way", WAYS)
def test_area(tmp_path, way):
    """Signed products of four parts; with all bits of coordinates in use."""
    corners = circuits.triangles(np.random.default_rng(1), 400)
    corners[::3] = np.random.default_rng(7).integers(-(1 << 20), 1 << 20, corners[::3].shape)
    found = circuits.in_verilog(design("area"), circuits.columns(corners), 400, tmp_path, files=WAYS[way])
    edges = scan.edges(corners)
    assert np.array_equal(found["float32"], FLOAT32.from_integer(np.where(edges.flipped, -edges.area, edges.area)))


@pytest.mark.parametrize("way", list(WAYS)[:2])
def test_reciprocal(tmp_path, way):
    """Unsigned products of up to 17 bits."""
    areas = np.random.default_rng(2).integers(1, 1 << 42, 600) >> np.arange(600) % 42
    areas = areas.clip(1)
    found = circuits.in_verilog(design("reciprocal"), {"area": areas}, 600, tmp_path, files=WAYS[way])
    assert np.array_equal(found["inverse"], interpolator.inverse_area(areas))


@pytest.mark.parametrize("way", list(WAYS)[:2])
def test_barycentrics(tmp_path, way):
    """Unsigned products of 18 bits."""
    rng = np.random.default_rng(3)
    area = rng.integers(1 << 20, 1 << 42, 400)
    l_ca, l_ab = (rng.random(400) * area / 2).astype(np.int64), (rng.random(400) * area / 2).astype(np.int64)
    inverse = interpolator.inverse_area(area)
    found = circuits.in_verilog(design("barycentrics"), {"l_ca": l_ca, "l_ab": l_ab, "inverse": inverse}, 400, tmp_path, files=WAYS[way])
    for name, words in zip(("alpha", "beta", "gamma"), interpolator.barycentrics(inverse, l_ca, l_ab)):
        assert np.array_equal(found[name], words)


def test_color(tmp_path):
    rng = np.random.default_rng(4)
    words = [circuits.random_words(rng, FLOAT24, 300) for _ in range(12)]
    found = circuits.in_verilog(design("color"), dict(zip(("alpha", "beta", "gamma", *COLORS), words)), 300, tmp_path)
    expected = interpolator.interpolate(*words[:3], np.array(words[3:]).T.reshape(-1, 3, 3))
    assert np.array_equal(np.stack([found[channel] for channel in "rgb"], 1), expected)


@pytest.mark.skipif(not tools.available("verilator"), reason="Verilator is not installed (apt install verilator)")
def test_barycentrics_in_verilator(tmp_path):
    """Another reading of the same Verilog, and one that is fast."""
    rng = np.random.default_rng(8)
    area = rng.integers(1, 1 << 42, 20000) >> rng.integers(0, 42, 20000)
    area = area.clip(2)
    l_ca, l_ab = (rng.random(20000) * area / 2).astype(np.int64), (rng.random(20000) * area / 2).astype(np.int64)
    inverse = interpolator.inverse_area(area)
    fields = {"l_ca": l_ca, "l_ab": l_ab, "inverse": inverse}
    found = circuits.in_verilog(design("barycentrics"), fields, 20000, tmp_path, simulator="verilator")
    for name, words in zip(("alpha", "beta", "gamma"), interpolator.barycentrics(inverse, l_ca, l_ab)):
        assert np.array_equal(found[name], words)


def test_scan_conversion(tmp_path):
    corners = circuits.triangles(np.random.default_rng(5), 30)
    found = [scan.scan(each, 60, 45) for each in corners]
    count = sum(max(1, len(each.x)) for each in found)  # one without fragments says so
    left = circuits.in_verilog(design("scan"), circuits.columns(corners), count, tmp_path, right=59, bottom=44)
    drawn = left["drawn"] == 1
    assert np.array_equal(left["x"][drawn], np.concatenate([each.x for each in found]))
    assert np.array_equal(left["y"][drawn], np.concatenate([each.y for each in found]))
    for name, k in (("l_ca", 1), ("l_ab", 2)):
        assert np.array_equal(left[name][drawn], np.concatenate([each.edges[:, k] for each in found]))


def test_whole(tmp_path):
    rng = np.random.default_rng(6)
    corners, words = circuits.triangles(rng, 40), circuits.colors(rng, 40)
    shaded = [interpolator.draw(*each, 60, 45) for each in zip(corners, words)]
    count = sum(len(each.x) for each in shaded)
    assert count > 300
    found = circuits.in_verilog(design("whole"), circuits.columns(corners, words), count, tmp_path, right=59, bottom=44)
    assert np.array_equal(found["x"], np.concatenate([each.x for each in shaded]))
    assert np.array_equal(found["y"], np.concatenate([each.y for each in shaded]))
    assert np.array_equal(np.stack([found[channel] for channel in "rgb"], 1), np.concatenate([each.colors for each in shaded]))


def test_unknown_module():
    with pytest.raises(InputError, match="expected one of area, reciprocal, scan, barycentrics, color, whole; got colour"):
        designs(["colour"])
