"""Errors of fixed-point interpolation against exact rational interpolation: by the length of the span, by format, and after lighting."""

from __future__ import annotations

from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.studies.report import Report
from luxel.studies.shading.fill import Filled, Triangle, fill, triangle
from luxel.studies.shading.fixed import VALUE_BITS, Format, errors
from luxel.studies.shading.schemes import CLASSICAL, CONTROL, COUNTERED, ENDS, INTERLEAVES, MIDLINES, PLANE, TRUNCATED, VARIANTS, WAVE, Scheme
from luxel.studies.shading.shapes import corners_of, flat_triangle, glossy_triangle
from luxel.studies.shading.speed import plain_ticks
from luxel.studies.study import Context

Row = dict[str, Any]
FOUR = INTERLEAVES[2]
OWN = next(scheme for scheme in VARIANTS if scheme.own_strides)
WAYS: dict[str, tuple[Scheme, str]] = {
    "classical": (CLASSICAL, ENDS),
    "counter": (COUNTERED, ENDS),
    "interleaved 4": (FOUR, ENDS),
    "interleaved 4, own strides": (OWN, ENDS),
    "EC-DDA": (CONTROL, ENDS),
    "classical, truncated": (CLASSICAL, TRUNCATED),
    "counter, truncated": (COUNTERED, TRUNCATED),
    "classical, plane's slopes": (CLASSICAL, PLANE),
    "counter, plane's slopes": (COUNTERED, PLANE),
}
"""What is compared; slopes are a span's own, rounded to nearest or down, but for the last two."""

FORMATS = (Format(8, 8), Format(8, 10), Format(8, 12), Format(8, 16))
_TO_VIEWER = np.array([0.0, 0.0, 1.0])
_TO_LIGHT = np.array([0.3, 0.4, 0.866])
_SHARPNESS = 40


def pixel_errors(what: Triangle, filled: Filled, form: Format) -> tuple[Array, Array, Array]:
    """Rows and columns of the pixels, in the order of rows, and the errors there, (channels, n) float64."""
    y, x = np.nonzero(filled.writes)
    found = errors(what.exact, x + what.covered.x, y + what.covered.y, np.ascontiguousarray(filled.value[:, y, x]), form)
    return y, x, found


