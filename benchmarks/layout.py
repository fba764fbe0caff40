"""luxel's triangle orders beside meshoptimizer's: misses on caches and GPU models, and speed; both in one run, in turns.

    python benchmarks/layout.py                 # print
    python benchmarks/layout.py --write         # and put the tables into RESULTS.md
    python benchmarks/layout.py --quick         # without the widest look-ahead and the largest meshes
    python benchmarks/layout.py --only speed    # or orders: the half that reads the clock, for which the machine should be quiet, or the other

Misses are counted by meshoptimizer's analyser where it is installed. Without it, or without the models, it says so and measures the rest.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import luxel
from luxel.layout import batch, misses, order
from luxel.layout.cache import used_vertices
from luxel.layout.partition import PART
from luxel.scene.builtin import bumpy_sphere
from meshopt import Meshoptimizer, Missing
from report import machine, median, meshes, table, write_section

FITTED = ("fandisk", "lionstatue", "beetle")
FITTED_PATCHES = (*FITTED, "horse", "koala")
FIFO = (12, 16)
WIDEST = 32


@dataclass(frozen=True)
class Case:
    """A mesh: (m, 3) int32 triangles below `vertices`."""

    name: str
    triangles: Any
    vertices: int

    @property
    def indices(self) -> Any:
        return self.triangles.astype(np.uint32)


def models(folder: Path) -> tuple[list[Case], list[Case]]:
    """The single models, welded by position as papers measure them; and all meshes of 200 triangles and more as the files have them."""
    welded, files = [], []
    for path in sorted(folder.rglob("*")):
        if path.suffix not in (".obj", ".ply", ".off", ".glb", ".gltf"):
            continue
        scene = luxel.load(path, normals=False)
        for k, mesh in enumerate(scene.meshes):
            name = path.stem if len(scene.meshes) == 1 else f"{path.stem} {k}"
            if len(mesh.triangles) >= 200:
                files.append(Case(name, mesh.triangles, len(mesh.positions)))
            if path.parent == folder:
                _, same = np.unique(mesh.positions, axis=0, return_inverse=True)
                first = np.unique(same.reshape(-1), return_index=True)[1]
                number = np.argsort(np.argsort(first))  # numbered as the file has them, not by coordinate
                welded.append(Case(name, number[same.reshape(-1)].astype(np.int32)[mesh.triangles], len(first)))
    return welded, files


def counted(peer: Meshoptimizer | None, case: Case, triangles: Any, cache: int) -> float:
    """Misses per triangle on a FIFO, by the peer's analyser if it is there."""
    if peer:
        return float(peer.reuse(np.ascontiguousarray(triangles, np.uint32), case.vertices, cache).acmr)
    return int(misses(triangles, cache, vertex_count=case.vertices).sum(dtype=np.int64)) / len(triangles)


def quality(peer: Meshoptimizer | None, case: Case, cache: int, width: int, threads: int) -> list[float]:
    """ACMR: file, the peer's two (Fifo at its best target), and luxel's orders."""
    names = [(name, None) for name in ("tipsify", "lin-yu", "greedy-2016", "greedy")] + [("look-ahead", w) for w in (3, 4, width)]
    ours = [order(case.triangles, case.vertices, name, cache, width=w, threads=threads).triangles for name, w in names]
    theirs = [case.triangles]
    if peer:
        targets = [peer.fifo(case.indices, case.vertices, cache + more) for more in range(-1, 5)]
        theirs += [peer.optimize(case.indices, case.vertices), min(targets, key=lambda t: counted(peer, case, t, cache))]
    return [counted(peer, case, triangles, cache) for triangles in (*theirs, *ours)]


def quality_table(peer: Meshoptimizer | None, cases: list[Case], cache: int, width: int, threads: int) -> str:
    head = ["mesh", "triangles", "file", *(["optimizeVertexCache", "Fifo, best target"] if peer else []),
            "tipsify", "lin-yu", "greedy-2016", "greedy", "look-ahead 3", "look-ahead 4", f"look-ahead {width}"]  # fmt: skip
    rows, all_ = [], []
    for case in cases:
        figures = quality(peer, case, cache, width, threads)
        all_.append(figures)
        rows.append([case.name + (" *" if case.name in FITTED else ""), f"{len(case.triangles)}", *(f"{x:.4f}" for x in figures)])
        print("  ".join(map(str, rows[-1])), flush=True)
    rows.append(["mean", "", *(f"{x:.4f}" for x in np.mean(all_, 0))])
    return table(head, rows)


