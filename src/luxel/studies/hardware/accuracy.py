"""Errors of weights and colours against exact ones: over families of triangles, over word lengths, and what an area in float32 would do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.hardware import float24
from luxel.hardware.bounds import bounds
from luxel.hardware.formats import FLOAT32
from luxel.hardware.interpolator import LUXEL, PAPER, Precision, area_in_float32, barycentrics, inverse_area, shade
from luxel.hardware.reciprocal import MIDDLING, SMALL
from luxel.hardware.scan import CENTRE, edges
from luxel.raster.constants import GUARD_HIGH, GUARD_LOW, SUBPIXEL
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context

UNIT = 2.0**-16
_WIDTHS = (
    Precision(16, 16, SMALL), PAPER, Precision(16, 18), Precision(17, 17), Precision(17, 18, MIDDLING), LUXEL, Precision(18, 18), Precision(20, 20),
)  # fmt: skip
_SHOWN = {"weight": "beta, gamma", "alpha": "alpha", "color": "colour"}
_PICTURE = 1024 * SUBPIXEL


class Cases(NamedTuple):
    """Fragments: corners (n, 3, 2) of the triangle of each, and its place (n, 2), in 1/256 pixel."""

    corners: Array
    place: Array


class Errors(NamedTuple):
    """Of fragments, in units of 2^-16: beta and gamma relative, alpha absolute, colours (of corners from 0 to 1) absolute."""

    weight: Array
    alpha: Array
    color: Array


def _inside(corners: Array, place: Array) -> Cases:
    setup = edges(corners)
    kept = (setup.area > 0) & (setup.at(place[:, 0], place[:, 1]) >= 0).all(1)
    return Cases(corners[kept], place[kept])


def _anywhere(rng: np.random.Generator, corners: Array, centres: bool = True) -> Cases:
    """A place in each triangle: at a pixel's centre, or at any of the 65,536 in it."""
    at = (corners * rng.dirichlet([0.7] * 3, len(corners))[..., None]).sum(1)
    place = np.rint((at - CENTRE) / SUBPIXEL) * SUBPIXEL + CENTRE if centres else np.rint(at)
    return _inside(corners, place.astype(np.int64))


def spread(rng: np.random.Generator, count: int) -> Cases:
    """Corners anywhere in a picture of 1024 x 1024."""
    return _anywhere(rng, rng.integers(0, _PICTURE, (count, 3, 2)))


def small(rng: np.random.Generator, count: int) -> Cases:
    """Up to four pixels wide."""
    return _anywhere(rng, rng.integers(0, _PICTURE, (count, 1, 2)) + rng.integers(0, 4 * SUBPIXEL, (count, 3, 2)))


def huge(rng: np.random.Generator, count: int) -> Cases:
    """Up to the ends of the guard band."""
    return _anywhere(rng, rng.integers(GUARD_LOW, GUARD_HIGH, (count, 3, 2)))


def slivers(rng: np.random.Generator, count: int) -> Cases:
    """Hundreds of pixels long and a few hundredths of a pixel wide."""
    return _anywhere(rng, sliver_corners(rng, count, 8), centres=False)


def sliver_corners(rng: np.random.Generator, count: int, width: int) -> Array:
    """Triangles along random lines up to 1024 pixels long, their corners up to `width` off them."""
    start, end = rng.integers(0, _PICTURE, (2, count, 1, 2))
    t = np.stack([np.zeros(count), rng.random(count), np.ones(count)], 1)[..., None]
    return start + np.rint((end - start) * t).astype(np.int64) + rng.integers(-width, width + 1, (count, 3, 2))


