"""Module 1 of the hardware paper: twice a triangle's area, by five additions and two multiplications, exact; and as float32."""

from __future__ import annotations

from amaranth import Mux, signed

from luxel.hardware.formats import FLOAT32
from luxel.hardware.rtl.floats import FromInteger
from luxel.hardware.rtl.pipeline import Operator, Pipeline, Timed
from luxel.hardware.rtl.product import product

CORNERS = ("x0", "y0", "x1", "y1", "x2", "y2")


def corner_shapes(bits: int) -> dict[str, object]:
    """The six coordinates."""
    return {key: signed(bits) for key in CORNERS}


class Area(Operator):
    """Twice the area (unsigned) in 1/65536 square pixel of corners in 1/256 pixel, and whether the triangle is seen from behind.

    Args:
        bits: Of a coordinate.
    """

    def __init__(self, bits: int) -> None:
        self.bits = bits
        super().__init__(f"area_{bits}", corner_shapes(bits))

    def build(self, p: Pipeline, **corner: Timed) -> dict[str, Timed]:
        """Latency 9 (7 if coordinates have up to 17 bits)."""

        def less(of: str, minus: str) -> Timed:
            return p.step(f"{of}_{minus}", lambda a, b: a - b, corner[of], corner[minus])

        left = product(p, less("x2", "x0"), less("y1", "y0"))
        right = product(p, less("x1", "x0"), less("y2", "y0"))
        width = 2 * self.bits + 1
        plain, opposite = p.step("plain opposite", lambda l, r: ((l - r)[:width].as_signed(), (r - l)[: width - 1]), left, right)
        flipped = p.step("flipped", lambda d: d[-1], plain)
        area = p.step("area", lambda d, o: Mux(d[-1], o, d[: width - 1]), plain, opposite)
        return {"area": area, "flipped": flipped}


class AreaFloat(Operator):
    """As the paper has it: the signed area in float32."""

    def __init__(self, bits: int) -> None:
        self.bits = bits
        super().__init__(f"area_float_{bits}", corner_shapes(bits))

    def build(self, p: Pipeline, **corner: Timed) -> dict[str, Timed]:
        """The word."""
        area, flipped = p.call(Area(self.bits), **corner)
        word = p.call(FromInteger(2 * self.bits, FLOAT32), v=area)
        return {"float32": p.step("float32", lambda w, f: (w | f << FLOAT32.bits - 1)[: FLOAT32.bits], word, flipped)}
