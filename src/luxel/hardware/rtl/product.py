"""Products of integers. One of up to 18 x 18 bits is a hard multiplier of an FPGA; wider ones are put together from such."""

from __future__ import annotations

from amaranth import Cat, Shape, signed, unsigned

from luxel.hardware.rtl.pipeline import Operator, Pipeline, Timed

HARD = 18
_LOW = HARD - 1  # bits of the lower part of a factor that is split: unsigned, it fits a signed multiplier
_PART = 6


class HardProduct(Operator):
    """a * b, three clocks: the registers that FPGAs have inside a multiplier (inputs, partial products, output).

    Where there is no hard multiplier, one clock has the products of a and up to six bits of b each, the next their sum. For an ECP5
    the whole module is replaced by one MULT18X18D (`luxel.hardware.synthesis.ecp5`), by its name.
    """

    def __init__(self, a: Shape, b: Shape) -> None:
        self.shapes = a, b
        super().__init__(f"hard_product_{shape_name(a)}_{shape_name(b)}", {"a": a, "b": b})

    def build(self, p: Pipeline, a: Timed, b: Timed) -> dict[str, Timed]:
        """Latency 3."""
        a_in, b_in = p.step("a", lambda v: v, a), p.step("b", lambda v: v, b)
        shape_a, shape_b = self.shapes
        shape = (signed if shape_a.signed or shape_b.signed else unsigned)(shape_a.width + shape_b.width)
        part = min(_PART, -(-shape_b.width // 2))
        cuts = range(0, shape_b.width, part)

        def parts(a, b):
            top = b[cuts[-1] :]
            return *(a * b[low : low + part] for low in cuts[:-1]), a * (top.as_signed() if shape_b.signed else top)

        found = p.step(" ".join(f"part{low}" for low in cuts), parts, a_in, b_in)
        found = found if isinstance(found, tuple) else (found,)
        return {"p": p.step("p", lambda *each: _resized(sum(part.shift_left(low) for part, low in zip(each, cuts)), shape), *found)}


class WideProduct(Operator):
    """a * b of signed numbers of 19 to 35 bits, five clocks: four products of their parts, and two sums."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"wide_product_{width}", {"a": signed(width), "b": signed(width)})

    def build(self, p: Pipeline, a: Timed, b: Timed) -> dict[str, Timed]:
        """Latency 5. With a = A 2^17 + a' and b alike, A B 2^34 and a' b' do not overlap; A b' + B a' is added in their middle."""
        low, high = unsigned(_LOW), signed(self.width - _LOW)
        parts = [(Timed(v.value[:_LOW], v.time), Timed(v.value[_LOW:].as_signed(), v.time)) for v in (a, b)]
        (a_low, a_high), (b_low, b_high) = parts
        lows = p.call(HardProduct(low, low), a=a_low, b=b_low)
        highs = p.call(HardProduct(high, high), a=a_high, b=b_high)
        cross = p.call(HardProduct(low, high), a=a_low, b=b_high)
        other = p.call(HardProduct(low, high), a=b_low, b=a_high)
        middle = p.step("middle", lambda c, o: c + o, cross, other)
        outer = p.step("outer", lambda l, h: Cat(l, h), lows, highs)
        total = p.step("p", lambda o, m: Cat(o[:_LOW], (o[_LOW:].as_signed() + m)[: 2 * self.width - _LOW]).as_signed(), outer, middle)
        return {"p": total}


def product(p: Pipeline, a: Timed, b: Timed) -> Timed:
    """a * b: one hard multiplier if both fit, else for signed numbers a wide product."""
    shapes = a.value.shape(), b.value.shape()
    if max(shape.width for shape in shapes) <= HARD:
        return p.call(HardProduct(*shapes), a=a, b=b)
    width = max(shape.width for shape in shapes)
    return p.call(WideProduct(width), a=a, b=b)


def shape_name(shape: Shape) -> str:
    """Such as s17 for a signed number of 17 bits, u8 for an unsigned one of 8."""
    return f"{'s' if shape.signed else 'u'}{shape.width}"


def _resized(value, shape):
    low = value[: shape.width]
    return low.as_signed() if shape.signed else low
