"""How far the interpolator's results can be from the exact ones: bounds that hold for every triangle, as exact fractions.

With every rounding to nearest within 2^-(f + 1) of its result, for f fraction bits, the derivation is (docs/hardware.md says it at length):

- beta and gamma, relative: an edge function, the area, the table, the reciprocal and the product each add their error.
- alpha, absolute: the errors of beta and gamma, together at most `weight` times 1 - alpha; 2^-18 for the first difference, which is at most 1; and
  2^-17 alpha for the second.
- a colour whose corners are between 0 and 1, absolute: alpha's bound (errors of the weights add up like that, as alpha takes up those of the
  others), and three roundings, of the products together and of the two sums.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from typing import NamedTuple

import numpy as np

from luxel.hardware.float24 import FLOAT24
from luxel.hardware.formats import Format
from luxel.hardware.interpolator import LUXEL, Precision
from luxel.hardware.reciprocal import Words, table

_LEAST = Fraction(1, 1 << 60)
"""More than what three products may lose by becoming zero."""


class Bounds(NamedTuple):
    """Exact bounds of the errors.

    Attributes:
        inverse: Of the reciprocal of the area, relative.
        weight: Of beta and gamma, relative.
        alpha: Of alpha, absolute.
        color: Of a channel whose corners are between 0 and 1, absolute.
    """

    inverse: Fraction
    weight: Fraction
    alpha: Fraction
    color: Fraction


@cache
def bounds(precision: Precision = LUXEL) -> Bounds:
    """The bounds of an interpolator that calculates so wide."""
    u = _half(FLOAT24)
    inverse = (1 + table_error(precision.table)) / (1 - _half(precision.area_format)) * (1 + _half(precision.reciprocal_format)) - 1
    weight = (1 + _half(precision.edge_format)) * (1 + inverse) * (1 + u) - 1
    alpha = weight + u / 2 + u * (weight + u / 2)
    heft = 1 + weight + alpha  # what the magnitudes of the three weights add up to, at most
    color = alpha + u * heft * (1 + (1 + u) + (1 + u) ** 2) + _LEAST
    return Bounds(inverse, weight, alpha, color)


@cache
def table_error(words: Words) -> Fraction:
    """The largest relative error of a reciprocal by this table, over every mantissa, exact."""
    n = words.fraction
    fraction = np.arange(1, 1 << n)
    off = (table(words).quotient(fraction) + (1 << n)) * (fraction + (1 << n)) - (1 << 2 * n + 1)
    return Fraction(int(np.abs(off).max()), 1 << 2 * n + 1)


def _half(form: Format) -> Fraction:
    """The largest relative error of rounding to a format."""
    return Fraction(1, (1 << form.fraction + 1) + 1)
