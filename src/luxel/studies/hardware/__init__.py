"""A hardware triangle colourer by barycentric interpolation (2016): what its numbers are worth, and what a circuit of them costs.

The paper gives a frequency, and no table of area, latency or error. The errors are measured here on the bit-exact model (`luxel.hardware`), next to
bounds that are derived.
"""

from __future__ import annotations

from collections.abc import Callable

from luxel.studies.hardware import accuracy, circuit, pictures, tables
from luxel.studies.report import Report
from luxel.studies.study import Context, Study

PAPER = "A hardware triangle colourer by barycentric interpolation (2016)"
PARTS: tuple[Callable[[Context, Report], None], ...] = (
    tables.formats, tables.smallest_tables, tables.bits_and_error, accuracy.widths, accuracy.families, accuracy.area,
    pictures.blocks_table, pictures.shown, circuit.modules, circuit.throughput, circuit.recorded,
)  # fmt: skip
"""What is measured, in the order of the report."""


def run(context: Context, report: Report) -> None:
    """Every part, one after the other."""
    for i, part in enumerate(PARTS):
        part(context, report)
        context.progress((i + 1) / len(PARTS))


STUDY = Study("hardware", "The colour interpolator in hardware", PAPER, run)
