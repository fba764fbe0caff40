"""Run a circuit with streams in Amaranth's own simulator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from amaranth import Cat
from amaranth.sim import Simulator

from luxel.arrays import Array
from luxel.hardware.rtl.pipeline import Operator


class Run(NamedTuple):
    """What left a circuit.

    Attributes:
        fields: (n,) int64 arrays, by the fields of its output stream.
        clocks: (n,) int64: on which clock each left; the first clock is 0.
        sent: On which clock the inputs were taken.
    """

    fields: dict[str, Array]
    clocks: Array
    sent: Array


def joined(columns: Sequence[Any], widths: Sequence[int]) -> list[int]:
    """Rows of integers as one number each, the first column lowest: a simulator settles after all that is set, so all is set at once."""
    total = np.zeros(len(columns[0]), object)
    for column, width, offset in zip(columns, widths, np.cumsum([0, *widths])):
        total |= (np.asarray(column).astype(object) & (1 << width) - 1) << int(offset)
    return list(total)


def compute(operator: Operator, inputs: dict[str, Array], goes: Callable[[int], bool] | None = None) -> dict[str, Array]:
    """The outputs of an operator, one set of inputs a clock.

    Args:
        operator: Any.
        inputs: (n,) arrays of integers, by its inputs.
        goes: Whether it goes on a clock; always, if not given.

    Returns:
        (n,) int64 arrays, by its outputs.
    """
    rows = joined([inputs[key] for key in operator.i], [len(signal) for signal in operator.i.values()])
    both = Cat(operator.go_next, *operator.i.values())
    found: list[list[int]] = []

    async def bench(ctx: Any) -> None:
        taken = clock = shown = 0
        while len(found) < len(rows):
            going = goes is None or goes(clock)
            ctx.set(both, shown << 1 | int(going))
            await ctx.tick()
            clock += 1
            if not going:
                continue
            # It goes on the clock that comes: what is at its inputs is taken, what is at its outputs has gone all the way.
            if taken >= operator.latency:
                found.append([int(ctx.get(signal)) for signal in operator.o.values()])
            shown = rows[min(taken, len(rows) - 1)]
            taken += 1

    simulator = Simulator(operator.module())
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return dict(zip(operator.o, np.array(found, np.int64).reshape(len(rows), -1).T))


def run(component: Any, inputs: dict[str, Array], count: int, offered: Callable[[int], bool] | None = None,
        taken: Callable[[int], bool] | None = None, limit: int = 1_000_000, **ports: int) -> Run:  # fmt: skip
    """Send payloads through the streams `i` and `o` of a component.

    Args:
        component: With the streams `i` and `o`.
        inputs: (m,) arrays of integers, by the fields of `i`.
        count: How many payloads to wait for.
        offered, taken: Whether the sender has one, and the receiver takes one, on a clock; always, if not given. A sender keeps what it offers.
        limit: Clocks after which to give up.
        ports: Values of further inputs.

    Raises:
        TimeoutError: After `limit` clocks fewer than `count` have left.
    """
    layout = component.i.payload.shape()
    rows = joined([inputs[key] for key in layout.members], [layout[key].width for key in layout.members])
    offer = Cat(component.i.valid, component.i.payload)
    found: list[list[int]] = []
    clocks: list[int] = []
    sent: list[int] = []

    async def send(ctx: Any) -> None:
        clock = 0
        for name, value in ports.items():
            ctx.set(getattr(component, name), value)
        for row in rows:
            while offered is not None and not offered(clock):
                await ctx.tick()
                clock += 1
            ctx.set(offer, row << 1 | 1)
            ready = 0
            while not ready:
                _, _, ready = await ctx.tick().sample(component.i.ready)
                clock += 1
            sent.append(clock - 1)
            ctx.set(component.i.valid, 0)

    async def receive(ctx: Any) -> None:
        fields: Sequence[Any] = [component.o.payload[key] for key in component.o.payload.shape().members]
        for clock in range(limit):
            take = taken is None or taken(clock)
            ctx.set(component.o.ready, int(take))
            _, _, valid, *values = await ctx.tick().sample(component.o.valid, *fields)
            if take and valid:
                found.append([int(value) for value in values])
                clocks.append(clock)
                if len(found) == count:
                    return
        raise TimeoutError(f"{len(found)} of {count} payloads left in {limit} clocks")

    simulator = Simulator(component)
    simulator.add_clock(1e-6)
    simulator.add_testbench(send, background=True)
    simulator.add_testbench(receive)
    if count:
        simulator.run()
    columns = np.array(found, np.int64).reshape(len(found), -1).T
    return Run(dict(zip(component.o.payload.shape().members, columns)), np.array(clocks, np.int64), np.array(sent, np.int64))
