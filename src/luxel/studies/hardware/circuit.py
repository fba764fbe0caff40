"""The circuit: its latency, simulated; two of its modules through synthesis (not with `quick`); and what synthesis of all has found, as recorded."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from luxel.errors import ExtraMissingError
from luxel.hardware.synthesis import tools
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context

RECORDED = Path(__file__).with_name("synthesis.json")
"""What `luxel hardware synth` has found, which takes too long for a study: written by benchmarks/hardware.py."""
PAPER = "paper"
_SYNTHESISED = ["reciprocal", "area"]
_LEFT_OUT = ("M a second", "of", "slowest path")


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
    found.append({"module": "the paper, 0.13 um", "MHz": PAPER_MHZ, "source": PAPER})
    report.table("synthesis", "Two modules on an ECP5-5G (speed 8), one seed", found, "`luxel hardware synth` does all modules and the whole.")


def recorded(context: Context, report: Report) -> None:
    """All modules through synthesis, on an ECP5 and in standard cells: not measured in this run."""
    for record in json.loads(RECORDED.read_text()):
        name = "recorded_ecp5" if record["target"].startswith("ECP5") else "recorded_cells"
        rows = [{key: value for key, value in row.items() if key not in _LEFT_OUT} | {"source": "recorded"} for row in record["modules"]]
        rows.append({"module": "the paper, 0.13 um", "MHz": 222.2, "source": PAPER})
        note = f"**Recorded, not measured in this run**: by `luxel hardware synth`, {record['made']}."
        report.table(name, f"All modules: {record['target']}", rows, note)
