"""Ranks of MPI on this machine: speed-up, balance, composition and memory.

    python benchmarks/cluster.py [--write]      # runs itself under mpiexec

A frame of 4 M triangles by two ranks beside one process with one thread; a scene that is all in one corner, divided dynamically and statically; what
composition sends and takes; the memory of each rank for 20 M triangles; and a bake by two ranks beside one, both with one thread each.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import luxel
from luxel.scene.builtin import bumpy_sphere
from luxel.scene.framing import frame
from report import machine, table, write_section

SIZE = (1920, 1080)


def scene(name: str, n: int) -> tuple[luxel.Scene, luxel.Camera]:
    mesh = bumpy_sphere(n)
    whole = luxel.Scene.from_mesh(mesh)
    camera = frame(whole, size=SIZE)
    if name == "corner":  # the lower right one
        turn = camera.world_from_camera
        place = mesh.positions * 0.35 + (turn[:3, 0] * 1.3 - turn[:3, 1] * 0.65).astype(np.float32)
        whole = luxel.Scene.from_mesh(luxel.Mesh(place, mesh.triangles, mesh.normals))
    return whole, camera


def peak() -> float:
    """The largest resident size of this process in MB; `getrusage` would begin with that of the process which started it."""
    return int(re.search(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())[1]) / 1024


def rank(what: str, source: str, repeats: int, divide: str, composition: str, balance: str) -> None:
    """One rank's part of a measurement; rank 0 prints it."""
    from luxel.cluster.comm import world
    from luxel.cluster.render import Renderer

    comm = world()
    with comm.guard():
        made, camera = scene(what, int(source)) if what != "file" else (source, None)
        renderer = Renderer(made, comm, divide, composition, balance)
        taken, ranks = [], []
        for _ in range(repeats):
            for _ in range(2):  # those who waited long in the first have slept, and come late to what follows
                comm.gather(0)
            start = time.perf_counter()
            renderer.render(camera, SIZE, threads=1)
            taken.append(time.perf_counter() - start)
            ranks.append(renderer.ranks)
        peaks = comm.gather(peak())
    if comm.rank == 0:
        print(json.dumps({"taken": taken, "ranks": ranks, "peaks": peaks}))


def ranks(count: int, *words: object) -> Any:
    line = ["mpiexec", "-n", str(count), sys.executable, __file__, "rank", *map(str, words)]
    done = subprocess.run(line, check=True, stdout=subprocess.PIPE, text=True, env={**os.environ, "LUXEL_THREADS": "1"})
    return json.loads(done.stdout)


def alone(n: int, repeats: int) -> list[float]:
    made, camera = scene("whole", n)
    prepared, taken = luxel.prepare(made), []
    for _ in range(repeats):
        start = time.perf_counter()
        luxel.render(prepared, camera, SIZE, threads=1)
        taken.append(time.perf_counter() - start)
    return taken


def speed(n: int = 1000, repeats: int = 33) -> str:
    """Two ranks on two cores beside one process with one thread; before and after, as the machine drifts."""
    one = alone(n, repeats)[3:]
    rows = []
    for balance in ("dynamic", "static"):
        both = ranks(2, "whole", n, repeats, "screen", "swap", balance)["taken"][3:]
        rows.append((balance, both))
    one = statistics.median(one + alone(n, repeats)[3:])
    body = [[name, f"{1e3 * one:.1f}", f"{1e3 * statistics.median(both):.1f}", f"{one / statistics.median(both):.2f}x"] for name, both in rows]
    return table(["screen divided", "one process, one thread, ms", "two ranks, ms", "speed-up"], body)


def corner(n: int = 500, repeats: int = 17) -> str:
    """All of it in one corner: how long the ranks draw, and how long the others wait for the slowest."""
    body = []
    for balance in ("static", "dynamic"):
        for count in (2, 4):
            found = ranks(count, "corner", n, repeats, "screen", "swap", balance)
            busy = np.median([[each["busy"] for each in frame] for frame in found["ranks"][5:]], 0) * 1e3
            idle = 1 - busy.mean() / busy.max()
            body.append([balance, count, f"{1e3 * statistics.median(found['taken'][5:]):.1f}", " ".join(f"{x:.1f}" for x in busy), f"{idle:.0%}"])
    return table(["screen divided", "ranks", "frame, ms", "busy, ms each", "idle"], body)


