"""luxel optimize: a file whose meshes a GPU's caches like."""

from __future__ import annotations

import json
from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet, seconds
from luxel.errors import InputError

if TYPE_CHECKING:
    from luxel.layout.optimize import Options, Report
    from luxel.scene.scene import Scene

EXAMPLE = "luxel optimize model.glb -o lean.glb --cache 16 --check --picture lean.png"


def _option(heading: str | None, *names: str, metavar: str | None = None, help: str) -> Any:
    return typer.Option(*names, metavar=metavar, help=help, rich_help_panel=heading, show_default=False)


_kinds = "A .glb, .gltf, .obj, .ply, .stl or .off."
File = Annotated[Path, typer.Argument(metavar="FILE", help=_kinds, show_default=False)]
_result = "The result, in any of these formats; the format of FILE keeps all it holds [none: only tell what it would bring]."
Output = Annotated[Path | None, _option(None, "-o", "--output", metavar="OUT", help=_result)]
Check = Annotated[bool, _option(None, "--check", help="Read OUT again, and prove that it is the same mesh.")]
Threads = Annotated[str | None, _option(None, "--threads", metavar="N", help="Of the processor [all].")]

_order = partial(_option, "Order")
_orders = "look-ahead, greedy, greedy-fifo, patches, greedy-2016, lin-yu, forsyth, tipsify, morton, random, file, auto: the best of several [auto]."
Order = Annotated[str, _order("--order", metavar="NAME", help=_orders)]
Cache = Annotated[str | None, _order("--cache", metavar="K", help="For a cache of so many vertices [12].")]
Policy = Annotated[str | None, _order("--policy", metavar="NAME", help="That works as fifo or lru [fifo].")]
Profile = Annotated[str | None, _order("--profile", metavar="GPU", help="In place of these: nvidia, amd, intel or mobile.")]
_limit = "Then sort clusters against overdraw, for so many times the cache misses, such as 1.05 [off]."
Overdraw = Annotated[str | None, _order("--overdraw", metavar="LIMIT", help=_limit)]
Seconds = Annotated[str | None, _order("--seconds", metavar="S", help="About so long for each mesh, where the order can choose.")]
Width = Annotated[str | None, _order("--width", metavar="N", help="look-ahead: orders kept side by side; 1 is fast, 64 the best [4].")]
Depth = Annotated[str | None, _order("--depth", metavar="N", help="look-ahead: settles after so many fans at the latest [64].")]
Weights = Annotated[str | None, _order("--weights", metavar="K1,K2,K3", help="lin-yu and greedy-2016: of the three terms of the cost.")]

_clean = partial(_option, "Cleaning")
Weld = Annotated[bool, _clean("--weld", help="Make one of vertices that are equal in all attributes.")]
Degenerate = Annotated[bool, _clean("--drop-degenerate", help="Drop triangles with two corners in one place.")]
Duplicates = Annotated[bool, _clean("--drop-duplicates", help="Drop triangles that come again, with the same winding.")]
Unused = Annotated[bool, _clean("--drop-unused", help="Drop vertices that no triangle uses.")]

_says = partial(_option, "What it says")
ReportFile = Annotated[Path | None, _says("--report", metavar="FILE", help="The figures, as .json.")]
Picture = Annotated[Path | None, _says("--picture", metavar="FILE", help="A .png: triangles by place in the order and by misses.")]


