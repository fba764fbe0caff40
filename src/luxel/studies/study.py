"""What a study is, and what it is told about this run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from luxel.studies.report import Report

HERE = "here"
"""The `source` of what was measured in this run; anything else names the publication that the figures were read from."""


def _silent(done: float) -> None:
    """Tell nobody."""


@dataclass(frozen=True)
class Context:
    """What the user asked for.

    Attributes:
        quick: Minutes are too long: fewer and smaller cases, marked so in the report.
        threads: How many to use where the study does not vary them.
        meshes: A folder of models to use beside those made by code, or None.
        progress: To be told the fraction that is done, now and then.
    """

    quick: bool = False
    threads: int = 1
    meshes: Path | None = None
    progress: Callable[[float], None] = _silent


@dataclass(frozen=True)
class Study:
    """One paper's experiment.

    Attributes:
        name: As on the command line.
        title: What it looks at, in a few words.
        paper: Authors, title and year.
        run: Measures, and puts what it finds into the report, piece by piece: what is there is kept when it is interrupted.
    """

    name: str
    title: str
    paper: str
    run: Callable[[Context, Report], None]
