"""The papers' experiments, run on this machine: `luxel study NAME` writes a folder of tables, figures and pictures.

One file a paper. To add one, write `luxel/studies/NAME.py` and put its name into `NAMES` below; the command line finds it there:

    from luxel.studies.study import HERE, Context, Study
    from luxel.studies.report import Report

    def run(context: Context, report: Report) -> None:
        report.say("What is measured, and how.")
        rows = [{"model": "bunny", "source": HERE, "ACMR": 0.61}, {"model": "bunny", "source": "Lin & Yu 2006", "ACMR": 0.628}]
        report.table("acmr", "ACMR", rows)                       # acmr.csv, acmr.json, and a table in README.md
        with report.figure("acmr", "ACMR over size") as axes:    # acmr.png; `axes` is matplotlib's
            axes.plot([1, 10], [0.7, 0.6], "o-", label="luxel")
            published(axes, [1, 10], [0.7, 0.65], "Lin & Yu 2006")  # dashed, hollow, marked as not ours
        report.picture("bunny", "Triangles by place in the order", image)  # (h, w, 3 or 4) uint8

    STUDY = Study("NAME", "Title in a few words", "Authors: Title of the paper, year", run)

What comes from a paper says so in its `source`. Import what is heavy inside functions: `luxel study --list` imports every study.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from luxel.studies.study import Study

NAMES: tuple[str, ...] = ("antialiasing", "cluster", "hardware", "layout", "shading")
"""The studies there are, each a module of this package."""


def find(name: str) -> Study:
    """The study of that name, one of `NAMES`."""
    study: Study = import_module(f"luxel.studies.{name}").STUDY
    return study
