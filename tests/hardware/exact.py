"""The interpolator once more, number by number in exact fractions: written from the text of docs/hardware.md, not from the model."""

from fractions import Fraction

GREATEST = {7: 127, 8: 254}


def nearest(value, exponent=7, fraction=16):
    """The float nearest to a fraction, ties to even, as a fraction: nothing below the smallest, the largest beyond it."""
    if value == 0:
        return Fraction(0)
    bias, size = 2 ** (exponent - 1) - 1, abs(Fraction(value))
    power = size.numerator.bit_length() - size.denominator.bit_length()
    power -= Fraction(2) ** power > size
    assert Fraction(2) ** power <= size < Fraction(2) ** (power + 1)
    step = Fraction(2) ** (power - fraction)
    size = round(size / step) * step  # Python rounds fractions to even
    if size < Fraction(2) ** (1 - bias):
        return Fraction(0)
    largest = (2 - Fraction(1, 2**fraction)) * Fraction(2) ** (GREATEST[exponent] - bias)
    return min(size, largest) * (-1 if value < 0 else 1)


def reciprocal(value, table):
    """1 / value of a float32, by the rows of a table."""
    w = table.words
    sign, size, power = (-1 if value < 0 else 1), abs(value), 0
    while size >= 2:
        size, power = size / 2, power + 1
    while size < 1:
        size, power = size * 2, power - 1
    if size == 1:
        return sign / Fraction(2) ** power
    segment = int((size - 1) * 2**w.segments)
    t = (size - 1) * 2**w.segments - segment
    square = Fraction(int(t * t * 2**w.square), 2**w.square)
    c = Fraction(int(table.c[segment]), 2**w.c)
    b = Fraction(int(table.b[segment]), 2 ** (w.segments + w.b - 1))
    a = Fraction(int(table.a[segment]), 2 ** (2 * w.segments + w.a - 1))
    found = c - b * t + a * square
    found = 1 + Fraction(int(found % 1 * 2**w.fraction), 2**w.fraction)
    return sign * found / Fraction(2) ** (power + 1)


def cross(p, q, s):
    return (q[0] - p[0]) * (s[1] - p[1]) - (q[1] - p[1]) * (s[0] - p[0])


def weights(corners, place):
    """The exact barycentric coordinates of a place."""
    a, b, c = corners
    area = cross(a, b, c)
    return Fraction(cross(b, c, place), area), Fraction(cross(c, a, place), area), Fraction(cross(a, b, place), area)


def rounded_weights(corners, place, precision, table):
    """alpha, beta and gamma as the circuit rounds them."""
    a, b, c = corners
    area = cross(a, b, c)
    inverse = nearest(reciprocal(nearest(Fraction(abs(area)), 8, table.words.fraction), table), 7, precision.reciprocal)
    ca, ab = (nearest(Fraction(abs(e)), 7, precision.edge) for e in (cross(c, a, place), cross(a, b, place)))
    beta, gamma = nearest(ca * inverse), nearest(ab * inverse)
    return nearest(nearest(1 - beta) - gamma), beta, gamma


def color(weights, corners):
    """One channel."""
    first, second, third = (nearest(w * c) for w, c in zip(weights, corners, strict=True))
    return nearest(nearest(first + second) + third)
