"""Streams: payloads with `valid` from the sender and `ready` from the receiver; one is handed over on every clock on which both are high.

A pipeline is not stopped by its receiver directly, for that would be a signal through all its length, but by a small FIFO at its end: when that
is nearly full, `room` falls, and a clock or two later all of the pipeline stops at once; what still arrives has its place.
"""

from __future__ import annotations

from typing import Any

from amaranth import Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from luxel.errors import InputError
from luxel.hardware.rtl.pipeline import Operator, Pipeline, Timed


class Fifo(wiring.Component):
    """First in, first out, with a register at its end.

    Args:
        shape: Of the payloads.
        depth: How many are kept, beside the one at the end.
        late: Pushes that may come after the level at which `room` falls: it is a register, so is `go`, and so is what is pushed. With
            depth >= 2 late, what reads can go on on every clock.

    Attributes:
        push: `data` is taken on this clock.
        room: Whether more than `late` fit.
        o: Stream out.
    """

    def __init__(self, shape: Any, depth: int = 8, late: int = 4) -> None:
        if depth < 2 * late:
            raise InputError(f"depth: expected at least {2 * late}, got {depth}")
        self.shape, self.depth, self.late = shape, depth, late
        super().__init__({"push": In(1), "data": In(shape), "room": Out(1), "o": Out(stream.Signature(shape))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.memory = memory = Memory(shape=self.shape, depth=self.depth, init=[])
        write, read = memory.write_port(), memory.read_port(domain="comb")
        level = Signal(range(self.depth + 1))
        some, push, take = Signal(), Signal(), Signal()
        data_in = Signal(self.shape, name="data_in", reset_less=True)
        following = Signal.like(level)
        m.d.comb += [
            write.en.eq(push),
            write.data.eq(data_in),
            take.eq(some & (~self.o.valid | self.o.ready)),
            following.eq(level + push - take),
        ]
        m.d.sync += self.room.eq(level <= self.depth - self.late)
        m.d.sync += [push.eq(self.push), data_in.eq(self.data), level.eq(following), some.eq(following != 0)]
        with m.If(push):
            m.d.sync += write.addr.eq(Mux(write.addr == self.depth - 1, 0, write.addr + 1))
        with m.If(take):
            m.d.sync += [read.addr.eq(Mux(read.addr == self.depth - 1, 0, read.addr + 1)), self.o.payload.eq(read.data), self.o.valid.eq(1)]
        with m.Elif(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        return m


def valid_line(m: Module, valid: Any, go: Any, length: int) -> list[Any]:
    """`valid` after 0, 1 .. `length` clocks of a pipeline that goes when `go` is high; all low after a reset."""
    line = Signal(length, name="valid_line")
    with m.If(go):
        m.d.sync += line.eq((line << 1 | valid)[:length])
    return [valid, *line]


class Streamed(wiring.Component):
    """An operator with a stream at either end.

    Attributes:
        i, o: Streams of the operator's inputs and outputs.
        latency: Clocks from the one to the other, if nothing stops.
    """

    def __init__(self, operator: Operator) -> None:
        self.operator = operator
        self.latency = operator.latency + 3
        shapes = [data.StructLayout({key: signal.shape() for key, signal in part.items()}) for part in (operator.i, operator.o)]
        super().__init__({"i": In(stream.Signature(shapes[0])), "o": Out(stream.Signature(shapes[1]))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.fifo = fifo = Fifo(self.o.payload.shape())
        pipe = Pipeline(fifo.room)
        out = pipe.call(self.operator, **{key: Timed(self.i.payload[key], 0) for key in self.operator.i})
        valid = valid_line(m, self.i.valid, pipe.go, self.operator.latency)[-1]
        wiring.connect(m, fifo.o, wiring.flipped(self.o))
        m.d.comb += [self.i.ready.eq(pipe.go), fifo.push.eq(valid & pipe.go)]
        for key, timed in zip(self.operator.o, out if len(self.operator.o) > 1 else [out]):
            m.d.comb += fifo.data[key].eq(timed.value)
        pipe.into(m)
        return m
