"""Anti-aliasing of triangle rasterisation, and its parallelisation (2021): its experiments, and how its strategies compare with what luxel does."""

from __future__ import annotations

from luxel.studies.report import Report
from luxel.studies.study import Context, Study

PAPER = "the paper (2021)"


def run(context: Context, report: Report) -> None:
    """Every part of the study, in the paper's order."""
    from luxel.studies.antialiasing import fourier, quality, schedule, traffic

    parts = (schedule.run, traffic.run, fourier.run, quality.run)
    for k, part in enumerate(parts):
        part(context, report)
        context.progress((k + 1) / len(parts))


STUDY = Study(
    "antialiasing",
    "Anti-aliasing: samples, schedules, memory traffic and frequencies",
    "Anti-aliasing of triangle rasterisation, and its parallelisation (2021)",
    run,
)
