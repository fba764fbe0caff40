"""Steps: how much faster each scheme fills a span and a triangle, how busy it is, and what it costs in adders."""

from __future__ import annotations

from typing import Any

import numpy as np

from luxel.studies.report import Report
from luxel.studies.shading.fill import Filled, Triangle, fill
from luxel.studies.shading.schemes import (
    CLASSICAL,
    CONTROL,
    COUNTERED,
    ENDS,
    INTERLEAVES,
    LITERAL,
    MIDLINES,
    PLANE,
    SCHEMES,
    VARIANTS,
    WAVE,
    Machine,
    Scheme,
)
from luxel.studies.shading.shapes import SHAPES, random_triangle, span
from luxel.studies.study import Context

Row = dict[str, Any]
_ON_LINES = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.8}
SPAN_SCHEMES = (CLASSICAL, COUNTERED, *INTERLEAVES)
_MACHINES = {
    "4 steps a row": (Machine(), ENDS),
    "4, overlapped": (Machine(overlapped=True), ENDS),
    "plane's slopes, 1 a row": (Machine(), PLANE),
    "nothing": (Machine(0, 0), ENDS),
}


def span_rows(lengths: list[int]) -> list[Row]:
    """Speed-up over one interpolator on a row of pixels, with set-up and without."""
    rows = []
    for length in lengths:
        what = span(length)
        for name in ("4 steps a row", "nothing"):
            machine, source = _MACHINES[name]
            steps = {scheme.name: fill(what, scheme, machine=machine, source=source).steps for scheme in SPAN_SCHEMES}
            ratios = {f"{key}, x": steps["classical"] / value for key, value in steps.items() if key != "classical"}
            rows.append({"pixels": length, "set-up": name, "classical, steps": steps["classical"]} | ratios)
    return rows


