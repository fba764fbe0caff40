"""Set-up of a triangle for scan conversion: everything that its blocks have in common.

At pixel centres, 256 units apart, an edge function changes by multiples of 256: its low 8 bits are the same all over a triangle. So walking and
comparing needs only what is above them. With the top-left rule e - 1 >= 0 instead of e >= 0 for some edges: that is different above the low
bits only if these are 0, and then by 1 (`under`).
"""

from __future__ import annotations

from typing import Any

from amaranth import C, Cat, Mux, Value, signed, unsigned
from amaranth.lib import data

from luxel.fixed import SUBPIXEL_LOG2
from luxel.hardware.rtl.area import CORNERS, Area, corner_shapes
from luxel.hardware.rtl.floats import chosen
from luxel.hardware.rtl.pipeline import Copy, Operator, Pipeline, Timed
from luxel.hardware.rtl.product import product
from luxel.hardware.scan import BLOCK, CENTRE

BLOCK_LOG2 = BLOCK.bit_length() - 1


class Sizes:
    """Widths that follow from the bits of a coordinate, `SUBPIXEL_LOG2` of which are fraction and one is the sign."""

    def __init__(self, coordinate: int) -> None:
        self.coordinate = coordinate
        self.pixel = coordinate - 1 - SUBPIXEL_LOG2
        self.step = signed(coordinate + 1)
        self.span = signed(coordinate + 6)  # of an edge function, from one pixel of a block to the furthest
        self.edge = signed(2 * coordinate + 2 - SUBPIXEL_LOG2)
        self.area = 2 * coordinate  # an edge function inside, with its low bits, has no more

    def triangle(self) -> data.StructLayout:
        """What set-up makes.

        e, below: Edge functions above their low bits, less `under`, at the first pixel of the first block, and of the first one in the next row.
        a, b: Their changes from pixel to pixel, across and down. high, low: their largest and smallest change within a block.
        fraction, under: Of edges 1 and 2, see above.
        first_x, last_x, first_y, last_y: Pixels of the bounding box. empty: There is nothing in it.
        more_x, more_y: How many blocks follow the first, across and down. one_x, one_y: Whether none does; two_x, two_y: whether one does.
        one, two: Whether there is one block, or two.
        """
        edges = {f"{name}{i}": shape for i in range(3) for name, shape in self.edge_fields().items()}
        pixels = {name: unsigned(self.pixel) for name in ("first_x", "last_x", "first_y", "last_y")}
        blocks = {name: unsigned(self.pixel - BLOCK_LOG2) for name in ("more_x", "more_y")}
        flags = dict.fromkeys(("one_x", "one_y", "two_x", "two_y", "one", "two", "empty"), 1)
        return data.StructLayout(edges | self.kept() | pixels | blocks | flags)

    def edge_fields(self) -> dict[str, Any]:
        """Of one edge."""
        return {"e": self.edge, "below": self.edge, "a": self.step, "b": self.step, "high": self.span, "low": self.span}

    def kept(self) -> dict[str, Any]:
        """What goes with a triangle to its fragments as it is."""
        return {f"{name}{i}": shape for i in (1, 2) for name, shape in (("fraction", unsigned(SUBPIXEL_LOG2)), ("under", unsigned(1)))}


