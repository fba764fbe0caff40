"""Every operator of the circuit, bit for bit what the model computes: all pairs of corner words and thousands of random ones, for the paper's
modules tens of thousands, stopped at random."""

import numpy as np
import pytest

pytest.importorskip("amaranth", reason="the extra hdl is not installed")

import circuits

from luxel.hardware import interpolator, scan
from luxel.hardware.float24 import FLOAT24
from luxel.hardware.formats import FLOAT32, Format
from luxel.hardware.interpolator import LUXEL, PAPER
from luxel.hardware.reciprocal import SMALL, WIDE, table
from luxel.hardware.rtl.area import Area, AreaFloat
from luxel.hardware.rtl.barycentric import COLORS, Barycentrics, Channel, Color
from luxel.hardware.rtl.floats import Add, Convert, FromInteger, Multiply
from luxel.hardware.rtl.product import HardProduct, WideProduct, signed, unsigned
from luxel.hardware.rtl.reciprocal import Inverse, Reciprocal
from luxel.hardware.rtl.setup import SetUp, Sizes
from luxel.hardware.rtl.simulate import compute
from luxel.hardware.scan import CENTRE

EDGE, RECIPROCAL = LUXEL.edge_format, LUXEL.reciprocal_format
MANY = 20000


def at_random(seed=1, share=0.8):
    rng = np.random.default_rng(seed)
    return lambda clock: rng.random() < share


@pytest.mark.parametrize(("out", "a", "b"), [(FLOAT24, FLOAT24, FLOAT24), (FLOAT24, EDGE, RECIPROCAL), (FLOAT24, Format(7, 16), Format(7, 17))])
def test_multiply(out, a, b):
    x, y = circuits.pairs(np.random.default_rng(1), a, b, 4000)
    found = compute(Multiply(out, a, b), {"a": x, "b": y}, at_random())
    assert np.array_equal(found["p"], out.multiply(x, y, a, b))


@pytest.mark.parametrize(("f", "count"), [(FLOAT24, 8000), (Format(5, 10), 2000)])
def test_add(f, count):
    x, y = circuits.pairs(np.random.default_rng(2), f, f, count)
    found = compute(Add(f), {"a": x, "b": y}, at_random())
    assert np.array_equal(found["s"], f.add(x, y))


def test_sums_that_cancel():
    """Numbers of nearly the same magnitude and the other sign: every number of leading zeros."""
    rng = np.random.default_rng(3)
    x = circuits.random_words(rng, FLOAT24, 4000)
    y = np.clip((x ^ 1 << 23).astype(np.int64) + rng.integers(-3, 4, len(x)) * (1 << rng.integers(0, 18, len(x))), 0, (1 << 24) - 1).astype(np.uint32)
    found = compute(Add(FLOAT24), {"a": x, "b": y})
    assert np.array_equal(found["s"], FLOAT24.add(x, y))


@pytest.mark.parametrize(("width", "f"), [(42, EDGE), (42, FLOAT32), (52, EDGE), (20, FLOAT24)])
def test_from_integer(width, f):
    rng = np.random.default_rng(4)
    values = rng.integers(0, 1 << width, 3000) >> rng.integers(0, width + 1, 3000)
    ends = np.array([(1 << k) + d for k in range(2, width) for d in (-1, 0, 1)])
    halves = np.array([((2 << f.fraction) + 2 * odd + 1 << k) + d for k in range(width - f.fraction - 2) for odd in (0, 1) for d in (-1, 0, 1)])
    values = np.concatenate([values, ends, [0, 1], halves[halves >> width == 0]])
    found = compute(FromInteger(width, f), {"v": values}, at_random())
    assert np.array_equal(found["word"], f.from_integer(values))


