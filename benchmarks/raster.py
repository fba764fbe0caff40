"""luxel's rasteriser beside llvmpipe: both in one run, in turns, medians; 1920x1080, the colour read back.

    python benchmarks/raster.py                 # print
    python benchmarks/raster.py --write         # and put the tables into RESULTS.md and README.md
    python benchmarks/raster.py --repeats 3 --sizes 50 160

Without moderngl or EGL it says so and measures luxel alone.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import floor
import luxel
import memory
from llvmpipe import Drawing, Llvmpipe, Missing
from luxel.scene.builtin import bumpy_sphere
from luxel.scene.colour import bytes_from_linear
from luxel.scene.transforms import look_at
from report import README, alternating, machine, median, meshes, milliseconds, table, write_between, write_section

SIZE = (1920, 1080)
STAGES = ("prepare", "project", "clip", "bin", "cover", "shade", "resolve")


@dataclass(frozen=True)
class Look:
    """The Lambert material and light that both draw with."""

    albedo: tuple[float, float, float] = (0.9, 0.9, 0.9)
    irradiance: float = 0.9 * math.pi
    ambient: float = 0.1
    direction: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def to_light(self) -> tuple[float, ...]:
        length = math.sqrt(sum(x * x for x in self.direction))
        return tuple(x / length for x in self.direction)

    def scene(self, mesh: luxel.Mesh, double_sided: bool = False) -> luxel.Scene:
        scene = luxel.Scene(ambient=luxel.Ambient((self.ambient,) * 3, (self.ambient,) * 3))
        scene.add(mesh, luxel.Material((*self.albedo, 1.0), specular=(0.0, 0.0, 0.0), shading="phong", double_sided=double_sided))
        scene.lights.append(luxel.Light("directional", intensity=self.irradiance, world_from_light=look_at(self.direction, (0, 0, 0))))
        return scene


@dataclass
class Case:
    """One mesh at one number of samples; the seconds are medians."""

    name: str
    triangles: int
    samples: int
    one: float
    two: float
    peer: float | None
    stages: dict[str, float]
    apart: float | None

    def row(self) -> list[str]:
        peer = "–" if self.peer is None else milliseconds(self.peer)
        ratio = "–" if self.peer is None else f"{self.peer / self.two:.1f}x"
        return [self.name, _many(self.triangles), "none" if self.samples == 1 else f"MSAA {self.samples}", milliseconds(self.two), peer, ratio,
                milliseconds(self.one), f"{self.one / self.two:.2f}x", f"{self.triangles / self.two / 1e6:.1f}",
                f"{SIZE[0] * SIZE[1] / self.two / 1e6:.0f}"]  # fmt: skip


HEAD = ["scene", "triangles", "anti-aliasing", "luxel, ms", "llvmpipe, ms", "ratio", "1 thread, ms", "1 to N threads", "Mtri/s", "Mpixel/s"]


def measure(name: str, scene: luxel.Scene, camera: luxel.Camera, samples: int, peer: Drawing | None, options: Any) -> Case:
    """Draw `scene` with all threads, with one, and by the peer, in turns."""
    prepared = luxel.prepare(scene)
    pictures: list[luxel.Picture] = []

    def draw(threads: int) -> None:
        pictures.append(luxel.render(prepared, camera, SIZE, samples=samples, threads=threads))
        del pictures[:-1]
        if threads == options.threads:
            stages.append(pictures[0].seconds)

    stages: list[dict[str, float]] = []
    jobs = [partial(draw, options.threads), partial(draw, 1), *([peer.draw] if peer else [])]
    times = [median(taken) for taken in alternating(options.repeats, *jobs, before=1)]
    by_stage = {stage: median([seconds.get(stage, 0.0) for seconds in stages[1:]]) for stage in STAGES}
    apart = _apart(pictures[0].color, peer.picture()) if peer else None
    return Case(name, scene.triangle_count, samples, times[1], times[0], times[2] if peer else None, by_stage, apart)


def _apart(ours: Any, theirs: Any) -> float:
    """Share of pixels that differ by more than 8 of 255 in the encoded colour: both must have drawn the same thing."""
    encoded = bytes_from_linear(theirs[..., :3].astype(np.float32) / np.float32(255)).astype(int)
    covered = (ours[..., 3:] / 255.0) * ours[..., :3]  # the peer's edges are blended with black, in linear light; compare away from them
    inside = (ours[..., 3] == 255) & (theirs[..., 3] == 255)
    differs = (np.abs(covered - encoded).max(-1) > 8) & inside
    return float((differs | ((ours[..., 3] > 0) != (theirs[..., 3] > 0))).mean())


def spheres(peer: Llvmpipe | None, options: Any) -> list[Case]:
    camera = luxel.Camera.look_at((0, 0, 2.6), (0, 0, 0), near=0.1, far=10.0)
    cases = []
    for n in options.sizes:
        mesh = bumpy_sphere(n)
        for samples in (1, 4):
            cases.append(_against("bumpy sphere", mesh, Look(), camera, samples, peer, options))
    return cases


def _against(name: str, mesh: luxel.Mesh, look: Look, camera: luxel.Camera, samples: int, peer: Llvmpipe | None, options: Any,
             double_sided: bool = False) -> Case:  # fmt: skip
    drawing = Drawing(peer, mesh, camera, SIZE, samples, look, double_sided) if peer else None
    try:
        case = measure(name, look.scene(mesh, double_sided), camera, samples, drawing, options)
    finally:
        if drawing:
            drawing.release()
    _tell(case)
    return case


def models(peer: Llvmpipe | None, folder: Path, options: Any) -> list[Case]:
    """The full Stanford dragon, Lambert-lit, by both; the textured helmet and the demo room, physically based, by luxel."""
    cases = []
    dragon = luxel.load(folder / "dragon_vrip.ply")
    camera = luxel.frame(dragon, size=SIZE)
    for samples in (1, 4):
        cases.append(_against("Stanford dragon", dragon.meshes[0], Look(), camera, samples, peer, options, double_sided=True))
    helmet = luxel.load(folder / "scenes" / "DamagedHelmet" / "DamagedHelmet.gltf")
    for name, scene in (("damaged helmet, PBR, 5 textures", helmet), ("demo room, PBR, textures", luxel.scene.builtin.room())):
        for samples in (1, 4):
            cases.append(measure(name, scene, luxel.camera_for(scene, SIZE), samples, None, options))
            _tell(cases[-1])
    return cases


def _tell(case: Case) -> None:
    print("  ".join(case.row()), "" if case.apart is None else f"  apart {case.apart:.2%}", flush=True)


def _many(count: int) -> str:
    return f"{count / 1e6:.1f} M" if count >= 1e6 else f"{count / 1e3:.0f} k"


def _stages(cases: list[Case]) -> str:
    rows = [[_label(case), *(f"{1e3 * case.stages[stage]:.1f}" for stage in STAGES)] for case in cases]
    return table(["ms", *STAGES], rows)


def _floors(cases: list[Case], bandwidth: float) -> str:
    rows = []
    for case in (case for case in cases if case.name == "bumpy sphere" and case.samples == 1):
        n = round(math.sqrt(case.triangles / 4))
        moved = floor.moved(bumpy_sphere(n), SIZE)
        least = moved / bandwidth
        rows.append([_many(case.triangles), f"{moved / 1e6:.0f}", milliseconds(least), milliseconds(case.two), f"{case.two / least:.1f}x"])
    return table(["triangles", "MB moved", "floor, ms", "luxel, ms", "above the floor"], rows)


def _label(case: Case) -> str:
    return f"{case.name}, {_many(case.triangles)}" + (f", MSAA {case.samples}" if case.samples > 1 else "")


def _short(cases: list[Case]) -> str:
    """The cases that stay below what luxel aims at, and the stage that takes most of their time."""
    below = []
    for case in cases:
        aim = 4.0 if case.samples > 1 else 3.0 if case.triangles >= 100_000 else 2.0
        ratio, threads = math.inf if case.peer is None else case.peer / case.two, case.one / case.two
        if ratio < aim or threads < 1.8:
            stage = max(STAGES, key=lambda name: case.stages[name])
            missed = [f"{ratio:.1f}x llvmpipe of {aim:.0f}x"] * (ratio < aim) + [f"{threads:.2f}x by threads"] * (threads < 1.8)
            below.append([_label(case), " and ".join(missed), f"{stage}, {case.stages[stage] / sum(case.stages.values()):.0%}"])
    if not below:
        return "All of them are reached."
    return table(["not reached", "measured", "most of the time"], below)


def _text(cases: list[Case], peer: str, bandwidth: float, peak: str, options: Any) -> str:
    apart = [case.apart for case in cases if case.apart is not None]
    same = f" Pixels in which the two pictures differ visibly: at most {max(apart):.2%}." if apart else ""
    return f"""{machine()}. Peer: {peer}.

