"""What synthesis found, in a table next to the paper's figure."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from luxel.hardware.synthesis import ecp5, liberty
from luxel.hardware.synthesis.designs import Design

PAPER_MHZ = 222.2
"""After synthesis in a 0.13 um process, says the paper; it gives no area and no latency."""


def latency(design: Design) -> int:
    """Clocks from the first input's arrival to the first output, simulated: a triangle of one pixel, or of zeros where there are no corners."""
    import numpy as np

    from luxel.hardware.rtl.simulate import run

    component = design.make()
    fields = component.i.payload.shape().members
    corner = {"x0": 0, "y0": 0, "x1": 0, "y1": 512, "x2": 512, "y2": 0}
    ports: Any = {name: 63 for name in ("right", "bottom") if hasattr(component, name)}
    found = run(component, {key: np.array([corner.get(key, 0)]) for key in fields}, 1, limit=1000, **ports)
    return int(found.clocks[0] - found.sent[0])


def on_ecp5(design: Design, folder: Path, seeds: int, device: str, speed: int, jobs: int) -> dict[str, Any]:
    """A row: Fmax over the seeds, what is used, and what comes of it."""
    found = ecp5.place(design, folder / design.name, seeds, device, speed, jobs)
    middle = median(found.fmax)
    return {
        "module": design.name, "MHz": middle, "MHz, least": min(found.fmax), "MHz, most": max(found.fmax), "seeds": len(found.fmax),
        "LUTs": found.luts, "registers": found.registers, "multipliers": found.multipliers, "memory, bits": found.memory,
        "latency, clocks": latency(design), "M a second": middle, "of": "fragments" if design.per_fragment else "triangles",
        "slowest path": found.path,
    }  # fmt: skip


def in_cells(design: Design, folder: Path, library: liberty.Library) -> dict[str, Any]:
    """A row: Fmax before layout, and area."""
    found = liberty.map_cells(design, library, folder / design.name)
    return {
        "module": design.name, "MHz": found.fmax, "area, mm2": found.area / 1e6, "gates (NAND2), k": found.gates / 1e3,
        "registers": found.registers, "latency, clocks": latency(design), "M a second": found.fmax,
        "of": "fragments" if design.per_fragment else "triangles", "slowest path": found.path,
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """Rows as Markdown, without the paths; the paper's figure last."""
    names = [name for name in rows[0] if name != "slowest path"]
    paper = {"module": "the paper, 0.13 um, synthesis", "MHz": PAPER_MHZ}
    lines = [[_cell(row.get(name, "")) for name in names] for row in [*rows, paper]]
    widths = [max(len(line[k]) for line in [names, *lines]) for k in range(len(names))]
    rule = [f"{'-' * (width - 1)}{'-' if k == 0 else ':'}" for k, width in enumerate(widths)]
    shown = [names, rule, *lines]
    return "\n".join("| " + " | ".join(f"{cell:{'<' if k == 0 else '>'}{widths[k]}}" for k, cell in enumerate(line)) + " |" for line in shown)


def rows_of(each: list[Design], make: Callable[[Design], dict[str, Any]], progress: Callable[[float, str], None]) -> list[dict[str, Any]]:
    """A row for every design, with word of how far it is."""
    rows = []
    for k, design in enumerate(each):
        progress(k / len(each), design.name)
        rows.append(make(design))
    progress(1, "")
    return rows


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.1f}" if value >= 10 else f"{value:.3g}"
    return f"{value:,}" if isinstance(value, int) else str(value)
