"""Standard cells of any Liberty file: Yosys and its ABC, timed by OpenSTA. Before layout: no wires, and a clock that comes everywhere at once."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from luxel.errors import FileError
from luxel.hardware.synthesis import tools
from luxel.hardware.synthesis.designs import Design

_PERIOD = 4.5  # ns: the paper's 222.2 MHz
_TARGET = 2500  # ps that ABC sizes cells for
_ABC = "strash;&get,-n;&st;&nf,-D,{d};&put;buffer,-c,-N,10;topo;upsize,-D,{d};dnsize,-D,{d}"
"""Maps the structure as it is (the adders are Kogge and Stone's), then buffers and sizes: ABC's own restructuring undoes such adders."""
_NAND = "module nand2(input a, input b, output y); assign y = ~(a & b); endmodule"


@dataclass(frozen=True)
class Mapped:
    """A design in standard cells.

    Attributes:
        fmax: MHz, of paths between registers.
        area: Square micrometres (the library's unit). gates: The same in two-input NANDs.
        registers: Flip-flops.
        path: The slowest path.
    """

    fmax: float
    area: float
    gates: float
    registers: int
    path: str


@dataclass(frozen=True)
class Library:
    """What the flow has to know about a Liberty file.

    Attributes:
        path: Of the file.
        gate: Its clock gate (name and pins), which takes the place of enabled flip-flops; "" if it has none.
        buffer: Its smallest buffer.
    """

    path: Path
    gate: str
    buffer: str


def read(path: Path) -> Library:
    """Look through a Liberty file.

    Raises:
        FileError: There is no such file, or it has no buffer.
    """
    try:
        text = path.read_text(errors="replace")
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror}") from None
    gate, buffers = "", []
    for cell in re.split(r"^\s*cell\s*\(", text, flags=re.M)[1:]:
        name = cell[: cell.index(")")].strip(' "')
        if re.search(r'clock_gating_integrated_cell\s*:\s*"latch_posedge"', cell) and not gate:
            gate = f"{name} {_pin(cell, 'enable')}:{_pin(cell, 'clock')}:{_pin(cell, 'out')}"
        functions = re.findall(r'\bfunction\s*:\s*"\(?(\w+)\)?"', cell)
        inputs = re.findall(r'direction\s*:\s*"?input', cell)
        area = re.search(r"\barea\s*:\s*([\d.]+)", cell)
        if len(functions) == len(inputs) == 1 and functions[0] not in "01" and area is not None and "dont_use : true" not in cell:
            buffers.append((float(area[1]), name))
    if not buffers:
        raise FileError(path, "expected a Liberty file of standard cells, found no buffer in it")
    return Library(path.resolve(), gate, min(buffers)[1])


def _pin(cell: str, role: str) -> str:
    for pin in re.split(r"^\s*pin\s*\(", cell, flags=re.M)[1:]:
        if re.search(rf"clock_gate_{role}_pin\s*:\s*true", pin):
            return pin[: pin.index(")")].strip(' "')
    return ""


def map_cells(design: Design, library: Library, folder: Path) -> Mapped:
    """Map a design to the cells of a library, operator by operator, and time it.

    Raises:
        ToolError: A program is missing or failed.
    """
    from luxel.hardware.rtl import netlist

    tools.command("sta")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "circuit.il").write_text("\n".join(unit.text for unit in netlist.units(design.make, design.top)))
    (folder / "cells.lib").write_bytes(library.path.read_bytes())
    (folder / "nand.v").write_text(_NAND)
    (folder / "constraints").write_text(f"set_driving_cell {library.buffer}\nset_load 10\n")
    tools.yosys("read_verilog nand.v\nsynth -top nand2 -noabc\nabc -liberty cells.lib\ntee -q -o area-nand stat -liberty cells.lib\n", folder)
    tools.yosys(_script(design.top, library), folder)
    flat = (folder / "mapped.v").read_text()
    (folder / "mapped.v").write_text(re.sub(r"\b(wire|input|output) signed\b", r"\1", flat))  # OpenSTA knows no signs
    (folder / "time.tcl").write_text(_timing(design.top))
    said = tools.run("sta", ["-no_splash", "-exit", "time.tcl"], folder).stdout.decode()
    slack = re.search(r"^\s*(-?[\d.]+)\s+slack", said, re.M)
    if slack is None:
        raise tools.ToolError(f"OpenSTA found no path between registers of {design.top}: {said[-500:]}")
    area, unit = (_area((folder / name).read_text()) for name in ("area", "area-nand"))
    registers = int((re.findall(r"^\s*(\d+)\s+\S*\s*\$_DFF\S*_\s*$", (folder / "registers").read_text(), re.M) or ["0"])[-1])
    return Mapped(1000 / (_PERIOD - float(slack[1])), area, area / unit, registers, _path(said))


def _script(top: str, library: Library) -> str:
    gate = f"clockgate -pos {library.gate} -min_net_size 3\n" if library.gate else ""
    abc = f"abc -liberty cells.lib -constr constraints -D {_TARGET} -script +{_ABC.format(d=_TARGET)}\n"
    return f"""read_rtlil circuit.il
synth -top {top} -noabc -extra-map +/choices/kogge-stone.v
{gate}dfflegalize -cell $_DFF_P_ 01
tee -q -o registers stat -top {top}
dfflibmap -liberty cells.lib
opt
{abc}setundef -zero
clean -purge
write_verilog -noattr -noexpr -simple-lhs mapped.v
tee -q -o area stat -liberty cells.lib -top {top}
"""


def _timing(top: str) -> str:
    """Pessimism about a clock that has two ways is not taken back, as an ideal clock has none."""
    return f"""read_liberty cells.lib
read_verilog mapped.v
link_design {top}
set sta_crpr_enabled 0
create_clock -name clk -period {_PERIOD} [get_ports clk]
report_checks -path_delay max -format full
exit
"""


def _area(report: str) -> float:
    return float(re.findall(r"Chip area for (?:top )?module '\S+':\s*([\d.]+)", report)[-1])


def _path(report: str) -> str:
    """Where the slowest path begins and ends."""
    ends = re.findall(r"^(?:Startpoint|Endpoint): (\S+)", report, re.M)
    cells = len(re.findall(r"^\s+[\d.]+\s+[\d.]+ [\^v] ", report, re.M)) - 2
    return f"{' to '.join(ends[:2])}, {max(cells, 0)} cells"
