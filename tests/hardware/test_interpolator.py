"""The whole interpolator: every bit against exact arithmetic fragment by fragment, and its errors against bounds that are derived."""

import subprocess
import sys
from fractions import Fraction

import exact
import numpy as np
import pytest

from luxel.errors import InputError
from luxel.hardware import float24
from luxel.hardware.bounds import bounds
from luxel.hardware.float24 import FLOAT24
from luxel.hardware.formats import FLOAT32
from luxel.hardware.interpolator import LUXEL, PAPER, Precision, area_in_float32, barycentrics, draw, interpolate, inverse_area, shade
from luxel.hardware.reciprocal import MIDDLING, SMALL, table
from luxel.hardware.scan import edges, scan

PLACES = {"small": (0, 600), "middling": (-3000, 40000), "huge": (-(1 << 23), 1 << 24)}


def triangles_and_places(rng, count, size, concentration=1.0):
    """Triangles (m, 3, 2) with an area and a position (m, 2) in each, on its border at times."""
    low, high = PLACES.get(size, (0, 0))
    if size == "slivers":
        start, along = rng.integers(0, 200000, (count, 1, 2)), rng.integers(-100000, 100000, (count, 1, 2))
        t = np.stack([np.zeros(count), rng.random(count), np.ones(count)], 1)[..., None]
        corners = start + np.rint(along * t).astype(int) + rng.integers(-2, 3, (count, 3, 2))
    else:
        corners = rng.integers(low, high, (count, 3, 2))
    weights = rng.dirichlet([concentration] * 3, count)
    at = np.rint((corners * weights[..., None]).sum(1)).astype(int)
    setup = edges(corners)
    kept = (setup.area > 0) & (setup.at(at[:, 0], at[:, 1]) >= 0).all(1)
    return corners[kept], at[kept]


@pytest.mark.parametrize("precision", [LUXEL, PAPER, Precision(20, 20), Precision(17, 18, MIDDLING)])
@pytest.mark.parametrize("size", ["small", "middling", "huge", "slivers"])
def test_every_bit_is_that_of_exact_arithmetic(precision, size):
    rng = np.random.default_rng(1)
    corners, at = triangles_and_places(rng, 250, size)
    colors = float24.from_float(np.where(rng.random((len(corners), 3, 3)) < 0.2, 1.0, rng.random((len(corners), 3, 3))))
    assert len(corners) > 40
    shaded = shade(corners, colors, at[:, 0], at[:, 1], np.arange(len(corners)), precision)
    for k in range(len(corners)):
        weights = exact.rounded_weights(corners[k].tolist(), at[k].tolist(), precision, table(precision.table))
        for channel in range(3):
            expected = exact.color(weights, [FLOAT24.to_fraction(word) for word in colors[k, :, channel]])
            assert FLOAT24.to_fraction(shaded[k, channel]) == expected


@pytest.mark.parametrize("precision", [LUXEL, PAPER, Precision(16, 16, SMALL)])
def test_errors_stay_within_the_bounds(precision):
    limit = [float(b) for b in bounds(precision)]
    rng = np.random.default_rng(2)
    for size in ("small", "middling", "huge", "slivers"):
        corners, at = triangles_and_places(rng, 40000, size, 0.5)
        setup = edges(corners)
        e = setup.at(at[:, 0], at[:, 1])
        found = [float24.to_float(w) for w in barycentrics(inverse_area(setup.area, precision), e[:, 1], e[:, 2], precision)]
        true = e / setup.area[:, None]  # float64: 2^-53
        assert np.abs(found[0] - true[:, 0]).max() <= limit[2]
        for k in (1, 2):
            assert (np.abs(found[k] - true[:, k]) <= limit[1] * true[:, k] + 1e-15).all()
        ends = np.where(rng.random((len(corners), 3, 3)) < 0.5, rng.integers(0, 2, (len(corners), 3, 3)), rng.random((len(corners), 3, 3)))
        words = float24.from_float(ends)
        colors = float24.to_float(shade(corners, words, at[:, 0], at[:, 1], np.arange(len(corners)), precision))
        assert np.abs(colors - (true[..., None] * float24.to_float(words)).sum(1)).max() <= limit[3]


