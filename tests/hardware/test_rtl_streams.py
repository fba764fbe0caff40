"""Streams: everything arrives, in order, whatever stalls; and a fragment on every clock."""

import numpy as np
import pytest

pytest.importorskip("amaranth", reason="the extra hdl is not installed")

import circuits

from luxel.hardware import interpolator, scan
from luxel.hardware.float24 import FLOAT24
from luxel.hardware.rtl.floats import Add
from luxel.hardware.rtl.simulate import run
from luxel.hardware.rtl.streams import Streamed
from luxel.hardware.rtl.whole import Interpolator, ScanConversion

WIDTH, HEIGHT = 60, 45
WINDOW = {"right": WIDTH - 1, "bottom": HEIGHT - 1}


def chance(seed, share):
    rng = np.random.default_rng(seed)
    return lambda clock: rng.random() < share


def bursts(seed):
    """Long stops and long runs."""
    rng = np.random.default_rng(seed)
    states = np.repeat(rng.integers(0, 2, 100000), rng.integers(1, 40, 100000))
    return lambda clock: bool(states[clock])


STALLS = {
    "none": (None, None), "slow sender": (chance(1, 0.3), None), "slow receiver": (None, chance(2, 0.4)), "both": (chance(3, 0.6), chance(4, 0.6)),
    "bursts": (bursts(5), bursts(6)),
}  # fmt: skip


@pytest.mark.parametrize("stalls", STALLS)
def test_streamed_operator(stalls):
    a, b = circuits.pairs(np.random.default_rng(7), FLOAT24, FLOAT24, 800)
    found = run(Streamed(Add(FLOAT24)), {"a": a, "b": b}, len(a), *STALLS[stalls])
    assert np.array_equal(found.fields["s"], FLOAT24.add(a, b))


def test_an_operator_takes_and_gives_one_a_clock():
    a, b = circuits.pairs(np.random.default_rng(8), FLOAT24, FLOAT24, 100)
    found = run(Streamed(Add(FLOAT24)), {"a": a, "b": b}, len(a))
    assert (np.diff(found.clocks) == 1).all()
    assert (np.diff(found.sent) == 1).all()
    assert found.clocks[0] - found.sent[0] == Add(FLOAT24).latency + 3


def test_a_receiver_that_stalls_never_waits():
    """Once the first is there, one is there on every clock on which the receiver takes one: stalls cost nothing beyond themselves."""
    a, b = circuits.pairs(np.random.default_rng(9), FLOAT24, FLOAT24, 1500)
    taken = []
    rng = np.random.default_rng(10)

    def takes(clock):
        taken.append(bool(rng.random() < 0.6))
        return taken[-1]

    found = run(Streamed(Add(FLOAT24)), {"a": a, "b": b}, len(a), taken=takes)
    ready = np.flatnonzero(taken)
    assert np.array_equal(ready[ready >= found.clocks[0]], found.clocks)


def expected_fragments(corners):
    """x, y, l_ca, l_ab, drawn, last of every element; None for what does not matter."""
    rows = []
    for triangle in corners:
        found = scan.scan(triangle, WIDTH, HEIGHT)
        n = len(found.x)
        rows += [(found.x[k], found.y[k], found.edges[k, 1], found.edges[k, 2], 1, k == n - 1) for k in range(n)] or [(None, None, None, None, 0, 1)]
    return rows


@pytest.mark.parametrize("stalls", ["none", "both", "bursts"])
def test_scan_conversion(stalls):
    corners = circuits.triangles(np.random.default_rng(11), 90)
    rows = expected_fragments(corners)
    found = run(ScanConversion(), circuits.columns(corners), len(rows), *STALLS[stalls], **WINDOW)
    for k, row in enumerate(rows):
        for name, value in zip(("x", "y", "l_ca", "l_ab", "drawn", "last"), row):
            assert value is None or found.fields[name][k] == value, (k, name)


def test_triangles_that_share_edges_share_no_pixel():
    """A fan around a pixel's centre covers every pixel once, through the circuit."""
    rng = np.random.default_rng(12)
    rim = np.stack([20 + 19 * np.cos(np.arange(11) * 0.5712), 20 + 19 * np.sin(np.arange(11) * 0.5712)], 1) * 256
    rim = np.rint(rim).astype(int) // 128 * 128
    corners = np.array([[[20 * 256 + 128, 20 * 256 + 128], rim[k], rim[(k + 1) % 11]] for k in range(11)])
    corners = corners[rng.permutation(11)]
    rows = expected_fragments(corners)
    found = run(ScanConversion(), circuits.columns(corners), len(rows), **WINDOW)
    drawn = found.fields["drawn"] == 1
    places = found.fields["y"][drawn] * WIDTH + found.fields["x"][drawn]
    assert len(np.unique(places)) == len(places) > 1000