1920x1080, the colour read back into memory; medians of {options.repeats} runs, luxel with {options.threads} threads, luxel with one and
llvmpipe with {options.threads} in turns. Lambert-lit; llvmpipe leaves its colours linear, luxel encodes them as sRGB and makes coverage alpha.{same}

{table(HEAD, [case.row() for case in cases])}

In its turn each draws two frames, and the second is timed: frames of one scene follow each other, and find their own data in the caches.

The aims are twice as fast as llvmpipe at every size, three times from 100 k triangles on, four times with MSAA 4, and 1.8 times as fast with two
threads as with one. What limits small scenes is work by the pixel, which no triangle count takes away: fragments are filled, lit and encoded. It is
arithmetic, not memory (see the floor). Two threads gain less there: one alone prepares, projects and bins for half a millisecond, the second starts
0.08 ms late, and two cores at work are each 5% slower than one; docs/decisions/0019 counts where the time of a frame goes.
What brought it here: planes of a triangle set up once a tile and runs filled eight fragments at a time, triangles judged and set up in vector
registers, four samples drawn at once, whole opaque pixels written straight to the picture, memory used again, one loop that lights and encodes
Lambert under a directional light in vectors of 512 bits, tiles that are covered and shaded at once, so that what is visible stays in the core's
cache, and threads that begin at both ends of the picture. Tried without gain: 512-bit vectors elsewhere, spans for triangles from 8 pixels on.

