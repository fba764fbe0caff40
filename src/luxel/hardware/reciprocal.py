"""The reciprocal of a mantissa by piecewise quadratics (module 2 of the hardware paper), and the search for the smallest table.

The mantissa X = 1.F has n fraction bits. The top m of them choose one of 2^m segments, with a row C, B, A of the table; the other n - m,
read as an integer L, make t = L / 2^(n - m) in [0, 1). Then 2 / X, which lies in (1, 2], is

    C - B t + A t^2      cut to n fraction bits.

It is a sum of integers, with u fraction bits, that only its last step cuts:

    S = C * 2^(u - n - g)  -  B * L * 2^(u - n - b + 1)  +  A * ((L * L) >> (2 (n - m) - s)) * 2^(u - 2 m - a - s + 1)
    F' = (S mod 2^u) >> (u - n)

where C has n + g bits, B has b, A has a, and the square s. The result is 1.F' whatever the table, so the whole part of C is not kept, and sums
wrap. The half of a last bit that would round is in C.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.hardware.formats import Format

_I = np.int64
_NODES = tuple(Fraction(node, 1 << 20) for node in (70241, 1 << 19, 978335))
"""Where Chebyshev's polynomial of degree 3 on [0, 1] is zero: the quadratic through these points is all but the best."""
_MOST_GUARD = 6


@dataclass(frozen=True)
class Words:
    """The word lengths of a table.

    Attributes:
        fraction: n, fraction bits of the mantissa and of the result.
        segments: m, of the top bits that choose a segment.
        guard: g, bits of C beyond n.
        b, a: Bits of B and of A.
        square: s, bits that are kept of the square.
    """

    fraction: int
    segments: int
    guard: int
    b: int
    a: int
    square: int

    def __post_init__(self) -> None:
        low = self.fraction - self.segments
        if not (8 <= self.fraction <= 24 and 1 <= self.segments <= 10 and low >= 2):
            raise InputError(f"words: expected 8 to 24 fraction bits and 1 to 10 for segments; got {self.fraction} and {self.segments}")
        if not (0 <= self.guard <= 8 and 1 <= self.b <= 24 and 1 <= self.a <= 16 and 1 <= self.square <= 2 * low):
            raise InputError(f"words: expected guard 0 to 8, b 1 to 24, a 1 to 16 and square 1 to {2 * low} bits; got {self}")

    @property
    def low(self) -> int:
        """n - m, the bits of L."""
        return self.fraction - self.segments

    @property
    def c(self) -> int:
        """Bits of C."""
        return self.fraction + self.guard

    @property
    def unit(self) -> int:
        """u, fraction bits of the sum."""
        return max(self.c, self.fraction + self.b - 1, 2 * self.segments + self.a + self.square - 1)

    @property
    def bits(self) -> int:
        """Of the whole table."""
        return (self.c + self.b + self.a) << self.segments

    def varying(self, low: Array, b: Any, a: Any) -> Array:
        """S without C, for the low bits `low` of the mantissa."""
        square = low * low >> 2 * self.low - self.square
        linear = low * b << self.unit - self.fraction - self.b + 1
        return (square * a << self.unit - 2 * self.segments - self.a - self.square + 1) - linear


SMALL = Words(16, 5, 1, 12, 5, 11)
"""The smallest table for 16 fraction bits."""
MIDDLING = Words(20, 6, 2, 15, 7, 12)
"""The smallest table for 20 fraction bits, which would do for weights within 2^-16."""
WIDE = Words(23, 7, 2, 17, 8, 13)
"""The smallest table for the 23 fraction bits of float32."""


class Table(NamedTuple):
    """A table of coefficients: words, and int64 arrays (2^m,) of C, B and A."""

    words: Words
    c: Array
    b: Array
    a: Array

    def quotient(self, fraction: Array) -> Array:
        """F', the fraction of 2 / 1.F, for fractions F (int64) that are not 0."""
        w = self.words
        i = fraction >> w.low
        total = (self.c[i] << w.unit - w.c) + w.varying(fraction & (1 << w.low) - 1, self.b[i], self.a[i])
        return (total & (1 << w.unit) - 1) >> w.unit - w.fraction

    def errors(self) -> Array:
        """1.F' - 2 / X in units in the last place, for every fraction but 0, as exact as float64 is ((2^n - 1,) float64)."""
        n = self.words.fraction
        fraction = np.arange(1, 1 << n)
        mantissa = fraction + (1 << n)
        return ((self.quotient(fraction) + (1 << n)) * mantissa - (1 << 2 * n + 1)) / mantissa

    def reciprocal(self, words: Any, of: Format) -> Array:
        """1 / words, in the format `of`, whose fraction the table was made for; the sign is passed on.

        The exponent E becomes 2 bias - E where the fraction is 0 (exact), else 2 bias - 1 - E. 1 / 0 is the largest number.
        """
        n = self.words.fraction
        if of.fraction != n:
            raise InputError(f"table: expected one for {of.fraction} fraction bits, got {n}")
        sign, exponent, fraction = of.unpack(words)
        quotient = np.where(fraction == 0, 0, self.quotient(fraction)) + (1 << n)
        power = np.where(fraction == 0, of.bias - exponent, of.bias - 1 - exponent)
        found = of.rounded(sign, power - n, quotient)  # nothing is rounded here but to zero: it has n + 1 bits
        return np.where(exponent == 0, (sign << of.bits - 1 | of.largest).astype(np.uint32), found)