def optimize(
    file: File,
    output: Output = None,
    check: Check = False,
    threads: Threads = None,
    order: Order = "auto",
    cache: Cache = None,
    policy: Policy = None,
    profile: Profile = None,
    overdraw: Overdraw = None,
    seconds_: Seconds = None,
    width: Width = None,
    depth: Depth = None,
    weights: Weights = None,
    weld: Weld = False,
    drop_degenerate: Degenerate = False,
    drop_duplicates: Duplicates = False,
    drop_unused: Unused = False,
    report: ReportFile = None,
    picture: Picture = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Order a file's triangles and vertices for the caches of a GPU.

    What is drawn stays the same. Shows caches, overdraw and fetches before and after. Under mpiexec the ranks share the work; a binary .ply of
    triangles is then larger than any of them need hold.
    """
    from luxel.cluster.comm import world
    from luxel.cluster.launchers import launched
    from luxel.layout.files import FORMATS, optimize_file
    from luxel.layout.optimize import Options

    comm = world()
    with comm.guard():  # before anything is looked at: what one rank cannot do ends all
        if profile is not None and (cache is not None or policy is not None):
            raise InputError("--profile is a cache of its own: it goes without --cache and --policy")
        more: dict[str, Any] = {name: values.whole(text, f"--{name}", 1) for name, text in (("width", width), ("depth", depth)) if text is not None}
        if weights is not None:
            more["weights"] = tuple(values.number(word, "--weights", "numbers such as 1,0.5,1.3") for word in weights.split(","))
        options = _checked_names(order, policy, profile)
        options |= {
            "cache": 12 if cache is None else values.whole(cache, "--cache", 3),
            "overdraw": None if overdraw is None else values.number(overdraw, "--overdraw", "a factor of at least 1, such as 1.05", lambda x: x >= 1),
            "seconds": None if seconds_ is None else values.number(seconds_, "--seconds", "a number above 0", lambda x: x > 0),
            "threads": None if threads is None else values.whole(threads, "--threads", 1),
        }
        for path, extensions, option in ((output, FORMATS, "--output"), (report, (".json",), "--report"), (picture, (".png",), "--picture")):
            if path is not None:
                values.output(path, extensions, option)
        chosen = Options(**options, weld=weld, drop_degenerate=drop_degenerate, drop_duplicates=drop_duplicates, drop_unused=drop_unused, more=more)
        console = Console(quiet, as_json)
        measures = not quiet or as_json or report is not None or picture is not None
        if launched():
            from luxel.cli.ranks import optimize_with_ranks

            result = optimize_with_ranks(comm, console, file, output, chosen, measures, check, picture)
            if result is None:
                return
            found, scenes = result
        else:
            with console.work("ordering") as told:
                found, scenes = optimize_file(file, output, chosen, measures=measures, check=check, progress=told)
        if picture is not None:
            _draw(picture, file, scenes, chosen)
        data = {"file": str(file), "output": None if output is None else str(output), "checked": check, **found.as_dict()}
        if report is not None:
            _write(report, data)
        if as_json:
            console.result(data, "")
        elif not quiet:
            _show(file, output, check, found)


def _checked_names(order: str, policy: str | None, profile: str | None) -> dict[str, Any]:
    """The names, if there are such."""
    from luxel.layout import ORDERS
    from luxel.layout.batch import MODELS
    from luxel.layout.cache import POLICIES

    return {
        "order": values.choice(order, ORDERS, "--order"),
        "policy": "fifo" if policy is None else values.choice(policy, POLICIES, "--policy"),
        "profile": None if profile is None else values.choice(profile, tuple(MODELS), "--profile"),
    }


def _draw(path: Path, file: Path, scenes: list[Scene], options: Options) -> None:
    from luxel.io.images import write_png
    from luxel.layout.pictures import picture

    if len(scenes) != 2:
        raise InputError(f"--picture: {file} needs what luxel cannot read, so it cannot be drawn")
    before, after = scenes
    write_png(path, picture(before, after, options.cache, options.policy, options.profile, threads=options.threads))


def _write(path: Path, data: dict[str, Any]) -> None:
    from luxel.io.files import atomic_write

    with atomic_write(path) as file:
        file.write(json.dumps(data, indent=1, allow_nan=False).encode())


def _show(file: Path, output: Path | None, check: bool, report: Report) -> None:
    from rich.console import Console as RichConsole
    from rich.table import Table
    from rich.text import Text

    out = RichConsole(highlight=False, emoji=False, markup=False)
    table = Table(box=None, header_style="dim", padding=(0, 3, 0, 0), pad_edge=False)
    table.add_column("")
    for name in ("best", "before", "after", "change"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in _rows(report):
        table.add_row(row[0], *(Text(cell) for cell in row[1:]))
    if table.row_count:
        out.print(table)
        out.print()
    spent = report.seconds.get("order", 0.0) + report.seconds.get("overdraw", 0.0)
    triangles, vertices = (report.after.triangles, report.after.vertices) if report.after else (0, 0)
    rate = f", {triangles / spent / 1e6:.2f} M triangles/s" if spent > 0 and triangles >= 1000 else ""
    orders = ", ".join(f"{name} ({count})" if len(report.orders) > 1 else name for name, count in Counter(report.orders).most_common())
    out.print(f"for {report.target}: {orders or 'nothing to order'}; ordered in {seconds(spent)}{rate}", soft_wrap=True)
    gone = _gone(report)
    if gone:
        out.print(gone, soft_wrap=True)
    if check:
        out.print("checked: the same triangles, with everything at their corners", style="green", soft_wrap=True)
    counts = f"({triangles:,} triangles, {vertices:,} vertices)"
    out.print(f"{output}  {counts}" if output is not None else f"{file} stays as it is; -o OUT writes the result  {counts}", soft_wrap=True)


def _gone(report: Report) -> str:
    parts = [
        (report.welded, "vertices welded"),
        (report.unused, "unused vertices dropped"),
        (report.degenerate, "degenerate triangles dropped"),
        (report.duplicates, "duplicate triangles dropped"),
    ]
    return ", ".join(f"{count:,} {what}" for count, what in parts if count)


def _rows(report: Report) -> list[tuple[str, str, str, str, str]]:
    """The table: measure, its best value, before, after, change."""
    a, b = report.before, report.after
    if a is None or b is None or not (a.triangles and b.triangles):
        return []
    floor = b.vertices / b.triangles
    rows: list[tuple[str, float, float | None, float | None]] = [(f"ACMR, FIFO {k}", floor, a.acmr[k], b.acmr[k]) for k in a.acmr]
    rows += [(f"ATVR, {name}", 1.0, a.atvr[name], b.atvr[name]) for name in a.atvr]
    rows += [
        ("overdraw, mean", 1.0, a.overdraw, b.overdraw),
        ("overdraw, worst view", 1.0, a.worst_overdraw, b.worst_overdraw),
        ("overfetch", 1.0, a.overfetch, b.overfetch),
        ("edge span, vertices", 1.0, a.edge_span, b.edge_span),
    ]
    return [(name, f"{best:.3f}", f"{x:.3f}", f"{y:.3f}", f"{y / x - 1:+.1%}") for name, best, x, y in rows if x is not None and y is not None]
