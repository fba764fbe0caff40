"""Tables of reciprocals: every mantissa, the search for the smallest table, and whole words against exact fractions."""

from dataclasses import replace
from fractions import Fraction

import exact
import numpy as np
import pytest

from luxel.errors import InputError
from luxel.hardware.bounds import table_error
from luxel.hardware.formats import FLOAT32, Format
from luxel.hardware.reciprocal import MIDDLING, SMALL, WIDE, Words, smallest, table


@pytest.mark.parametrize(("words", "bits"), [(SMALL, 1088), (MIDDLING, 2816), (WIDE, 6400)])
def test_every_mantissa_is_within_one_unit_in_the_last_place(words, bits):
    n = words.fraction
    found = table(words)
    assert words.bits == bits == sum(len(part) for part in found[1:]) // 3 * (words.c + words.b + words.a)
    assert all(((part >= 0) & (part < 1 << width)).all() for part, width in zip(found[1:], (words.c, words.b, words.a), strict=True))
    fraction = np.arange(1, 1 << n)
    quotient = found.quotient(fraction) + (1 << n)
    assert quotient.min() >= 1 << n
    assert quotient.max() < 2 << n
    mantissa = fraction + (1 << n)
    assert (np.abs(quotient * mantissa - (1 << 2 * n + 1)) < mantissa).all()  # less than one unit: the quotient is next to 2 / X
    assert (np.diff(quotient) <= 0).all()
    assert np.abs(found.errors()).max() < 1
    assert 0 < table_error(words) < Fraction(1, 1 << n)


def test_the_sum_is_what_the_text_says():
    rng = np.random.default_rng(1)
    for words in (SMALL, WIDE):
        n, found = words.fraction, table(words)
        for fraction in [1, 2, (1 << n) - 1, *rng.integers(1, 1 << n, 500).tolist()]:
            expected = exact.reciprocal(1 + Fraction(fraction, 1 << n), found) * 2 - 1
            assert Fraction(int(found.quotient(np.array(fraction))), 1 << n) == expected


def test_the_search_finds_the_smallest_table():
    assert smallest(16, 4) is None  # an eighth as many segments would have to be eight times as good
    assert smallest(16, 5) == SMALL
    assert smallest(16, 6).bits > SMALL.bits


def fits(words, segment):
    """Whether any A and any B within a fifth of the slope leave a C in the segment: nothing is assumed of where good ones lie."""
    n, low = words.fraction, np.arange(segment == 0, 1 << words.low)
    floor = (1 << 2 * n + 1) // (low + (segment << words.low) + (1 << n))
    slope = 2 ** (words.b + words.segments) * 2 / (2**words.segments + segment) ** 2 * 2**words.segments / 2
    b = np.arange(int(slope * 0.8) - 2, min(1 << words.b, int(slope * 1.2) + 3))[:, None]
    step, half = words.unit - words.c, np.arange(0, len(b), 256)
    for a in range(1 << words.a):
        for part in (b[i : i + 256] for i in half):
            varying = words.varying(low, part, a)
            first = ((floor << words.unit - n) - varying).max(1)
            last = ((floor + 2 << words.unit - n) - varying).min(1) - 1
            if (-(-first >> step) <= last >> step).any():
                return True
    return False


# Segments that have no row, for each way to share 33 bits among A, B and C; with fewer than 4 or more than 7 bits, A fails in the first already.
WITNESSES = {(3, 14): 0, (3, 13): 0, (3, 12): 0, (4, 13): 2, (4, 12): 2, (4, 11): 3, (5, 12): 18, (5, 11): 0, (5, 10): 1,
             (6, 11): 0, (6, 10): 0, (6, 9): 0, (7, 10): 1, (7, 9): 0, (7, 8): 0}  # fmt: skip


@pytest.mark.parametrize("shared", WITNESSES)
def test_no_table_of_32_segments_has_shorter_rows(shared):
    a, b = shared
    assert SMALL.a + SMALL.b + SMALL.c == 34
    assert not fits(Words(16, 5, 17 - a - b, b, a, 22), WITNESSES[shared])


def test_the_proof_can_fail():
    assert all(fits(replace(SMALL, square=22), segment) for segment in (0, 1, 2, 3, 18, 31))


@pytest.mark.parametrize("words", [SMALL, MIDDLING, WIDE])
@pytest.mark.parametrize("part", ["guard", "b", "a", "square"])
def test_no_word_can_be_a_bit_shorter(words, part):
    with pytest.raises(InputError, match="no table of"):
        table(replace(words, **{part: getattr(words, part) - 1}))


def test_more_bits_do_no_harm():
    longer = table(replace(SMALL, guard=4, b=14, a=7, square=22))
    assert np.abs(longer.errors()).max() < np.abs(table(SMALL).errors()).max()


@pytest.mark.parametrize(("words", "form"), [(SMALL, Format(7, 16)), (WIDE, FLOAT32)])
def test_words(words, form):
    rng = np.random.default_rng(2)
    sign, exponent = rng.integers(0, 2, 3000), rng.integers(2, 2 * form.bias - 1, 3000)
    fraction = np.where(rng.random(3000) < 0.1, 0, rng.integers(0, 1 << words.fraction, 3000))
    given = form.pack(sign, exponent, fraction)
    found = table(words).reciprocal(given, form)
    for word, result in zip(given.tolist(), found.tolist(), strict=True):
        value, inverse = form.to_fraction(word), form.to_fraction(result)
        assert abs(inverse * value - 1) <= table_error(words)
        assert inverse == exact.reciprocal(value, table(words))


def test_powers_of_two_are_exact_and_extremes_stay_in_range():
    found = table(SMALL)
    form = Format(7, 16)
    for exponent in range(1, 126):
        assert found.reciprocal(form.pack(0, exponent, 0), form) == form.pack(0, 126 - exponent, 0)
    assert found.reciprocal(form.pack(0, 126, 0), form) == 0  # 2^-63
    assert found.reciprocal(form.pack(1, 125, 5), form) == 0
    assert found.reciprocal(form.pack(1, 124, 5), form) >> 16 == 0x81
    assert found.reciprocal(0x0000FF, form) == form.largest  # zero
    assert found.reciprocal(0x800000, form) == 1 << 23 | form.largest


def test_what_is_refused():
    with pytest.raises(InputError, match="expected one for 23 fraction bits, got 16"):
        table(SMALL).reciprocal(0, FLOAT32)
    with pytest.raises(InputError, match="8 to 24 fraction bits"):
        Words(30, 5, 1, 12, 5, 11)
    with pytest.raises(InputError, match="square 1 to 22"):
        replace(SMALL, square=23)