{_short(cases)}

Time by stage, all threads; where only colours are wanted, tiles are covered and shaded at once, and the time is under shade:

{_stages(cases)}

The floor: bytes that this pipeline must move (see `floor.py`) at the {bandwidth / 1e9:.1f} GB/s that copying reaches with as many threads.

{_floors(cases, bandwidth)}

Memory: {peak}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=21)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--sizes", type=int, nargs="+", default=[50, 160, 500, 1000], help="n of 4 n^2 triangles")
    parser.add_argument("--no-models", action="store_true", help="only the spheres")
    parser.add_argument("--write", action="store_true", help="put the tables into RESULTS.md and README.md")
    options = parser.parse_args()
    peer: Llvmpipe | None = None
    try:
        peer = Llvmpipe(options.threads)
        peer_name = peer.name
    except Missing as missing:
        peer_name = f"missing ({missing})"
    print(f"{machine()}\npeer: {peer_name}", flush=True)
    cases = spheres(peer, options)
    folder = meshes()
    if folder is None:
        print("no real models: LUXEL_MESHES names no folder")
    elif not options.no_models:
        cases += models(peer, folder, options)
    peak = memory.sentence(max(options.sizes), SIZE)
    text = _text(cases, peer_name, floor.bandwidth(options.threads), peak, options)
    print(text)
    if options.write:
        write_section("Rasteriser", text)
        write_between(README, "performance", table(HEAD[:6], [case.row()[:6] for case in cases]))


if __name__ == "__main__":
    main()
