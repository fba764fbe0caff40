"""The direct Fourier transform of the paper: serial, on threads, on the ranks of MPI, and on both; and the fast one beside them."""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cluster.launchers import launched
from luxel.filter.transform import dft2, fft2, idft2, ifft2
from luxel.studies.antialiasing import PAPER
from luxel.studies.report import Report, published
from luxel.studies.study import HERE, Context

_PUBLISHED = {8: (1.05256, 0.62173, 0.447273, 0.77006), 16: (15.4747, 5.24593, 1.48177, 0.967979), 32: (254.575, 75.142, 6.4249, 5.7888),
              64: (3916.36, 1071.5, 96.0414, 37.5295)}  # fmt: skip
_COLUMNS = ("serial, ms", "threads, ms", "MPI, ms", "MPI and threads, ms", "FFT, ms")


def random_plane(size: int) -> Array:
    """The paper's input: random values in 0.1 .. 10."""
    return np.random.default_rng(size).uniform(0.1, 10, (size, size))


def timed(call: Callable[[], object], budget: float = 0.5) -> float:
    """Median seconds of a call, repeated (and for short ones in rounds) until `budget` seconds are spent; the first is not counted."""
    call()
    start = time.perf_counter()
    call()
    once = time.perf_counter() - start
    rounds = max(1, int(1e-3 / max(once, 1e-9)))
    times: list[float] = []
    spent = 0.0
    while len(times) < 3 or (spent < budget and len(times) < 51):
        start = time.perf_counter()
        for _ in range(rounds):
            call()
        spent += time.perf_counter() - start
        times.append((time.perf_counter() - start) / rounds)
        if once > budget:
            break
    return statistics.median(times)


def launcher() -> str | None:
    """mpiexec, that of this environment first, if it and mpi4py are there."""
    from importlib.util import find_spec

    if find_spec("mpi4py") is None:
        return None
    return shutil.which("mpiexec", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))


def over_ranks(sizes: list[int], ranks: int, threads: int) -> dict[int, float] | None:
    """Seconds of the inverse direct transform of each size by `ranks` ranks of `threads` threads; None without MPI."""
    command = launcher()
    if command is None or launched():  # or already one of several ranks
        return None
    line = [command, "-n", str(ranks), sys.executable, "-m", __name__, json.dumps(sizes), str(threads)]
    done = subprocess.run(line, capture_output=True, text=True, check=True)
    return {int(size): seconds for size, seconds in json.loads(done.stdout).items()}


def main() -> None:
    """What each rank runs: times of the sizes and threads given, as JSON on rank 0."""
    from luxel.cluster.comm import world
    from luxel.cluster.fft import dft2 as ranks_dft2

    comm = world()
    sizes, threads = json.loads(sys.argv[1]), int(sys.argv[2])
    found = {}
    with comm.guard():
        for size in sizes:
            spectrum = fft2(random_plane(size), 1)
            times: list[float] = []
            for _ in range(4 if size >= 64 else 12):
                comm.share(None)
                start = time.perf_counter()
                ranks_dft2(spectrum if comm.rank == 0 else None, comm, threads, inverse=True)
                times.append(time.perf_counter() - start)
            found[size] = statistics.median(times[1:])
    if comm.rank == 0:
        print(json.dumps(found))  # noqa: T201


def run(context: Context, report: Report) -> None:
    """Times and speed-ups at each size, and the round trip."""
    sizes = [8, 16, 32] if context.quick else [8, 16, 32, 64, 128]
    threads = max(context.threads, 1)
    ranks = max(2, threads)
    by_mpi, by_both = over_ranks(sizes, ranks, 1), over_ranks(sizes, ranks, 2)
    rows: list[dict[str, Any]] = []
    trips = []
    for size in sizes:
        spectrum = fft2(random_plane(size), 1)
        row: dict[str, Any] = {"size": size, "source": HERE, "serial, ms": 1e3 * timed(partial(idft2, spectrum, 1)),
                               "threads, ms": 1e3 * timed(partial(idft2, spectrum, threads))}  # fmt: skip
        if by_mpi is not None and by_both is not None:
            row |= {"MPI, ms": 1e3 * by_mpi[size], "MPI and threads, ms": 1e3 * by_both[size]}
        row["FFT, ms"] = 1e3 * timed(partial(ifft2, spectrum, 1))
        rows.append(row | {"serial / FFT": row["serial, ms"] / row["FFT, ms"]})
        trips += [round_trip(size, kind) for kind in (np.float64, np.float32)] if size <= 64 else []
    for size, times in _PUBLISHED.items():
        rows.append({"size": size, "source": PAPER} | dict(zip(_COLUMNS, times, strict=False)))
    note = f"Here {threads} threads, {ranks} ranks, and {ranks} ranks of 2 threads; the paper has 4 threads, and a cluster of 32 nodes of 2 cores."
    if by_mpi is None:
        note += " MPI is not installed here: pip install 'luxel[mpi]'."
    report.table("fourier", "The inverse transform", rows, f"The direct quadruple sum, complex double precision. {note} Medians.")
    report.table("round_trip", "There and back", trips, "Largest error of the direct transform and its inverse on values in 0.1 .. 10; "
                 "the paper asks for 1e-2.")  # fmt: skip
    _figure(report, rows)


def round_trip(size: int, kind: Any) -> dict[str, Any]:
    """The error of forward and inverse together, and whether the paper's check passes."""
    f = random_plane(size).astype(kind)
    error = float(np.abs(idft2(dft2(f, None), None) - f).max())
    return {"size": size, "precision": np.dtype(kind).name, "largest error": error, "within 1e-2": "yes" if error < 1e-2 else "no"}


def _figure(report: Report, rows: list[dict[str, Any]]) -> None:
    with report.figure("fourier", "Speed-up over the serial direct transform", size=(9.0, 4.2)) as axes:
        for name in _COLUMNS[1:]:
            for source in (HERE, PAPER):
                chosen = [row for row in rows if row["source"] == source and row.get(name)]
                x, y = [row["size"] for row in chosen], [row["serial, ms"] / row[name] for row in chosen]
                if chosen and source == HERE:
                    axes.plot(x, y, "o-", label=name.removesuffix(", ms"))
                elif chosen:
                    published(axes, x, y, name.removesuffix(", ms"))
        axes.set_xscale("log", base=2)
        axes.set_yscale("log")
        axes.set_xlabel("pixels a side")
        axes.set_ylabel("serial time / time")


if __name__ == "__main__":
    main()
