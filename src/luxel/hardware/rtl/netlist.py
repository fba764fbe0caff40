"""Circuits as text: every operator a module of its own, so that the Verilog can be read, and synthesis does each once."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

from amaranth.back import rtlil

from luxel.hardware.rtl.pipeline import Operator, library

_PORT = re.compile(r"^ *wire width (\d+) (input|output) \d+ *(signed)? *\\(\S+)$", re.M)


class Port(NamedTuple):
    """A port of a module."""

    name: str
    width: int
    signed: bool
    output: bool


class Unit(NamedTuple):
    """A module, and those of its own that are no operators, in RTLIL (Yosys' own language)."""

    name: str
    text: str
    ports: list[Port]

    @property
    def modules(self) -> list[str]:
        """Names of all that are in it."""
        return re.findall(r"^module \\(\S+)$", self.text, re.M)


def units(make: Callable[[], Any], top: str) -> list[Unit]:
    """The modules of a circuit, those used before those that use them.

    Args:
        make: Makes it: an operator, or a component.
        top: Name for the outermost module.
    """
    with library() as operators:
        outermost = _unit(make(), top)
    return [*(_unit(operator, name) for name, operator in operators.items()), outermost]


def _unit(design: Any, name: str) -> Unit:
    ports = None
    if isinstance(design, Operator):
        ports = [*design.i.values(), *design.o.values(), design.go_next]
        design = design.module()
    text = rtlil.convert(design, ports=ports, name=name, emit_src=False)
    own = text[text.index(f"module \\{name}\n") :]
    own = own[: own.index("\nend\n")]
    text = re.sub(rf"\\{name}(\.\w+)+", lambda path: path[0].replace(".", "_"), text.replace("attribute \\top 1\n", ""))
    return Unit(name, text, [Port(n, int(w), bool(s), way == "output") for w, way, s, n in _PORT.findall(own)])
