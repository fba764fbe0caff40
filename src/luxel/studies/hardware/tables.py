"""The number formats, and the smallest tables of reciprocals."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from luxel.errors import InputError
from luxel.hardware.float24 import FLOAT24
from luxel.hardware.formats import FLOAT32, Format
from luxel.hardware.interpolator import LUXEL
from luxel.hardware.reciprocal import SMALL, WIDE, Table, Words, smallest, table
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context

_SEARCHED = ((16, (3, 4, 5, 6, 7, 8)), (20, (5, 6, 7)), (23, (6, 7)))
_QUICK = ((16, (4, 5, 6)), (20, (5,)), (23, (6,)))


def formats(context: Context, report: Report) -> None:
    """What numbers there are, and how they are rounded."""
    used = (("float24: weights, colours", FLOAT24), ("edge functions", LUXEL.edge_format), ("1 / area", LUXEL.reciprocal_format), ("area", FLOAT32))
    rows = [_format_row(name, form) for name, form in used]
    note = (
        "Every operation rounds once, to nearest, ties to even. There is one zero (E = 0), and there are no subnormals, infinities and NaN: "
        "what is too small is zero, what is too large the largest number."
    )
    report.table("formats", "Numbers", rows, note)


def _format_row(name: str, form: Format) -> dict[str, Any]:
    return {
        "what": name,
        "source": HERE,
        "bits": form.bits,
        "exponent": form.exponent,
        "fraction": form.fraction,
        "bias": form.bias,
        "smallest": f"2^{1 - form.bias}",
        "largest": f"2^{form.highest - form.bias} (2 - 2^-{form.fraction})",
        "rounding, relative": f"2^-{form.fraction + 1}",
    }


def smallest_tables(context: Context, report: Report) -> None:
    """For each number of segments the smallest table within one unit in the last place, by search."""
    rows = []
    for fraction, segments in _QUICK if context.quick else _SEARCHED:
        for m in segments:
            rows.append(_table_row(fraction, m, smallest(fraction, m)))
    if context.quick:  # the search takes ten seconds; what it finds is written down
        rows.append(_table_row(23, 7, WIDE))
    note = (
        "Quadratics C - B t + A t^2 on 2^m segments of the mantissa, every mantissa tried. `best` is the error with exact coefficients: "
        "1/2 + 2^(n - 3m - 4) units. Where it is 1 or more, no table will do, whatever its words. Each doubling of the segments gains 3 bits. "
        "Errors are cut, not rounded: all are below 1."
    )
    report.table("reciprocal", "The smallest table that gives one unit in the last place", rows, note)


def _table_row(fraction: int, m: int, words: Words | None) -> dict[str, Any]:
    row: dict[str, Any] = {"fraction n": fraction, "segments m": m, "source": HERE, "best": 0.5 + 2.0 ** (fraction - 3 * m - 4)}
    if words is None:
        return row | {"C + B + A": "none"}
    made = table(words)
    errors = np.abs(made.errors())
    return row | {
        "C + B + A": f"{words.c} + {words.b} + {words.a}",
        "square": words.square,
        "table bits": words.bits,
        "largest error, ulp": _cut(errors.max()),
        "correctly rounded, %": float((errors <= 0.5).mean() * 100),
        "monotone": "yes" if _monotone(made) else "no",
    }


def _cut(error: float) -> float:
    """To four digits, downwards: 0.99998 must not be shown as 1."""
    return math.floor(error * 1e4) / 1e4


def _monotone(made: Table) -> bool:
    quotient = made.quotient(np.arange(1, 1 << made.words.fraction))
    return bool((np.diff(quotient) <= 0).all())


def bits_and_error(context: Context, report: Report) -> None:
    """Bits of the table against its error, for 16 fraction bits: what longer words buy."""
    segments = (5, 6) if context.quick else (5, 6, 7)
    note = "16 fraction bits. Each point is one choice of word lengths; a line joins those that no other one beats. Half a unit is correct rounding."
    rows = []
    with report.figure("table_bits", "Table bits against the largest error", note) as axes:
        for m in segments:
            found = sorted(_pairs(m))
            front = [point for i, point in enumerate(found) if all(point[1] < other[1] for other in found[:i])]
            (line,) = axes.plot(*zip(*front, strict=True), "o-", markersize=4, label=f"{1 << m} segments")
            axes.plot(*zip(*found, strict=True), ".", markersize=3, alpha=0.4, color=line.get_color())
            rows += [{"segments m": m, "source": HERE, "table bits": bits, "largest error, ulp": _cut(error)} for bits, error in front]
        axes.plot(SMALL.bits, np.abs(table(SMALL).errors()).max(), "k*", markersize=12, label="taken")
        axes.set_xscale("log", base=2)
        axes.set_ylim(0.45, 1.02)  # below the lines there is room for the legend
        axes.set_xlabel("bits")
        axes.set_ylabel("largest error, units in the last place")
    report.table("table_bits", "What longer words buy", rows)


def _pairs(m: int) -> list[tuple[int, float]]:
    """(bits, error) of tables of 2^m segments for 16 fraction bits."""
    least = smallest(16, m)
    assert least is not None
    found = []
    for guard in range(least.guard, least.guard + 4):
        for b in range(least.b - 1, least.b + 4):
            for a in range(max(1, least.a - 1), least.a + 4):
                try:
                    made = table(replace(least, guard=guard, b=b, a=a, square=2 * least.low))
                except InputError:
                    continue
                found.append((made.words.bits, float(np.abs(made.errors()).max())))
    return found
