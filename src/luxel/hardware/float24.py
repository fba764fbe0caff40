"""float24, the hardware paper's custom float: 1 sign, 7 exponent (bias 63) and 16 fraction bits (module 4 of the paper).

Words are uint32 below 2^24, in arrays of any shape; see `luxel.hardware.formats` for how it rounds, and what zero and the largest number are.

    >>> from luxel.hardware import float24
    >>> hex(float24.multiply(float24.from_float(1.5), float24.from_float(-2.0)))
    '0xc08000'
    >>> float(float24.to_float(0xC08000))
    -3.0
"""

from __future__ import annotations

from luxel.hardware.formats import Format

FLOAT24 = Format(7, 16)
ONE = 63 << 16
"""The word of 1."""
LARGEST = FLOAT24.largest
"""The word of the largest number, 2^64 * (2 - 2^-16)."""

pack, unpack = FLOAT24.pack, FLOAT24.unpack
add, subtract, multiply, negate = FLOAT24.add, FLOAT24.subtract, FLOAT24.multiply, FLOAT24.negate
from_float, to_float = FLOAT24.from_float, FLOAT24.to_float
from_fraction, to_fraction = FLOAT24.from_fraction, FLOAT24.to_fraction
from_integer, convert = FLOAT24.from_integer, FLOAT24.convert
