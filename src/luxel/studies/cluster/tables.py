"""What the study of ranks says: what is measured here, how near the model comes to it, and what it says of machines that are not here."""

from __future__ import annotations

import os
import tempfile
import warnings
from pathlib import Path
from typing import Any

from luxel.cluster.composite import COMPOSITIONS
from luxel.cluster.launchers import launched
from luxel.errors import InputError, LuxelWarning
from luxel.studies.cluster import calibrate
from luxel.studies.cluster.facts import Facts, facts_of
from luxel.studies.cluster.messages import rounds
from luxel.studies.cluster.model import DIVISIONS, Costs, Frame, Memory, Network, alone, frame, row
from luxel.studies.report import Report
from luxel.studies.shading.speed import plain_ticks
from luxel.studies.study import HERE, Context

Row = dict[str, Any]
SIMULATED = "simulated"
NETWORKS = (Network("InfiniBand, 200 Gb/s", 1.5e-6, 22e9), Network("Ethernet, 10 Gb/s", 30e-6, 1.1e9))
"""What is taken for networks that are not here: usual figures of MPI on them."""
RANKS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 10_000)
MEASURED = (1, 2, 4)
LARGE = 100
"""Triangles that each one of the measured frame stands for in the large scene."""
_WAYS = [("objects", "direct"), ("objects", "swap"), ("objects", "radix"), ("both", "radix"), ("screen, static", "swap"), ("screen", "swap")]
_CALL = 20e-6  # seconds of a message in Python, where it cannot be measured
_BYTE = 1e-9  # seconds of a byte that is exchanged, likewise
_MEMORY = Memory(180e6, 80.0, 30.0)  # likewise


def run(context: Context, report: Report) -> None:
    """All parts."""
    if launched():
        raise InputError("luxel study cluster starts mpiexec itself: run it without")
    size, n = ((640, 360), 150) if context.quick else ((1920, 1080), 500)
    scenes = {kind: facts_of(kind, n, size) for kind in ("even", "corner")}
    context.progress(0.1)
    launcher = calibrate.mpiexec()
    found = _measure(context, launcher, n, size) if launcher else {}
    context.progress(0.5)
    network = Network("here", *(found[2]["latency"], found[2]["bandwidth"])) if found else Network("here", _CALL, 5e9)
    prices, fitted = calibrate.costs(context.quick, network.latency, *((found[2]["step"], found[2]["byte"]) if found else (_CALL, _BYTE)))
    context.progress(0.7)
    memory = calibrate.memory(found[1]["rows"], (320 * 180, size[0] * size[1]), scenes["even"]) if found else _MEMORY
    if found:
        prices = prices._replace(travel=_travel(scenes["even"], found[2], prices, memory, network))
    _say_costs(report, prices, memory, network, fitted, bool(found))
    if found:
        rows = [{**each, "step": found[ranks]["step"]} for ranks in MEASURED for each in found[ranks]["rows"]]
        check(report, scenes, rows, prices, memory, network)
    else:
        what = "mpiexec or mpi4py is missing: frames of several ranks are not measured; pip install 'luxel[mpi]'"
        warnings.warn(what, LuxelWarning, stacklevel=2)
        report.say(f"**Not measured:** {what}.")
    beyond(context, report, scenes["even"], prices, memory)


def _measure(context: Context, launcher: str, n: int, size: tuple[int, int]) -> dict[int, Row]:
    repeats = 3 if context.quick else 9
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tiny = [calibrate.case("tiny", "even", 10, (320, 180), [("screen", "swap")], 2, folder),
                calibrate.case("tiny large", "even", 10, size, [("screen", "swap")], 2, folder)]  # fmt: skip
        main = [calibrate.case(kind, kind, n, size, _WAYS if kind == "even" else _WAYS[-2:], repeats, folder) for kind in ("even", "corner")]
        return {ranks: calibrate.run_ranks(launcher, ranks, main if ranks > 1 else tiny + main) for ranks in MEASURED}


def _travel(facts: Facts, found: Row, prices: Costs, memory: Memory, network: Network) -> float:
    """What the model lacks of one frame of two ranks, for each pixel that a rank gets."""
    here = prices._replace(call=0.0)
    rows = [each for each in found["rows"] if each["name"] == "even" and each["division"] == "objects"]
    lack = [each["seconds"] - frame(facts, "objects", 2, here, memory, network, each["composition"], 2).seconds for each in rows]
    return max(0.0, sum(lack) / len(lack)) / (len(facts.owner) / 2)