def test_the_bounds_are_those_of_the_papers_claim():
    claim = Fraction(1, 1 << 16)
    assert bounds(LUXEL).weight < claim < bounds(PAPER).weight
    assert bounds(LUXEL).alpha < claim * Fraction(115, 100)
    assert bounds(LUXEL).color < Fraction(1, 1 << 14)  # of full scale: a sixty-fourth of a step of 8 bits
    assert bounds(Precision(17, 17)).weight > claim  # no narrower factors would do
    assert bounds(Precision(16, 18)).weight > claim
    assert bounds(Precision(17, 18, MIDDLING)).weight < claim < bounds(Precision(17, 18, SMALL)).weight


def test_the_bounds_are_nearly_reached():
    """Edge functions and areas chosen so that all roundings go one way."""
    rng = np.random.default_rng(3)
    area = (1 << 41) - rng.integers(1, 1 << 34, 200000)  # so the reciprocal is just above a power of two, where a place weighs most
    inverse = inverse_area(area)
    off = LUXEL.reciprocal_format.to_float(inverse) * area - 1
    for chosen in (off.argsort()[:300], off.argsort()[-300:]):
        e = (1 << 36) + (2 * np.arange(600) + 1 << 18) + np.where(off[chosen[0]] > 0, 1, -1)  # half a place, and a little
        e, r = (part.ravel() for part in np.broadcast_arrays(e[:, None], inverse[chosen]))
        exact_weight = e / np.broadcast_to(area[chosen], (600, 300)).ravel()
        beta = float24.to_float(barycentrics(r, e, np.zeros_like(e))[1])
        assert np.abs(beta / exact_weight - 1).max() > 0.97 * float(bounds(LUXEL).weight)


def test_one_colour_stays_itself():
    """Weights that do not add up to 1 show here: within 2^-17, and the roundings of three products and two sums."""
    corners, at = triangles_and_places(np.random.default_rng(4), 20000, "middling", 0.5)
    words = np.broadcast_to(float24.from_float([1.0, 0.5, 0.0]), (len(corners), 3, 3))
    found = float24.to_float(shade(corners, words, at[:, 0], at[:, 1], np.arange(len(corners))))
    assert np.abs(found - [1, 0.5, 0]).max() <= 2.5 * 2.0**-16


def test_corners_have_their_own_colours_and_weights_are_exact_there():
    corners, _ = triangles_and_places(np.random.default_rng(5), 3000, "middling")
    words = float24.from_float(np.random.default_rng(6).random((len(corners), 3, 3)))
    numbers = np.arange(len(corners))
    for corner in range(3):
        found = shade(corners, words, corners[:, corner, 0], corners[:, corner, 1], numbers)
        assert np.abs(float24.to_float(found) - float24.to_float(words[:, corner])).max() <= float(bounds().color)
        assert np.array_equal(found[:], words[:, corner]) == (corner == 0)  # alpha is 1 - 0 - 0; beta and gamma are e / e, rounded


def test_a_turned_triangle_has_the_same_weights():
    corners, at = triangles_and_places(np.random.default_rng(7), 5000, "middling")
    setup, turned = edges(corners), edges(corners[:, [0, 2, 1]])
    assert np.array_equal(setup.area, turned.area)
    assert (setup.flipped != turned.flipped).all()
    e, f = setup.at(at[:, 0], at[:, 1]), turned.at(at[:, 0], at[:, 1])
    inverse = inverse_area(setup.area)
    assert np.array_equal(barycentrics(inverse, e[:, 1], e[:, 2])[1:], barycentrics(inverse, f[:, 2], f[:, 1])[1:])


