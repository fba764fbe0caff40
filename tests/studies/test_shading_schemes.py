"""Schemes of parallel shading: every one fills exactly the rasteriser's pixels, each once, with values within proven bounds of the exact ones."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.raster.reference import covers
from luxel.studies.shading.coverage import coverage, ids_of, spans_of
from luxel.studies.shading.fill import fill, inside_of, triangle
from luxel.studies.shading.fixed import VALUE_BITS, Format, errors, nearest, planes, wrap
from luxel.studies.shading.schemes import (
    CLASSICAL,
    CONTROL,
    COUNTERED,
    ENDS,
    INTERLEAVES,
    LITERAL,
    MIDLINES,
    PLANE,
    SCHEMES,
    TRUNCATED,
    VARIANTS,
    WAVE,
    Machine,
)

EXACT_SCHEMES = SCHEMES + VARIANTS
PIXEL = 256


@st.composite
def corners(draw, low=-3, high=24):
    """Any triangle, a sliver along a line, one at most a pixel wide or high, or one on whole pixels."""
    place = st.tuples(*2 * [st.integers(low * PIXEL, high * PIXEL)])
    near = st.integers(-3, 3)
    a, b, c = draw(place), draw(place), draw(place)
    kind = draw(st.sampled_from(["any", "sliver", "narrow", "low", "whole", "even"]))
    if kind == "sliver":
        part = draw(st.integers(0, 16))
        c = tuple(a[k] + (b[k] - a[k]) * part // 16 + draw(near) for k in range(2))
    elif kind in ("narrow", "low"):
        axis = int(kind == "low")
        moved = [[a[axis] + draw(st.integers(0, PIXEL)) if k == axis else p[k] for k in range(2)] for p in (b, c)]
        b, c = (tuple(p) for p in moved)
    elif kind in ("whole", "even"):
        unit = PIXEL * (1 + (kind == "even"))
        a, b, c = (tuple(v // unit * unit for v in p) for p in (a, b, c))
    assume((b[0] - a[0]) * (c[1] - a[1]) != (b[1] - a[1]) * (c[0] - a[0]))
    return np.array([a, b, c])


intensities = st.lists(st.integers(0, 255 << VALUE_BITS), min_size=3, max_size=3).map(lambda v: np.array(v)[:, None])
screens = st.sampled_from([None, (0, 0, 16, 16), (3, 5, 9, 30), (-2, 7, 24, 8)])


@settings(max_examples=300, deadline=None)
@given(corners(), screens)
def test_coverage_is_the_rasterisers(points, screen):
    """Against its slow oracle; and the row's runs are what `spans_of` says."""
    found = coverage(points, screen)
    x0, y0, x1, y1 = screen or (*(points.min(0) // PIXEL), *(points.max(0) // PIXEL + 1))
    expected = {(x, y) for y in range(y0, y1) for x in range(x0, x1) if covers(points.tolist(), (x * PIXEL + 128, y * PIXEL + 128))}
    ys, xs = np.nonzero(found.mask)
    assert {(int(x), int(y)) for x, y in zip(xs + found.x, ys + found.y, strict=True)} == expected
    spans = spans_of(found.mask)
    assert [(y, x) for y, left, right in spans.tolist() for x in range(left, right + 1)] == list(zip(ys.tolist(), xs.tolist(), strict=True))


@settings(max_examples=250, deadline=None)
@given(corners(), intensities, screens, st.sampled_from([ENDS, TRUNCATED, PLANE]), st.booleans())
def test_every_scheme_writes_every_pixel_once(points, values, screen, source, overlapped):
    what = triangle(points, values, screen)
    for scheme in EXACT_SCHEMES:
        filled = fill(what, scheme, machine=Machine(overlapped=overlapped), source=source)
        assert np.array_equal(filled.writes, what.covered.mask), scheme.name
        written = filled.writes > 0
        assert ((filled.step >= 0) == written).all()
        assert (filled.step < filled.steps).all()
        assert filled.idle == filled.units * filled.steps - what.covered.pixels >= 0
        pairs = np.stack([filled.step[written], filled.unit[written]])
        assert len(np.unique(pairs, axis=1).T) == written.sum(), f"{scheme.name}: an interpolator wrote two pixels in a step"
        assert (filled.unit[written] < filled.units).all(), scheme.name


@settings(max_examples=150, deadline=None)
@given(corners(), intensities, screens, st.sampled_from([Format(8, 8), Format(8, 12), Format(), Format(9, 20)]), st.sampled_from([ENDS, TRUNCATED]))
def test_errors_stay_within_their_bounds(points, values, screen, form, source):
    """With ends exact to half a unit, k additions of a slope rounded to half a unit make at most (1 + k) / 2 units, of one rounded down 1 / 2 + k;
    carried remainders, one."""
    what = triangle(points, values, screen)
    covered = what.covered
    spans = {y: (left, right) for y, left, right in spans_of(covered.mask).tolist()}
    for scheme in (CLASSICAL, COUNTERED, CONTROL, *INTERLEAVES, VARIANTS[-1]):
        filled = fill(what, scheme, form, source=source)
        for y, x in np.argwhere(covered.mask).tolist():
            left, right = spans[y]
            k = {"counter": min(x - left, right - x), "EC-DDA": 1}.get(scheme.name, x - left)
            if scheme.own_strides:
                k = (x - left) % scheme.lanes + (x - left) // scheme.lanes
            error = Fraction(int(filled.value[0, y, x]), 1 << form.fraction) - what.exact[0].at(covered.x + x, covered.y + y)
            most = k if source == TRUNCATED and scheme is not CONTROL else Fraction(k, 2)
            assert abs(error) * (1 << form.fraction) <= Fraction(1, 2) + most, scheme.name


@settings(max_examples=100, deadline=None)
@given(corners(), intensities, screens)
def test_the_planes_slopes_give_every_scheme_the_same_bits(points, values, screen):
    """Sums of whole numbers do not depend on the way: counter interpolation then halves nothing. Errors grow by half a unit a step."""
    what = triangle(points, values, screen)
    covered = what.covered
    first = fill(what, CLASSICAL, source=PLANE)
    for scheme in (COUNTERED, *INTERLEAVES, WAVE):
        assert np.array_equal(fill(what, scheme, source=PLANE).value, first.value), scheme.name
    ys, xs = np.nonzero(covered.mask)
    if len(xs):
        found = errors(what.exact, xs + covered.x, ys + covered.y, first.value[:, ys, xs], Format())
        assert (np.abs(found) <= (1 + abs(xs - xs[0]) + abs(ys - ys[0])) / 2 / 65536).all()


@settings(max_examples=60, deadline=None)
@given(corners(), st.lists(st.integers(-1 << VALUE_BITS, 1 << VALUE_BITS), min_size=9, max_size=9))
def test_measured_errors_are_exact(points, numbers):
    """`errors` against fractions, with channels of both signs."""
    what = triangle(points, np.array(numbers).reshape(3, 3))
    covered, form = what.covered, Format(2, 10)
    filled = fill(what, MIDLINES, form)
    ys, xs = np.nonzero(covered.mask)
    found = errors(what.exact, xs + covered.x, ys + covered.y, filled.value[:, ys, xs], form)
    for c in range(3):
        for i, (x, y) in enumerate(zip(xs.tolist(), ys.tolist(), strict=True)):
            exact = Fraction(int(filled.value[c, y, x]), 1024) - what.exact[c].at(x + covered.x, y + covered.y)
            assert found[c, i] == pytest.approx(float(exact), rel=1e-9, abs=1e-12)


def test_planes_go_through_their_corners():
    points = np.array([[128, 128], [128 + 7 * PIXEL, 128 + 2 * PIXEL], [128 + PIXEL, 128 + 5 * PIXEL]])  # centres of pixels
    for order in ([0, 1, 2], [2, 1, 0]):
        (plane,) = planes(points[order], np.array([[5 << 16], [70 << 16], [255 << 16]])[order])
        assert [plane.at(0, 0), plane.at(7, 2), plane.at(1, 5)] == [5, 70, 255]


@pytest.mark.parametrize("length", [1, 2, 3, 7, 8, 64, 65])
def test_steps_of_one_span(length):
    """A row of pixels: n steps, half of them, or one n-th after the start-up's additions; and set-up before."""
    what = triangle([[0, 0], [PIXEL * length, 128], [0, 255]], [[0], [65536], [0]])
    assert what.covered.mask.sum() == length == len(np.nonzero(what.covered.mask[0])[0])
    setup = 4
    assert fill(what, CLASSICAL).steps == setup + length
    assert fill(what, COUNTERED).steps == setup + (length + 1) // 2
    for scheme in INTERLEAVES:
        startup = (min(scheme.lanes, length) - 1).bit_length()
        assert fill(what, scheme).steps == setup + startup + -(-length // scheme.lanes)
    assert fill(what, CLASSICAL, source=PLANE).steps == 2 * 3 + 1 + length


def test_overlapped_rows_hide_their_setup():
    what = triangle([[0, 0], [100 * PIXEL, 0], [0, 10 * PIXEL]], [[0], [65536], [0]])
    rows = spans_of(what.covered.mask)
    lengths = (rows[:, 2] - rows[:, 1] + 1).tolist()
    assert fill(what, CLASSICAL).steps == sum(4 + n for n in lengths)
    assert fill(what, CLASSICAL, machine=Machine(overlapped=True)).steps == 4 + sum(lengths[:-1] if lengths[-1] > 4 else []) + lengths[-1]
    assert min(lengths) > 4


def test_the_waves_steps_are_distances():
    """Within the border, a pixel's step after the seed's is its 4-neighbour distance from it."""
    what = triangle([[0, 0], [60 * PIXEL, 9 * PIXEL], [22 * PIXEL, 47 * PIXEL]], [[0], [65536], [0]])
    filled = fill(what, WAVE)
    inner = inside_of(what.covered.mask)
    assert filled.seeds == 1
    seed = np.argwhere(inner & (filled.step == filled.step[inner].min()))
    assert len(seed) == 1
    y, x = np.nonzero(inner)
    assert np.array_equal(filled.step[y, x] - filled.step[inner].min(), abs(y - seed[0, 0]) + abs(x - seed[0, 1]))  # it is convex enough
    assert filled.step[what.covered.mask & ~inner].max() < filled.step[inner].min()


def test_the_literal_wave_misses_pixels_of_thin_triangles():
    what = triangle([[0, 0], [40 * PIXEL, 23 * PIXEL], [39 * PIXEL, 24 * PIXEL]], [[0], [65536], [0]])
    filled = fill(what, LITERAL[0])
    assert filled.seeds == 1
    assert filled.pixels < what.covered.pixels / 2
    filled = fill(what, VARIANTS[2])
    assert filled.seeds > 1
    assert np.array_equal(filled.writes, what.covered.mask)


def test_a_border_drawn_first_makes_one_seed_worse():
    """Of a thin triangle it leaves fewer pixels within, and those in pieces."""
    rng = np.random.default_rng(2)
    lost = np.zeros(2, int)
    for _ in range(40):
        end, across = rng.integers(20 * PIXEL, 60 * PIXEL, 2), rng.integers(2 * PIXEL, 4 * PIXEL, 2) * [1, -1]
        what = triangle([[0, 0], end, end + across], [[0], [65536], [0]])
        left = [what.covered.mask & (fill(what, scheme).writes == 0) for scheme in LITERAL]
        lost += [m.sum() for m in left]
        assert not (left[1] & ~inside_of(what.covered.mask)).any()
    assert lost[1] > lost[0] > 0


@pytest.mark.parametrize(("unit", "place", "exact"), [(2 * PIXEL, 0, True), (2 * PIXEL, 77, False), (PIXEL, 0, False), (97, 0, False)])
def test_midlines_are_congruent_where_corners_are_an_even_number_of_pixels_apart(unit, place, exact):
    """And the middle one, which is turned, where they also lie on whole pixels. The edges' slopes are such that no pixel's centre is on one."""
    repaired = 0
    for i in range(1, 8):
        points = np.array([[0, 0], [(2 * i + 17) * unit, 4 * unit], [4 * unit, (4 * i + 10) * unit]]) + place
        filled = fill(triangle(points, [[0], [99 << 16], [7 << 16]]), MIDLINES)
        repaired += filled.repaired
        if exact:
            assert filled.refused == filled.repaired == 0
            assert len({int((filled.unit == k).sum()) for k in range(4)}) == 1
    assert (repaired == 0) == exact


def test_the_registers_wrap_and_hold_a_little_less_than_nothing():
    assert wrap(255, 9) == 255
    assert wrap(256, 9) == -256
    assert nearest(-1, 2) == 0
    assert nearest(-3, 2) == -1
    points = [[0, 0], [300 * PIXEL, 0], [0, 300 * PIXEL]]
    filled = fill(triangle(points, [[0], [0], [3]]), CLASSICAL, Format(8, 16), source=PLANE)
    assert -300 < filled.value.min() <= filled.value.max() < 300


def test_what_cannot_be_filled_is_named():
    what = triangle([[0, 0], [900, 0], [0, 900]], [[300 << 16], [0], [0]])
    with pytest.raises(InputError, match=r"at most 2\^8 in size for registers of 8\.16, got 300"):
        fill(what)
    fill(what, form=Format(9, 4))
    with pytest.raises(InputError, match="format: expected"):
        fill(what, form=Format(0, 4))
    with pytest.raises(InputError, match="fill: expected"):
        fill(what, source="corner")
    with pytest.raises(InputError, match="do not lie on a line"):
        triangle([[0, 0], [1, 1], [2, 2]], [[0], [0], [0]])
    with pytest.raises(InputError, match="at most 4096 pixels a side"):
        triangle([[0, 0], [1 << 21, 0], [0, 900]], [[0], [0], [0]])
    with pytest.raises(InputError, match=r"corners: expected \(3, 2\)"):
        triangle([[0, 0], [1, 1]], [[0], [0], [0]])
    nothing = triangle([[0, 0], [50, 0], [0, 50]], [[0], [0], [0]])
    assert all(fill(nothing, scheme).steps == 0 for scheme in EXACT_SCHEMES)


def test_many_at_once_are_as_one_by_one():
    rng = np.random.default_rng(4)
    points = rng.integers(0, 60 * PIXEL, (12, 3, 2))
    ids = ids_of(points, 60, 60)
    alone = np.full((60, 60), -1)
    for i in range(11, -1, -1):
        found = coverage(points[i], (0, 0, 60, 60))
        h, w = found.mask.shape
        alone[found.y : found.y + h, found.x : found.x + w][found.mask] = i
    assert np.array_equal(ids, alone)