class SetUp(Operator):
    """Of corners in 1/256 pixel, and the last column and row of the picture: a triangle as `Sizes.triangle` has it, and `area`.

    `area` is also at hand before the rest: `early` says when, as (value, time).
    """

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = sizes
        pixel = unsigned(sizes.pixel)
        super().__init__(f"set_up_{sizes.coordinate}", corner_shapes(sizes.coordinate) | {"right": pixel, "bottom": pixel})

    def build(self, p: Pipeline, right: Timed, bottom: Timed, **corner: Timed) -> dict[str, Timed]:
        """Latency 19."""
        x, y = ([corner[f"{axis}{i}"] for i in range(3)] for axis in "xy")
        area, flipped = p.call(Area(self.sizes.coordinate), **{key: corner[key] for key in CORNERS})
        first_x, last_x = self._box(p, "x", x, right)
        first_y, last_y = self._box(p, "y", y, bottom)
        beside = [p.step(f"beside_{axis}", lambda f, l: f > l, *ends) for axis, ends in (("x", (first_x, last_x)), ("y", (first_y, last_y)))]
        empty = p.step("empty", lambda x, y, area: x | y | ~area.any(), *beside, area)
        steps = self._steps(p, x, y, flipped)
        e = self._edges(p, x, y, first_x, first_y, area, flipped)
        made: dict[str, Timed] = {}
        for i, (edge, (a, b)) in enumerate(zip(e, steps)):
            some = [p.step(f"some_{name}{i}", lambda v: ~v[-1] & v.any(), v) for name, v in (("a", a), ("b", b))]
            level = p.step(f"level{i}", lambda a: ~a.any(), a)
            inclusive = p.step(f"inclusive{i}", lambda a, b, level: a | (b & level), *some, level)
            under = p.step(f"under{i}", lambda e, inclusive: ~inclusive & ~e[:SUBPIXEL_LOG2].any(), edge, inclusive)
            start = p.step(f"e{i}", lambda e, u: (e[SUBPIXEL_LOG2:].as_signed() - u)[: len(e) - SUBPIXEL_LOG2].as_signed(), edge, under)
            below = p.step(f"below{i}", lambda e, b: (e + b.shift_left(BLOCK_LOG2))[: len(e)].as_signed(), start, b)
            made |= {f"e{i}": start, f"below{i}": below, f"a{i}": a, f"b{i}": b}
            for name, sign in (("high", 0), ("low", 1)):
                made[f"{name}{i}"] = self._span(p, f"{name}{i}", a, b, sign)
            if i > 0:
                made |= {f"fraction{i}": Timed(edge.value[:SUBPIXEL_LOG2], edge.time), f"under{i}": under}
        box = {"first_x": first_x, "last_x": last_x, "first_y": first_y, "last_y": last_y}
        for axis, first, last in (("x", first_x, last_x), ("y", first_y, last_y)):
            box[f"more_{axis}"] = more = self._more(p, axis, first, last, empty)
            for name, count in (("one", 0), ("two", 1)):
                box[f"{name}_{axis}"] = p.step(f"{name}_{axis}", lambda v, count=count: v == count, more)
        box["one"] = p.step("one", lambda x, y: x & y, box["one_x"], box["one_y"])
        box["two"] = p.step("two", lambda x, y, xx, yy: (x & yy) | (xx & y), *(box[name] for name in ("one_x", "one_y", "two_x", "two_y")))
        self.early = area
        return made | box | {"empty": empty, "area": area}

    def _more(self, p: Pipeline, axis: str, first: Timed, last: Timed, empty: Timed) -> Timed:
        """How many blocks follow the first."""
        width = self.sizes.pixel - BLOCK_LOG2
        blocks = p.step(f"blocks_{axis}", lambda f, l: (l.shift_right(BLOCK_LOG2) - f.shift_right(BLOCK_LOG2))[:width], first, last)
        return p.step(f"more_{axis}", lambda v, none: Mux(none, 0, v), blocks, empty)

    def _box(self, p: Pipeline, name: str, v: list[Timed], end: Timed) -> tuple[Timed, Timed]:
        """The first and the last pixel along an axis whose centre may be inside, within the picture; signed."""
        width = self.sizes.coordinate
        less = [p.step(f"{name}{i}_less", lambda u, w: u < w, v[i], v[j]) for i, j in ((0, 1), (1, 2), (2, 0))]

        def which(uv, vw, wu):
            return Mux(uv & ~wu, 0, Mux(vw & ~uv, 1, 2))[:2], Mux(wu & ~uv, 0, Mux(uv & ~vw, 1, 2))[:2]

        ends = p.step(f"{name}_which_least {name}_which_most", which, *less)
        least, most = (
            p.step(f"{name}_{way}", lambda which, *v: chosen(which, list(v)).as_signed(), which, *v) for way, which in zip(("least", "most"), ends)
        )
        first, last = p.step(
            f"{name}_first {name}_last",
            lambda l, m: ((l + (CENTRE - 1)).shift_right(SUBPIXEL_LOG2), (m - CENTRE).shift_right(SUBPIXEL_LOG2)),
            least, most,
        )  # fmt: skip
        first = p.step(f"{name}_first", lambda f: Mux(f < 0, 0, f)[: width - SUBPIXEL_LOG2].as_signed(), first)
        last = p.step(f"{name}_last", lambda l, end: Mux(l > end, end, l)[: width - SUBPIXEL_LOG2].as_signed(), last, end)
        return first, last

    def _steps(self, p: Pipeline, x: list[Timed], y: list[Timed], flipped: Timed) -> list[tuple[Timed, Timed]]:
        """a and b of the three edges, turned to be at least 0 inside."""
        found = []
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            turn, pair = p.call(Copy(), v=flipped), []
            for name, of, minus in (("a", y[k], y[j]), ("b", x[j], x[k])):
                late = (Timed(p.at(v, flipped.time), flipped.time) for v in (of, minus))
                plain, opposite = p.step(f"{name}{i}_plain {name}{i}_opposite", lambda u, v: (u - v, v - u), *late)
                pair.append(p.step(f"{name}{i}", lambda d, o, turn: Mux(turn, o, d), plain, opposite, turn))
            found.append((pair[0], pair[1]))
        return found

    def _edges(self, p: Pipeline, x: list[Timed], y: list[Timed], first_x: Timed, first_y: Timed, area: Timed, flipped: Timed) -> list[Timed]:
        """The edge functions at the first pixel's centre. Both of those at corner 0 are taken from there; the three add up to the area."""
        width = 2 * self.sizes.coordinate + 2

        def away(name: str, first: Timed, corner: Timed, align: int) -> Timed:
            centre = Timed(Cat(C(CENTRE, SUBPIXEL_LOG2 + align), first.value[align:]).as_signed(), first.time)
            return p.step(name, lambda f, c: (f - c)[: len(c) + 1].as_signed(), centre, corner)

        dx, dy = away("dx", first_x, x[0], BLOCK_LOG2), away("dy", first_y, y[0], BLOCK_LOG2)
        found = []
        for i, j, k in ((1, 2, 0), (2, 0, 1)):
            a = p.step(f"a{i}_plain", lambda u, v: u - v, y[k], y[j])
            b = p.step(f"b{i}_plain", lambda u, v: u - v, x[j], x[k])
            plain = p.step(f"e{i}_plain", lambda u, v: (u + v)[:width].as_signed(), product(p, a, dx), product(p, b, dy))
            before = plain.time - 1
            turn = p.call(Copy(), v=Timed(p.at(flipped, before), before))
            found.append(p.step(f"e{i}_turned", lambda e, f: turned(e, f), plain, turn))
        both = p.step("e12", lambda u, v: (u + v)[: width + 1].as_signed(), *found)
        third = p.step("e0_turned", lambda area, both: (area - both)[:width].as_signed(), area, both)
        return [third, *found]

    def _span(self, p: Pipeline, name: str, a: Timed, b: Timed, sign: int) -> Timed:
        """The largest (smallest) change of an edge function within a block."""
        parts = (p.step(f"{name}_{axis}", lambda v: Mux(v[-1] == sign, v, 0), v) for axis, v in (("x", a), ("y", b)))
        part = p.step(f"{name}_part", lambda x, y: x + y, *parts)
        return p.step(name, lambda v: (v.shift_left(BLOCK_LOG2) - v)[: self.sizes.span.width].as_signed(), part)


def turned(value: Value, sign: Value) -> Value:
    """-value if `sign`, of the same width."""
    return ((value ^ sign.replicate(len(value))) + sign)[: len(value)].as_signed()
