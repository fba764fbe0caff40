"""Walks: states that come from a stream and change step by step, one a clock."""

from __future__ import annotations

from typing import Any

from amaranth import Module, Mux, Signal, Value

from luxel.hardware.rtl.pipeline import Pipeline


class Walk:
    """A state that is fetched from a stream and then changes step by step; when its last step is done the next is fetched.

    Enables and choices of wide registers are registers themselves, near what they drive: it is known a clock before.

    Args:
        m: Module that the walk is in.
        p: Pipeline that takes the states, and stops the walk.
        i: Stream.
        single: Whether what the stream has is one state only.
        ends: Whether the state after this one is the last.

    Attributes:
        go, load: Whether the state changes on this clock; if so, whether a new one is fetched. load_next: `load` a clock later.
        busy: Whether there is a state.
    """

    def __init__(self, m: Module, p: Pipeline, i: Any, single: Value, ends: Value) -> None:
        self.p, self.go = p, p.near()
        self.load, self.busy, self.load_next = Signal(init=1, name="load"), Signal(name="busy"), Signal(name="load_next")
        m.d.comb += self.load_next.eq(Mux(self.go, Mux(self.load, ~i.valid | single, ends), self.load))
        m.d.comb += i.ready_next.eq(p.go_next & self.load_next)
        m.d.sync += self.load.eq(self.load_next)
        with m.If(self.fetch()):
            m.d.sync += self.busy.eq(i.valid)

    def fetch(self) -> Signal:
        """Whether a new state is fetched on this clock; each call makes another register of it."""
        return self.p.near(self.p.go_next & self.load_next)

    def fetched(self, registers: list[tuple[Signal, Value]]) -> None:
        """Registers that only change when a new state is fetched."""
        self.p.state(registers, self.p.go_next & self.load_next)

    def stepped(self, register: Signal, new: Value, step: Value) -> None:
        """A register that has `new` when a state is fetched, else `step`."""
        self.p.state([(register, Mux(self.fetch(), new, step))])