@pytest.mark.parametrize("stalls", ["none", "both"])
def test_whole(stalls):
    rng = np.random.default_rng(13)
    corners, words = circuits.triangles(rng, 30), circuits.colors(rng, 30)
    shaded = [interpolator.draw(*each, WIDTH, HEIGHT) for each in zip(corners, words)]
    count = sum(len(each.x) for each in shaded)
    found = run(Interpolator(), circuits.columns(corners, words), count, *STALLS[stalls], **WINDOW)
    assert np.array_equal(found.fields["x"], np.concatenate([each.x for each in shaded]))
    assert np.array_equal(found.fields["y"], np.concatenate([each.y for each in shaded]))
    colors = np.stack([found.fields[channel] for channel in "rgb"], 1)
    assert np.array_equal(colors, np.concatenate([each.colors for each in shaded]))
    ends = np.cumsum([len(each.x) for each in shaded if len(each.x)]) - 1
    assert np.array_equal(np.flatnonzero(found.fields["last"]), ends)


def test_a_fragment_on_every_clock():
    """From the first to the last, over triangles of various shapes one after the other, and with stalls on every clock on which one is taken."""
    large = [[[100, 200], [5600, 900], [2000, 4900]], [[5600, 900], [2000, 4900], [6300, 5200]]]
    corners = np.array([*large, [[1000, 1000], [5000, 3000], [3000, 4000]]])
    words = circuits.colors(np.random.default_rng(14), 3)
    count = sum(len(interpolator.draw(*each, WIDTH, HEIGHT).x) for each in zip(corners, words))
    found = run(Interpolator(), circuits.columns(corners, words), count, **WINDOW)
    assert count > 300
    assert (np.diff(found.clocks) == 1).all()
    taken = []
    rng = np.random.default_rng(15)

    def takes(clock):
        taken.append(bool(rng.random() < 0.7))
        return taken[-1]

    stalled = run(Interpolator(), circuits.columns(corners, words), count, taken=takes, **WINDOW)
    ready = np.flatnonzero(taken)
    assert np.array_equal(ready[ready >= stalled.clocks[0]], stalled.clocks)


@pytest.mark.parametrize(("pixels", "clocks"), [(1, 3.3), (3, 3.8), (6, 0)])
def test_small_triangles(pixels, clocks):
    """From 5 pixels on they leave no clock unused; smaller ones come every three clocks or so."""
    rng = np.random.default_rng(17)
    angles = rng.random((60, 1)) * 6.283 + np.arange(3) * 2.094 + rng.normal(0, 0.2, (60, 3))
    radius = np.sqrt(pixels * 4 / 27**0.5)
    corners = np.rint(256 * (rng.random((60, 1, 2)) * 36 + 4 + radius * np.stack([np.cos(angles), np.sin(angles)], -1))).astype(int)
    words = circuits.colors(rng, 60)
    shaded = [interpolator.draw(*each, WIDTH, HEIGHT) for each in zip(corners, words)]
    count = sum(len(each.x) for each in shaded)
    assert 0.8 * 60 * pixels < count < 1.2 * 60 * pixels
    found = run(Interpolator(), circuits.columns(corners, words), count, **WINDOW)
    assert np.array_equal(found.fields["x"], np.concatenate([each.x for each in shaded]))
    assert np.array_equal(found.fields["r"], np.concatenate([each.colors[:, 0] for each in shaded]))
    span = found.clocks[-1] - found.clocks[0] + 1
    assert count <= span <= max(60 * clocks, 1.02 * count)


def test_wider_coordinates():
    """As far as the rasteriser's guard band reaches."""
    corners = np.array([[[-(1 << 23), -300], [1 << 24, 5000], [4000, 1 << 24]], [[100, 100], [1 << 24, 7000], [9000, -(1 << 23)]]])
    words = circuits.colors(np.random.default_rng(16), 2)
    shaded = [interpolator.draw(*each, 16, 12) for each in zip(corners, words)]
    found = run(Interpolator(26), circuits.columns(corners, words), sum(len(each.x) for each in shaded), right=15, bottom=11)
    colors = np.stack([found.fields[channel] for channel in "rgb"], 1)
    assert np.array_equal(colors, np.concatenate([each.colors for each in shaded]))
    assert len(colors) > 50
