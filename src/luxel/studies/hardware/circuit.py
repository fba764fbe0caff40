"""The circuit: its latency, simulated, and (not with `quick`) two of its modules through synthesis."""

from __future__ import annotations

import tempfile
from pathlib import Path

from luxel.errors import ExtraMissingError
from luxel.hardware.synthesis import tools
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context

_SYNTHESISED = ["reciprocal", "area"]


def modules(context: Context, report: Report) -> None:
    """Clocks from end to end of every module; what comes of synthesis is told by `luxel hardware synth`, which takes longer than a study."""
    try:
        from luxel.hardware.synthesis.designs import designs
        from luxel.hardware.synthesis.report import PAPER_MHZ, latency, on_ecp5

        known = designs()
    except ExtraMissingError as missing:
        report.say(f"The circuit is left out: {missing}.")
        return
    rows = [
        {"module": each.name, "source": HERE, "latency, clocks": latency(each), "takes one a clock": "fragment" if each.per_fragment else "triangle"}
        for each in known
    ]
    note = "Simulated in Amaranth, FIFOs at the end included; set-up and scan conversion together are `scan`. The paper gives none."
    report.table("circuit", "The circuit's latency", rows, note)
    if context.quick or not (tools.available("yosys") and tools.available("nextpnr-ecp5")):
        return
    with tempfile.TemporaryDirectory() as name:
        placed = [on_ecp5(each, Path(name), 1, "um5g-45k", 8, 1) for each in designs(_SYNTHESISED)]
    columns = ("module", "MHz", "LUTs", "registers", "multipliers", "memory, bits")
    found = [{key: row[key] for key in columns} | {"source": HERE} for row in placed]
    found.append({"module": "the paper, 0.13 um", "MHz": PAPER_MHZ, "source": "paper"})
    report.table("synthesis", "Two modules on an ECP5-5G (speed 8), one seed", found, "`luxel hardware synth` does all modules and the whole.")
