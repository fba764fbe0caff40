"""What a triangle, a pixel, a tile and a message cost on this machine; and the measured frames."""

from __future__ import annotations

import importlib.util
import json
import os
import pickle
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import luxel
from luxel.cluster.comm import Comm
from luxel.cluster.composite import merge, pack
from luxel.cluster.render import Renderer
from luxel.errors import InputError
from luxel.raster.chunks import chunks_of, reach
from luxel.raster.constants import NOTHING
from luxel.raster.frame import see
from luxel.raster.project import Window
from luxel.raster.render import prepare
from luxel.studies.cluster.facts import TILE, Facts, facts_of, scene_of
from luxel.studies.cluster.model import Costs, Memory

Row = dict[str, Any]
_LIMIT = 150  # seconds that the measured frames of one number of ranks may take


def mpiexec() -> str | None:
    """The launcher, of this environment first; None where it or mpi4py is missing."""
    found = shutil.which("mpiexec", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    return found if importlib.util.find_spec("mpi4py") is not None else None


def case(name: str, kind: str, n: int, size: tuple[int, int], ways: list[tuple[str, str]], repeats: int, folder: Path) -> Row:
    """What `ranks.measured` is to measure: the scene goes into a file, of which a rank reads its share."""
    scene, camera = scene_of(kind, n, size)
    path = folder / f"{kind}-{n}.ply"
    if not path.exists():
        luxel.save(scene, path)
    return {"name": name, "file": str(path), "camera": pickle.dumps(camera).hex(), "size": size, "ways": ways, "repeats": repeats}


def run_ranks(launcher: str, ranks: int, cases: list[Row]) -> Row:
    """Run measured frames with so many ranks of one thread.

    Raises:
        InputError: They failed: what they said.
    """
    line = [launcher, "-n", str(ranks), sys.executable, "-m", "luxel.studies.cluster.ranks", json.dumps(cases)]
    try:
        done = subprocess.run(line, capture_output=True, text=True, timeout=_LIMIT, env={**os.environ, "LUXEL_THREADS": "1"}, check=False,
                              stdin=subprocess.DEVNULL)  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{launcher} -n {ranks}: no end after {_LIMIT} s") from error
    if done.returncode:
        raise InputError(f"{launcher} -n {ranks}: {done.stderr.strip()[-500:] or f'exit code {done.returncode}'}")
    found: Row = json.loads(done.stdout.splitlines()[-1])
    return found


def costs(quick: bool, call: float, step: float, byte: float) -> tuple[Costs, list[Row]]:
    """Prices, fitted to frames of one thread (non-negative least squares of relative errors); and those frames, beside the fit."""
    from scipy.optimize import nnls

    sizes = ((320, 180), (640, 360)) if quick else ((640, 360), (1280, 720), (1920, 1080))
    numbers = (30, 120) if quick else (60, 250, 500)
    rows: list[Row] = []
    terms, taken = [], []
    for kind in ("even", "corner"):
        for n in numbers:
            for size in sizes:
                facts, seconds = facts_of(kind, n, size), _seconds(kind, n, size, 2 if quick else 5)
                terms.append([1.0, facts.triangles, float(facts.seen.sum()), len(facts.owner), facts.tiles])
                taken.append(seconds)
                rows.append({"scene": kind, "triangles": facts.triangles, "seen": int(facts.seen.sum()), "covered pixels": len(facts.owner),
                             "tiles": facts.tiles, "ms": 1e3 * seconds})  # fmt: skip
    matrix, time_of = np.array(terms), np.array(taken)
    found, _ = nnls(matrix / time_of[:, None], np.ones(len(time_of)))
    for row, fit in zip(rows, matrix @ found, strict=True):
        row["fit, ms"] = 1e3 * float(fit)
        row["fit / measured"] = row["fit, ms"] / row["ms"]
    base, triangle, visible, pixel, tile = map(float, found)
    n, size = numbers[-1], sizes[-1]
    return Costs(base, triangle, visible, pixel, tile, _skipped(n, size), _sample(), _owned(n, size), byte, 0.0, call, step), rows


def _median(work: Any, repeats: int) -> float:
    taken = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken[1:]))


def _seconds(kind: str, n: int, size: tuple[int, int], repeats: int) -> float:
    scene, camera = scene_of(kind, n, size)
    prepared = prepare(scene)
    return _median(lambda: luxel.render(prepared, camera, size, samples=1, threads=1), repeats)


def _owned(n: int, size: tuple[int, int]) -> float:
    """Of a covered pixel, what one rank takes longer that shares triangles with nobody."""
    scene, camera = scene_of("even", n, size)
    taken = {}
    for divide in ("screen", "objects"):
        renderer = Renderer(scene, Comm(), divide)
        taken[divide] = _median(lambda renderer=renderer: renderer.render(camera, size, samples=1, threads=1), 5)
    return max(0.0, taken["objects"] - taken["screen"]) / len(facts_of("even", n, size).owner)


def _skipped(n: int, size: tuple[int, int]) -> float:
    """Of a triangle whose neighbours are all out of reach."""
    scene, camera = scene_of("even", n, size)
    prepared = prepare(scene)
    view, chunks = see(prepared, camera, size, None, 1).view, chunks_of(prepared.geometry)
    window = Window(0, 0, *size, *size)
    return _median(lambda: reach(chunks, view, window, (0, 0, TILE, TILE)), 5) / scene.triangle_count


def _sample() -> float:
    """Of a sample of a tile that is packed and merged."""
    tiles, samples = 200, TILE * TILE
    ids = np.where(np.arange(samples) % 100 < 80, np.arange(samples, dtype=np.int32), np.int32(NOTHING))[None].repeat(tiles, 0)
    depths, slots = np.where(ids >= 0, np.float32(0.5), np.float32(-1)), np.arange(tiles)
    into, nearness = ids.copy(), depths.copy()
    return _median(lambda: merge(pack(slots, samples, ids, depths), into, nearness), 5) / (tiles * samples * 0.8)


def memory(rows: list[Row], tiny: tuple[int, int], facts: Facts) -> Memory:
    """Bytes of a rank, of the peaks of one rank that drew "tiny", "tiny large" and "main", in turn.

    Args:
        rows: Measured.
        tiny: Pixels of "tiny" and of "tiny large".
        facts: Of "main".
    """
    peaks = [next(row["peak"] for row in rows if row["name"] == name) for name in ("tiny", "tiny large", "even")]
    pixel = max(0.0, (peaks[1] - peaks[0]) / (tiny[1] - tiny[0]))
    return Memory(peaks[0] - pixel * tiny[0], max(1.0, (peaks[2] - peaks[1]) / facts.all_triangles), pixel)
