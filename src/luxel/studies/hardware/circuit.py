"""The circuit: its latency, simulated; two of its modules through synthesis (not with `quick`); and what synthesis of all has found, as recorded."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import ExtraMissingError
from luxel.fixed import SUBPIXEL
from luxel.hardware.scan import scan
from luxel.hardware.synthesis import tools
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context

RECORDED = Path(__file__).with_name("synthesis.json")
"""What `luxel hardware synth` has found, which takes too long for a study: written by benchmarks/hardware.py."""
PAPER = "paper"
_WINDOW = 64
_GROUPS = ((1, 60), (2, 60), (3, 60), (5, 60), (8, 40), (300, 3))
_QUICK_GROUPS = ((1, 12), (3, 12), (8, 12), (150, 1))
"""Pixels of triangles, and how many of them: small ones first, as larger ones leave no clock unused and so hide what comes next."""
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
    found.append({"module": "the paper, 0.13 um", "MHz": PAPER_MHZ, "source": PAPER})
    report.table("synthesis", "Two modules on an ECP5-5G (speed 8), one seed", found, "`luxel hardware synth` does all modules and the whole.")


def triangles_of(rng: np.random.Generator, pixels: float, count: int) -> Array:
    """(count, 3, 2) int64 corners in 1/256 pixel, about regular, of about so many pixels each, anywhere in the window of the simulation."""
    radius = np.sqrt(pixels * 4 / 27**0.5)
    angles = rng.random((count, 1)) * 2 * np.pi + np.arange(3) * 2 * np.pi / 3 + rng.normal(0, 0.2, (count, 3))
    middle = radius + rng.random((count, 1, 2)) * (_WINDOW - 2 * radius)
    return np.rint(SUBPIXEL * (middle + radius * np.stack([np.cos(angles), np.sin(angles)], -1))).astype(np.int64)


def throughput(context: Context, report: Report) -> None:
    """Fragments a clock of the whole, by the size of triangles: for a receiver that takes on every clock, and for one that often does not."""
    try:
        from luxel.hardware.rtl.barycentric import COLORS
        from luxel.hardware.rtl.simulate import run
        from luxel.hardware.rtl.whole import Interpolator
    except ExtraMissingError:
        return  # which `modules` has said
    rng, rows = np.random.default_rng(6), []
    groups = [triangles_of(rng, pixels, count) for pixels, count in (_QUICK_GROUPS if context.quick else _GROUPS)]
    corners = np.concatenate(groups)
    fields = {f"{axis}{k}": corners[:, k, i] for k in range(3) for i, axis in enumerate("xy")}
    fields |= dict.fromkeys(COLORS, np.zeros(len(corners), np.int64))
    ends = np.cumsum([sum(len(scan(each, _WINDOW, _WINDOW).x) for each in group) for group in groups])
    for taken, said in ((0.7, "7 of 10, at random"),) if context.quick else ((1.0, "every clock"), (0.7, "7 of 10, at random")):
        ready = rng.random(1_000_000) < taken
        found = run(Interpolator(), fields, int(ends[-1]), taken=ready.item, right=_WINDOW - 1, bottom=_WINDOW - 1)
        for group, first, end in zip(groups, [0, *ends], ends):
            clocks = ready[found.clocks[first] : found.clocks[end - 1] + 1].sum()
            rows.append({"receiver takes on": said, "source": HERE, "triangles": len(group), "pixels each": (end - first) / len(group),
                         "clocks on which it takes": int(clocks), "with a fragment, %": 100 * (end - first) / clocks})  # fmt: skip
    note = "The whole circuit in Amaranth's simulator, one size of triangles after the other, from the first fragment of a size to its last."
    report.table("throughput", "Fragments a clock", rows, note)


def shown(modules: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of `luxel hardware synth` for a table: what a module does a second in one cell, and no paths."""
    left_out = ("M a second", "of", "slowest path")
    return [
        {key: value for key, value in row.items() if key not in left_out} | {"a second": f"{row['M a second']:.0f} M {row['of']}"}
        for row in modules
    ]


def recorded(context: Context, report: Report) -> None:
    """All modules through synthesis, on an ECP5 and in standard cells: not measured in this run."""
    for record in json.loads(RECORDED.read_text()):
        name = "recorded_ecp5" if record["target"].startswith("ECP5") else "recorded_cells"
        rows = [row | {"source": "recorded"} for row in shown(record["modules"])]
        rows.append({"module": "the paper, 0.13 um", "MHz": 222.2, "source": PAPER})
        note = f"**Recorded, not measured in this run**: by `luxel hardware synth`, {record['made']}."
        report.table(name, f"All modules: {record['target']}", rows, note)