def _say_costs(report: Report, prices: Costs, memory: Memory, network: Network, fitted: list[Row], measured: bool) -> None:
    report.say("# Measured on this machine")
    source = HERE if measured else "assumed"
    rows: list[Row] = [{"what": f"a {name}, ns", "cost": 1e9 * value, "source": "fitted to two ranks" if name == "travel" else HERE}
                       for name, value in prices._asdict().items() if name not in ("call", "step", "byte")]  # fmt: skip
    rows += [{"what": "a message between two ranks, us", "cost": 1e6 * network.latency, "source": source},
             {"what": "a step of two ranks that agree, us", "cost": 1e6 * prices.step, "source": source},
             {"what": "a byte that is exchanged, ns", "cost": 1e9 * prices.byte, "source": source},
             {"what": "bandwidth between two ranks, GB/s", "cost": network.bandwidth / 1e9, "source": source},
             {"what": "memory of a rank with nothing, MB", "cost": memory.base / 1e6, "source": source},
             {"what": "memory of a triangle, bytes", "cost": memory.triangle, "source": source},
             {"what": "memory of a pixel, bytes", "cost": memory.pixel, "source": source}]  # fmt: skip
    report.table("costs", "What things cost one thread", rows,
                 "`skipped`: a triangle left out with its 256 neighbours. `sample`: packed, and merged by who gets it.")  # fmt: skip
    report.table("fit", "Frames of one process and one thread, and the sum of these costs", fitted)