def by_length(lengths: list[int], count: int, form: Format) -> list[Row]:
    """Largest and RMS errors of all spans of each octave of lengths, in units of the last place, of flat random triangles."""
    rows = []
    for length in lengths:
        rng = np.random.default_rng(length)
        what = [flat_triangle(rng, length) for _ in range(count)]
        row: Row = {"pixels, more than": length // 2, "up to": length}
        for name, (scheme, source) in WAYS.items():
            all_errors, seam = [], 0.0
            for one in what:
                filled = fill(one, scheme, form, source=source)
                y, x, found = pixel_errors(one, filled, form)
                wanted = np.bincount(y)[y] > length // 2
                all_errors.append(found[0, wanted] / form.ulp)
                if scheme is COUNTERED:
                    seam = max(seam, _seam(filled, y, x, found[0] / form.ulp, wanted))
            together = np.concatenate(all_errors)
            row |= {f"{name}, largest": float(np.abs(together).max()), f"{name}, RMS": float(np.sqrt(np.mean(together**2)))}
            if scheme is COUNTERED and source == ENDS:
                row["counter, seam"] = seam
        rows.append(row)
    return rows


def _seam(filled: Filled, y: Array, x: Array, error: Array, wanted: Array) -> float:
    """The largest change of the error between neighbours that different interpolators wrote."""
    beside = (np.diff(y) == 0) & (np.diff(filled.unit[y, x]) != 0) & wanted[1:]
    return float(np.abs(np.diff(error))[beside].max(initial=0))


def _halving(rows: list[Row]) -> list[Row]:
    found = []
    for row in rows:
        ratio = {f"{kind}, {name}": row[f"counter{end}, {kind}"] / row[f"classical{end}, {kind}"]
                 for name, end in (("span's slopes", ""), ("truncated", ", truncated"), ("plane's slopes", ", plane's slopes"))
                 for kind in ("largest", "RMS")}  # fmt: skip
        seam = row["counter, seam"] / row["classical, largest"]
        found.append({"pixels, more than": row["pixels, more than"], "up to": row["up to"]} | ratio | {"seam / largest one-way error": seam})
    return found


def attribute_triangles(rng: np.random.Generator, kind: str, count: int, area: float) -> list[Triangle]:
    """Random triangles with an intensity, with RGB, or with unit normals."""
    if kind == "normals":
        return [glossy_triangle(rng, area) for _ in range(count)]
    channels = 1 if kind == "intensity" else 3
    return [triangle(corners_of(rng, area), rng.integers(0, 255 << VALUE_BITS, (3, channels), endpoint=True)) for _ in range(count)]


def level(normals: Array) -> Array:
    """Lambert and Blinn-Phong light on normals (3, n) of any length, 0 to 255: they are normalised first, as Phong's shading asks."""
    unit = normals / np.linalg.norm(normals, axis=0)
    half = _TO_LIGHT / np.linalg.norm(_TO_LIGHT) + _TO_VIEWER
    diffuse = np.maximum(0, _TO_LIGHT / np.linalg.norm(_TO_LIGHT) @ unit)
    glossy = np.maximum(0, half / np.linalg.norm(half) @ unit) ** _SHARPNESS
    return 255 * np.minimum(1, 0.1 + 0.6 * diffuse + 0.3 * glossy)


def attribute_rows(kind: str, count: int, area: float) -> list[Row]:
    """Errors of every way on triangles of one size, by format."""
    rng = np.random.default_rng(11)
    what = attribute_triangles(rng, kind, count, area)
    rows = []
    for form in FORMATS:
        for name, (scheme, source) in {**WAYS, "wave": (WAVE, PLANE), "midlines": (MIDLINES, ENDS)}.items():
            found, lit = [], []
            for one in what:
                filled = fill(one, scheme, form, source=source)
                y, x, wrong = pixel_errors(one, filled, form)
                held = filled.value[:, y, x] * form.ulp
                found.append(wrong.ravel())
                right = held - wrong
                lit.append(np.stack([level(held), level(right)]) if kind == "normals" else np.stack([held.ravel(), right.ravel()]))
            shown, shines = np.concatenate(found), np.clip(np.concatenate(lit, 1), 0, 255)
            apart = np.abs(np.diff(np.floor(shines + 0.5), axis=0))
            rows.append({"attribute": kind, "format": str(form), "scheme": name, "largest error, ulp": float(np.abs(shown).max() / form.ulp),
                         "RMS error, ulp": float(np.sqrt(np.mean(shown**2)) / form.ulp),
                         "largest error of the level": float(np.abs(np.diff(shines, axis=0)).max()),
                         "levels wrong, %": float(100 * (apart > 0).mean())})  # fmt: skip
    return rows


def _by_format(rows: list[Row]) -> list[Row]:
    """A row for each attribute and scheme."""
    found: dict[tuple[str, str], Row] = {}
    for row in rows:
        cells = found.setdefault((row["attribute"], row["scheme"]), {"attribute": row["attribute"], "scheme": row["scheme"]})
        form = row["format"]
        cells |= {f"{form} wrong, %": row["levels wrong, %"], f"{form} off by": row["largest error of the level"]}
        if form == str(FORMATS[-1]):
            cells |= {"largest error, ulp": row["largest error, ulp"], "RMS error, ulp": row["RMS error, ulp"]}
    return list(found.values())


def phong_copies(count: int, area: float) -> Row:
    """How far midlines' copies are from the template by a constant: the normals, and what they look like lit."""
    rng = np.random.default_rng(13)
    normal, lit = [], []
    for _ in range(count):
        one = glossy_triangle(rng, area)
        a, b = one.values[0].astype(float), one.values[1].astype(float)
        s, t = rng.random((2, 400)) / 2
        inside = s + t < 0.5
        at = a[:, None] + np.outer(b - a, s[inside]) + np.outer(one.values[2] - a, t[inside])
        moved = at + ((b - a) / 2)[:, None]
        normal.append(np.ptp(moved - at, axis=1).max() / 2**VALUE_BITS)
        lit.append(np.ptp(level(moved) - level(at)))
    return {"normals": float(max(normal)), "lit, levels, mean": float(np.mean(lit)), "lit, levels, largest": float(max(lit))}


def run(context: Context, report: Report, facts: Row) -> None:
    """By length, by format, by attribute."""
    lengths = [4, 16, 64, 256] if context.quick else [2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048]
    rows = by_length(lengths, 10 if context.quick else 40, Format())
    report.table("errors", "Errors by the length of the span", rows,
                 "In units of the last place (8.16: 2^-16 of a grey level), against exact rational interpolation at pixels' centres. Both ends "
                 "of a span are exact to half a unit and its slope is divided out and rounded, to nearest or down (truncated); or all comes "
                 "from one pixel by the plane's slopes. `seam`: the change of the error between the two neighbours in mid-span.")  # fmt: skip
    halves = _halving(rows)
    report.table("halving", "Counter interpolation: its error over that of one interpolator", halves, "The claim is 0.5.")
    _figure(report, rows)
    kinds = []
    area = 600 if context.quick else 8000
    for kind in ("intensity", "RGB", "normals"):
        kinds += attribute_rows(kind, 4 if context.quick else 12, area)
    report.table("attributes", "Gouraud and Phong: errors by format", _by_format(kinds),
                 f"Triangles of {area:,} pixels. Normals are interpolated, then normalised and lit (Lambert and Blinn-Phong) in floating point. "
                 "Levels are of 255; `wrong`: pixels, %, whose level is not what exact interpolation gives; `off by`: the largest difference "
                 "before rounding.")  # fmt: skip
    facts |= {"errors": rows, "halving": halves, "attributes": kinds, "phong copies": phong_copies(20 if context.quick else 200, area)}


def _figure(report: Report, rows: list[Row]) -> None:
    for kind in ("largest", "RMS"):
        note = "One interpolator and four interleaved ones are the same bits, and both that take the plane's slopes."
        note += " Dotted: (1 + k) / 2, which k additions of a rounded slope cannot exceed; and half of that." if kind == "largest" else ""
        title = f"{kind[0].upper() + kind[1:]} error against the length of the span, 8.16"
        with report.figure(f"errors-{kind.lower()}", title, note, (9.0, 4.2)) as axes:
            x = [row["up to"] for row in rows]
            for k, name in enumerate(WAYS):
                style = "s--" if "plane" in name else "^:" if "truncated" in name else "o-"
                axes.plot(x, [row[f"{name}, {kind}"] for row in rows], style, color=f"C{k}", label=name, markersize=4)
            if kind == "largest":
                axes.plot(x, [n / 2 for n in x], ":", color="grey")
                axes.plot(x, [n / 4 for n in x], ":", color="grey")
            plain_ticks(axes, "x", x)
            axes.set_yscale("log")
            axes.set_xlabel("pixels in the span, up to")
            axes.set_ylabel("units of the last place")
