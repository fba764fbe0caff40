"""Parallel shading of a triangle (Romanyuk): its schemes in fixed point, run step by step, and as compiled loops of this processor.

The files: `fixed` (registers, exact planes), `coverage` (which pixels: asked of luxel's rasteriser), `interpolators` (kernels that step), `schemes`
(what there is, and of what it is made), `fill` (a triangle by a scheme); then the parts of the study.
"""

from __future__ import annotations

from typing import Any

from luxel.studies.report import Report
from luxel.studies.study import Context, Study


def run(context: Context, report: Report) -> None:
    """Every part of the study; the last judges what the others found."""
    from luxel.studies.shading import accuracy, balance, claims, cpu, pictures, speed

    facts: dict[str, Any] = {}
    parts = (speed.run, accuracy.run, pictures.run, balance.run, cpu.run, claims.run)
    for k, part in enumerate(parts):
        part(context, report, facts)
        context.progress((k + 1) / len(parts))


STUDY = Study(
    "shading",
    "Parallel shading: counter, wave, interleaved interpolation and midlines",
    "Romanyuk: Parallel shading of a triangle, and parallel rendering of a frame",
    run,
)