def composition(n: int = 500, repeats: int = 7) -> str:
    """What is sent, beside N b (1 - 1 / P) with b = 8 bytes of every pixel; and what the frame takes."""
    body = []
    for count in (2, 3, 4):
        for name in ("direct", "swap", "radix"):
            found = ranks(count, "whole", n, repeats, "objects", name, "dynamic")
            last = found["ranks"][-1]
            composed = np.array([each["composed"] for each in last])
            bound = SIZE[0] * SIZE[1] * 8 * (1 - 1 / count)
            took = np.array([each["composing"] for each in last])
            sent = np.array([each["sent"] for each in last]).mean()
            body.append([count, name, f"{composed.mean() / 1e6:.2f}", f"{bound / 1e6:.2f}", f"{composed.mean() / bound:.0%}", f"{sent / 1e6:.2f}",
                         f"{1e9 * took.mean() / (SIZE[0] * SIZE[1]):.1f}"])  # fmt: skip
    return table(["ranks", "composition", "sent, MB a rank", "N b (1 - 1/P), MB", "of it", "in all, MB", "ns a pixel and rank"], body)


def memory(n: int = 2236) -> str:
    body, mesh = [], bumpy_sphere(n)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sphere.ply"
        for normals in ("in the file", "made"):
            luxel.save(mesh if normals == "in the file" else luxel.Mesh(mesh.positions, mesh.triangles), path)
            line = [sys.executable, __file__, "whole", path]
            whole = float(subprocess.run(line, check=True, stdout=subprocess.PIPE, text=True).stdout)
            body.append([normals, "one process", 1, f"{whole:.0f}", "100%"])
            for count in (2, 4):
                peaks = ranks(count, "file", path, 1, "objects", "swap", "dynamic")["peaks"]
                body.append([normals, "objects", count, f"{max(peaks):.0f}", f"{max(peaks) / whole:.0%}"])
    return table(["normals", "divided", "ranks", "largest rank, MB", "of one process"], body)


def bake_rank(*qualities: str) -> None:
    """One rank's part of bakes; rank 0 prints seconds of each, and what the ranks have sent and how long they have waited."""
    from luxel.cluster.comm import world
    from luxel.radiosity.bake import bake
    from luxel.scene.builtin import room_complex

    comm = world()
    found: dict[str, Any] = {}
    with comm.guard():
        made = room_complex()
        for quality in qualities:
            bake(made, quality=quality, density=3, threads=1, comm=comm)  # compiles
        for quality in qualities:
            sent, waited = comm.sent, comm.waited
            comm.gather(0)
            start = time.perf_counter()
            baked = bake(made, quality=quality, threads=1, comm=comm)
            took = time.perf_counter() - start
            of_all = comm.gather([comm.sent - sent, comm.waited - waited])
            found[quality] = took, of_all
    if comm.rank == 0:
        print(json.dumps({"luxels": len(baked.luxels.area), "found": found}))


def baking(repeats: int = 2) -> str:
    """Bakes of the second of the paper's rooms, one rank and two in turn; the least of the times."""
    qualities, body = ("normal", "final"), []
    runs: dict[int, list[Any]] = {1: [], 2: []}
    for count in (1, 2) * repeats:
        line = ["mpiexec", "-n", str(count), sys.executable, __file__, "bake", *qualities]
        done = subprocess.run(line, check=True, stdout=subprocess.PIPE, text=True, env={**os.environ, "LUXEL_THREADS": "1"})
        runs[count].append(json.loads(done.stdout))
    for quality in qualities:
        one, two = (min(run["found"][quality] for run in runs[count]) for count in (1, 2))
        idle = " ".join(f"{waited / two[0]:.0%}" for _, waited in two[1])
        sent = np.mean([sent for sent, _ in two[1]]) / 1e6
        body.append([quality, f"{runs[1][0]['luxels']:,}", f"{one[0]:.2f}", f"{two[0]:.2f}", f"{one[0] / two[0]:.2f}x", idle, f"{sent:.1f}"])
    return table(["quality", "luxels", "one rank, s", "two ranks, s", "speed-up", "idle, each", "sent, MB a rank"], body)


