"""Streams: payloads with `valid` from the sender and `ready` from the receiver; one is handed over on every clock on which both are high.

A pipeline is not stopped by its receiver directly, for that would be a signal through all its length, but by a small FIFO at its end: when that
is nearly full, `room` falls, and a clock or two later all of the pipeline stops at once; what still arrives has its place.
"""

from __future__ import annotations

from typing import Any

from amaranth import Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from luxel.errors import InputError
from luxel.hardware.rtl.pipeline import Operator, Pipeline, Timed

_LANE = 72
"""Bits of a FIFO that share addresses."""


class Early(wiring.Signature):
    """A stream whose receiver says a clock before whether it will take what then is there. So every part of the sender has a register of that."""

    def __init__(self, shape: Any) -> None:
        super().__init__({"payload": Out(shape), "valid": Out(1), "ready_next": In(1)})


class Fifo(wiring.Component):
    """First in, first out, with a register at its end.

    Wide registers have no enables: the one at the end takes what the memory has at the next address, which is often what it had. Payloads are kept in
    lanes, each with addresses of its own, so that what is decided in one place is a few bits that stay near.

    Args:
        shape: Of the payloads.
        depth: How many are kept, the one at the end among them.
        early: The stream out is an `Early` one.
        late: Pushes that may come after the level at which `room` falls: it is a register, so is `go`, and so is what is pushed. With
            depth > 2 late, what reads can go on on every clock.

    Attributes:
        push: `data` is taken on this clock.
        room: Whether more than `late` fit.
        o: Stream out.
    """

    def __init__(self, shape: Any, depth: int = 9, late: int = 4, early: bool = False) -> None:
        if depth <= 2 * late:
            raise InputError(f"depth: expected at least {2 * late + 1}, got {depth}")
        self.shape, self.depth, self.late, self.early = shape, depth, late, early
        super().__init__({"push": In(1), "data": In(shape), "room": Out(1), "o": Out(Early(shape) if early else stream.Signature(shape))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        data, payload = Value.cast(self.data), Value.cast(self.o.payload)
        lanes = []
        for k, low in enumerate(range(0, len(data), _LANE)):
            m.submodules[f"lane{k}"] = lane = Lane(len(data[low : low + _LANE]), self.depth, self.early)
            m.d.comb += [lane.push.eq(self.push), lane.data.eq(data[low : low + _LANE]), payload[low : low + _LANE].eq(lane.payload)]
            m.d.comb += lane.ready.eq(self.o.ready_next if self.early else self.o.ready)
            lanes.append(lane)
        m.d.comb += self.o.valid.eq(lanes[0].valid)
        m.d.sync += self.room.eq(lanes[0].level <= self.depth - self.late)
        return m


class Lane(wiring.Component):
    """Some bits of a FIFO's payloads: a FIFO by itself, in step with the others.

    Attributes:
        push, data: As the FIFO's.
        payload, valid, ready: Its output; `ready` is a clock early if `early`.
        level: How many there are.
    """

    def __init__(self, width: int, depth: int, early: bool) -> None:
        self.width, self.depth, self.early = width, depth, early
        ports = {"push": In(1), "data": In(width), "payload": Out(width), "valid": Out(1), "ready": In(1)}
        super().__init__(ports | {"level": Out(range(depth + 1))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.memory = memory = Memory(shape=self.width, depth=self.depth, init=[])
        write = memory.write_port()
        now, following = Signal.like(write.addr), Signal.like(write.addr, init=1)
        data, payload = Signal(self.width, name="data_in", reset_less=True), Signal(self.width, name="data_out", reset_less=True)
        take, valid_next = Signal(), Signal()
        m.d.comb += [
            valid_next.eq((self.level > 1) | ((self.level == 1) & ~take)),
            write.data.eq(data),
            self.payload.eq(payload),
        ]
        address = Mux(take, following, now)
        if self.early:
            m.d.sync += [take.eq(valid_next & self.ready), payload.eq(_read(m, memory, address))]
        else:  # the decision comes late, so both are read
            m.d.comb += take.eq(self.valid & self.ready)
            m.d.sync += payload.eq(Mux(take, _read(m, memory, following), _read(m, memory, now)))
        m.d.sync += [write.en.eq(self.push), data.eq(self.data), now.eq(address)]
        m.d.sync += [self.level.eq(self.level + write.en - take), self.valid.eq(valid_next)]
        with m.If(write.en):
            m.d.sync += write.addr.eq(self._after(write.addr))
        with m.If(take):
            m.d.sync += following.eq(self._after(following))
        return m

    def _after(self, address: Value) -> Value:
        return Mux(address == self.depth - 1, 0, address + 1)


def _read(m: Module, memory: Memory, address: Value) -> Value:
    read = memory.read_port(domain="comb")
    m.d.comb += read.addr.eq(address)
    return read.data


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
