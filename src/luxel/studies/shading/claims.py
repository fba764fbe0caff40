"""What of the paper holds and what does not: each claim beside what this run measured, and judged by that."""

from __future__ import annotations

from typing import Any

from luxel.studies.report import Report
from luxel.studies.shading.accuracy import FORMATS
from luxel.studies.study import Context

Row = dict[str, Any]
_ENOUGH = 0.95  # of what is claimed
_NO_SETUP, _SETUP = "nothing", "4 steps a row"


def first_that_reaches(rows: list[Row], column: str, claimed: float) -> int | None:
    """The span length from which on a speed-up is at least 95% of what is claimed; None if the longest has not that."""
    found = None
    for row in rows:
        if row[column] < _ENOUGH * claimed:
            found = None
        elif found is None:
            found = row["pixels"]
    return found


def _from(length: int | None) -> str:
    return "at no length measured" if length is None else f"from {length:,} pixels on"


def _verdict(every: bool, some: bool) -> str:
    return "holds" if every else "in part" if some else "does not hold"


def _area(facts: Row, scheme: str, shape: str = "any", column: str = "speed-up") -> dict[int, float]:
    return {row["area"]: row[column] for row in facts["areas"] if row["scheme"] == scheme and row["shape"] == shape}


def _both_ends(values: dict[int, float], form: str) -> str:
    few, many = min(values), max(values)
    return f"{form.format(values[few])} at {few:,} pixels, {form.format(values[many])} at {many:,}"


def _claim(claim: str, verdict: str, *measured: str) -> Row:
    return {"claim": claim, "verdict": verdict, "measured": "; ".join(measured)}


def speed_claims(facts: Row) -> list[Row]:
    """Counter, interleaved and midlines: twice, up to four times, four times as fast."""
    spans = {setup: [row for row in facts["spans"] if row["set-up"] == setup] for setup in (_NO_SETUP, _SETUP)}
    ratios = {row["pixels"]: row["counter, x"] for row in spans[_NO_SETUP]}
    even = min(ratio for length, ratio in ratios.items() if length % 2 == 0)
    rows = [_claim(
        "counter: twice as fast", _verdict(min(ratios.values()) >= 2 * _ENOUGH, even >= 2 * _ENOUGH),
        f"{even:.2f}x on every even span without set-up",
        f"odd spans of 1, 3, 5 pixels {ratios[1]:.2f}x, {ratios[3]:.2f}x, {ratios[5]:.2f}x",
        f"with 4 steps a row 95% of it {_from(first_that_reaches(spans[_SETUP], 'counter, x', 2))}",
        f"triangles {_both_ends(_area(facts, 'counter'), '{:.2f}x')}",
    )]  # fmt: skip
    for n in (2, 4):
        without, with_setup = (first_that_reaches(spans[setup], f"interleaved {n}, x", n) for setup in (_NO_SETUP, _SETUP))
        rows.append(_claim(
            f"interleaved {n}: {n} times as fast", _verdict(with_setup == min(ratios), without is not None),
            f"95% of it {_from(without)} without set-up, {_from(with_setup)} with",
            f"triangles {_both_ends(_area(facts, f'interleaved {n}'), '{:.2f}x')}",
        ))  # fmt: skip
    any_shape, even_shape = _area(facts, "midlines"), _area(facts, "midlines", "even")
    fastest = max([*any_shape.values(), *even_shape.values()])
    rows.append(_claim(
        "midlines: four times as fast, perfectly balanced", _verdict(min(any_shape.values()) > 4 * _ENOUGH, fastest > 4 * _ENOUGH),
        f"triangles {_both_ends(any_shape, '{:.2f}x')}: copies leave pixels, {_both_ends(_area(facts, 'midlines', column='repaired'), '{:.1%}')}",
        f"with corners an even number of pixels apart {_both_ends(even_shape, '{:.2f}x')}",
        "a quarter has half of the rows, so the set-up of rows is halved only",
    ))  # fmt: skip
    return rows


