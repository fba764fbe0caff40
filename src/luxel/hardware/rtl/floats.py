"""Operators on floats of any `luxel.hardware.formats.Format`, bit for bit as that does, in steps that are short: one carry chain of 27 bits, or two
or three levels of logic."""

from __future__ import annotations

from amaranth import C, Cat, Mux, Value, unsigned

from luxel.hardware.formats import Format
from luxel.hardware.rtl.pipeline import Operator, Pipeline, Timed
from luxel.hardware.rtl.product import HARD, HardProduct

_GUARD = 3
"""Bits beyond those kept that a sum needs to be rounded right; the last stands for all that is below."""


class Fields:
    """Sign, exponent and significand (with its leading 1) of a word."""

    def __init__(self, word: Value, f: Format) -> None:
        self.fraction, self.exponent, self.sign = word[: f.fraction], word[f.fraction : f.bits - 1], word[f.bits - 1]
        self.significand = Cat(self.fraction, C(1, 1))


def rounded(p: Pipeline, f: Format, sign: Timed, exponent: Timed, kept: Timed, guard: Timed, rest: Timed, zero: Timed) -> Timed:
    """The word of a normalised number in three clocks.

    Args:
        p: Pipeline.
        f: Format of the word.
        sign, guard, rest, zero: 1 bit: the sign, the first bit below those kept, whether there is anything below that, whether it is 0.
        exponent: Signed, biased.
        kept: fraction + 1 bits, the first of them 1.
    """
    up = p.step("up", lambda k, g, r: g & (r | k[0]), kept, guard, rest)
    together = p.step("rounded", lambda k, e, u: (Cat(k[: f.fraction], e).as_signed() + u)[: f.fraction + len(e)].as_signed(), kept, exponent, up)

    # Whether the exponent is too high or too low, as it is and if rounding makes it one more: which of both it was is seen by its last bit.
    high, higher, low, lower, odd = p.step("high higher low lower odd", lambda e: (e > f.highest, e >= f.highest, e < 1, e < 0, e[0]), exponent)

    def packed(number, sign, zero, high, higher, low, lower, odd):
        more = number[f.fraction] ^ odd
        word = Mux(Mux(more, higher, high), C(f.largest, f.bits - 1), number[: f.bits - 1])
        return Mux(zero | Mux(more, lower, low), 0, Cat(word, sign))

    return p.step("word", packed, together, sign, zero, high, higher, low, lower, odd)


class Multiply(Operator):
    """a * b. The significand of a has at most 18 bits, that of b 19: the leading 1 of 19 is left out of the multiplier and added."""

    def __init__(self, out: Format, a: Format | None = None, b: Format | None = None) -> None:
        self.out, self.a, self.b = out, a or out, b or out
        super().__init__(f"float{self.out.bits}_multiply_{self.a.bits}_{self.b.bits}", {"a": unsigned(self.a.bits), "b": unsigned(self.b.bits)})

    def build(self, p: Pipeline, a: Timed, b: Timed) -> dict[str, Timed]:
        """Latency 7, or 8 with an addition."""
        x, y, f = Fields(a.value, self.a), Fields(b.value, self.b), self.out.fraction
        significand = Timed(x.significand, 0)
        if self.b.fraction < HARD:
            digits = p.call(HardProduct(significand.value.shape(), y.significand.shape()), a=significand, b=Timed(y.significand, 0))
        else:
            part = p.call(HardProduct(significand.value.shape(), y.fraction.shape()), a=significand, b=Timed(y.fraction, 0))
            digits = p.step("product", lambda q, s: Cat(q[: self.b.fraction], q[self.b.fraction :] + s), part, significand)
        width = self.a.fraction + self.b.fraction + 2
        below = width - 3 - f

        def normalised(q):
            moved = Mux(q[width - 1], q[below + 1 :], q[below:])[: f + 2]
            return moved[1:], moved[0], q[:below].any() | (q[width - 1] & q[below])

        kept, guard, rest = p.step("kept guard rest", normalised, digits)
        bias = self.a.bias + self.b.bias - self.out.bias
        exponents = p.step("exponents", lambda e, g: e + g, Timed(x.exponent, 0), Timed(y.exponent, 0))
        unbiased = p.step("unbiased", lambda e: (e - bias)[: len(e) + 1].as_signed(), exponents)
        exponent = p.step("exponent", lambda e, q: (e + q[width - 1])[: len(e)].as_signed(), unbiased, digits)
        sign = p.step("sign", lambda s, t: s ^ t, Timed(x.sign, 0), Timed(y.sign, 0))
        zero = p.step("zero", lambda e, g: ~(e.any() & g.any()), Timed(x.exponent, 0), Timed(y.exponent, 0))
        return {"p": rounded(p, self.out, sign, exponent, kept, guard, rest, zero)}