def triangles(areas: list[int], count: int, shape: str, seed: int = 5) -> dict[int, list[Triangle]]:
    """`count` triangles of each area, fewer of the largest."""
    rng = np.random.default_rng(seed)
    return {area: [random_triangle(rng, area, shape) for _ in range(max(6, min(count, count * 2048 // area)))] for area in areas}


def area_row(scheme: Scheme, what: list[Triangle], baseline: list[Filled], machine: Machine, source: str) -> Row:
    """A scheme on triangles beside one interpolator on the same, by sums over all of them."""
    filled = [fill(one, scheme, machine=machine, source=source) for one in what]
    steps, pixels = sum(f.steps for f in filled), sum(f.pixels for f in filled)
    slots = sum(f.units * f.steps for f in filled)
    covered = sum(one.covered.pixels for one in what)
    return {"scheme": scheme.name, "speed-up": sum(f.steps for f in baseline) / steps, "steps a triangle": steps / len(what),
            "pixels a triangle": covered / len(what), "utilisation": pixels / slots, "idle a triangle": (slots - pixels) / len(what),
            "units, most": max(f.units for f in filled), "seeds, mean": sum(f.seeds for f in filled) / len(what),
            "repaired": sum(f.repaired for f in filled) / max(1, covered), "missed": 1 - pixels / max(1, covered)}  # fmt: skip


def area_rows(what: dict[int, list[Triangle]], shape: str, schemes: tuple[Scheme, ...], setup: str = "4 steps a row") -> list[Row]:
    """Every scheme on every area."""
    machine, source = _MACHINES[setup]
    rows = []
    for area, some in what.items():
        baseline = [fill(one, CLASSICAL, machine=machine, source=source) for one in some]
        rows += [{"shape": shape, "area": area, "set-up": setup} | area_row(scheme, some, baseline, machine, source) for scheme in schemes]
    return rows


def resource_rows(rows: list[Row], area: int) -> list[Row]:
    """What each scheme is made of, and the speed-up that buys on triangles of one area."""
    found = []
    chosen = {row["scheme"]: row for row in rows if row["area"] == area and row["shape"] == "any"}
    base = CLASSICAL.resources(1).sums(3)
    for scheme in (*SCHEMES, *VARIANTS):
        row = chosen[scheme.name]
        units = row["units, most"]
        parts = scheme.resources(units)
        found.append({"scheme": scheme.name, "edge": parts.edge, "line": parts.line, "code": parts.code, "adders beside": parts.adders,
                      "pixels a step": units, "adders, intensity": parts.sums(1), "adders, RGB": parts.sums(3), "speed-up": row["speed-up"],
                      "speed-up / adders": row["speed-up"] / (parts.sums(3) / base)})  # fmt: skip
    return found


MODEL = """The last table, what holds and what does not, has the conclusions.

## Model

Coverage is luxel's rasteriser's: no scheme decides what a triangle covers. In a step each interpolator makes one addition and writes at most one
pixel. An *edge* interpolator carries x and the channels down an edge, a *line* interpolator x along a span, a *code* interpolator the channels. A
row costs one step of the edge interpolators and, if its slope is divided out, three for that; with the plane's slopes, a triangle costs six steps
and a row one. Interleaved interpolators need ceil(log2 n) more to find their first values, by shifts and additions.

The wave is read so: two edge interpolators draw the border first; a seed is found by two halvings; an active pixel activates those of its four
neighbours that are within and not active; where the wave dies before all is filled, the rows are gone through, a step each, for the next seed.
`wave, seeds only` draws no border. The wave to the letter, from one seed, is measured too, but does not fill every pixel.

Midlines: the template is the quarter at the first corner, its copies are moved by whole pixels, and the middle one is turned; a copy writes a pixel
only if it is covered and not yet written; what then is left is filled by one interpolator, run by run.

Steps are counted while this runs. Utilisation is pixels / (pixels that all units could have written), so a unit is idle whether it waits for a row
or has nothing to do."""


def run(context: Context, report: Report, facts: Row) -> None:
    """Spans, areas, utilisation and adders."""
    report.say(MODEL)
    lengths = [1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 32, 64, 128, 256, 512, 1024]
    spans = span_rows([n for n in lengths if n <= 256 or not context.quick])
    report.table("spans", "Speed-up against the length of a span", spans, "Over one interpolator.")
    _span_figure(report, spans)
    areas = [4, 16, 64, 256, 1024] if context.quick else [4, 16, 64, 256, 1024, 4096, 16384, 65536]
    count = 12 if context.quick else 60
    rows, setups = [], []
    for shape in SHAPES:
        what = triangles([a for a in areas if shape != "thin" or a <= 1024], count, shape)
        rows += area_rows(what, shape, (*SCHEMES, *VARIANTS, *LITERAL))
        if shape == "any":
            setups = [row for name in _MACHINES for row in area_rows(what, shape, SCHEMES, name)]
            facts["wave distances"] = [wave_follows_distance(one) for some in what.values() for one in some[:20]]
    _area_tables(report, rows, setups)
    _area_figures(report, rows)
    middle = 1024
    made = resource_rows(rows, middle)
    report.table("resources", "What each scheme is made of, and what that buys", made,
                 f"Speed-up on triangles of {middle:,} pixels; adders include those in interpolators. The last column is 1 where speed costs "
                 "what it brings, and more where it is cheap. Not counted: the wave's marks of active pixels and its wiring to neighbours, and "
                 "midlines' test of coverage.")  # fmt: skip
    _cost_figure(report, made, middle)
    facts |= {"spans": spans, "areas": rows, "setups": setups, "resources": made}


def wave_follows_distance(what: Triangle) -> bool:
    """Whether the wave, to the letter, takes as many steps as its farthest pixel is away, by 4-neighbours, and one for the seed."""
    from scipy.ndimage import binary_dilation

    filled = fill(what, LITERAL[0])
    written = filled.step[filled.writes > 0]
    if not len(written):
        return True
    reached, distance = filled.step == written.min(), -1
    grown = reached
    while grown.any():
        reached, distance = reached | grown, distance + 1
        grown = binary_dilation(reached) & what.covered.mask & ~reached
    return distance == int(written.max() - written.min())


def _area_tables(report: Report, rows: list[Row], setups: list[Row]) -> None:
    kept = {scheme.name for scheme in (*SCHEMES, *VARIANTS)}
    whole = [row for row in rows if row["scheme"] in kept]
    note = "Random triangles of three shapes: any; corners on those of pixels, an even number apart; two pixels wide."
    report.table("areas", "Speed-up against area", _pivot(whole, "shape", "speed-up"), f"{note} Over one interpolator, 4 steps a row.")
    report.table("utilisation", "Utilisation against area", _pivot(whole, "shape", "utilisation"),
                 "Pixels / (units x steps); of the wave, units are the most at once.")  # fmt: skip
    idle = [row | {"idle a pixel": row["idle a triangle"] / max(1.0, row["pixels a triangle"])} for row in whole]
    report.table("idle", "Idle units against area", _pivot(idle, "shape", "idle a pixel"),
                 "Steps in which a unit wrote nothing, for each pixel that was written.")  # fmt: skip
    report.table("help", "What midlines and the wave need", _help(rows),
                 "Midlines: part of the pixels that the copies left. Wave: seeds, and the most pixels at once; then the same without a border; "
                 "then the part of the pixels that one seed never reaches. All other schemes fill every pixel, once.")  # fmt: skip
    report.table("setup", "What set-up does to the speed-up", _pivot(setups, "set-up", "speed-up"),
                 "Triangles of any shape; over one interpolator with the same set-up. A wave always takes the plane's slopes.")  # fmt: skip


def _help(rows: list[Row]) -> list[Row]:
    cells = {("midlines", "repaired"): "midlines, left", ("wave", "seeds, mean"): "wave, seeds", ("wave", "units, most"): "wave, most at once",
             ("wave, seeds only", "seeds, mean"): "no border, seeds", ("wave, seeds only", "units, most"): "no border, most at once",
             ("wave, one seed", "missed"): "one seed, missed", ("wave, border, one seed", "missed"): "border and one seed, missed"}  # fmt: skip
    found: dict[tuple[str, int], Row] = {}
    for row in rows:
        here = found.setdefault((row["shape"], row["area"]), {"shape": row["shape"], "area": row["area"]})
        here |= {label: row[key] for (scheme, key), label in cells.items() if scheme == row["scheme"]}
    return list(found.values())


def _pivot(rows: list[Row], kind: str, value: str) -> list[Row]:
    """A row for each `kind` and area, and a column for each scheme."""
    found: dict[tuple[str, int], Row] = {}
    for row in rows:
        found.setdefault((row[kind], row["area"]), {kind: row[kind], "area": row["area"]})[row["scheme"]] = row[value]
    return list(found.values())


def _span_figure(report: Report, rows: list[Row]) -> None:
    with report.figure("spans", "Speed-up of a span", "Solid: a row costs 4 steps before it is filled; dotted: nothing.", (9.0, 4.2)) as axes:
        for k, scheme in enumerate(SPAN_SCHEMES[1:]):
            for setup, style in (("4 steps a row", "o-"), ("nothing", ":")):
                chosen = [(row["pixels"], row[f"{scheme.name}, x"]) for row in rows if row["set-up"] == setup]
                label = scheme.name if style == "o-" else None
                axes.plot(*zip(*chosen, strict=True), style, color=f"C{k}", label=label, markersize=4)
        plain_ticks(axes, "x", [4**k for k in range(6) if 4**k <= rows[-1]["pixels"]])
        plain_ticks(axes, "y", [1, 2, 4, 8, 16])
        axes.set_xlabel("pixels in the span")
        axes.set_ylabel("steps of one interpolator / steps")


def _area_figures(report: Report, rows: list[Row]) -> None:
    shown = (COUNTERED, INTERLEAVES[0], INTERLEAVES[2], INTERLEAVES[4], WAVE, VARIANTS[1], MIDLINES, CONTROL)
    for column, title in (("speed-up", "Speed-up of triangles"), ("utilisation", "Utilisation")):
        with report.figure(f"area-{column}", f"{title} against area", "Solid: any shape; dashed: two pixels wide.", (9.0, 4.2)) as axes:
            for k, scheme in enumerate(shown):
                for shape, style in (("any", "o-"), ("thin", "--")):
                    chosen = [(row["area"], row[column]) for row in rows if row["scheme"] == scheme.name and row["shape"] == shape]
                    axes.plot(*zip(*chosen, strict=True), style, color=f"C{k}", label=scheme.name if style == "o-" else None, markersize=4)
            axes.set_xlabel("area, pixels")
            plain_ticks(axes, "x", [row["area"] for row in rows])
            if column == "speed-up":
                plain_ticks(axes, "y", [1, 2, 4, 8, 16, 32])
                axes.set_ylabel("steps of one interpolator / steps")
            else:
                axes.set_ylabel("pixels / (units x steps)")
                axes.set_ylim(0, 1)


def _cost_figure(report: Report, rows: list[Row], area: int) -> None:
    note = "Dashed: as much faster as it is larger. Orange: other readings and combinations than the paper's."
    with report.figure("cost", f"Speed against adders, triangles of {area:,} pixels, RGB", note, (8.0, 4.6)) as axes:
        base = next(row for row in rows if row["scheme"] == "classical")
        most = max(row["adders, RGB"] for row in rows)
        axes.plot([base["adders, RGB"], most], [1, most / base["adders, RGB"]], "--", color="grey")
        for row in rows:
            place = row["adders, RGB"], row["speed-up"]
            if "own strides" in row["scheme"]:  # the same place as with added ones
                continue
            offset = {"interleaved 2": (5, -9), "interleaved 3": (5, -9), "EC-DDA": (5, -9), "classical": (-12, 7)}.get(row["scheme"], (5, 3))
            axes.plot(*place, "o", color="C0" if row["scheme"] in {s.name for s in SCHEMES} else "C1")
            axes.annotate(row["scheme"], place, xytext=offset, textcoords="offset points", fontsize=7, bbox=_ON_LINES)
        plain_ticks(axes, "x", [2**k for k in range(3, 11) if 2**k < 2 * most])
        plain_ticks(axes, "y", [1, 2, 4, 8, 16])
        axes.set_xlim(base["adders, RGB"] / 1.3, most * 1.8)
        axes.set_xlabel("adders")
        axes.set_ylabel("speed-up")


def plain_ticks(axes: Any, axis: str, values: list[int]) -> None:
    """A logarithmic axis with these numbers at it."""
    values = sorted(set(values))
    getattr(axes, f"set_{axis}scale")("log")
    getattr(axes, f"set_{axis}ticks")(values, [f"{v:,}" for v in values])
    getattr(axes, f"set_{axis}ticks")([], minor=True)