def check(report: Report, scenes: dict[str, Facts], rows: list[Row], prices: Costs, memory: Memory, network: Network) -> list[Row]:
    """Measured frames beside the model's; one row each."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    out: list[Row] = []
    for each in rows:
        if each["name"] not in scenes:
            continue
        here = prices._replace(call=0.0, step=each["step"] - network.latency)  # Python is in what was measured of messages
        made, bare = [frame(scenes[each["name"]], each["division"], each["ranks"], costs, memory, network, each["composition"], cores)
                      for costs in (here, here._replace(travel=0.0))]  # fmt: skip
        shared = each["division"] in ("objects", "both")
        out.append({"scene": each["name"], "division": each["division"], "composition": each["composition"] if shared else "", "ranks": each["ranks"],
                    "measured, ms": 1e3 * each["seconds"], "model, ms": 1e3 * made.seconds, "model / measured": made.seconds / each["seconds"],
                    "without travel": bare.seconds / each["seconds"],
                    "sent, MB a rank": each["composed"] / 1e6 if shared else None, "model, MB": made.composed / 1e6 if shared else None,
                    "memory, MB": each["peak"] / 1e6, "model memory, MB": made.memory / 1e6})  # fmt: skip
    report.table("check", "Measured frames, and the model of them", out,
                 f"Ranks of one thread, on {cores} cores: of more ranks than cores the model lets them take turns. `memory` is the largest rank's. "
                 "Costs come from one process, but for `travel`, which makes up for what the others lack of `objects` at two ranks: those rows do "
                 "not check the model, and `without travel` shows how far it is from them by itself.")  # fmt: skip
    with report.figure("check", "The model over what was measured", "On the line they are the same.") as axes:
        for division in DIVISIONS:
            some = [(r["measured, ms"], r["model, ms"]) for r in out if r["division"] == division]
            axes.plot(*zip(*some, strict=True), "o", label=division, alpha=0.7)
        ends = [min(min(r["measured, ms"], r["model, ms"]) for r in out), max(max(r["measured, ms"], r["model, ms"]) for r in out)]
        axes.plot(ends, ends, "k-", linewidth=0.8)
        axes.set(xscale="log", yscale="log", xlabel="measured, ms a frame", ylabel="model, ms a frame")
    return out


def beyond(context: Context, report: Report, facts: Facts, prices: Costs, memory: Memory) -> list[Row]:
    """The model run out to 10,000 ranks; one row for each scene, network, division and number of ranks."""
    report.say("# Simulated: machines that are not here")
    report.say("Nothing below was measured. Each rank has a core and a network link of its own: " + "; ".join(
        f"{net.name}: {1e6 * net.latency:g} us, {net.bandwidth / 1e9:g} GB/s" for net in NETWORKS) + "; the price of a message in Python is added. "
        f"The large scene is the measured frame with {LARGE} triangles for each of its own, on as many pixels.")  # fmt: skip
    ranks = RANKS[::3] + RANKS[-1:] if context.quick else RANKS
    scenes = {f"{facts.all_triangles / 1e6:.3g} M triangles": facts,
              f"{facts.all_triangles * LARGE / 1e6:.3g} M triangles": facts._replace(weight=float(LARGE))}  # fmt: skip
    rows: list[Row] = []
    for scene, each in scenes.items():
        one = alone(each, prices)
        for network in NETWORKS:
            for division in DIVISIONS:
                for count in dict.fromkeys(ranks):
                    made = _best(each, division, count, prices, memory, network)
                    rows.append({"scene": scene, "network": network.name, **row(division, made, count, one), "source": SIMULATED})
        context.progress(0.7 + 0.25 * len(rows) / (2 * len(NETWORKS) * len(DIVISIONS) * len(ranks)))
    report.table("simulated", "Every division, to 10,000 ranks", rows, "Composition by the fastest of direct, swap and radix.")
    report.table("wins", "Which division is the fastest", wins(rows), "`also fits`: the fastest whose ranks need at most 2 GB.")
    _figures(report, rows)
    _composition(report, facts, ranks)
    return rows


def _best(facts: Facts, division: str, ranks: int, prices: Costs, memory: Memory, network: Network) -> Frame:
    ways = COMPOSITIONS if division in ("objects", "both") else COMPOSITIONS[:1]
    return min((frame(facts, division, ranks, prices, memory, network, way) for way in ways), key=lambda made: made.seconds)


def wins(rows: list[Row]) -> list[Row]:
    """For each scene, network and number of ranks the division that is fastest."""
    out = []
    for scene, network, count in dict.fromkeys((r["scene"], r["network"], r["ranks"]) for r in rows):
        if count == 1:
            continue
        some = sorted((r for r in rows if (r["scene"], r["network"], r["ranks"]) == (scene, network, count)), key=lambda r: r["ms"])
        fits = [r for r in some if r["memory, MB a rank"] <= 2000]
        out.append({"scene": scene, "network": network, "ranks": count, "fastest": some[0]["division"], "ms": some[0]["ms"],
                    "efficiency": some[0]["efficiency"], "next": some[1]["division"], "times slower": some[1]["ms"] / some[0]["ms"],
                    "also fits": fits[0]["division"] if fits else "none", "source": SIMULATED})  # fmt: skip
    return out


def _figures(report: Report, rows: list[Row]) -> None:
    for k, scene in enumerate(dict.fromkeys(r["scene"] for r in rows)):
        for name, key, label in (("time", "ms", "ms a frame"), ("efficiency", "efficiency", "efficiency"),
                                 ("memory", "memory, MB a rank", "MB, largest rank")):  # fmt: skip
            with report.figure(f"{name}-{k}", f"Simulated: {name}, {scene}", size=(8.0, 4.2)) as axes:
                for network, line in zip(NETWORKS[: 1 if name == "memory" else 2], ("o-", "s--"), strict=False):
                    for division, color in zip(DIVISIONS, ("tab:gray", "tab:blue", "tab:orange", "tab:green"), strict=True):
                        some = [(r["ranks"], r[key]) for r in rows if (r["scene"], r["network"], r["division"]) == (scene, network.name, division)]
                        label_of = division if name == "memory" else f"{division}; {network.name.split(',')[0]}"
                        axes.plot(*zip(*some, strict=True), line, color=color, label=label_of, markersize=4)
                plain_ticks(axes, "x", sorted({r["ranks"] for r in rows})[:: 1 if len({r["ranks"] for r in rows}) < 7 else 2])
                axes.set(xlabel="ranks", ylabel=label)
                if name == "efficiency":
                    axes.set_ylim(0, 1.05)
                else:
                    axes.set_yscale("log")


def _composition(report: Report, facts: Facts, ranks: tuple[int, ...]) -> None:
    """Bytes and rounds of the ways to composite, beside the bound of what is never hidden nor empty."""
    rows: list[Row] = []
    pixels = facts.size[0] * facts.size[1]
    for count in dict.fromkeys(ranks):
        if count == 1:
            continue
        for way in COMPOSITIONS:
            steps = rounds(facts, count, way)
            rows.append({"ranks": count, "composition": way, "rounds": len(steps), "messages a rank": sum(step.partners for step in steps),
                         "sent, MB a rank": sum(float(step.sent.mean()) for step in steps) / 1e6,
                         "most, MB": sum(float(max(step.sent.max(), step.got.max())) for step in steps) / 1e6,
                         "N b (1 - 1/P), MB": 8e-6 * pixels * (1 - 1 / count), "source": SIMULATED})  # fmt: skip
    report.table("composition", "What composition sends", rows, "8 bytes a pixel that is covered; the bound has all pixels, from every rank.")
    with report.figure("composition", "Simulated: bytes of composition, the busiest rank") as axes:
        for way in COMPOSITIONS:
            some = [(r["ranks"], r["most, MB"]) for r in rows if r["composition"] == way]
            axes.plot(*zip(*some, strict=True), "o-", label=way, markersize=4)
        bound = [(r["ranks"], r["N b (1 - 1/P), MB"]) for r in rows if r["composition"] == "direct"]
        axes.plot(*zip(*bound, strict=True), "k--", label="N b (1 - 1/P)")
        plain_ticks(axes, "x", sorted({r["ranks"] for r in rows})[:: 1 if len(rows) < 20 else 2])
        axes.set(yscale="log", xlabel="ranks", ylabel="MB")