class Add(Operator):
    """a + b: align in three steps, sum, normalise in three steps, round."""

    def __init__(self, f: Format) -> None:
        self.f = f
        super().__init__(f"float{f.bits}_add", {"a": unsigned(f.bits), "b": unsigned(f.bits)})

    def build(self, p: Pipeline, a: Timed, b: Timed) -> dict[str, Timed]:
        """Latency 12 for float24."""
        f = self.f
        swap, ahead, behind = p.step(
            "swap ahead behind",
            lambda a, b: (a[:-1] < b[:-1], Fields(a, f).exponent - Fields(b, f).exponent, Fields(b, f).exponent - Fields(a, f).exponent),
            a, b,
        )  # fmt: skip
        large = p.step("large", lambda a, b, s: Mux(s, b, a), a, b, swap)
        small = p.step("small", lambda a, b, s: Mux(s, a, b), a, b, swap)
        distance = p.step("distance", lambda s, d, e: Mux(s, e, d)[: f.exponent], swap, ahead, behind)
        moved, sticky = self._aligned(p, small, distance)
        less = p.step("less", lambda v, w: v[-1] ^ w[-1], large, small)

        def total(v, m, s, less):
            addend = Cat(m[0] | s, m[1:]) ^ less.replicate(len(m))
            sum_ = Cat(less, Cat(C(0, _GUARD), Fields(v, f).significand)) + Cat(less, addend)  # carry in through a bit below
            return Cat(sum_[1 : len(m) + 1], sum_[len(m) + 1] & ~less)

        digits = p.step("total", total, large, moved, sticky, less)
        shown, zeros, none = normalised(p, digits)
        width = shown.value.shape().width
        zero = p.step("zero", lambda v, n: n | ~Fields(v, f).exponent.any(), large, none)
        # The leading place of the sum is one above that of the larger.
        exponent = p.step("exponent", lambda v, z: (Fields(v, f).exponent + 1 - z).as_signed()[: f.exponent + 2].as_signed(), large, zeros)
        sign = p.step("sign", lambda v: v[-1], large)
        low = width - f.fraction - 1
        kept, guard, rest = p.step("kept guard rest", lambda v: (v[low:], v[low - 1], v[: low - 1].any()), shown)
        return {"s": rounded(p, f, sign, exponent, kept, guard, rest, zero)}

    def _aligned(self, p: Pipeline, small: Timed, distance: Timed) -> tuple[Timed, Timed]:
        """The smaller significand with guard bits, moved down by `distance`; and whether anything fell off."""
        f = self.f

        def far(word, distance):
            part = Fields(word, f)
            there, gone, half = part.exponent.any(), distance[5:].any(), distance[4]
            digits = Cat(C(0, _GUARD), part.significand & there.replicate(f.fraction + 1))
            return Mux(gone, 0, Mux(half, digits.shift_right(16), digits)), gone & there, half, there & digits[_GUARD:16].any()

        def near(unit, low):
            def move(digits, distance):
                count = distance[low : low + 2]
                moved = [digits.shift_right(unit * k) for k in range(4)]
                fell = [C(0, 1)] + [digits[: unit * k].any() for k in range(1, 4)]
                return chosen(count, moved), chosen(count, fell)

            return move

        moved, gone, half, low = p.step("far gone half low", far, small, distance)
        lost = p.step("lost", lambda gone, half, low: gone | (half & low), gone, half, low)
        moved, fell = p.step("middle fell", near(4, 2), moved, distance)
        moved, last = p.step("near last", near(1, 0), moved, distance)
        lost = p.step("sticky", lambda lost, fell: lost | fell, lost, fell)
        return moved, Timed(lost.value | last.value, lost.time)


