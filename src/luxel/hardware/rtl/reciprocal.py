"""Module 2 of the hardware paper: the reciprocal by piecewise quadratics, the steps of `luxel.hardware.reciprocal` one for one."""

from __future__ import annotations

from amaranth import C, Cat, Mux, unsigned

from luxel.hardware.formats import FLOAT32, Format
from luxel.hardware.interpolator import LUXEL, Precision
from luxel.hardware.reciprocal import Table, table
from luxel.hardware.rtl.floats import Convert, Fields, FromInteger, chosen
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
            looked_up(p, name, Timed(segment, 0), column, bits)
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
        exact = p.step("exact", lambda x: ~x.any(), Timed(part.fraction, 0))
        zero = p.step("zero", lambda e: ~e.any(), Timed(part.exponent, 0))
        power = p.step("power", lambda e, exact: (2 * f.bias - 1 - e + exact)[: f.exponent + 2].as_signed(), Timed(part.exponent, 0), exact)
        none = p.step("none", lambda power: power < 1, power)

        def packed(fraction, power, exact, none, zero, sign):
            fraction = Mux(zero, C(f.largest, f.fraction), Mux(exact | none, 0, fraction))
            power = Mux(zero, C(f.largest >> f.fraction, f.exponent), Mux(none, 0, power[: f.exponent]))
            return Cat(fraction, power, sign & (zero | ~none))

        return {"reciprocal": p.step("reciprocal", packed, total, power, exact, none, zero, Timed(part.sign, 0))}


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


def looked_up(p: Pipeline, name: str, index: Timed, column: object, bits: int) -> Timed:
    """column[index] out of constants, by a tree of choices in two steps: synthesis makes logic of it."""
    values = [C(int(value), bits) for value in column]  # type: ignore[attr-defined]
    half = len(values) // 2
    low, high = p.step(f"{name}_low {name}_high", lambda i: (chosen(i[:-1], values[:half]), chosen(i[:-1], values[half:])), index)
    top = Timed(index.value[-1], index.time)
    return p.step(name, lambda low, high, top: Mux(top, high, low), low, high, top)