def searched(rng: np.random.Generator, count: int) -> Cases:
    """Made so that all roundings of beta are near their worst, and go one way: the hundredth that comes out worst.

    The corners are (0, 0), (w, 0) and (0, h) and the place (x, 1), so that beta is h x / h w. With h w just below a power of two, its reciprocal is
    just above one; h x is just above one too, half a place from the next float.
    """
    h = rng.integers(1 << 15, 1 << 18, count)
    w = (1 << 36) // h - rng.integers(0, 4, count)
    half = (1 << 28) + (2 * rng.integers(0, 1 << 10, count) + 1 << 10)  # of 29 bits, floats of 18 bits drop 11
    x = np.clip(half // h + rng.integers(0, 2, count), 0, w)
    zero = np.zeros(count, np.int64)
    corners = np.stack([np.stack([zero, zero], 1), np.stack([w, zero], 1), np.stack([zero, h], 1)], 1)
    cases = _inside(corners, np.stack([x, np.ones_like(x)], 1))
    worst = measure(cases, LUXEL).weight.argsort()[-max(1, count // 100) :]
    return Cases(cases.corners[worst], cases.place[worst])


FAMILIES: dict[str, Callable[[np.random.Generator, int], Cases]] = {
    "anywhere": spread, "small": small, "huge": huge, "slivers": slivers, "searched": searched,
}  # fmt: skip


def measure(cases: Cases, precision: Precision) -> Errors:
    """Errors of the model; what is exact is a quotient of exact integers in float64."""
    setup = edges(cases.corners)
    e = setup.at(cases.place[:, 0], cases.place[:, 1])
    exact = e / setup.area[:, None]
    alpha, beta, gamma = barycentrics(inverse_area(setup.area, precision), e[:, 1], e[:, 2], precision)
    apart = np.abs(np.stack([float24.to_float(word) for word in (alpha, beta, gamma)], 1) - exact)
    relative = apart[:, 1:] / np.where(e[:, 1:] > 0, exact[:, 1:], 1)
    colors = np.random.default_rng(1).random((len(e), 3, 3))
    colors[::2] = np.rint(colors[::2])  # half of the corners are black or full
    words = float24.from_float(colors)
    shaded = float24.to_float(shade(cases.corners, words, cases.place[:, 0], cases.place[:, 1], np.arange(len(e)), precision))
    off = np.abs(shaded - np.einsum("nk,nkc->nc", exact, float24.to_float(words)))
    return Errors(relative.max(1) / UNIT, apart[:, 0] / UNIT, off.max(1) / UNIT)


def _count(context: Context) -> int:
    return 30_000 if context.quick else 400_000


def widths(context: Context, report: Report) -> None:
    """Bounds and worst errors found, for factors of several widths."""
    rng = np.random.default_rng(2)
    cases = [family(rng, _count(context) // 4) for family in FAMILIES.values()]
    rows = []
    for precision in _WIDTHS:
        found = [measure(part, precision) for part in cases]
        limit = bounds(precision)
        row: dict[str, Any] = {"table": precision.table.fraction, "table bits": precision.table.bits, "edge": precision.edge}
        row |= {"1 / area": precision.reciprocal, "source": HERE}
        for name, what in _SHOWN.items():
            row[f"{what}: bound"] = float(getattr(limit, name)) / UNIT
            row[f"{what}: found"] = max(float(getattr(errors, name).max()) for errors in found)
        row["weights within 2^-16"] = "yes" if limit.weight < UNIT else "no"
        rows.append(row)
    note = (
        "Fraction bits of the area and its reciprocal by the table, of an edge function and of 1 / area as factors; the rest is float24. Errors in "
        "units of 2^-16: beta and gamma relative, alpha absolute, colours absolute for corners from 0 to 1. 23, 16 and 16 is float32 and float24, as "
        "in the paper; 23, 17 and 18 is what luxel has: one product of 18 by 18 bits and an addition. An area of 20 bits would do."
    )
    report.table("widths", "Precision by word length: what is sure, and the worst that was found", rows, note)


def families(context: Context, report: Report) -> None:
    """How errors are distributed, by the kind of triangle."""
    rng = np.random.default_rng(3)
    rows, weights = [], {}
    for name, family in FAMILIES.items():
        errors = measure(family(rng, _count(context)), LUXEL)
        weights[name] = errors.weight
        for (what, values), limit in zip(errors._asdict().items(), bounds(LUXEL)[1:], strict=True):
            shares = np.quantile(values, [0.5, 0.99, 0.9999])
            rows.append({
                "triangles": name, "source": HERE, "error of": _SHOWN[what], "fragments": len(values), "median": shares[0], "99 %": shares[1],
                "99.99 %": shares[2], "largest": values.max(), "bound": float(limit) / UNIT,
            })  # fmt: skip
    note = "Units of 2^-16, as above. `searched` are triangles made so that every rounding of beta is near its worst, and all go one way."
    report.table("errors", "Errors by kind of triangle", rows, note)
    note = "Share of fragments whose larger relative error, of beta or gamma, is above x. Where a curve would reach the bound, there is nothing."
    with report.figure("errors", "How often weights are how wrong", note, (9.0, 4.2)) as axes:
        for name, values in weights.items():
            style = "-." if name == "huge" else "-"  # as wrong as anywhere, which is to be seen too
            axes.plot(np.sort(values), 1 - np.arange(len(values)) / len(values), style, label=name)
        both = measure(FAMILIES["anywhere"](rng, _count(context)), PAPER).weight
        axes.plot(np.sort(both), 1 - np.arange(len(both)) / len(both), "--", label="anywhere, float24 throughout")
        axes.axvline(float(bounds(LUXEL).weight) / UNIT, color="k", linewidth=1)
        axes.axvline(float(bounds(PAPER).weight) / UNIT, color="k", linewidth=1, linestyle="--")
        axes.set_yscale("log")
        axes.set_xlabel("relative error, units of 2^-16; upright: the bounds")
        axes.set_ylabel("share of fragments above")


def area(context: Context, report: Report) -> None:
    """What remains of the area of slivers: in float32, as the paper has it, and summed exactly."""
    rng = np.random.default_rng(4)
    rows = []
    limit = float(bounds(LUXEL).inverse)
    for width in (1, 2, 4, 16, 64, 256, 1024, 4096, 16384, 65536):
        corners = sliver_corners(rng, _count(context) // 4, width)
        corners = corners[edges(corners).area > 0]
        setup = edges(corners)
        signed = np.where(setup.flipped, -1, 1) * setup.area
        theirs, ours = FLOAT32.to_float(area_in_float32(corners)), LUXEL.reciprocal_format.to_float(inverse_area(setup.area))
        off = np.abs(theirs / signed - 1)
        rows.append({
            "width, pixels": 2 * width / SUBPIXEL, "source": HERE, "triangles": len(corners),
            "float32: wrong sign or zero, %": (theirs * signed <= 0).mean() * 100,
            "float32: off by more than 2^-16, %": (off > UNIT).mean() * 100,
            "float32: largest error": off.max(),
            "exact sum: largest error of 1 / area": np.abs(ours * setup.area - 1).max(),
        })  # fmt: skip
    note = (
        "Triangles along lines up to 1024 pixels long, their corners up to half the width off. In float32 each of five sums and two products "
        "rounds; an exact sum is rounded once. A wrong sign is a triangle that is drawn nowhere, or from its other side."
    )
    report.table("area", "The area of slivers", rows, note)
    with report.figure("area", "Largest error of the area") as axes:
        x = [row["width, pixels"] for row in rows]
        axes.loglog(x, [row["float32: largest error"] for row in rows], "o-", label="float32 throughout: area")
        axes.loglog(x, [row["exact sum: largest error of 1 / area"] for row in rows], "s-", label="exact sum: 1 / area")
        axes.axhline(limit, color="k", linewidth=1, label="its bound")
        axes.set_xlabel("width of the sliver, pixels")
        axes.set_ylabel("relative error")