def normalised(p: Pipeline, digits: Timed) -> tuple[Timed, Timed, Timed]:
    """Digits moved up until the first is 1, filled to a multiple of 4 bits; how many zeros went; and whether there is no 1.

    Zeros are counted by fours, then the rest of at most three. Up to 8 fours take three clocks, up to 16 five.
    """
    fill = -len(digits.value) % 4
    count = (len(digits.value) + fill) // 4

    def fours(v):
        v = Cat(C(0, fill), v)
        return Cat(*(v[4 * k : 4 * k + 4].any() for k in reversed(range(count))))

    def first(any_):
        found = C(0, (count - 1).bit_length())
        for k in reversed(range(count)):
            found = Mux(any_[k], k, found)
        return found[: (count - 1).bit_length()], ~any_.any()

    if count <= 8:
        coarse, none = p.step("coarse none", lambda v: first(fours(v)), digits)
        moved = p.step("moved", lambda v, c: chosen(c, [_up(Cat(C(0, fill), v), 4 * k) for k in range(count)]), digits, coarse)
    else:
        any_ = p.step("fours", fours, digits)
        coarse, none = p.step("coarse none", first, any_)
        half = p.step("half", lambda v, c: chosen(c[2:], [_up(Cat(C(0, fill), v), 16 * k) for k in range(-(-count // 4))]), digits, coarse)
        moved = p.step("moved", lambda v, c: chosen(c[:2], [_up(v, 4 * k) for k in range(4)]), half, coarse)

    def fine(v, coarse):
        top = v[-4:]
        zeros = Cat(~top[3] & (top[2] | ~top[1]), ~(top[3] | top[2]))
        return chosen(zeros, [_up(v, k) for k in range(4)]), Cat(zeros, coarse)

    shown, zeros = p.step("shown zeros", fine, moved, coarse)
    return shown, zeros, none


class FromInteger(Operator):
    """The float nearest to an unsigned integer, which the format must be able to hold."""

    def __init__(self, width: int, f: Format) -> None:
        self.f = f
        super().__init__(f"float{f.bits}_from_integer_{width}", {"v": unsigned(width)})

    def build(self, p: Pipeline, v: Timed) -> dict[str, Timed]:
        """Latency 8 for 33 to 64 bits. The sign bit is 0."""
        f = self.f
        shown, zeros, none = normalised(p, v)
        width = shown.value.shape().width
        low = width - f.fraction - 1
        kept, guard, rest = p.step("kept guard rest", lambda v: (v[low:], v[low - 1], v[: low - 1].any()), shown)
        exponent = p.step("exponent", lambda z, n: Mux(n, 0, f.bias + len(v.value) - 1 - z)[: f.exponent], zeros, none)
        up = p.step("up", lambda k, g, r: g & (r | k[0]), kept, guard, rest)
        word = p.step("word", lambda k, e, u: Cat((Cat(k[: f.fraction], e) + u)[: f.bits - 1], C(0, 1)), kept, exponent, up)
        return {"word": word}


class Convert(Operator):
    """A float in another format, with as many or fewer fraction bits."""

    def __init__(self, out: Format, source: Format) -> None:
        self.out, self.source = out, source
        super().__init__(f"float{out.bits}_from_{source.bits}", {"v": unsigned(source.bits)})

    def build(self, p: Pipeline, v: Timed) -> dict[str, Timed]:
        """Latency 3, or 4 where exponents have different biases."""
        part, drop = Fields(v.value, self.source), self.source.fraction - self.out.fraction
        wide = self.source.exponent + 2
        exponent = p.step("exponent", lambda e: (e - self.source.bias + self.out.bias)[:wide].as_signed(), Timed(part.exponent, 0))
        zero = p.step("zero", lambda e: ~e.any(), Timed(part.exponent, 0))
        below = Cat(C(0, 2), part.significand)  # so that there is something below, if nothing is dropped
        low = drop + 2
        kept, guard, rest = (Timed(value, 0) for value in (below[low:], below[low - 1], below[: low - 1].any()))
        return {"word": rounded(p, self.out, Timed(part.sign, 0), exponent, kept, guard, rest, zero)}


def chosen(index: Value, values: list[Value]) -> Value:
    """values[index], by a balanced tree; the last stands for those beyond."""
    if len(values) == 1:
        return values[0]
    bits = (len(values) - 1).bit_length()
    half = 1 << bits - 1
    return Mux(index[bits - 1], chosen(index[: bits - 1], values[half:]), chosen(index[: bits - 1], values[:half]))


def _up(value: Value, count: int) -> Value:
    return Cat(C(0, count), value)[: len(value)]
