"""The whole interpolator: a stream of triangles in, a stream of coloured fragments out.

A triangle's corners go to set-up and scan conversion, its colours wait (in two FIFOs, one after the other) for its first fragment, and so does the
reciprocal of its area, which is made meanwhile in a pipeline that never stops: there is a place for each. The last fragment of a triangle takes
them away.
"""

from __future__ import annotations

from typing import Any

from amaranth import C, Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from luxel.hardware.float24 import FLOAT24
from luxel.hardware.interpolator import LUXEL, Precision
from luxel.hardware.rtl.barycentric import CHANNELS, COLORS, Barycentrics, Color
from luxel.hardware.rtl.pipeline import Pipeline, Timed
from luxel.hardware.rtl.reciprocal import Inverse
from luxel.hardware.rtl.scan import Fragments, Scan, connected, fragment_layout
from luxel.hardware.rtl.setup import SetUp, Sizes
from luxel.hardware.rtl.streams import Early, Fifo, valid_line

COORDINATE_BITS = 21
"""Corners from -4096 to 4096 pixels, so pictures of up to 4096 x 4096."""


class TriangleSetUp(wiring.Component):
    """Stream of corners in, stream of triangles that are set up out; areas leave on their own, earlier.

    Attributes:
        i, o: Streams. right, bottom: Last column and row of the picture, which are not to change while triangles are under way.
        area, area_valid: Of each triangle once, never stopped.
    """

    def __init__(self, sizes: Sizes) -> None:
        self.sizes, self.operator = sizes, SetUp(sizes)
        corners = data.StructLayout({key: signal.shape() for key, signal in self.operator.i.items() if key not in ("right", "bottom")})
        super().__init__(
            {
                "i": In(stream.Signature(corners)),
                "o": Out(Early(sizes.triangle())),
                "right": In(sizes.pixel),
                "bottom": In(sizes.pixel),
                "area": Out(sizes.area),
                "area_valid": Out(1),
            }
        )

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.fifo = fifo = Fifo(self.sizes.triangle(), early=True)
        p = Pipeline(fifo.room)
        corners = {key: Timed(self.i.payload[key], 0) for key in self.i.payload.shape().members}
        out = p.call(self.operator, **corners, right=Timed(self.right, 0), bottom=Timed(self.bottom, 0))
        made = dict(zip(self.operator.o, out))
        valid = valid_line(m, self.i.valid, p.go, self.operator.latency)
        wiring.connect(m, fifo.o, wiring.flipped(self.o))
        m.d.comb += [self.i.ready.eq(p.go), fifo.push.eq(valid[-1] & p.go)]
        m.d.comb += [fifo.data[key].eq(made[key].value) for key in self.sizes.triangle().members]
        m.d.comb += [self.area.eq(made["area"].value), self.area_valid.eq(valid[made["area"].time] & p.go)]
        p.into(m)
        return m


class ScanConversion(wiring.Component):
    """Stream of corners in, stream of fragments out: set-up and scan."""

    def __init__(self, coordinate_bits: int = COORDINATE_BITS) -> None:
        self.set_up, self.sizes = TriangleSetUp(Sizes(coordinate_bits)), Sizes(coordinate_bits)
        ports = {name: In(self.sizes.pixel) for name in ("right", "bottom")}
        fragments = stream.Signature(fragment_layout(self.sizes))
        super().__init__({"i": In(stream.Signature(self.set_up.i.payload.shape())), "o": Out(fragments)} | ports)

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.set_up = self.set_up
        m.submodules.scan = scan = Scan(self.sizes)
        wiring.connect(m, wiring.flipped(self.i), self.set_up.i)
        wiring.connect(m, self.set_up.o, scan.i)
        wiring.connect(m, scan.o, wiring.flipped(self.o))
        m.d.comb += [self.set_up.right.eq(self.right), self.set_up.bottom.eq(self.bottom)]
        return m