def order(source: str, target: str) -> None:
    """Lay a file out: under mpiexec with all ranks, else alone; rank 0 prints what it took."""
    from luxel.cluster.comm import world
    from luxel.cluster.launchers import launched
    from luxel.cluster.layout_file import optimize_file
    from luxel.layout import files
    from luxel.layout.optimize import Options

    comm, options, start = world(), Options(order="greedy"), time.perf_counter()
    with comm.guard():
        if launched():
            report = optimize_file(Path(source), Path(target), options, comm)[0]
        else:
            report = files.optimize_file(Path(source), Path(target), options)[0]
        taken, peaks = time.perf_counter() - start, comm.gather(peak())
    if comm.rank == 0:
        print(json.dumps({"taken": taken, "peak": max(peaks), "acmr": report.after.acmr[12], "triangles": report.after.triangles}))


def ordering(n: int = 1118) -> str:
    """Memory, time and misses of an order by parts, beside one process's."""
    body, kept = [], []
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "sphere.ply", Path(folder) / "out.ply"
        luxel.save(bumpy_sphere(n), path)
        for count in (0, 1, 2, 4):
            line = ["mpiexec", "-n", str(count)] * (count > 0) + [sys.executable, __file__, "order", str(path), str(out)]
            env = {**os.environ, **({"LUXEL_THREADS": str(max(1, 2 // count))} if count else {})}
            done = json.loads(subprocess.run(line, check=True, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True, env=env).stdout)
            kept += [hashlib.sha256(out.read_bytes()).hexdigest()] * (count > 0)
            name = "one process" if not count else f"ranks: {count}"
            body.append([name, f"{done['peak']:.0f}", f"{done['taken']:.0f}", f"{done['acmr']:.4f}"])
    assert len(set(kept)) == 1, "ranks wrote different bytes"
    return table(["ordered by", "largest rank, MB", "s, measures and all", "ACMR, FIFO 12"], body)


def main() -> None:
    parts = {"speed": speed, "corner": corner, "composition": composition, "memory": memory, "baking": baking, "ordering": ordering}
    chosen = [word for word in sys.argv[1:] if word in parts] or list(parts)
    titles = {
        "ordering": "`luxel optimize --order greedy`, 5 M triangles in a binary PLY file, 2 cores; all numbers of ranks wrote the same bytes:",
        "speed": "4.0 M triangles, 1920x1080, one thread a rank; medians of 30 frames:",
        "corner": "A scene of 1 M triangles that is all in one corner:",
        "composition": "Bytes of composition, 1 M triangles, 1920x1080:",
        "memory": "20 M triangles from a binary PLY file, 1920x1080, peak of each process (a share above 1 M triangles stays in the file):",
        "baking": "Bakes of `room-complex`, one thread a rank, without the pictures' gutters and seams, which rank 0 makes:",
    }
    text = "\n\n".join(f"{titles[name]}\n\n{parts[name]()}" for name in chosen)
    print(text)
    if "--write" in sys.argv:
        write_section("Ranks of MPI", f"{machine()}.\n\n{text}\n")


if __name__ == "__main__":
    if sys.argv[1:2] == ["rank"]:
        what, source, repeats, *ways = sys.argv[2:]
        rank(what, source, int(repeats), *ways)
    elif sys.argv[1:2] == ["order"]:
        order(*sys.argv[2:])
    elif sys.argv[1:2] == ["bake"]:
        bake_rank(*sys.argv[2:])
    elif sys.argv[1:2] == ["whole"]:
        luxel.render(sys.argv[2], size=SIZE, threads=1)
        print(peak())
    else:
        main()
