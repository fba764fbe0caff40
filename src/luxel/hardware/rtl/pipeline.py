"""Pipelines that balance themselves.

A value in a pipeline has a time: how many clocks after the inputs it is there. `Pipeline.step` brings its inputs to the latest of their times,
through registers that are shared, computes and registers. So the latency of an operator follows from what it is made of, and no delay
is counted by hand.

All registers of an operator stop together while `go` is low, so a pipeline may be stopped at any clock. `go` is a register, and every few hundred
bits have their own: it drives only what is near. Its next value comes from outside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from amaranth import ClockSignal, Const, Instance, Module, Shape, Signal, Value

_NEAR = 256
"""Bits that one register of `go` drives."""
_library: dict[str, Operator] | None = None


@contextmanager
def library() -> Iterator[dict[str, Operator]]:
    """Within it, operators that are used by others are set aside, one of each name, and are only named where they are used.

    Such a circuit is for a netlist, in which every operator is a module of its own, however often used; Amaranth cannot simulate it.
    """
    global _library
    before, _library = _library, {}
    try:
        yield _library
    finally:
        _library = before


class Timed(NamedTuple):
    """A value, and the clocks after the inputs at which it is valid."""

    value: Value
    time: int


class Pipeline:
    """Makes the registers of one module.

    Args:
        go_next: Its registers change on the clock after one with this high.
    """

    def __init__(self, go_next: Value) -> None:
        self.go_next, self.go = go_next, Signal(name="go", reset_less=True)
        self._registers: list[tuple[Signal, Value]] = []
        self._states: list[tuple[list[tuple[Signal, Value]], Value]] = []
        self._wires: list[Any] = []
        self._parts: dict[str, Any] = {}
        self._later: dict[tuple[int, int], Timed] = {}
        self._kept: list[Value] = []  # keys are identities, so what they name must live

    def into(self, m: Module) -> None:
        """Put all that was made into a module."""
        m.d.sync += self.go.eq(self.go_next)
        for registers, enable_next in [(self._registers, self.go_next), *self._states]:
            for group in _groups(registers):
                with m.If(self.near(enable_next)):
                    m.d.sync += [signal.eq(value) for signal, value in group]
        m.d.comb += self._wires
        for name, part in self._parts.items():
            m.submodules[name] = part.module() if isinstance(part, Operator) else part

    def register(self, value: Value, time: int, name: str) -> Timed:
        """`value`, a clock later."""
        signal = Signal(value.shape(), name=f"{name}_{time + 1}", reset_less=True)
        self._registers.append((signal, value))
        return Timed(signal, time + 1)

    def at(self, timed: Timed, time: int, name: str = "") -> Value:
        """The value at a later time, through registers that all who ask share."""
        if isinstance(timed.value, Const) or timed.time == time:
            return timed.value
        key = (id(timed.value), timed.time)
        if key not in self._later:
            if not name:
                name = getattr(timed.value, "name", "v").rsplit(f"_{timed.time}", 1)[0]
            self._later[key] = self.register(timed.value, timed.time, name)
            self._kept.append(timed.value)
        return self.at(self._later[key], time, name)

    def step(self, name: str, function: Callable[..., Any], *inputs: Timed) -> Any:
        """`function` of the inputs, registered: a clock after the latest of them. Of several results (a tuple) each is."""
        time = max(timed.time for timed in inputs)
        result = function(*(self.at(timed, time) for timed in inputs))
        if not isinstance(result, tuple):
            return self.register(Value.cast(result), time, name)
        names = name.split()
        return tuple(self.register(Value.cast(value), time, each) for each, value in zip(names, result, strict=True))

    def call(self, operator: Operator, **inputs: Timed) -> Any:
        """The outputs of an operator, which becomes a submodule: one, or a tuple."""
        time = max((timed.time for timed in inputs.values() if not isinstance(timed.value, Const)), default=0)
        aligned = {key: self.at(timed, time) for key, timed in inputs.items()}
        signals = self._place(operator, aligned)
        outputs = tuple(Timed(signal, time + operator.latency) for signal in signals.values())
        return outputs[0] if len(outputs) == 1 else outputs

    def state(self, registers: list[tuple[Signal, Value]], enable_next: Value | None = None) -> None:
        """Registers and what they change to, on the clock after one with `enable_next` high (not given: with the others)."""
        self._states.append((registers, self.go_next if enable_next is None else enable_next))

    def near(self, value_next: Value | None = None) -> Signal:
        """A register of `value_next`, one bit (not given: `go`), that is not shared: it drives only what is near."""
        return self._place(Go(), {}, value_next)["go"]

    def _place(self, operator: Operator, inputs: dict[str, Value], go_next: Value | None = None) -> dict[str, Signal]:
        """Put an operator to work, and return its outputs."""
        name = f"{operator.name}_{len(self._parts)}"
        go_next = self.go_next if go_next is None else go_next
        if _library is None:
            self._parts[name] = operator
            self._wires += [operator.go_next.eq(go_next), *(operator.i[key].eq(value) for key, value in inputs.items())]
            return operator.o
        _library.setdefault(operator.name, operator)
        ports = {key: Signal(signal.shape(), name=f"{name}_{key}") for key, signal in (operator.i | operator.o).items()}
        self._wires += [ports[key].eq(value) for key, value in inputs.items()]
        wires = {f"{'i' if key in operator.i else 'o'}_{key}": port for key, port in ports.items()}
        self._parts[name] = Instance(operator.name, i_clk=ClockSignal(), i_go_next=go_next, **wires)
        return {key: ports[key] for key in operator.o}


class Operator:
    """A module of fixed latency that takes new inputs on every clock on which it goes.

    A subclass gives its inputs' shapes, and `build`, which makes the outputs.

    Attributes:
        name: Of the kind of operator: two of the same name are the same circuit.
        i, o: Its inputs and outputs, by name.
        go_next: Whether it goes on the next clock.
        latency: Clocks from the inputs to the outputs.
    """

    def __init__(self, name: str, inputs: dict[str, Any]) -> None:
        self.name = name
        self.i = {key: Signal(Shape.cast(shape), name=key) for key, shape in inputs.items()}
        self.go_next = Signal()
        self._pipe = pipe = Pipeline(self.go_next)
        made = self.build(pipe, **{key: Timed(signal, 0) for key, signal in self.i.items()})
        self.latency = max(timed.time for timed in made.values())
        self._outputs = {key: pipe.at(timed, self.latency) for key, timed in made.items()}  # their names differ from those of the inputs
        self.o = {key: Signal(value.shape(), name=key) for key, value in self._outputs.items()}

    def build(self, p: Pipeline, **inputs: Timed) -> dict[str, Timed]:
        """The outputs, by name."""
        raise TypeError(f"{type(self).__name__} has no build")

    def module(self) -> Module:
        """Amaranth's module of it."""
        m = Module()
        self._pipe.into(m)
        m.d.comb += [self.o[key].eq(value) for key, value in self._outputs.items()]
        return m


class Copy(Operator):
    """One bit, a clock later: for values that are needed far and wide. A module, as `Go` is."""

    def __init__(self) -> None:
        super().__init__("copy", {"v": 1})

    def build(self, p: Pipeline, v: Timed) -> dict[str, Timed]:
        """Latency 1."""
        return {"copy": p.step("copied", lambda v: v, v)}


class Go(Operator):
    """A copy of `go`: a module, so that synthesis does not make one of all of them."""

    def __init__(self) -> None:
        super().__init__("go", {})

    def build(self, p: Pipeline) -> dict[str, Timed]:
        """The register that every pipeline has."""
        return {"go": Timed(p.go, 0)}


def _groups(registers: list[tuple[Signal, Value]]) -> Iterator[list[tuple[Signal, Value]]]:
    """Groups of some `_NEAR` bits, in order: from the inputs to the outputs."""
    group: list[tuple[Signal, Value]] = []
    for signal, value in registers:
        group.append((signal, value))
        if sum(len(each) for each, _ in group) >= _NEAR:
            yield group
            group = []
    if group:
        yield group