@pytest.mark.parametrize("of", [RECIPROCAL, FLOAT24])
def test_convert(of):
    words = np.concatenate([circuits.corner_words(FLOAT32), circuits.random_words(np.random.default_rng(5), FLOAT32, 3000)])
    found = compute(Convert(of, FLOAT32), {"v": words})
    assert np.array_equal(found["word"], of.convert(words, FLOAT32))


@pytest.mark.parametrize(("f", "words"), [(FLOAT32, WIDE), (FLOAT24, SMALL)])
def test_reciprocal(f, words):
    """Every segment of the table at its ends, powers of two, zeros, and results that are too small."""
    rows, rng = table(words), np.random.default_rng(6)
    ends = (np.arange(1 << words.segments)[:, None] << words.low) + np.array([0, 1, (1 << words.low) - 1])
    inputs = np.concatenate([circuits.corner_words(f), (ends + (f.bias << f.fraction)).ravel(), circuits.random_words(rng, f, 4000)])
    found = compute(Reciprocal(f, rows), {"v": inputs}, at_random())
    assert np.array_equal(found["reciprocal"], rows.reciprocal(inputs, f))


@pytest.mark.parametrize(("precision", "count"), [(LUXEL, MANY), (PAPER, 1500)])
def test_inverse(precision, count):
    rng = np.random.default_rng(7)
    areas = np.concatenate([rng.integers(1, 1 << 42, count) >> rng.integers(0, 42, count), 1 << np.arange(42)]).clip(1)
    found = compute(Inverse(42, precision), {"area": areas}, at_random())
    assert np.array_equal(found["inverse"], interpolator.inverse_area(areas, precision))


@pytest.mark.parametrize(("a", "b"), [(unsigned(18), unsigned(18)), (signed(18), signed(18)), (unsigned(17), signed(5)), (signed(6), unsigned(13))])
def test_hard_product(a, b):
    rng = np.random.default_rng(8)
    x, y = (rng.integers(-(1 << s.width - 1) if s.signed else 0, 1 << s.width - s.signed, 2000) for s in (a, b))
    assert np.array_equal(compute(HardProduct(a, b), {"a": x, "b": y}, at_random())["p"], x * y)


def test_wide_product():
    ends = np.array([-(1 << 21), -(1 << 21) + 1, -(1 << 17), -1, 0, 1, (1 << 17) - 1, 1 << 17, (1 << 21) - 1])
    x, y = (part.ravel() for part in np.meshgrid(ends, ends))
    rng = np.random.default_rng(9)
    x, y = (np.concatenate([part, rng.integers(-(1 << 21), 1 << 21, 3000)]) for part in (x, y))
    assert np.array_equal(compute(WideProduct(22), {"a": x, "b": y}, at_random())["p"], x * y)


