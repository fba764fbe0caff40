"""luxel info: what is in a file, and what is odd about it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from luxel.cli.console import Console, Json, Quiet, seconds

if TYPE_CHECKING:
    from luxel.scene.inspect import Report

EXAMPLE = "luxel info model.glb"
Cells = list[tuple[str, ...]]
_ROWS = 20  # of a table, without --all


def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A .glb, .gltf, .obj, .ply, .stl or .off.")],
    everything: Annotated[bool, typer.Option("--all", help=f"Tables of more than {_ROWS} rows in full.")] = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Show what is in a file, and what is odd about it."""
    from luxel import load
    from luxel.scene.inspect import inspect

    console = Console(quiet, as_json)
    start = time.perf_counter()
    scene = load(file, normals=False)  # the file's own
    loaded = time.perf_counter() - start
    report = inspect(scene)
    if as_json:
        data = {"file": str(file), "bytes": file.stat().st_size, "load_seconds": loaded, **report.as_dict()}
        console.result(data, "")
    elif not quiet:
        _show(file, loaded, report, None if everything else _ROWS)


def _show(file: Path, loaded: float, report: Report, rows: int | None) -> None:
    from rich.console import Console as RichConsole
    from rich.padding import Padding
    from rich.text import Text

    out = RichConsole(highlight=False, soft_wrap=False)
    size = " x ".join(f"{e:.4g}" for e in report.extent)
    low, high = (", ".join(f"{c:.4g}" for c in corner) for corner in report.bounds)
    out.print(Text.assemble((str(file), "bold"), f"  {_bytes(file.stat().st_size)}, loaded in {seconds(loaded)}"))
    counts = (_many(report.triangles, "triangle"), _many(report.vertices, "vertex"), _many(report.objects, "object"))
    out.print(f"  {', '.join(counts)}\n  {size} m, from ({low}) to ({high})")
    for title, columns, cells in _tables(report):
        if cells:
            out.print(Padding(_table(title, columns, cells, rows), (1, 0, 0, 2)))
    out.print()
    if not report.oddities:
        out.print("  Nothing odd.", style="green")
    for oddity in report.oddities[:rows]:
        where = Text(f"{oddity.where}: " if oddity.where else "", "dim")
        out.print(Text.assemble("  ", where, (f"{oddity.count:,} {oddity.kind}", "yellow"), f", {oddity.what}"))
    if rows and len(report.oddities) > rows:
        out.print(f"  ... and {len(report.oddities) - rows} more (--all)", style="dim")


def _tables(report: Report) -> list[tuple[str, tuple[str, ...], Cells]]:
    """Title, headings (a leading '>' aligns to the right) and cells of each table."""
    largest_first = sorted(report.meshes, key=lambda mesh: -mesh.triangles * max(mesh.instances, 1))
    meshes: Cells = [
        (
            m.name,
            f"{m.triangles:,}",
            f"{m.vertices:,}",
            str(m.instances),
            m.material,
            ", ".join(m.attributes),
            _closed(m),
        )
        for m in largest_first
    ]
    materials: Cells = [
        (m["name"], m["shading"], _alpha(m), _color(m["base_color"]), ", ".join(m["textures"]))
        for m in report.materials
    ]
    textures: Cells = [
        (t["name"], "{} x {}".format(*t["size"]), str(t["channels"]), t["dtype"], _bytes(t["bytes"]))
        for t in report.textures
    ]
    lights: Cells = [(x["name"], x["kind"], f"{x['intensity']:.4g}", _color(x["color"])) for x in report.lights]
    cameras: Cells = [(c["name"], c["kind"], _lens(c), ", ".join(f"{v:.4g}" for v in c["eye"])) for c in report.cameras]
    return [
        ("Meshes", ("name", ">triangles", ">vertices", ">instances", "material", "attributes", "surface"), meshes),
        ("Materials", ("name", "shading", "alpha", "base colour", "textures"), materials),
        ("Textures", ("name", ">size", ">channels", "type", ">memory"), textures),
        ("Lights", ("name", "kind", ">intensity", "colour"), lights),
        ("Cameras", ("name", "kind", ">lens", "eye"), cameras),
    ]


def _table(title: str, columns: tuple[str, ...], cells: Cells, rows: int | None) -> Any:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    heading = f"{title} ({len(cells)})"
    table = Table(title=heading, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        right = column.startswith(">")
        table.add_column(column.removeprefix(">"), justify="right" if right else "left", overflow="fold")
    for row in cells[:rows]:
        table.add_row(*map(escape, row))
    if rows and len(cells) > rows:
        table.caption = f"... and {len(cells) - rows} more (--all)"
        table.caption_justify = "left"
    return table


def _closed(mesh: Any) -> str:
    return "closed" if mesh.closed else "open"


def _alpha(material: dict[str, Any]) -> str:
    return material["alpha"].lower() + (", double-sided" if material["double_sided"] else "")


def _many(count: int, noun: str) -> str:
    plural = {"vertex": "vertices"}.get(noun, noun + "s")
    return f"{count:,} {noun if count == 1 else plural}"


def _bytes(count: int) -> str:
    value = float(count)
    for unit in ("B", "kB", "MB"):
        if value < 1000:
            return f"{value:.3g} {unit}"
        value /= 1000
    return f"{value:.3g} GB"


def _color(color: list[float]) -> str:
    return " ".join(f"{c:.2f}" for c in color[:3])


def _lens(camera: dict[str, Any]) -> str:
    if "height" in camera:
        return f"{camera['height']:.4g} m high"
    return f"{camera['yfov_degrees']:.1f} deg"
