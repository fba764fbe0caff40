"""Module 2 of the hardware paper: the reciprocal by piecewise quadratics, the steps of `luxel.hardware.reciprocal` one for one."""

from __future__ import annotations

from amaranth import C, Cat, Mux, Value, unsigned

from luxel.hardware.formats import FLOAT32, Format
from luxel.hardware.interpolator import LUXEL, Precision
from luxel.hardware.reciprocal import Table, table
from luxel.hardware.rtl.floats import Convert, Fields, FromInteger
from luxel.hardware.rtl.pipeline import Operator, Pipeline, Timed
from luxel.hardware.rtl.product import HardProduct


class Reciprocal(Operator):
    """1 / v in the format of v, with a table made for its fraction bits; the sign is passed on, and 1 / 0 is the largest number."""

    def __init__(self, of: Format, rows: Table) -> None:
        self.of, self.rows = of, rows
        w = rows.words
        super().__init__(f"float{of.bits}_reciprocal_{w.segments}_{w.c}_{w.b}_{w.a}_{w.square}", {"v": unsigned(of.bits)})

    def build(self, p: Pipeline, v: Timed) -> dict[str, Timed]:
        """Latency 8."""
        f, w = self.of, self.rows.words
        part = Fields(v.value, f)
        low, segment = Timed(part.fraction[: w.low], 0), part.fraction[w.low :]
        c, b, a = (
            p.step(name, lambda i, column=column, bits=bits: looked_up(i, column, bits), Timed(segment, 0))
            for name, column, bits in (("c", self.rows.c, w.c), ("b", self.rows.b, w.b), ("a", self.rows.a, w.a))
        )
        whole = unsigned(w.low)
        square = p.call(HardProduct(whole, whole), a=low, b=low)
        square = Timed(square.value[2 * w.low - w.square :], square.time)
        linear = p.call(HardProduct(whole, unsigned(w.b)), a=low, b=b)
        curved = p.call(HardProduct(unsigned(w.square), unsigned(w.a)), a=square, b=a)
        u = w.unit
        shifts = u - w.c, u - w.fraction - w.b + 1, u - 2 * w.segments - w.a - w.square + 1
        line = p.step("line", lambda c, l: (c.shift_left(shifts[0]) - l.shift_left(shifts[1]))[:u], c, linear)
        total = p.step("total", lambda l, q: (l + q.shift_left(shifts[2]))[u - w.fraction : u], line, curved)
        power = p.step(
            "power",
            lambda e, x: (2 * f.bias - 1 - e + ~x.any()).as_signed()[: f.exponent + 2].as_signed(),
            Timed(part.exponent, 0),
            Timed(part.fraction, 0),
        )
        exact, zero = Timed(~part.fraction.any(), 0), Timed(~part.exponent.any(), 0)

        def packed(fraction, power, exact, zero, sign):
            word = Mux(power < 1, 0, Cat(Mux(exact, 0, fraction), power[: f.exponent], sign))
            return Mux(zero, Cat(C(f.largest, f.bits - 1), sign), word)

        return {"reciprocal": p.step("reciprocal", packed, total, power, exact, zero, Timed(part.sign, 0))}


class Inverse(Operator):
    """1 / area as the barycentric coordinates want it: of an integer, `luxel.hardware.interpolator.inverse_area`."""

    def __init__(self, width: int, precision: Precision = LUXEL) -> None:
        self.width, self.precision = width, precision
        super().__init__(f"inverse_{width}_{precision.reciprocal}", {"area": unsigned(width)})

    def build(self, p: Pipeline, area: Timed) -> dict[str, Timed]:
        """Float32, reciprocal, shorter float."""
        word = p.call(FromInteger(self.width, FLOAT32), v=area)
        found = p.call(Reciprocal(FLOAT32, table(self.precision.table)), v=word)
        return {"inverse": p.call(Convert(self.precision.reciprocal_format, FLOAT32), v=found)}


def looked_up(index: Value, column: object, bits: int) -> Value:
    """column[index] out of constants, by a tree of choices: synthesis makes logic of it."""
    values = [C(int(value), bits) for value in column]  # type: ignore[attr-defined]
    for bit in index:
        values = [Mux(bit, values[k + 1], values[k]) for k in range(0, len(values), 2)]
    return values[0]


