"""luxel's bake beside the radiosity paper, Mitsuba and Blender's Cycles: speed, truth, time to equal error, relighting, growth, and a million charts.

    python benchmarks/bake.py                     # print all
    python benchmarks/bake.py --write             # and put the tables into RESULTS.md
    python benchmarks/bake.py rooms truth --keep refs   # some parts; the path-traced references are kept in a folder and used again

Mitsuba comes with the extra `peers`; for Blender see `blender.py`. What is missing is said and left out.
"""

from __future__ import annotations

import argparse
import math
import pickle
import time
import warnings
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import confetti
import luxel
import memory
from blender import Cycles
from luxel.radiosity import lightmap
from luxel.radiosity.bake import Baked, bake
from luxel.scene.builtin import SCENES, box, quad, to_bake, transformed
from luxel.scene.transforms import rotation, translation
from pathtracer import Missing, Mitsuba, Truth, truth
from report import ROOT, alternating, machine, median, meshes, milliseconds, table, write_section

QUALITIES = ("progressive", "draft", "normal", "final")
PAPER = {"room-simple": (4.0, 2.0), "room-complex": (139.0, 79.0)}  # seconds on its CPU and its GPU
ROOMS = tuple(PAPER)
STAGES = ("unwrap", "luxels", "inside", "patches", "solve", "gather")
PARTS = ("rooms", "truth", "peers", "relight", "scale", "charts")


@dataclass(frozen=True)
class Case:
    """A scene that is compared with its path-traced light: luxels compared, and paths for each of them; and the box that those lie in, if not all."""

    name: str
    scene: luxel.Scene
    density: float | None
    sky: float | None
    luxels: int
    samples: int
    within: tuple[tuple[float, ...], tuple[float, ...]] = ((-np.inf,) * 3, (np.inf,) * 3)
    cycles: bool = False  # Cycles can bake the same: its surfaces give light on both sides, so only where no backs are seen


_INDOORS = (-4.95, 0.9, -2.45), (4.95, 3.55, 2.45)  # of living_room.glb, which has a garden too


