"""Measured frames: run as a module under mpiexec, `python -m luxel.studies.cluster.ranks CASES`, it prints what each took, as JSON."""

from __future__ import annotations

import json
import pickle
import sys
import time
from typing import Any

import numpy as np

from luxel.cluster.comm import Comm, world
from luxel.memory import peak_bytes

_PINGS = 200


def network_of(comm: Comm) -> tuple[float, float]:
    """Seconds of an empty message, and bytes a second, between rank 0 and 1."""
    if comm.size < 2 or comm.rank > 1:
        return 0.0, 0.0
    found = []
    for size, repeats in ((1, _PINGS), (1 << 24, 5)):
        data, got, taken = np.zeros(size, np.uint8), np.zeros(size, np.uint8), []
        for _ in range(repeats):
            start = time.perf_counter()
            comm.move([(1 - comm.rank, data)], [(1 - comm.rank, got)])
            taken.append(time.perf_counter() - start)
        found.append(float(np.median(taken)))
    return found[0], (1 << 24) / max(found[1] - found[0], 1e-9)


def byte_of(comm: Comm) -> float:
    """Seconds of a byte that all ranks exchange, in fresh memory."""
    taken, size = [], 1 << 22
    for _ in range(7):
        comm.gather(None)
        start = time.perf_counter()
        comm.exchange([np.zeros(size, np.uint8) for _ in range(comm.size)])
        taken.append(time.perf_counter() - start)
    return float(np.median(taken)) / (size * comm.size)


def step_of(comm: Comm) -> float:
    """Seconds in which all ranks agree, over the depth of their tree."""
    taken = []
    for _ in range(_PINGS):
        start = time.perf_counter()
        comm.gather(None)
        taken.append(time.perf_counter() - start)
    return float(np.median(taken)) / max(1.0, np.log2(comm.size))


def measured(comm: Comm, case: dict[str, Any]) -> list[dict[str, Any]]:
    """A row for each division and composition: medians of the frames. Memory is the most so far, so what needs least should come first."""
    from luxel.cluster.render import Renderer

    size, rows = tuple(case["size"]), []
    camera = pickle.loads(bytes.fromhex(case["camera"]))
    for division, composition in case["ways"]:
        divide, _, balance = division.partition(", ")
        renderer = Renderer(case["file"], comm, divide, composition, balance or "dynamic")
        taken, busy = [], []
        for _ in range(case["repeats"]):
            comm.gather(None)
            start = time.perf_counter()
            renderer.render(camera, (size[0], size[1]), samples=1, threads=1)
            taken.append(time.perf_counter() - start)
            busy.append([each["busy"] for each in renderer.ranks])
        composed = float(np.mean([each.get("composed", 0.0) for each in renderer.ranks]))
        peaks = comm.gather(peak_bytes())
        rows.append({"name": case["name"], "division": division, "composition": composition, "ranks": comm.size,
                     "seconds": float(np.median(taken[1:])), "busy": np.median(busy[1:], 0).tolist(), "composed": composed,
                     "peak": max(peaks)})  # fmt: skip
    return rows


def main(words: list[str]) -> None:
    """Measure the cases, given as JSON; rank 0 prints."""
    comm = world()
    with comm.guard():
        rows = [row for case in json.loads(words[0]) for row in measured(comm, case)]
        pings = network_of(comm)
        step, byte = step_of(comm), byte_of(comm)
    if comm.rank == 0:
        print(json.dumps({"rows": rows, "latency": pings[0], "bandwidth": pings[1], "step": step, "byte": byte}))  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1:])
