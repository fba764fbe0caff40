"""luxel study: a paper's experiment, run on this machine."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet, seconds
from luxel.errors import FileError, InputError

EXAMPLE = "luxel study layout --quick -o layout-study"


def study(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="Which; see --list.", show_default=False)] = None,
    listed: Annotated[bool, typer.Option("--list", help="Name the studies there are.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FOLDER", help="Where to write [study-NAME, here].", show_default=False)
    ] = None,
    meshes: Annotated[
        Path | None, typer.Option("--meshes", metavar="FOLDER", help="Models to use beside those made by code.", show_default=False)
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer and smaller cases.")] = False,
    threads: Annotated[str | None, typer.Option("--threads", metavar="N", help="Of the processor [all].", show_default=False)] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Run a paper's experiment on this machine.

    Writes a folder: README.md, tables (also CSV and JSON), figures and pictures, with published figures beside and marked as such.
    """
    from luxel.studies import NAMES, find

    console = Console(quiet, as_json)
    if listed:
        known = [find(each) for each in NAMES]
        width = max(map(len, NAMES))
        data = {"studies": [{"name": each.name, "title": each.title, "paper": each.paper} for each in known]}
        console.result(data, "\n".join(f"{each.name:{width}}  {each.title}\n{'':{width}}  after {each.paper}" for each in known))
        return
    if name is None:
        raise InputError(f"NAME: expected one of {', '.join(NAMES)}; --list says what they are")
    values.choice(name, NAMES, "NAME")
    chosen = None if threads is None else values.whole(threads, "--threads", 1)
    if meshes is not None and not meshes.is_dir():
        raise FileError(meshes, "--meshes: there is no such folder")
    _run(console, name, output or Path(f"study-{name}"), meshes, quick, chosen)


def _run(console: Console, name: str, folder: Path, meshes: Path | None, quick: bool, threads: int | None) -> None:
    from luxel.jit import checked_threads
    from luxel.studies import find
    from luxel.studies.report import Report
    from luxel.studies.study import Context

    start = time.perf_counter()
    study = find(name)
    report = Report(folder, study, quick)
    with console.work(study.name) as told:
        study.run(Context(quick, checked_threads(threads), meshes, told), report)
    took = time.perf_counter() - start
    data = {"output": [str(path) for path in report.files], "study": name, "quick": quick, "seconds": took}
    console.result(data, f"{folder / 'README.md'}  ({len(report.files)} files, {seconds(took)})")