def cases(quick: bool) -> list[Case]:
    """Lit by their own surfaces, or by the sky; no stand-in lamps."""
    share = 8 if quick else 1
    found = [Case("Cornell box", bare(SCENES["cornell-box"]()), 60.0, None, 600, 16384 // share, cycles=True)]
    folder = meshes()
    if folder is None or not (folder / "scenes" / "living_room.glb").exists():
        print("missing: scenes/living_room.glb (LUXEL_MESHES)", flush=True)
    else:
        scene = bare(luxel.load(folder / "scenes" / "living_room.glb"))
        found.append(Case("living room, sky", scene, 8.0, 1.0, 600, 16384 // share, _INDOORS))
        found.append(Case("living room, lamp", with_lamp(scene), 8.0, None, 600, 16384 // share, _INDOORS))
    return [*found, Case("room-simple", bare(SCENES["room-simple"]()), None, None, 600, 8192 // share, cycles=True)]


def closed(quick: bool) -> list[Case]:
    return [case for case in cases(quick) if case.sky is None]


def with_lamp(scene: luxel.Scene) -> luxel.Scene:
    """With a glowing panel below the ceiling."""
    lit = replace(scene, meshes=[*scene.meshes], instances=[*scene.instances], materials=[*scene.materials])
    panel = transformed(quad(1.2, 1.2), translation((-1.0, 3.2, 0.0)) @ rotation((1, 0, 0), np.pi / 2))
    lit.add(panel, luxel.Material((0.8, 0.8, 0.8, 1.0), emissive=(20.0, 18.0, 15.0), name="lamp"))
    return lit


def bare(scene: luxel.Scene) -> luxel.Scene:
    return replace(scene, lights=[], ambient=None)


def ceiling_lamp(quick: bool) -> Case:
    """A small lamp two centimetres below a ceiling: much of the light comes off a bright ring around it. Compared are luxels below the ceiling; to
    a path tracer the ring is what it is to rays, so it needs many paths."""
    scene, paint, wood = luxel.Scene(), luxel.Material((0.75, 0.75, 0.75, 1.0)), luxel.Material((0.5, 0.35, 0.25, 1.0))
    shell = box((4.0, 2.8, 5.0))
    inward = replace(shell, triangles=np.ascontiguousarray(shell.triangles[:, ::-1]), normals=-shell.normals)
    scene.add(transformed(inward, translation((0, 1.4, 0))), paint)
    scene.add(transformed(box((1.6, 0.7, 0.9)), translation((0.4, 0.38, -0.8))), wood)
    glow = luxel.Material((0.6, 0.6, 0.6, 1.0), emissive=(221.0, 199.0, 177.0))
    scene.add(transformed(box((0.12, 0.12, 0.12)), translation((-0.35, 2.72, 0.45))), glow)
    return Case("ceiling lamp", scene, 12.0, None, 200, 262144 // (8 if quick else 1), ((-np.inf,) * 3, (np.inf, 2.6, np.inf)))


def demo_room(quick: bool) -> Case:
    """The demo's, lit through its windows as `luxel demo` lights it, in plain colours that a path tracer can tell light from."""
    scene = to_bake(SCENES["room"]())
    materials = []
    for material in scene.materials:
        color = *(min(max(channel, 0.02), 0.8) for channel in material.base_color[:3]), 1.0
        untextured = {"base_color_texture": None, "emissive_texture": None, "metallic": 0.0, "alpha_mode": "OPAQUE"}
        plain = replace(material, base_color=color, **untextured)
        materials.append(plain)
    uncolored = [replace(mesh, colors=None) for mesh in scene.meshes]
    return Case("demo's room", bare(replace(scene, materials=materials, meshes=uncolored)), 10.0, None, 600, 32768 // (8 if quick else 1))


# Speed of the paper's rooms


def rooms_table(repeats: int) -> str:
    """Median seconds by stage, and what the paper took."""
    rows, solved = [], {}
    for name in ROOMS:
        scene = SCENES[name]()
        for threads in (2, 1):
            made: list[Baked] = []

            def once(threads: int = threads, scene: luxel.Scene = scene, made: list[Baked] = made) -> None:
                made.append(bake(scene, tolerance=1e-3, threads=threads))

            whole = median(alternating(repeats, once)[0])
            stages = [median([b.seconds[stage] for b in made[1:]]) for stage in STAGES]
            solved[name, threads] = whole
            cpu, gpu = PAPER[name]
            ratios = [f"{cpu / whole:.1f}x", f"{gpu / whole:.1f}x"]
            counts = [f"{len(made[-1].luxels.area):,}", threads, f"{made[-1].ledger[-1].shots:,}"]
            rows.append([name, *counts, *(f"{s:.3f}" for s in stages), f"{whole:.2f}", *ratios])
            print("  ".join(map(str, rows[-1])), flush=True)
    head = ["scene", "luxels", "threads", "shots", *(f"{stage}, s" for stage in STAGES), "all, s", "paper's CPU", "paper's GPU"]
    growth = solved[ROOMS[1], 2] / solved[ROOMS[0], 2]
    patches = 86_077 / 14_445
    note = (
        f"Quality `normal`, to 0.1 % unshot; medians of {repeats} after one that is not counted. From the first room to the second there are "
        f"{patches:.1f} times as many patches, and the time grows {growth:.1f}-fold (the paper's 35-fold). Aimed at: under 0.4 s and 5 s."
    )
    return f"{table(head, rows)}\n\n{note}"


# Truth


def reference(case: Case, baked: Baked, keep: Path | None) -> tuple[Mitsuba, Truth]:
    """The path tracer, and its irradiance of some luxels, from the folder if it is there."""
    peer = Mitsuba(baked, case.sky)
    position = baked.luxels.position
    inside = ((position > case.within[0]) & (position < case.within[1])).all(1)
    chosen = np.flatnonzero(peer.comparable() & inside)
    chosen = np.sort(np.random.default_rng(1).choice(chosen, min(case.luxels, len(chosen)), replace=False))
    path = None if keep is None else keep / f"{case.name.replace(' ', '-')}-{case.samples}.pickle"
    if path is not None and path.exists():
        stored: Truth = pickle.loads(path.read_bytes())
        if np.array_equal(stored.chosen, chosen):
            return peer, _alone(peer, stored)
    found = truth(peer, chosen, case.samples)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(pickle.dumps(found))
    return peer, _alone(peer, found)


def _alone(peer: Mitsuba, found: Truth) -> Truth:
    kept = peer.alone(found.chosen)
    return replace(found, chosen=found.chosen[kept], irradiance=found.irradiance[kept])


def truth_table(chosen: list[Case], keep: Path | None) -> str:
    rows = []
    for case in chosen:
        made = {q: bake(case.scene, density=case.density, sky=case.sky, quality=q) for q in QUALITIES}
        last = made["final"]
        peer, found = reference(case, last, keep)
        share = peer.comparable().mean()  # of all luxels
        errors = [f"{found.error(b.irradiance):.2%}" for b in made.values()]
        bias = float((last.irradiance[found.chosen] - found.irradiance).mean()) / found.mean
        counts = [f"{len(last.luxels.area):,}", f"{share:.0%}", len(found.chosen)]
        rows.append([case.name, *counts, f"{found.noise / found.mean:.2%}", *errors, f"{bias:+.2%}"])
        print("  ".join(map(str, rows[-1])), flush=True)
    head = ["scene", "luxels", "comparable", "compared", "reference's noise", *QUALITIES, "bias at final"]
    note = (
        "RMSE over luxels and channels, relative to the mean irradiance, beside Mitsuba's path tracer (scalar_rgb, 64 bounces), which averages over "
        "each luxel's footprint. The noise of the reference, known from its two independent halves, is taken off in quadrature. Compared are luxels "
        "drawn at random from the whole texels on which nothing stands: where a leg or a wall's foot covers a part of one, it has no one irradiance; "
        "nor those in which two surfaces lie in each other, or on which something lies, a tenth of a side above or less. "
        "`progressive` is the classic method: patches shoot, through hemicubes. The demo's room, lit through its windows, is the hard case: "
        "its luxels are 10 cm wide, on books, slats and chairs that are finer. The ceiling lamp is 12 cm wide and 2 cm below the ceiling. "
        "Aimed at: under 3 % at `normal` and 1 % at `final`. docs/gallery/bake-error.png shows the Cornell box's error at `normal`."
    )
    return f"{table(head, rows)}\n\n{note}"


def draw_error(case: Case, samples: int, keep: Path | None, path: Path) -> None:
    """The lit scene, and beside it the error of every comparable luxel: red too bright, blue too dark, full colour at 10 % of the mean."""
    baked = bake(case.scene, density=case.density, sky=case.sky)
    _, found = reference(replace(case, luxels=len(baked.luxels.area), samples=samples), baked, keep)
    apart = 10 * (baked.irradiance[found.chosen] - found.irradiance).mean(1, keepdims=True) / found.mean
    colors = np.full_like(baked.irradiance, 0.25)
    colors[found.chosen] = 1 - np.abs(apart).clip(0, 1) * np.where(apart > 0, [0, 1, 1], [1, 1, 0])
    white = [replace(m, base_color=(1.0, 1.0, 1.0, 1.0), emissive=(0.0, 0.0, 0.0)) for m in baked.atlas.scene.materials]
    pages = lightmap.finish(baked.atlas, baked.luxels, math.pi * colors, baked.valid)[0]
    error = lightmap.attach(baked.atlas._replace(scene=replace(baked.atlas.scene, materials=white)), pages)
    pictures = [luxel.render(scene, size=(640, 640), samples=8).color for scene in (baked.scene, error)]
    luxel.Picture(color=np.concatenate(pictures, 1)).save(path)
    print(f"written: {path}", flush=True)


# Time to equal error


def peers_table(chosen: list[Case], keep: Path | None, repeats: int) -> str:
    """For each peer: how many samples give luxel's error, and how long they take for all luxels. Both peers' errors are noise, which falls with the
    root of the samples; it is measured, not modelled, at the numbers of samples on both sides."""
    try:
        cycles: Cycles | None = Cycles()
    except Missing as missing:
        cycles = None
        print(f"missing: {missing}", flush=True)
    rows = []
    for case in chosen:
        jobs = [partial(bake, case.scene, density=case.density, sky=case.sky, quality=quality) for quality in ("draft", "normal")]
        made = [job() for job in jobs]
        peer, found = reference(case, made[0], keep)
        curves = [_by_mitsuba(peer, found)]
        if cycles is not None and case.cycles:
            curves.append(_by_cycles(cycles, made[0], found))
        for quality, baked, times in zip(("draft", "normal"), made, alternating(repeats, *jobs), strict=True):
            error, seconds = found.error(baked.irradiance), median(times)
            line = [case.name, quality, f"{error:.2%}", f"{seconds:.2f}", *(word for curve in curves for word in _equal(error, seconds, *curve))]
            rows.append([*line, *[""] * (10 - len(line))])
            print("  ".join(rows[-1]), flush=True)
    head = ["scene", "quality", "error", "luxel, s", "Mitsuba samples", "s", "ratio", "Cycles samples", "s", "ratio"]
    note = (
        "The whole bake by luxel (unwrapping included, kernels compiled before), medians. For the peers the samples that give the same error, and "
        "their time for all luxels, read off lines through what was measured at 16, 64 and 256 samples (Mitsuba on the luxels compared, scaled to "
        f"all; Cycles the whole lightmap). 2 threads each. Aimed at: 10x. Peers: {peer.name}{', ' + cycles.name if cycles else ''}."
    )
    return f"{table(head, rows)}\n\n{note}"


def _by_mitsuba(peer: Mitsuba, found: Truth) -> tuple[list[int], list[float], list[float]]:
    """Samples, seconds for all luxels, and errors; a part of the luxels is traced and the time of all of them scaled from it."""
    counts, seconds, errors = [16, 64, 256], [], []
    peer.irradiance(found.chosen[:64], 4, 1)
    for count in counts:
        start = time.perf_counter()
        values = np.zeros((len(peer.baked.luxels.area), 3))
        values[found.chosen] = peer.irradiance(found.chosen, count, 99 + count)
        seconds.append((time.perf_counter() - start) / len(found.chosen) * int(peer.baked.valid.sum()))
        errors.append(found.error(values))
    return counts, seconds, errors


def _by_cycles(cycles: Cycles, baked: Baked, found: Truth) -> tuple[list[int], list[float], list[float]]:
    counts = [16, 64, 256]
    seconds, values = cycles.bake(baked, counts, 2)
    return counts, seconds, [found.error(v) for v in values]


def _equal(error: float, ours: float, counts: list[int], seconds: list[float], errors: list[float]) -> list[str]:
    """Samples and seconds at which the peer has the error, by a line through the logarithms of what was measured; and how much longer it takes."""
    slope, offset = np.polyfit(np.log(counts), np.log(errors), 1)
    samples = float(np.exp((np.log(error) - offset) / slope))
    per_sample, fixed = np.polyfit(counts, seconds, 1)
    taken = max(float(per_sample * samples + max(fixed, 0.0)), 1e-9)
    return [f"{samples:,.0f}", f"{taken:.1f}", f"{taken / ours:.1f}x"]


# Relighting and growth


def relight_table(repeats: int) -> str:
    """`Transport.solve` after other emission."""
    rows = []
    for name in ROOMS:
        baked = bake(SCENES[name](), tolerance=1e-3, transport=True)
        transport = baked.transport
        assert transport is not None
        brighter = baked.luxels.emission * np.float32(1.5)
        darker = baked.luxels.albedo * np.float32(0.8)
        one, colours = alternating(repeats, partial(transport.solve, brighter), partial(transport.solve, albedo=darker))
        apart = np.abs(transport.solve() - baked.irradiance).max(1)[baked.valid]
        rms = float(np.sqrt((apart**2).mean()) / baked.irradiance[baked.valid].mean())
        rows.append([name, f"{len(transport.starts) - 1:,}", milliseconds(median(one)), milliseconds(median(colours)), f"{rms:.2%}"])
        print("  ".join(map(str, rows[-1])), flush=True)
    text = table(["scene", "groups", "other lights, ms", "other colours, ms", "apart from the bake (RMS)"], rows)
    return f"{text}\n\nMedians of {repeats}, 2 threads. Aimed at: under 100 ms."


_GROWTH = """
import time, warnings
from luxel.radiosity.bake import bake
from luxel.radiosity.diagnosis import estimate
from luxel.scene.builtin import SCENES
warnings.simplefilter("ignore")
bake(SCENES["room-simple"]())
start = time.perf_counter()
baked = bake(SCENES["room-complex"](), page=int(sys.argv[1]))
luxels, triangles = len(baked.luxels.area), sum(len(mesh.triangles) for mesh in baked.atlas.scene.meshes)
print(json.dumps([luxels, time.perf_counter() - start, baked.seconds["solve"], len(baked.ledger), peak(), estimate(luxels, triangles)[0]]))
"""


def scale_table(pages: list[int]) -> str:
    """room-complex on larger pages, each in a process of its own."""
    rows = []
    for page in pages:
        luxels, whole, solve, steps, peak, said = memory.run(_GROWTH, page)
        bytes_ = [f"{peak / 1e6:,.0f}", f"{said / 1e6:,.0f}"]
        rows.append([f"{luxels:,}", f"{whole:.1f}", f"{solve:.1f}", f"{steps}", f"{1e6 * solve / luxels:.1f}", *bytes_])
        print("  ".join(rows[-1]), flush=True)
    head = ["luxels", "all, s", "solve, s", "steps", "us a luxel to solve", "peak, MB", "said before, MB"]
    note = (
        "Quality `normal`, 2 threads, to 0.1 % unshot, without making the pages. The peak is the whole process's, which begins with some 200 MB. "
        "Aimed at: linear, and 1 M luxels within 2 GB."
    )
    return f"{table(head, rows)}\n\n{note}"


_LOOSE = """
sys.path.insert(0, sys.argv[1])
from confetti import measured
print(json.dumps({**measured(int(sys.argv[2])), "peak": peak()}))
"""


def charts_table(count: int) -> str:
    """Rooms full of confetti, up to so many triangles, each in a process of its own."""
    rows = []
    for triangles in (count // 100, count // 10, count):
        got = memory.run(_LOOSE, Path(__file__).parent, triangles)
        times = [f"{got[name]:.1f}" for name in ("laid", "whole", "worked", "said")]
        bytes_ = [f"{got[name] / 1e6:,.0f}" for name in ("peak", "bytes")]
        light = [f"{got['direct'] - 1:+.1%}", f"{got['absorbed'] - 1:+.1%}", "yes" if got["finite"] else "no"]
        rows.append([f"{triangles:,}", f"{got['charts']:,}", f"{got['luxels']:,}", f"{got['pages']}", *times, *bytes_, *light])
        print("  ".join(rows[-1]), flush=True)
    head = ["triangles", "charts", "luxels", "pages", "to lay out, s", "all, s", "processor, s", "said before, s", "peak, MB", "said before, MB",
            "the lamp's light", "absorbed", "finite, none below 0"]  # fmt: skip
    note = (
        f"Quality `draft`, {confetti.DENSITY:g} luxels a metre, 2 threads, with the pages: loose two-sided triangles, {100 * confetti.EDGE:g} cm "
        f"wide, anywhere in a room of {' x '.join(f'{side:g}' for side in confetti.ROOM)} m, facing anywhere, each with one luxel (two sides), about "
        f"a point light. The lamp's light on those {confetti.NEAR:g} to {confetti.FAR:g} m from it is beside what Beer and Lambert's law gives, and "
        "what is absorbed beside what the lamp gives: both are known on the mean only, and a few triangles within centimetres of the lamp hide a per "
        "cent or two of its light more or less. On two cores that nobody shares all takes half of the processor's time."
    )
    return f"{table(head, rows)}\n\n{note}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(PARTS)}; all")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--charts", type=int, default=1_000_000, metavar="N", help="loose triangles at most [1,000,000, which take minutes]")
    parser.add_argument("--quick", action="store_true", help="fewer paths, and no more than 1 M luxels")
    parser.add_argument("--keep", type=Path, help="folder for the path-traced references")
    parser.add_argument("--picture", action="store_true", help="draw the Cornell box's error into docs/gallery (minutes)")
    parser.add_argument("--write", action="store_true", help="put the tables into RESULTS.md, a section a part")
    options = parser.parse_args()
    wanted = set(options.parts or PARTS)
    if wanted - set(PARTS):
        parser.error(f"no part {min(wanted - set(PARTS))!r}")
    warnings.simplefilter("ignore", luxel.LuxelWarning)
    print(machine(), flush=True)
    pages = [1024, 2048, 3500] + ([] if options.quick else [7000])
    jobs = {
        "rooms": ("the paper's rooms", lambda: rooms_table(options.repeats)),
        "truth": ("truth", lambda: truth_table([*cases(options.quick), ceiling_lamp(options.quick), demo_room(options.quick)], options.keep)),
        "peers": ("time to equal error", lambda: peers_table(closed(options.quick), options.keep, options.repeats)),
        "relight": ("relighting", lambda: relight_table(options.repeats)),
        "scale": ("growth", lambda: scale_table(pages)),
        "charts": ("a million charts", lambda: charts_table(options.charts)),
    }
    for part in PARTS:
        if part in wanted:
            title, job = jobs[part]
            print(f"\n{title}", flush=True)
            try:
                text = job()
            except Missing as missing:
                text = f"Missing: {missing}."
            print(text, flush=True)
            if options.write:
                write_section(f"Bake: {title}", f"{machine()}.\n\n{text}")
    if options.picture:
        draw_error(cases(True)[0], 4096, options.keep, ROOT / "docs" / "gallery" / "bake-error.png")


if __name__ == "__main__":
    main()