@cache
def table(words: Words) -> Table:
    """The table of these word lengths: in every segment, the coefficients that leave C the widest choice, and C from its middle.

    Raises:
        InputError: No such table is within one unit in the last place for all mantissas.
    """
    rows = [_best(words, segment) for segment in range(1 << words.segments)]
    found = [row for row in rows if row is not None]
    if len(found) < len(rows):
        raise InputError(f"words: no table of {words} is within one unit in the last place; {len(rows) - len(found)} segments have no row")
    c, b, a = np.array(found, _I).T
    return Table(words, c, b, a)


def _best(words: Words, segment: int) -> tuple[int, int, int] | None:
    """C, B, A of a segment, or None."""
    best: tuple[int, int, int, int] | None = None
    step = words.unit - words.c
    for b, a, low, high in _choices(words, segment):
        first, last = -(-low >> step), high >> step
        if first <= last and (best is None or high - low > best[0]):
            best = high - low, first + last >> 1, b, a
    return None if best is None else (best[1] & (1 << words.c) - 1, best[2], best[3])


def _choices(words: Words, segment: int) -> list[tuple[int, int, int, int]]:
    """B, A near the quadratic through `_NODES`, each with the lowest and highest C (in units 2^-u, with its whole part) that keep every
    result next to its quotient. There are none with low > high."""
    n, unit = words.fraction, words.unit
    low = np.arange(segment == 0, 1 << words.low, dtype=_I)  # X = 1 is exact without a table
    floor = (1 << 2 * n + 1) // (low + (segment << words.low) + (1 << n))
    least, most = floor << unit - n, floor + 2 << unit - n
    slope, curve = _quadratic(words, segment)
    found = []
    for a in _near(curve * (1 << 2 * words.segments + words.a - 1), words.a):
        changed = slope + Fraction(a, 1 << 2 * words.segments + words.a - 1) - curve
        for b in _near(changed * (1 << words.segments + words.b - 1), words.b):
            varying = words.varying(low, b, a)
            c_low, c_high = int((least - varying).max()), int((most - varying).min()) - 1
            if c_low <= c_high:
                found.append((b, a, c_low, c_high))
    return found


def _near(value: Fraction, bits: int) -> list[int]:
    """The two integers next to a value, as far as they fit."""
    below = value.numerator // value.denominator
    return [number for number in (below, below + 1) if 0 <= number < 1 << bits]


def _quadratic(words: Words, segment: int) -> tuple[Fraction, Fraction]:
    """B and A, exact, of C - B t + A t^2 through 2 / X at `_NODES`."""
    width = Fraction(1, 1 << words.segments)
    p, q, r = _NODES
    at = [2 / (1 + (segment + node) * width) for node in _NODES]
    first, second = (at[1] - at[0]) / (q - p), (at[2] - at[1]) / (r - q)
    curve = (second - first) / (r - p)
    return curve * (p + q) - first, curve


def smallest(fraction: int, segments: int) -> Words | None:
    """The word lengths of the smallest table that is within one unit in the last place for every mantissa, or None.

    Of equally small ones, that with the shorter B; then the shortest square that will do.
    """
    found: Words | None = None
    for a in range(2, 13):
        for b in range(max(2, fraction - segments - 2), fraction + 3 - segments + 1):
            words = Words(fraction, segments, _MOST_GUARD, b, a, 2 * (fraction - segments))
            room = 99 if found is None else found.c + found.b + found.a - fraction - a - b
            guard = _guard(words, min(_MOST_GUARD, room - 1))
            if guard is not None:
                found = replace(words, guard=guard)
    return None if found is None else _short_square(found)


def _guard(words: Words, most: int) -> int | None:
    """The fewest guard bits, up to `most`, with which every segment has a row."""
    needed = 0
    for segment in range(1 << words.segments):
        least = most + 1
        for _, _, low, high in _choices(words, segment):
            for guard in range(needed, least):
                step = words.unit - words.fraction - guard
                if -(-low >> step) <= high >> step:
                    least = guard
                    break
        needed = least
        if needed > most:
            return None
    return needed


def _short_square(words: Words) -> Words:
    while words.square > 1:
        shorter = replace(words, square=words.square - 1)
        if _guard(shorter, words.guard) is None:
            break
        words = shorter
    return words
