"""luxel info: what is in a file, and what is odd about it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from luxel.cli.console import Console, Json, Quiet, seconds

if TYPE_CHECKING:
    from luxel.scene.inspect import Oddity, Report

EXAMPLE = "luxel info model.glb"
Cells = list[tuple[str, ...]]
_ROWS = 20  # of a table, without --all
_STATES = ("no triangles", "tiny extent", "huge extent", "far from the origin")  # oddities of which there is one or none
_UNFOLDED = 10_000  # columns: what goes into a file or to another program keeps its lines whole,
_NARROW = 72  # and so does what a narrower terminal wraps more readably than a table folds


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
    from rich.text import Text

    out = RichConsole(highlight=False, emoji=False, markup=False)
    if not out.is_terminal or out.width < _NARROW:
        out.width = _UNFOLDED
    size = " x ".join(f"{e:.4g}" for e in report.extent)
    low, high = (", ".join(f"{c:.4g}" for c in corner) for corner in report.bounds)
    title = Text.assemble((str(file), "bold"), f"  {_bytes(file.stat().st_size)}, loaded in {seconds(loaded)}")
    out.print(title, soft_wrap=True)
    counts = (_many(report.triangles, "triangle"), _many(report.vertices, "vertex"), _many(report.objects, "object"))
    out.print(f"  {', '.join(counts)}\n  {size} m, from ({low}) to ({high})", soft_wrap=True)
    for heading, columns, cells in _tables(report):
        if cells:
            out.print(f"\n{heading} ({len(cells)})", style="bold")
            out.print(_table(columns, cells[:rows]), soft_wrap=out.width == _UNFOLDED)
            if rows and len(cells) > rows:
                out.print(f"  ... and {len(cells) - rows} more (--all)", style="dim")
    out.print("\nOdd" if report.oddities else "\nNothing odd.", style="bold" if report.oddities else "green")
    for count, kind, where, what in _grouped(report, everything=rows is None):
        counted = kind if kind in _STATES else f"{count:,} {kind}"
        out.print(Text.assemble("  ", (counted, "yellow"), where, (f"  ({what})", "dim")), soft_wrap=True)


def _grouped(report: Report, everything: bool) -> list[tuple[int, str, str, str]]:
    """Count, kind, where and meaning: one line a kind, or one for each mesh as well."""
    if everything:
        return [(o.count, o.kind, f" in {o.where}" if o.where else "", o.what) for o in report.oddities]
    kinds: dict[str, list[Oddity]] = {}
    for oddity in report.oddities:
        kinds.setdefault(oddity.kind, []).append(oddity)
    lines = []
    for kind, found in kinds.items():
        where = f" in {len(found)} places" if len(found) > 1 else f" in {found[0].where}" if found[0].where else ""
        lines.append((sum(oddity.count for oddity in found), kind, where, found[0].what))
    return lines


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
            _attributes(m),
            _closed(m),
        )
        for m in largest_first
    ]
    materials: Cells = [(m["name"], m["shading"], _alpha(m), _color(m["base_color"]), ", ".join(m["textures"])) for m in report.materials]
    textures: Cells = [(t["name"], "{} x {}".format(*t["size"]), str(t["channels"]), t["dtype"], _bytes(t["bytes"])) for t in report.textures]
    lights: Cells = [(x["name"], x["kind"], f"{x['intensity']:.4g}", _color(x["color"])) for x in report.lights]
    cameras: Cells = [(c["name"], c["kind"], _lens(c), ", ".join(f"{v:.4g}" for v in c["eye"])) for c in report.cameras]
    return [
        ("Meshes", ("name", ">triangles", ">vertices", ">used", "material", "has", "surface"), meshes),
        ("Materials", ("name", "shading", "alpha", "base colour", "textures"), materials),
        ("Textures", ("name", ">size", ">channels", "type", ">memory"), textures),
        ("Lights", ("name", "kind", ">intensity", "colour"), lights),
        ("Cameras", ("name", "kind", ">lens", "eye"), cameras),
    ]


def _table(columns: tuple[str, ...], cells: Cells) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, header_style="dim", padding=(0, 2, 0, 0), pad_edge=True)
    table.add_column("")
    used = [i for i in range(len(columns)) if any(row[i] for row in cells)]
    for column in (columns[i] for i in used):
        right = column.startswith(">")
        table.add_column(column.removeprefix(">"), justify="right" if right else "left", overflow="fold", no_wrap=right)
    for row in cells:
        table.add_row("", *(Text(row[i]) for i in used))
    return table


def _attributes(mesh: Any) -> str:
    short = {"normals": "normal", "texcoords": "uv", "texcoords1": "uv1", "colors": "color", "tangents": "tangent"}
    return " ".join(short[name] for name in mesh.attributes)


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