def test_draw_is_scan_and_shade():
    corners, colors = np.array([[300, 400], [9000, 2500], [2000, 11000]]), float24.from_float(np.eye(3))
    found, fragments = draw(corners, colors, 30, 40), scan(corners, 30, 40)
    assert len(found.x) == len(fragments.x) > 300
    inverse = inverse_area(edges(corners).area)
    for k in range(0, len(found.x), 7):
        weights = barycentrics(inverse, fragments.edges[k, 1], fragments.edges[k, 2])
        assert np.array_equal(found.colors[k], interpolate(*weights, colors))
        assert np.allclose(float24.to_float(found.colors[k]), [float(w) for w in exact.weights(
            corners.tolist(), (int(found.x[k]) * 256 + 128, int(found.y[k]) * 256 + 128))], atol=3e-5)  # fmt: skip


def test_the_papers_area_is_that_of_float32():
    rng = np.random.default_rng(8)
    corners = rng.integers(-(1 << 20), 1 << 20, (20000, 3, 2))
    x, y = (corners[..., i].astype(np.float32) for i in (0, 1))
    expected = (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0]) - (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0])
    assert np.array_equal(area_in_float32(corners).view(np.float32), expected)


def test_the_papers_area_fails_for_slivers_where_ours_does_not():
    rng = np.random.default_rng(9)
    start, along = rng.integers(-(1 << 19), 1 << 19, (20000, 2)), rng.integers(-(1 << 18), 1 << 18, (20000, 2))
    corners = np.stack([start, start + along, start + 2 * along + rng.integers(-1, 2, (20000, 2))], 1)
    corners = corners[edges(corners).area > 0]
    setup = edges(corners)
    signed = np.where(setup.flipped, -1, 1) * setup.area
    theirs = FLOAT32.to_float(area_in_float32(corners))
    assert (np.sign(theirs) != np.sign(signed)).mean() > 0.002
    assert np.abs(theirs / signed - 1).max() > 1
    inverse = LUXEL.reciprocal_format.to_float(inverse_area(setup.area))
    assert np.abs(inverse * setup.area - 1).max() <= float(bounds().inverse)


def test_chunks_and_channels_make_no_difference():
    rng = np.random.default_rng(10)
    corners, at = triangles_and_places(rng, 40000, "middling")
    colors = float24.from_float(rng.random((len(corners), 3, 4)))
    numbers = np.arange(len(corners))
    whole = shade(corners, colors, at[:, 0], at[:, 1], numbers)
    some = numbers[5::3000]
    assert np.array_equal(whole[some], shade(corners, colors, at[some, 0], at[some, 1], some))
    assert np.array_equal(whole[some, :1], shade(corners, colors[..., :1], at[some, 0], at[some, 1], some))
    assert shade(corners, colors, at[:0, 0], at[:0, 1], numbers[:0]).shape == (0, 4)


def test_what_is_refused():
    flat, words = np.array([[[0, 0], [5, 5], [9, 9]]]), np.zeros((1, 3, 3), np.uint32)
    with pytest.raises(InputError, match="triangles with an area, got 0"):
        shade(flat, words, np.array([5]), np.array([5]), np.array([0]))
    with pytest.raises(InputError, match="colors: expected"):
        shade(flat, words[:, :2], np.array([5]), np.array([5]), np.array([0]))
    with pytest.raises(InputError, match="colors: expected"):
        draw(flat[0], words.astype(float)[0], 5, 5)
    with pytest.raises(InputError, match="exponent bits"):
        bounds(Precision(30, 16))


def test_the_model_stands_alone():
    """The rasteriser calls it; it needs nothing of the rasteriser, nor a compiler."""
    code = "import sys, luxel.hardware.bounds; print(*(m for m in sys.modules if m.startswith('luxel.') or m == 'numba'))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True).stdout.split()
    parts = {name.split(".")[1] if "." in name else name for name in found}
    assert parts == {"hardware", "arrays", "errors", "fixed"}