def error_claims(facts: Row) -> list[Row]:
    """Halved errors, the same error for all strides, and how much of it is seen."""
    halves, errors = facts["halving"], facts["errors"]
    last, longest = halves[-1], errors[-1]
    ratios = [row["largest, span's slopes"] for row in halves]
    rms, seam = last["RMS, span's slopes"], last["seam / largest one-way error"]
    apart = max(abs(row["largest, plane's slopes"] - 1) for row in halves)
    truncated = longest["classical, truncated, largest"] / longest["classical, largest"]
    down = last["largest, truncated"]
    own, four, classical = (longest[f"{name}, largest"] for name in ("interleaved 4, own strides", "interleaved 4", "classical"))
    seen = ", ".join(f"{2**form.fraction:,} at {form}" for form in FORMATS)
    plain = [row for row in facts["attributes"] if row["scheme"] == "classical" and row["attribute"] == "intensity"]
    wrong = ", ".join(f"{row['levels wrong, %']:.2g}% at {row['format']}" for row in plain)
    return [
        _claim(
            "counter: half the error", _verdict(max(ratios) < 0.5 / _ENOUGH and apart > _ENOUGH / 2, abs(ratios[-1] - 0.5) < 0.025),
            f"where both ends are exact and the slope is the span's, {ratios[-1]:.3f} of the largest error and {rms:.3f} of the RMS on spans of "
            f"up to {last['up to']:,} pixels, and up to {max(ratios):.2f} on short ones, where the ends' rounding is most of it",
            f"with slopes rounded down, which makes all errors {truncated:.1f} times as large, {down:.3f}",
            f"with the plane's slopes it has the bits of one interpolator: {1 + apart:.2f}",
            f"a seam stays in mid-span, {seam:.2f} of the whole one-way error",
        ),
        _claim(
            "interleaved: increments by a shift and an addition", _verdict(four <= classical, True), "the bits are those of one interpolator",
            f"but increments that are divided out have {own / classical:.2f} of that error: four interpolators make a quarter of the steps",
        ),
        _claim(
            "errors grow with the number of steps", _verdict(classical > 10 * errors[0]["classical, largest"], False),
            f"by up to half a unit a step, {classical:.0f} units at {longest['up to']:,} pixels",
            f"half a grey level needs a span of {seen}", f"levels that are wrong: {wrong}",
        ),
        _claim(
            "(control) EC-DDA: the remainder is carried", "control",
            f"at most {max(row['EC-DDA, largest'] for row in errors):.2f} units at any length", "one more adder a channel, and no faster",
        ),
    ]  # fmt: skip


def wave_claims(facts: Row) -> list[Row]:
    """The wave reaches every pixel, in as many steps as the farthest is away."""
    alone, border = (_area(facts, name, "thin", "missed") for name in ("wave, one seed", "wave, border, one seed"))
    wide, follows = _area(facts, "wave, one seed", "any", "missed"), facts["wave distances"]
    covers = max([*alone.values(), *border.values(), *wide.values()]) == 0
    same = {row["area"]: row["speed-up"] for row in facts["setups"] if row["scheme"] == "wave" and row["set-up"].startswith("plane")}
    units = max(row["units, most"] for row in facts["areas"] if row["scheme"] == "wave")
    return [
        _claim(
            "wave: every pixel is reached from one seed", _verdict(covers, min(wide.values()) < 0.01),
            f"of triangles two pixels wide {min(alone.values()):.1%} to {max(alone.values()):.1%} are missed, with the border drawn first "
            f"{min(border.values()):.1%} to {max(border.values()):.1%}",
            f"of any shape {_both_ends(wide, '{:.2%}')}", "here it starts again until nothing is left",
        ),
        _claim(
            "wave: steps are the largest distance from the seed", _verdict(all(follows), any(follows)),
            f"so for {sum(follows)} of {len(follows)} triangles, of what is reached",
            f"but two edge interpolators that draw the border first take longer than the wave: {_both_ends(_area(facts, 'wave'), '{:.1f}x')} as "
            f"fast as one interpolator ({_both_ends(same, '{:.1f}x')} as one that has the plane's slopes too)",
            f"without a border {_both_ends(_area(facts, 'wave, seeds only'), '{:.1f}x')}",
            f"up to {units} interpolators at once, busy {_both_ends(_area(facts, 'wave', column='utilisation'), '{:.0%}')}",
        ),
    ]  # fmt: skip


def other_claims(facts: Row) -> list[Row]:
    """Phong, lanes, and the load."""
    copies, cpu = facts["phong copies"], facts["cpu"]
    longest = max(row["pixels a span"] for row in cpu)
    speed = {row["way"]: row["speed-up"] for row in cpu if row["pixels a span"] == longest}
    lanes = speed["interleaved 8"]
    best = [row for row in facts["balance"] if row["units"] == 64]
    return [
        _claim(
            "midlines: copies differ by a constant", _verdict(copies["lit, levels, largest"] < 0.5, copies["normals"] < 1e-9),
            "so do intensities and normals",
            f"what is normalised and lit does not, by up to {copies['lit, levels, largest']:.0f} of 255 levels, "
            f"{copies['lit, levels, mean']:.0f} in the mean: Phong needs a normaliser and a light for each of the four",
        ),
        _claim(
            "lanes of SIMD are interleaving", _verdict(lanes > 8 * _ENOUGH, lanes > 2),
            f"8 lanes are {lanes:.1f}x as fast as one interpolator on this processor, 16 are {speed['interleaved 16']:.1f}x, on spans of "
            f"{longest:.0f} pixels",
            f"the compiler by itself {speed['classical, as the compiler likes']:.1f}x",
            ", ".join(f"{name} {speed[name]:.2f}x" for name in ("counter", "midlines", "wave", "EC-DDA")),
        ),
        _claim(
            "(asked) the size of triangle that balances 64 units", "measured",
            *(f"{row['triangulation']} {row['pixels a triangle']:,.0f} pixels, {row['pixels a step']:.0f} pixels a step" for row in best),
        ),
    ]  # fmt: skip


def run(context: Context, report: Report, facts: Row) -> None:
    """The table."""
    rows = [*speed_claims(facts), *error_claims(facts), *wave_claims(facts), *other_claims(facts)]
    report.table("claims", "What holds, and what does not", rows, "`holds`: within 5% of what is claimed wherever measured; `in part`: somewhere.")
