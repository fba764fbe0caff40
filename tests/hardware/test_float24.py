"""The floats of the circuit against exact fractions (every corner pattern), float64 and IEEE float32 (millions of random words)."""

import itertools
from fractions import Fraction

import numpy as np
import pytest
from exact import nearest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.hardware import float24
from luxel.hardware.float24 import FLOAT24
from luxel.hardware.formats import FLOAT32, Format, bit_length

EDGE, RECIPROCAL = Format(7, 17), Format(7, 18)
WORDS = st.integers(0, 0xFFFFFF)
MILLIONS = 1_000_000


def corner_words():
    exponents = (0, 1, 2, 46, 62, 63, 64, 80, 126, 127)
    fractions = (0, 1, 2, 0x5555, 0x7FFF, 0x8000, 0x8001, 0xFFFE, 0xFFFF)
    return np.array([s << 23 | e << 16 | f for s, e, f in itertools.product((0, 1), exponents, fractions)], np.uint32)


def random_words(rng, count, first=0, last=127):
    return FLOAT24.pack(rng.integers(0, 2, count), rng.integers(first, last + 1, count), rng.integers(0, 1 << 16, count))


def rounded(values):
    """float24 values nearest to float64 values, by NumPy's own rounding to even."""
    mantissa, power = np.frexp(values)
    found = np.ldexp(np.rint(np.ldexp(mantissa, 17)), power - 17)
    found = np.where(np.abs(found) < 2.0**-62, 0.0, found)
    largest = 2.0**64 * (2 - 2.0**-16)
    return np.clip(found, -largest, largest)


def same(words, values):
    """The values, and of zeros the one canonical word."""
    assert np.array_equal(float24.to_float(words), values)
    assert (words[values == 0] == 0).all()


@pytest.mark.parametrize("operation", ["add", "multiply"])
def test_every_pair_of_corner_patterns(operation):
    words = corner_words()
    exact = [FLOAT24.to_fraction(word) for word in words]
    a, b = (part.ravel() for part in np.meshgrid(words, words, indexing="ij"))
    found = getattr(float24, operation)(a, b)
    combine = {"add": Fraction.__add__, "multiply": Fraction.__mul__}[operation]
    expected = [nearest(combine(x, y)) for x in exact for y in exact]
    wrong = [i for i, value in enumerate(expected) if FLOAT24.to_fraction(found[i]) != value or (value == 0 and found[i] != 0)]
    assert wrong == []
    assert np.array_equal(float24.subtract(a, b), float24.add(a, b ^ 0x800000))


@pytest.mark.parametrize("near", [127, 20, 2, 0])
def test_millions_of_random_sums_and_products(near):
    """`near`: how far apart exponents are; cancellation is where they are close."""
    rng = np.random.default_rng(near)
    a = random_words(rng, MILLIONS)
    exponents = np.clip((a >> 16 & 127).astype(int) + rng.integers(-near, near + 1, MILLIONS), 0, 127)
    b = FLOAT24.pack(rng.integers(0, 2, MILLIONS), exponents, rng.integers(0, 1 << 16, MILLIONS))
    x, y = float24.to_float(a), float24.to_float(b)
    same(float24.add(a, b), rounded(x + y))  # float64 is exact, or its error far from where a float24 is undecided
    same(float24.subtract(a, b), rounded(x - y))
    same(float24.multiply(a, b), rounded(x * y))


def test_ties_go_to_even():
    one, half_place = float24.from_float(1.0), float24.from_float(2.0**-17)
    assert float24.add(one, half_place) == one
    assert float24.add(one + 1, half_place) == one + 2
    assert float24.subtract(one + 1, half_place) == one
    assert float24.multiply(0x3F0001, 0x3F8000) == 0x3F8002  # 1.5 (1 + 2^-16): between ...8001 and ...8002
    assert float24.multiply(0x3F0003, 0x3F8000) == 0x3F8004


def test_a_bit_far_below_decides_a_tie():
    one, tiny = float24.from_float(1.0), float24.from_float(2.0**-50)
    tie = float24.from_float(2.0**-17)
    assert float24.add(one, float24.add(tie, tiny)) == one  # the tie's own sum has lost the bit
    assert float24.add(one, tie + 1) == one + 1
    assert float24.subtract(one, tiny) == one
    assert float24.subtract(one, float24.from_float(2.0**-18) + 1) == one - 1


def test_zero_and_the_largest():
    assert float24.multiply(0x800000, 0x3F0000) == 0  # -0 is zero, and zeros come out as no bits
    assert float24.multiply(0x00FFFF, 0x7F0000) == 0  # with exponent 0, the fraction does not count
    assert float24.add(0x800001, 0x80FFFF) == 0
    assert float24.add(0xBF0000, 0x3F0000) == 0
    assert float24.multiply(0x010001, 0x3EFFFE) == 0x010000  # 2^-62 - 2^-93 rounds up to the smallest
    assert float24.multiply(0x010000, 0x3EFFFF) == 0  # 2^-62 - 2^-79 does not, and below there is nothing
    assert float24.add(float24.LARGEST, float24.LARGEST) == float24.LARGEST
    assert float24.add(float24.LARGEST, 0x6F0000) == float24.LARGEST
    assert float24.multiply(0xFF0000, 0x7F0000) == 0xFFFFFF