def models_table(peer: Meshoptimizer | None, cases: list[Case], threads: int) -> str:
    """ATVR on the GPU models: the peer's order, and luxel's for each model."""
    rows, all_ = [], []
    for case in cases:
        used, figures = used_vertices(case.triangles, case.vertices), []
        theirs = peer.optimize(case.indices, case.vertices).astype(np.int32) if peer else None
        for name in batch.MODELS:
            if theirs is not None:
                figures.append(batch.reuse(theirs, name, case.vertices).atvr)
            figures.append(order(case.triangles, case.vertices, profile=name, threads=threads).acmr * len(case.triangles) / used)
        rows.append([case.name + (" *" if case.name in FITTED_PATCHES else ""), *(f"{x:.3f}" for x in figures)])
        print("  ".join(rows[-1]), flush=True)
        if case.name not in FITTED_PATCHES:
            all_.append(figures)
    mean = np.mean(all_, 0)
    rows.append(["mean of those not *", *(f"{x:.3f}" for x in mean)])
    if peer:
        rows.append(["ratio", *(text for a, b in mean.reshape(-1, 2) for text in ("", f"{b / a - 1:+.1%}"))])
    return table(["mesh", *(f"{name}, {who}" for name in batch.MODELS for who in ((["meshoptimizer"] if peer else []) + ["luxel"]))], rows)


def processor_time(repeats: int, *jobs: Callable[[], object]) -> list[float]:
    """Median seconds of this thread's processor time of each job, run in turns after one that is not counted."""
    taken: list[list[float]] = [[] for _ in jobs]
    for turn in range(repeats + 1):
        for job, times in zip(jobs, taken, strict=True):
            start = time.thread_time()
            job()
            if turn:
                times.append(time.thread_time() - start)
    return [median(times) for times in taken]