def corners_of(rng, count, bits):
    corners = rng.integers(-(1 << bits - 1), 1 << bits - 1, (count, 3, 2))
    corners[: count // 2] >>= rng.integers(0, bits - 1, (count // 2, 1, 1))
    corners[::50, 2] = corners[::50, 1]
    ends = np.array([-(1 << bits - 1), (1 << bits - 1) - 1])
    corners[1::50] = ends[rng.integers(0, 2, corners[1::50].shape)]
    return corners


@pytest.mark.parametrize(("bits", "count"), [(21, MANY), (16, 1000)])
def test_area(bits, count):
    corners = corners_of(np.random.default_rng(10), count, bits)
    edges = scan.edges(corners)
    some = slice(1000)
    found = compute(Area(bits), circuits.columns(corners[some]), at_random())
    assert np.array_equal(found["area"], edges.area[some])
    assert np.array_equal(found["flipped"], edges.flipped[some])
    word = compute(AreaFloat(bits), circuits.columns(corners), at_random())["float32"]
    assert np.array_equal(word, FLOAT32.from_integer(np.where(edges.flipped, -edges.area, edges.area)))


def test_set_up():
    rng = np.random.default_rng(11)
    corners = corners_of(rng, 2000, 21)
    size = rng.integers(1, 4097, (2, 2000)).T
    found = compute(SetUp(Sizes(21)), circuits.columns(corners) | {"right": size[:, 0] - 1, "bottom": size[:, 1] - 1}, at_random())
    edges = scan.edges(corners)
    first = np.maximum(corners.min(1) - CENTRE + 255 >> 8, 0)
    last = np.minimum(corners.max(1) - CENTRE >> 8, size - 1)
    empty = (last < first).any(1) | (edges.area == 0)
    assert 0.1 < empty.mean() < 0.9
    assert np.array_equal(found["empty"], empty)
    there = ~empty
    for k, axis in enumerate("xy"):
        assert np.array_equal(found[f"first_{axis}"][there], first[there, k])
        assert np.array_equal(found[f"last_{axis}"][there], last[there, k])
    start = first // 8 * 8 * 256 + CENTRE
    values = edges.at(start[:, 0], start[:, 1])
    biased = values + edges.bias >> 8
    for i in range(3):
        assert np.array_equal(found[f"e{i}"][there], biased[there, i])
        assert np.array_equal(found[f"a{i}"], edges.a[:, i])
        assert np.array_equal(found[f"b{i}"], edges.b[:, i])
        assert np.array_equal(found[f"high{i}"], 7 * (np.maximum(edges.a, 0) + np.maximum(edges.b, 0))[:, i])
        assert np.array_equal(found[f"low{i}"], 7 * (np.minimum(edges.a, 0) + np.minimum(edges.b, 0))[:, i])
    for i in (1, 2):
        assert np.array_equal((found[f"e{i}"] + found[f"under{i}"] << 8 | found[f"fraction{i}"])[there], values[there, i])


@pytest.mark.parametrize(("precision", "count"), [(LUXEL, MANY), (PAPER, 1500)])
def test_barycentrics(precision, count):
    rng = np.random.default_rng(12)
    area = rng.integers(1, 1 << 42, count) >> rng.integers(0, 42, count)
    area = area.clip(1)
    l_ca = (rng.random(count) * (area + 1)).astype(np.int64).clip(0, area)
    l_ab = (rng.random(count) * (area - l_ca + 1)).astype(np.int64).clip(0, area - l_ca)
    inverse = interpolator.inverse_area(area, precision)
    found = compute(Barycentrics(42, precision), {"l_ca": l_ca, "l_ab": l_ab, "inverse": inverse}, at_random())
    for name, words in zip(("alpha", "beta", "gamma"), interpolator.barycentrics(inverse, l_ca, l_ab, precision)):
        assert np.array_equal(found[name], words)


def test_channel():
    """Any words, those of corners among them, and weights with colours between 0 and 1."""
    rng = np.random.default_rng(16)
    words = [circuits.random_words(rng, FLOAT24, MANY) for _ in range(6)]
    for k in range(6):
        words[k][: MANY // 4] = rng.choice(circuits.corner_words(FLOAT24), MANY // 4)
        words[k][MANY // 2 :] = FLOAT24.from_float(rng.random(MANY // 2))
    found = compute(Channel(), dict(zip(("alpha", "beta", "gamma", "a", "b", "c"), words)), at_random())
    expected = interpolator.interpolate(*words[:3], np.stack(words[3:], 1)[..., None])
    assert np.array_equal(found["value"], expected[:, 0])


def test_color():
    """Three channels, each with colours of its own."""
    rng = np.random.default_rng(13)
    words = [circuits.random_words(rng, FLOAT24, 600) for _ in range(12)]
    words[0][:26] = words[5][:26] = words[11][:26] = circuits.corner_words(FLOAT24)
    found = compute(Color(), dict(zip(("alpha", "beta", "gamma", *COLORS), words)), at_random())
    expected = interpolator.interpolate(*words[:3], np.array(words[3:]).T.reshape(-1, 3, 3))
    assert np.array_equal(np.stack([found[channel] for channel in "rgb"], 1), expected)
