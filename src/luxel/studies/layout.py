"""Greedy mesh layout for the vertex cache (2016): its experiments, and those of the papers that it compares itself with."""

from __future__ import annotations

from luxel.studies.report import Report
from luxel.studies.study import HERE, Context, Study

_EXAMPLE = ((1, 2), (1, 1), (2, 1), (3, 3))  # (C1, C2) of the paper's four candidates
_PRINTED = ((1.25, 1.5, 2.5, 3.17), (1.75, 2.5, 4.5, 4.17))  # their costs in the paper: Lin & Yu's without C3, and its own
PAPER = "the paper (2016)"


def run(context: Context, report: Report) -> None:
    """Every part of the study, shortest first."""
    _example(report)


def _example(report: Report) -> None:
    """The paper's worked example: which of four candidates each cost prefers."""
    rows = []
    for k, name in enumerate(("Lin & Yu: C1 + 0.5 / C2", "2016: C1 + 0.5 / C2 + C1 / C2")):
        ours = [c1 + 0.5 / c2 + k * c1 / c2 for c1, c2 in _EXAMPLE]
        for source, costs in ((HERE, ours), (PAPER, _PRINTED[k])):
            rows.append({"cost": name, "source": source} | {f"C1 {c[0]}, C2 {c[1]}": v for c, v in zip(_EXAMPLE, costs, strict=True)})
    report.table("example", "The paper's example", rows, "Cost of four candidates; C3 left out. Least is drawn first.")


STUDY = Study(
    "layout",
    "Triangle orders for the vertex cache",
    "the greedy mesh layout of 2016, with Lin & Yu 2006 and Sander, Nehab & Barczak 2007",
    run,
)
