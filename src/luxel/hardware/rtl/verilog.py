"""Verilog of the circuit, a file a module."""

from __future__ import annotations

import tempfile
from pathlib import Path

from luxel.hardware.rtl import netlist
from luxel.hardware.synthesis import tools
from luxel.hardware.synthesis.designs import Design


def write(design: Design, folder: Path) -> list[Path]:
    """Write a design to `folder`: a file for every module, and `NAME.f`, which lists them for simulators (`iverilog -c`, `verilator -f`).

    Returns:
        The files, the list last.
    """
    units = netlist.units(design.make, design.top)
    names = [name for unit in units for name in unit.modules]
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        (place / "circuit.il").write_text("\n".join(unit.text for unit in units))
        writes = [f"select {name}\nwrite_verilog -noattr -selected {name}.v\nselect -clear" for name in names]
        tools.yosys("\n".join(["read_rtlil circuit.il", f"hierarchy -check -top {design.top}", "proc", *writes, ""]), place)
        files = []
        for name in names:
            files.append(folder / f"{name}.v")
            files[-1].write_text((place / f"{name}.v").read_text())
    files.append(folder / f"{design.top}.f")
    files[-1].write_text("".join(f"{path.name}\n" for path in files[:-1]))
    return files
