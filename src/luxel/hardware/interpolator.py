"""The hardware colour interpolator, bit for bit: area, reciprocal, barycentric coordinates and colours of a triangle's fragments.

After the hardware paper (2016): beta = l_ca(P) / 2A and gamma = l_ab(P) / 2A, alpha = 1 - beta - gamma, and C = alpha Ca + beta Cb + gamma Cc for
three channels, with one reciprocal a triangle, in floats of 24 bits. Corners a, b, c are those of the triangle in their order, l_ca and
l_ab the edge functions 1 and 2 of `luxel.hardware.scan`. What differs from the paper (docs/decisions/0012-hardware-numbers.md):

- The area is summed exactly, in integers, and rounded once, to float32. Its sign decides about coverage, so it has to be exact anyway; and
  rounded products of float32 leave nothing of the area of a sliver (`area_in_float32` is the paper's way).
- The two factors of beta and gamma are one and two bits wider than float24, as wide as an 18-bit multiplier allows: that is what it takes to have
  them within 2^-16 of their value. `PAPER` has floats of 24 bits there too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.fixed import SUBPIXEL
from luxel.hardware.float24 import FLOAT24, ONE
from luxel.hardware.formats import FLOAT32, Format
from luxel.hardware.reciprocal import WIDE, Words, table
from luxel.hardware.scan import CENTRE, edges, scan

_CHUNK = 1 << 14  # fragments at once: their arrays stay in a core's cache


@dataclass(frozen=True)
class Precision:
    """How wide the interpolator calculates.

    Attributes:
        edge: Fraction bits of the float that an edge function becomes.
        reciprocal: Fraction bits of the float that the reciprocal of the area becomes.
        table: Word lengths of the reciprocal's table. Its fraction bits are those that the area is rounded to: 23 make it a float32.
    """

    edge: int = 17
    reciprocal: int = 18
    table: Words = WIDE

    @property
    def edge_format(self) -> Format:
        """Of the edge functions."""
        return Format(7, self.edge)

    @property
    def area_format(self) -> Format:
        """Of the area and its reciprocal by the table."""
        return Format(8, self.table.fraction, reserved=1)

    @property
    def reciprocal_format(self) -> Format:
        """Of the reciprocal of the area as a factor."""
        return Format(7, self.reciprocal)


LUXEL = Precision()
PAPER = Precision(16, 16)


class Shaded(NamedTuple):
    """The coloured fragments of one triangle, in the order in which they leave.

    Attributes:
        x, y: (n,) int64, pixels.
        colors: (n, 3) uint32, float24.
    """

    x: Array
    y: Array
    colors: Array


def area_in_float32(corners: Array) -> Array:
    """Twice the signed area (float32 words) as the paper has it: corners (..., 3, 2) become floats, and each of five adders and two multipliers
    rounds."""
    f = FLOAT32
    p = f.from_integer(corners)
    x, y = p[..., 0], p[..., 1]
    left = f.multiply(f.subtract(x[..., 2], x[..., 0]), f.subtract(y[..., 1], y[..., 0]))
    right = f.multiply(f.subtract(x[..., 1], x[..., 0]), f.subtract(y[..., 2], y[..., 0]))
    return f.subtract(left, right)


def inverse_area(area: Array, precision: Precision = LUXEL) -> Array:
    """1 / area, in `precision.reciprocal_format`, of twice the area of triangles (exact, int64, above 0)."""
    form = precision.area_format
    found = table(precision.table).reciprocal(form.from_integer(area), form)
    return precision.reciprocal_format.convert(found, form)


def barycentrics(inverse: Array, l_ca: Array, l_ab: Array, precision: Precision = LUXEL) -> tuple[Array, Array, Array]:
    """alpha, beta and gamma, float24 words, of edge functions (int64) and the inverse area of their triangles."""
    e, r = precision.edge_format, precision.reciprocal_format
    beta = FLOAT24.multiply(e.from_integer(l_ca), inverse, e, r)
    gamma = FLOAT24.multiply(e.from_integer(l_ab), inverse, e, r)
    return FLOAT24.subtract(FLOAT24.subtract(ONE, beta), gamma), beta, gamma


def interpolate(alpha: Array, beta: Array, gamma: Array, colors: Array) -> Array:
    """(..., k) float24 words: (alpha Ca + beta Cb) + gamma Cc in every channel, each operation rounded; colors: (..., 3 corners, k channels)."""
    f = FLOAT24
    first, second, third = (f.multiply(weight[..., None], colors[..., i, :]) for i, weight in enumerate((alpha, beta, gamma)))
    return f.add(f.add(first, second), third)


def shade(corners: Array, colors: Array, x: Array, y: Array, triangle: Array, precision: Precision = LUXEL) -> Array:
    """Colours of fragments anywhere, of any triangles.

    Args:
        corners: (m, 3, 2) integers, x and y in 1/256 pixel.
        colors: (m, 3, k) float24 words: of every corner, k channels.
        x, y: (n,) integers: positions in 1/256 pixel.
        triangle: (n,) integers: of which triangle each is a fragment; its area is not 0.
        precision: How wide to calculate.

    Returns:
        (n, k) uint32: float24 words.

    Raises:
        InputError: An array is not as above, or a triangle without area has a fragment.
    """
    corners, colors = checked(corners, ("m", 3, 2), np.int64, "corners"), checked(colors, (len(corners), 3, "k"), np.uint32, "colors")
    x, y = checked(x, ("n",), np.int64, "x"), checked(y, (len(x),), np.int64, "y")
    triangle = checked(triangle, (len(x),), np.int64, "triangle")
    setup = edges(corners)
    inverse = inverse_area(setup.area, precision)
    if (setup.area[triangle] == 0).any():
        raise InputError(f"triangle: expected triangles with an area, got {triangle[setup.area[triangle] == 0][0]}, which has none")
    shaded = np.empty((len(x), colors.shape[2]), np.uint32)
    for first in range(0, len(x), _CHUNK):
        part = slice(first, first + _CHUNK)
        t = triangle[part]
        e = setup.take(t).at(x[part], y[part])
        shaded[part] = interpolate(*barycentrics(inverse[t], e[:, 1], e[:, 2], precision), colors[t])
    return shaded


def draw(corners: Array, colors: Array, width: int, height: int, precision: Precision = LUXEL) -> Shaded:
    """What the circuit makes of one triangle: its fragments in a picture of width x height pixels, coloured.

    Args:
        corners: (3, 2) integers, x and y in 1/256 pixel.
        colors: (3, 3) float24 words: of each corner, three channels.
        width, height: Of the picture, pixels.
        precision: How wide to calculate.
    """
    corners, colors = checked(corners, (3, 2), np.int64, "corners"), checked(colors, (3, 3), np.uint32, "colors")
    found = scan(corners, width, height)
    x, y = found.x * SUBPIXEL + CENTRE, found.y * SUBPIXEL + CENTRE
    return Shaded(found.x, found.y, shade(corners[None], colors[None], x, y, np.zeros_like(x), precision))