class Interpolator(wiring.Component):
    """Stream of triangles in, stream of coloured fragments out.

    Args:
        coordinate_bits: Of a corner's coordinate; 8 are fraction.
        precision: As the model's.
        triangles: How many may be under way: as it takes some ninety clocks from one end to the other, one can be taken every three.

    Attributes:
        i: x0 .. y2, signed, in 1/256 pixel; r_a .. b_c, float24.
        o: x, y, pixels; r, g, b, float24; last, of its triangle.
        right, bottom: Last column and row of the picture, which are not to change while triangles are under way.
    """

    def __init__(self, coordinate_bits: int = COORDINATE_BITS, precision: Precision = LUXEL, triangles: int = 32) -> None:
        self.sizes, self.precision, self.triangles = Sizes(coordinate_bits), precision, triangles
        self.set_up = TriangleSetUp(self.sizes)
        word = FLOAT24.bits
        corners = dict(self.set_up.i.payload.shape().members)
        self.colors = data.StructLayout(dict.fromkeys(COLORS, word))
        fragment = data.StructLayout({"x": self.sizes.pixel, "y": self.sizes.pixel} | dict.fromkeys(CHANNELS, word) | {"last": 1})
        super().__init__(
            {
                "i": In(stream.Signature(data.StructLayout(corners | dict.fromkeys(COLORS, word)))),
                "o": Out(stream.Signature(fragment)),
                "right": In(self.sizes.pixel),
                "bottom": In(self.sizes.pixel),
            }
        )

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.set_up = self.set_up
        m.submodules.waiting = waiting = Fifo(self.colors, self.triangles // 2, early=True)
        m.submodules.colors = colors = Fifo(self.colors, self.triangles // 2, 5, early=True)
        m.submodules.inverses = inverses = Fifo(self.precision.reciprocal_format.bits, self.triangles, early=True)
        move = Signal()
        m.d.sync += move.eq(colors.room)
        m.d.comb += [waiting.o.ready_next.eq(colors.room), colors.push.eq(waiting.o.valid & move), colors.data.eq(waiting.o.payload)]
        self._take(m, waiting)
        self._invert(m, inverses)
        self._shade(m, connected(m, self.sizes, self.set_up.o), colors, inverses)
        return m

    def _take(self, m: Module, colors: Fifo) -> None:
        """A triangle is taken when there is a place for its colours."""
        room = Signal()
        accepted = Signal()
        m.d.sync += room.eq(colors.room)
        m.d.comb += [
            self.i.ready.eq(self.set_up.i.ready & room),
            accepted.eq(self.i.valid & self.i.ready),
            self.set_up.i.valid.eq(self.i.valid & room),
            self.set_up.right.eq(self.right),
            self.set_up.bottom.eq(self.bottom),
            colors.push.eq(accepted),
        ]
        m.d.comb += [self.set_up.i.payload[key].eq(self.i.payload[key]) for key in self.set_up.i.payload.shape().members]
        m.d.comb += [colors.data[key].eq(self.i.payload[key]) for key in COLORS]

    def _invert(self, m: Module, inverses: Fifo) -> None:
        """1 / area, by a pipeline that never stops: no more triangles are under way than fit the FIFO."""
        p = Pipeline(C(1, 1))
        inverse = p.call(Inverse(self.sizes.area, self.precision), area=Timed(self.set_up.area, 0))
        m.d.comb += [inverses.data.eq(inverse.value), inverses.push.eq(valid_line(m, self.set_up.area_valid, C(1, 1), inverse.time)[-1])]
        p.into(m)

    def _shade(self, m: Module, rows: Any, colors: Fifo, inverses: Fifo) -> None:
        """Fragments, barycentric coordinates and colours, in one pipeline."""
        m.submodules.fifo = fifo = Fifo(self.o.payload.shape())
        p = Pipeline(fifo.room)
        fragment, busy = Fragments(self.sizes).walk(m, p, rows)
        place = {key: Timed(fragment[key], 0) for key in ("x", "y", "drawn", "last")}
        edges = {key: Timed(fragment[key], 0) for key in ("l_ca", "l_ab")}
        weights = p.call(Barycentrics(self.sizes.area, self.precision), **edges, inverse=Timed(inverses.o.payload, 1))
        time = weights[0].time
        values = {key: Timed(colors.o.payload[key], time) for key in COLORS}
        out = p.call(Color(), **dict(zip(("alpha", "beta", "gamma"), weights)), **values)
        end = out[0].time
        valid = valid_line(m, busy, p.go, end)
        for waiting, when in ((inverses, 1), (colors, time)):
            ends = [valid[t] & p.at(place["last"], t) for t in (when - 1, when)]
            m.d.comb += waiting.o.ready_next.eq(p.go_next & Mux(p.go, *ends))  # on the clock that comes it is there, and goes
        m.d.comb += fifo.push.eq(p.go & valid[end] & p.at(place["drawn"], end))
        m.d.comb += [fifo.data[key].eq(p.at(place[key], end)) for key in ("x", "y", "last")]
        m.d.comb += [fifo.data[key].eq(timed.value) for key, timed in zip(CHANNELS, out)]
        wiring.connect(m, fifo.o, wiring.flipped(self.o))
        p.into(m)