@given(WORDS, WORDS)
@settings(deadline=None)
def test_laws(a, b):
    assert float24.add(a, b) == float24.add(b, a)
    assert float24.multiply(a, b) == float24.multiply(b, a)
    assert float24.to_float(float24.add(float24.negate(a), float24.negate(b))) == -float24.to_float(float24.add(a, b))
    assert FLOAT24.to_fraction(int(float24.multiply(a, float24.ONE))) == FLOAT24.to_fraction(a)


@pytest.mark.parametrize("form", [FLOAT24, EDGE, RECIPROCAL, FLOAT32])
def test_every_fraction_comes_back(form):
    fractions = np.arange(0, 1 << form.fraction, 1 if form.fraction < 20 else 61)
    for sign, exponent in itertools.product((0, 1), (1, form.bias - 1, form.bias, form.highest)):
        words = form.pack(sign, exponent, fractions)
        for part, expected in zip(form.unpack(words), (sign, exponent, fractions), strict=True):
            assert (part == expected).all()
        assert np.array_equal(form.from_float(form.to_float(words)), words)
        assert form.from_fraction(form.to_fraction(int(words[-1]))) == words[-1]


@pytest.mark.parametrize("form", [FLOAT24, EDGE, RECIPROCAL])
@given(value=st.one_of(st.integers(-(1 << 62), 1 << 62), st.floats(-1e25, 1e25)))
@settings(deadline=None)
def test_numbers_are_rounded_to_nearest(form, value):
    expected = nearest(Fraction(value), 7, form.fraction)
    assert form.to_fraction(int(form.from_float(float(value)))) == nearest(Fraction(float(value)), 7, form.fraction)
    assert form.to_fraction(form.from_fraction(Fraction(value))) == expected
    if isinstance(value, int):
        assert form.to_fraction(int(form.from_integer(value))) == expected


@given(st.fractions(min_value=-10, max_value=10))
@settings(deadline=None)
def test_fractions_are_rounded_to_nearest(value):
    assert FLOAT24.to_fraction(FLOAT24.from_fraction(value)) == nearest(value)


def test_float32_is_that_of_the_processor():
    rng = np.random.default_rng(5)
    for near in (100, 3):
        exponents = rng.integers(100, 151, MILLIONS)
        fractions = rng.integers(0, 1 << 23, (2, MILLIONS))
        a = FLOAT32.pack(rng.integers(0, 2, MILLIONS), exponents, fractions[0])
        b = FLOAT32.pack(rng.integers(0, 2, MILLIONS), np.clip(exponents + rng.integers(-near, near + 1, MILLIONS), 60, 180), fractions[1])
        x, y = a.view(np.float32), b.view(np.float32)
        assert np.array_equal(FLOAT32.add(a, b).view(np.float32), x + y)
        assert np.array_equal(FLOAT32.multiply(a, b).view(np.float32), x * y)
    values = rng.integers(-(1 << 60), 1 << 60, MILLIONS)
    assert np.array_equal(FLOAT32.from_integer(values).view(np.float32), values.astype(np.float32))


@pytest.mark.parametrize("of", [FLOAT24, FLOAT32])
def test_factors_of_other_formats(of):
    """The product of an edge function and a reciprocal is rounded once."""
    rng = np.random.default_rng(6)
    for _ in range(2000):
        a = int(EDGE.pack(rng.integers(0, 2), rng.integers(40, 100), rng.integers(0, 1 << 17)))
        b = int(RECIPROCAL.pack(rng.integers(0, 2), rng.integers(20, 63), rng.integers(0, 1 << 18)))
        exact = EDGE.to_fraction(a) * RECIPROCAL.to_fraction(b)
        assert of.to_fraction(int(of.multiply(a, b, EDGE, RECIPROCAL))) == nearest(exact, of.exponent, of.fraction)


def test_conversion():
    rng = np.random.default_rng(7)
    words = FLOAT32.pack(rng.integers(0, 2, 4000), rng.integers(50, 210, 4000), rng.integers(0, 1 << 23, 4000))
    for form in (FLOAT24, EDGE, RECIPROCAL):
        found = form.convert(words, FLOAT32)
        assert all(form.to_fraction(int(w)) == nearest(FLOAT32.to_fraction(int(v)), 7, form.fraction) for v, w in zip(words, found, strict=True))


def test_bit_length():
    values = np.array([0, 1, 2, 3, 4, 255, 256, (1 << 62) - 1, 1 << 62])
    assert bit_length(values).tolist() == [int(value).bit_length() for value in values]


def test_shapes_are_broadcast():
    a, b = random_words(np.random.default_rng(8), 12).reshape(3, 4), random_words(np.random.default_rng(9), 4)
    for operation in (float24.add, float24.subtract, float24.multiply):
        assert operation(a, b).shape == (3, 4)
        assert operation(a, b).dtype == np.uint32
        assert operation(int(a[0, 0]), int(b[0])) == operation(a, b)[0, 0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: float24.add(np.array([1.5]), 0), "expected integers of 24 bits, got float64"),
        (lambda: float24.multiply(1 << 24, 0), "expected 24 bits, got 0x1000000"),
        (lambda: float24.add(-1, 0), "expected 24 bits"),
        (lambda: float24.pack(0, 128, 0), "exponent: expected 7 bits, 0 to 127; got 128"),
        (lambda: float24.from_float([1.0, np.nan]), "1 that are NaN"),
        (lambda: float24.from_integer([0, -(1 << 63)]), "expected -2.62 .. 2.62, got -9223372036854775808 .. 0"),
        (lambda: Format(9, 10), "expected 2 to 8 exponent bits"),
        (lambda: Format(8, 24), "32 in all"),
    ],
)
def test_what_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
