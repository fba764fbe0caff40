"""Floating-point formats as a small circuit computes them: words of bits in, words of bits out, integer arithmetic only, vectorised.

A word is a sign bit, a biased exponent E and a fraction F; its value is (-1)^S * 2^(E - bias) * 1.F. What the paper leaves open is decided in
docs/decisions/0012-hardware-numbers.md:

- Every operation rounds once, to nearest, ties to even.
- E = 0 is zero, whatever the other bits; zeros that are made have all bits zero. There are no subnormals: what rounds (with no bound to the
  exponent) to less than the smallest number becomes zero.
- There are no infinities and no NaN: what is too large becomes the largest number, with its sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError

_I = np.int64


def bit_length(magnitude: Array) -> Array:
    """Bits that each of the int64 numbers (at least 0) has: 0 for 0, 1 for 1, 2 for 2 and 3 ..."""
    filled = magnitude | magnitude >> 1
    for step in (2, 4, 8, 16, 32):
        filled |= filled >> step
    return np.bitwise_count(filled).astype(_I)


@dataclass(frozen=True)
class Format:
    """A floating-point format of up to 32 bits. Words are uint32 arrays of any shape, and are broadcast.

    Attributes:
        exponent: Its bits; the bias is half of its range, 2^(exponent - 1) - 1.
        fraction: Its bits, at most 24.
        reserved: How many of the greatest exponents no number has (IEEE 754 keeps one for infinities and NaN).
    """

    exponent: int
    fraction: int
    reserved: int = 0

    def __post_init__(self) -> None:
        if not (2 <= self.exponent <= 8 and 1 <= self.fraction <= 24 and self.bits <= 32):
            raise InputError(f"format: expected 2 to 8 exponent bits and 1 to 24 fraction bits, 32 in all; got 1-{self.exponent}-{self.fraction}")

    @property
    def bits(self) -> int:
        """Of a word."""
        return 1 + self.exponent + self.fraction

    @property
    def bias(self) -> int:
        """What is added to the exponent of a value to store it."""
        return (1 << self.exponent - 1) - 1

    @property
    def highest(self) -> int:
        """The greatest stored exponent."""
        return (1 << self.exponent) - 1 - self.reserved

    @property
    def largest(self) -> int:
        """The word of the largest number."""
        return (self.highest + 1 << self.fraction) - 1

    def pack(self, sign: Any, exponent: Any, fraction: Any) -> Array:
        """Words of a sign (0 or 1), a stored exponent and a fraction; as they are, not made canonical.

        Raises:
            InputError: One of them does not fit its bits.
        """
        sign, exponent, fraction = (np.asarray(part, _I) for part in (sign, exponent, fraction))
        for name, part, bits in (("sign", sign, 1), ("exponent", exponent, self.exponent), ("fraction", fraction, self.fraction)):
            if ((part < 0) | (part >> bits != 0)).any():
                raise InputError(f"{name}: expected {bits} bits, 0 to {(1 << bits) - 1}; got {int(part.min())} .. {int(part.max())}")
        return self._join(sign, exponent, fraction)

    def unpack(self, words: Any) -> tuple[Array, Array, Array]:
        """Sign, stored exponent and fraction of words, int64."""
        w = self._checked(words)
        return w >> self.bits - 1, w >> self.fraction & (1 << self.exponent) - 1, w & (1 << self.fraction) - 1

    def scaled(self, words: Any) -> tuple[Array, Array, Array]:
        """Sign, power and integer magnitude of words, int64: the value is (-1)^sign * magnitude * 2^power. Zero has magnitude 0."""
        sign, exponent, fraction = self.unpack(words)
        magnitude = np.where(exponent == 0, 0, fraction | 1 << self.fraction)
        return sign, exponent - (self.bias + self.fraction), magnitude

    def rounded(self, sign: Any, power: Any, magnitude: Any) -> Array:
        """The words nearest to (-1)^sign * magnitude * 2^power, ties to even: the one place where anything is rounded.

        Args:
            sign: 0 or 1.
            power: int64.
            magnitude: int64, 0 to 2^62.
        """
        sign, power, magnitude = (np.asarray(part, _I) for part in (sign, power, magnitude))
        length = bit_length(magnitude)
        drop = np.maximum(length - (self.fraction + 1), 0)
        half = (_I(1) << drop) >> 1
        odd = magnitude >> drop & 1
        # Adding half - 1, and one more where what is kept is odd, carries just where the rest is above half, or half beside an odd number.
        kept = magnitude + np.where(drop > 0, half - 1 + odd, 0) >> drop
        kept <<= np.maximum(self.fraction + 1 - length, 0)
        # The leading 1 of `kept` is not stored but taken off; where rounding has made it a 2, the exponent is one more, and the fraction 0.
        words = (power + length + (self.bias - 2) << self.fraction) + kept
        nothing = (words < 1 << self.fraction) | (magnitude == 0)
        return np.where(nothing, 0, np.minimum(words, self.largest) | sign << self.bits - 1).astype(np.uint32)

    def convert(self, words: Any, source: Format) -> Array:
        """Words of another format in this one."""
        return self.rounded(*source.scaled(words))

    def negate(self, words: Any) -> Array:
        """The words with their sign turned (that of zero too)."""
        return np.asarray(words, np.uint32) ^ np.uint32(1 << self.bits - 1)

    def multiply(self, a: Any, b: Any, a_format: Format | None = None, b_format: Format | None = None) -> Array:
        """a * b, rounded once; the factors may have formats of their own."""
        a_sign, a_power, a_magnitude = (a_format or self).scaled(a)
        b_sign, b_power, b_magnitude = (b_format or self).scaled(b)
        return self.rounded(a_sign ^ b_sign, a_power + b_power, a_magnitude * b_magnitude)

    def add(self, a: Any, b: Any) -> Array:
        """a + b, rounded once."""
        a, b = np.broadcast_arrays(self._checked(a), self._checked(b))
        below = (1 << self.bits - 1) - 1
        swap = a & below < b & below  # the larger exponent first
        first, second = np.where(swap, b, a), np.where(swap, a, b)
        sign, power, large = self.scaled(first.astype(np.uint32))
        other, other_power, small = self.scaled(second.astype(np.uint32))
        spare = self.fraction + 3  # beyond so many places, what is left is below half of the last bit of any result
        distance = np.minimum(power - other_power, spare + self.fraction + 1)
        small <<= spare
        moved = small >> distance
        sticky = moved << distance != small
        total = (large << spare) + np.where(sign == other, moved | sticky, -(moved | sticky))
        return self.rounded(sign, power - spare, total)

    def subtract(self, a: Any, b: Any) -> Array:
        """a - b, rounded once."""
        return self.add(a, self.negate(b))

    def from_integer(self, values: Any) -> Array:
        """Integers of magnitudes up to 2^62, rounded.

        Raises:
            InputError: One is larger.
        """
        values = np.asarray(values, _I)
        if values.size and max(-int(values.min()), int(values.max())) > 1 << 62:
            raise InputError(f"values: expected -2^62 .. 2^62, got {values.min()} .. {values.max()}")
        return self.rounded(values < 0, 0, np.abs(values))

    def from_float(self, values: Any) -> Array:
        """float64 values, rounded (through their bits). Not a number is refused; infinity is too large like others.

        Raises:
            InputError: A value is not a number.
        """
        values = np.asarray(values, np.float64)
        if np.isnan(values).any():
            raise InputError(f"values: expected numbers, got {int(np.isnan(values).sum())} that are NaN")
        bits = values.view(_I)
        exponent, fraction = bits >> 52 & 2047, bits & (1 << 52) - 1
        return self.rounded(bits < 0, np.maximum(exponent, 1) - 1075, np.where(exponent > 0, fraction | 1 << 52, fraction))

    def to_float(self, words: Any) -> Array:
        """The values of words, float64, exact."""
        sign, power, magnitude = self.scaled(words)
        return np.ldexp(np.where(sign > 0, -magnitude, magnitude).astype(np.float64), power.astype(np.int32))

    def from_fraction(self, value: Fraction | int) -> int:
        """The word nearest to an exact fraction, by long division."""
        value = Fraction(value)
        power = value.numerator.bit_length() - value.denominator.bit_length() - self.fraction - 3
        scaled = abs(value) / Fraction(2) ** power
        magnitude = scaled.numerator // scaled.denominator
        return int(self.rounded(int(value < 0), power - 1, magnitude << 1 | (magnitude != scaled)))

    def to_fraction(self, word: int) -> Fraction:
        """The exact value of one word."""
        sign, power, magnitude = (int(part) for part in self.scaled(word))
        return (-1) ** sign * magnitude * Fraction(2) ** power

    def _join(self, sign: Array, exponent: Array, fraction: Array) -> Array:
        return np.asarray(sign << self.bits - 1 | exponent << self.fraction | fraction).astype(np.uint32)

    def _checked(self, words: Any) -> Array:
        array = np.asarray(words)
        if array.dtype.kind not in "iu":
            raise InputError(f"words: expected integers of {self.bits} bits, got {array.dtype}")
        wide = array.astype(_I)
        if (wide >> self.bits).any():
            raise InputError(f"words: expected {self.bits} bits, got {int(wide.min()):#x} .. {int(wide.max()):#x}")
        return wide


FLOAT32 = Format(8, 23, reserved=1)
"""IEEE 754 binary32 as far as it goes without subnormals, infinities and NaN."""