def speed_table(peer: Meshoptimizer | None, cases: list[Case], repeats: int) -> str:
    """Million triangles a second of one core: whole calls, from indices to indices."""
    pairs = ["optimizeVertexCache", "greedy", "ratio", "Fifo 14", "tipsify", "ratio"] if peer else ["greedy", "tipsify"]
    head = ["mesh", "triangles", *pairs, "look-ahead 1", "look-ahead 3", "look-ahead 4"]
    rows, ratios = [], []
    for case in cases:
        ours: list[Callable[[], object]] = [partial(order, case.triangles, case.vertices, name, threads=1) for name in ("greedy", "tipsify")]
        ours += [partial(order, case.triangles, case.vertices, "look-ahead", width=width, threads=1) for width in (1, 3, 4)]
        indices = case.indices
        theirs: list[Callable[[], object]] = []
        if peer:
            theirs = [partial(peer.optimize, indices, case.vertices), partial(peer.fifo, indices, case.vertices, 14)]
        fast = processor_time(repeats, *theirs, *ours[:2])
        slow = processor_time(max(1, repeats // 5), *ours[2:])
        m = len(case.triangles) / 1e6
        if peer:
            figures = [m / fast[0], m / fast[2], fast[0] / fast[2], m / fast[1], m / fast[3], fast[1] / fast[3]]
        else:
            figures = [m / fast[0], m / fast[1]]
        ratios.append(figures + [m / x for x in slow])
        rows.append([case.name, f"{len(case.triangles)}", *(f"{x:.2f}" for x in ratios[-1])])
        print("  ".join(rows[-1]), flush=True)
    rows.append(["mean", "", *(f"{x:.2f}" for x in np.mean(ratios, 0))])
    return table(head, rows)


def threads_table(case: Case, repeats: int) -> str:
    """One thread and two on a large mesh, by the clock; and what the parts cost."""
    from luxel.layout import partition

    rows = []
    for name, width in (("greedy", None), ("look-ahead", 4)):
        walls: dict[int, list[float]] = {1: [], 2: []}
        processor: dict[int, list[float]] = {1: [], 2: []}
        for turn in range(repeats + 1):
            for threads in walls:
                start, began = time.perf_counter(), time.process_time()
                ordered = order(case.triangles, case.vertices, name, width=width, threads=threads)
                if turn:
                    walls[threads].append(time.perf_counter() - start)
                    processor[threads].append(time.process_time() - began)
        partition.PART = len(case.triangles)
        whole = order(case.triangles, case.vertices, name, width=width, threads=1)
        partition.PART = PART
        seconds = [min(times) for times in (*walls.values(), *processor.values())]
        cost = f"{ordered.acmr / whole.acmr - 1:+.2%}"
        rows.append([name, *(f"{x:.2f}" for x in seconds), f"{seconds[0] / seconds[1]:.2f}x", f"{ordered.acmr:.4f}", f"{whole.acmr:.4f}", cost])
    head = [f"{case.name}, {len(case.triangles)} triangles", "1 thread, s", "2 threads, s", "1 thread, processor s", "2 threads, processor s",
            "ratio", "ACMR", "without parts", "parts cost"]  # fmt: skip
    return table(head, rows)


def growth_table(sizes: list[int], threads: int) -> str:
    """Seconds and memory against size, on bumpy spheres."""
    rows = []
    for n in sizes:
        mesh = bumpy_sphere(n)
        for name, width in (("greedy", None), ("look-ahead", 4)):
            tracemalloc.start()
            start, processor = time.perf_counter(), time.process_time()
            ordered = order(mesh.triangles, len(mesh.positions), name, width=width, threads=threads)
            taken, used, m = time.perf_counter() - start, time.process_time() - processor, len(mesh.triangles)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            rows.append([f"{m}", name, f"{ordered.acmr:.4f}", f"{taken:.2f}", f"{1e9 * used / m:.0f}", f"{peak / m:.0f}"])
            print("  ".join(rows[-1]), flush=True)
    head = ["triangles", "order", "ACMR at 12", f"s, {threads} threads", "processor ns a triangle", "peak of arrays made, bytes a triangle"]
    return table(head, rows)


def orders(peer: Meshoptimizer | None, welded: list[Case], files: list[Case], width: int, threads: int) -> list[str]:
    """What the orders miss: no clock is read."""
    text = []
    for cache in FIFO:
        print(f"FIFO of {cache}", flush=True)
        text += [f"ACMR on a FIFO of {cache}, vertices welded by position. Meshes with * were used to fit the costs.",
                 quality_table(peer, welded, cache, width, threads)]  # fmt: skip
    print("models", flush=True)
    text += ["ATVR on the GPU models (cache, warp, group: nvidia 32, 32, 32; amd 14, 64, 128; intel 128; mobile 16), `auto`. "
             "Those with * were used to fit the patches for nvidia; amd and intel were fitted on the three with * above, and meshes made by code.",
             models_table(peer, welded, threads)]  # fmt: skip
    print("files", flush=True)
    small = [case for case in files if len(case.triangles) < 200_000]
    return [*text, "ACMR on a FIFO of 12, vertices as the files have them.", quality_table(peer, small, 12, min(width, 16), threads)]


def speed(peer: Meshoptimizer | None, welded: list[Case], sizes: list[int], repeats: int, threads: int) -> list[str]:
    """How long they take."""
    text = []
    if welded:
        print("speed", flush=True)
        text += ["Million triangles a second of one core (processor time, medians, in turns), whole calls, at a FIFO of 12.",
                 speed_table(peer, welded, repeats)]  # fmt: skip
        largest = max(welded, key=lambda case: len(case.triangles))
        text += ["Threads, the best of the runs, by the clock and by processor time (two threads alone on two cores take half as long by the clock):",
                 threads_table(largest, repeats)]  # fmt: skip
    return [*text, "Growth, on bumpy spheres:", growth_table(sizes, threads)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--only", choices=["orders", "speed"], help="what the orders miss, or how long they take; both unless told")
    parser.add_argument("--quick", action="store_true", help="look-ahead no wider than 16, and no mesh above a million triangles")
    parser.add_argument("--write", action="store_true", help="put the tables into RESULTS.md")
    options = parser.parse_args()
    warnings.simplefilter("ignore", luxel.LuxelWarning)
    try:
        peer: Meshoptimizer | None = Meshoptimizer()
        peer_name = peer.name if peer else ""
    except Missing as missing:
        peer, peer_name = None, f"missing ({missing})"
    print(f"{machine()}\npeer: {peer_name}", flush=True)
    head = f"{machine()}. Peer: {peer_name}, compiled C++ called through ctypes."
    folder = meshes()
    welded, files = models(folder) if folder else ([], [])
    if folder is None:
        head += " No real models: LUXEL_MESHES names no folder."
    made: dict[str, list[str]] = {}
    if options.only != "speed" and folder:
        made["Mesh layout"] = orders(peer, welded, files, 16 if options.quick else WIDEST, options.threads)
    if options.only != "orders":
        sizes = [50, 158, 500] if options.quick else [50, 158, 500, 1581]
        made["Mesh layout, speed"] = speed(peer, welded, sizes, options.repeats, options.threads)
    for title, parts in made.items():
        text = "\n\n".join([head, *parts])
        print(f"## {title}\n\n{text}")
        if options.write:
            write_section(title, text)


if __name__ == "__main__":
    main()
