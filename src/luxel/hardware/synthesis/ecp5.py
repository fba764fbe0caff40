"""Lattice ECP5: Yosys, then placed and routed by nextpnr."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from luxel.hardware.synthesis import tools
from luxel.hardware.synthesis.designs import Design

DEVICES = ("12k", "25k", "45k", "85k", "um-25k", "um-45k", "um-85k", "um5g-25k", "um5g-45k", "um5g-85k")
"""As nextpnr names them; those of um5g have only speed grade 8."""
_REGISTERS = ("INPUTA", "INPUTB", "PIPELINE", "OUTPUT")
_SMALL = 19  # product bits up to which logic is as good as a hard multiplier
_FREQUENCY = "300"  # MHz that placing and routing tries for

_SCRIPT = """synth_ecp5 -nodsp -noflatten -top {top} -run :map_ffs
dffunmap -srst-only
synth_ecp5 -nodsp -noflatten -top {top} -run map_ffs:json
flatten
clean
write_json mapped.json
"""
"""Resets of registers become logic: the wires to a reset's pin are slow, and Yosys uses it for every "else 0"."""


@dataclass(frozen=True)
class Placed:
    """A design after place and route.

    Attributes:
        fmax: MHz, for each seed.
        luts, registers, multipliers: 4-input LUTs (those of carries and memory too), flip-flops, 18 x 18 multipliers.
        memory: Bits in LUTs, of 16 x 4 a piece.
        path: Of the slowest seed, the slowest path: from where to where, and nanoseconds of logic and of wire.
    """

    fmax: tuple[float, ...]
    luts: int
    registers: int
    multipliers: int
    memory: int
    path: str


def place(design: Design, folder: Path, seeds: int = 5, device: str = "um5g-45k", speed: int = 8, jobs: int = 1) -> Placed:
    """Synthesise a design, then place and route it with seeds 1 .. `seeds`, out of context (its ports are no pins).

    Operators stay modules until all is mapped, so each is mapped once; then the whole is flattened and placed as one.

    Raises:
        ToolError: A program is missing or failed.
    """
    synthesise(design, folder)
    with ThreadPoolExecutor(jobs) as pool:
        reports = list(pool.map(lambda seed: _route(folder, seed, device, speed), range(1, seeds + 1)))
    used = {name: int(value["used"]) for name, value in reports[0]["utilization"].items()}
    fmax = tuple(min(float(clock["achieved"]) for clock in report["fmax"].values()) for report in reports)
    slowest = reports[fmax.index(min(fmax))]
    return Placed(
        fmax, used["TRELLIS_COMB"], used["TRELLIS_FF"], used["MULT18X18D"], 64 * used.get("TRELLIS_RAMW", 0), path_of(slowest["critical_paths"]),
    )  # fmt: skip


def synthesise(design: Design, folder: Path) -> None:
    """Map a design to the cells of an ECP5: `mapped.json` in the folder, flat.

    Raises:
        ToolError: Yosys is missing or failed.
    """
    from luxel.hardware.rtl import netlist

    units = netlist.units(design.make, design.top)
    hard = hard_products(units)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "circuit.il").write_text("\n".join(unit.text for unit in units if unit not in hard))
    (folder / "hard.v").write_text("\n".join(multiplier(unit) for unit in hard))
    read = "read_rtlil circuit.il\n" + ("read_verilog hard.v\n" if hard else "")
    tools.yosys(read + _SCRIPT.format(top=design.top), folder)


def hard_products(units: list[Any]) -> list[Any]:
    """Those units of a circuit that a hard multiplier takes the place of."""
    return [unit for unit in units if unit.name.startswith("hard_product") and sum(p.width for p in unit.ports if p.name in "ab") > _SMALL]


def _route(folder: Path, seed: int, device: str, speed: int) -> dict[str, Any]:
    report = folder / f"report-{device}-{speed}-{seed}.json"
    part = [f"--{device}", "--speed", str(speed), "--out-of-context", "--freq", _FREQUENCY, "--timing-allow-fail", "--seed", str(seed)]
    tools.run("nextpnr-ecp5", ["-q", *part, "--json", "mapped.json", "--write", f"routed-{seed}.json", "--report", report.name], folder)
    (folder / f"routed-{seed}.json").unlink()
    return dict(json.loads(report.read_text()))


def path_of(paths: list[dict[str, Any]]) -> str:
    """The slowest path between two registers in words."""
    inside = [each["path"] for each in paths if "async" not in each["from"] and "async" not in each["to"]]
    if not inside:
        return ""
    worst = max(inside, key=lambda path: sum(float(step["delay"]) for step in path))
    wire = sum(float(step["delay"]) for step in worst if step["type"] == "routing")
    logic = sum(float(step["delay"]) for step in worst) - wire
    return f"{worst[0]['from']['cell']} to {worst[-1]['to']['cell']}: {logic:.2f} ns logic, {wire:.2f} ns wire"


def multiplier(unit: Any) -> str:
    """Verilog of a hard product as one MULT18X18D, with the registers that it has inside: its three clocks are those of the module."""
    ports = {port.name: port for port in unit.ports}

    def bits(name: str) -> str:
        port = ports[name]
        wires = [f"{name}[{min(i, port.width - 1)}]" if i < port.width or port.signed else "1'b0" for i in range(18)]
        return ", ".join(f".{name.upper()}{i}({wire})" for i, wire in enumerate(wires))

    a, b, p = (ports[name].width - 1 for name in "abp")
    registers = ", ".join(f'.REG_{each}_CLK("CLK0"), .REG_{each}_CE("CE0"), .REG_{each}_RST("RST0")' for each in _REGISTERS)
    outputs = ", ".join(f".P{i}(p[{i}])" for i in range(p + 1))
    signs = ", ".join(f".SIGNED{name.upper()}(1'b{int(ports[name].signed)}), .SOURCE{name.upper()}(1'b0)" for name in "ab")
    return f"""module {unit.name}(input clk, input rst, input go_next, input [{a}:0] a, input [{b}:0] b, output [{p}:0] p);
reg go = 0;
always @(posedge clk) go <= go_next;
MULT18X18D #({registers}) m ({bits("a")}, {bits("b")}, {signs}, .CLK0(clk), .CE0(go), .RST0(1'b0), {outputs});
endmodule
"""
