"""Ranks beyond this machine: a model of a frame divided over ranks, checked against frames measured here, and run out to 10,000 ranks.

The files: `facts` (a frame that is really drawn: which triangle each pixel shows, which tile each triangle lies in), `messages` (what composition
sends, counted on that frame), `model` (seconds and bytes of a division), `calibrate` (what a triangle, a pixel, a tile and a message cost here),
`ranks` (the measured frames, run under mpiexec), `tables` (what the report says).
"""

from __future__ import annotations

from luxel.studies.report import Report
from luxel.studies.study import Context, Study


def run(context: Context, report: Report) -> None:
    """Measure, check the model, and run it out."""
    from luxel.studies.cluster import tables

    tables.run(context, report)


STUDY = Study(
    "cluster",
    "Ranks: dividing the screen, the triangles or both, from 1 to 10,000",
    "Molnar et al.: A sorting classification of parallel rendering, 1994; Romanyuk: Parallel shading of a triangle and parallel rendering of a frame",
    run,
)
