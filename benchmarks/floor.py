"""The floor from memory traffic: bytes that the pipeline must move through memory, and how fast this machine moves bytes."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import luxel


def moved(mesh: luxel.Mesh, size: tuple[int, int], samples: int = 1) -> int:
    """Bytes read and written once each, for a closed mesh whose front half is seen.

    project: 12 a vertex in, 16 out. bin: those 16 and 12 a triangle of indices in; 4 and 8 (id and box of tiles) out and in again, and 4
    out, for each that faces the eye. cover: ids, indices and corners of those again; ids of samples out. shade: ids in, normals of
    seen vertices in, colour out.
    """
    vertices, triangles, pixels = len(mesh.positions), len(mesh.triangles), size[0] * size[1]
    project = (12 + 16) * vertices
    binned = 16 * vertices + 12 * triangles + (12 + 12 + 4) * triangles // 2
    covered = (4 + 12) * triangles // 2 + 16 * vertices // 2 + 4 * pixels * samples
    shaded = 4 * pixels * samples + 12 * vertices // 2 + 4 * pixels
    return project + binned + covered + shaded


def bandwidth(threads: int, size: int = 1 << 28, repeats: int = 5) -> float:
    """Bytes per second, read and written both counted, of copying arrays that no cache holds."""
    pairs = [(np.ones(size // threads, np.uint8), np.zeros(size // threads, np.uint8)) for _ in range(threads)]
    best = float("inf")
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(repeats):
            start = time.perf_counter()
            list(pool.map(lambda pair: np.copyto(pair[1], pair[0]), pairs))
            best = min(best, time.perf_counter() - start)
    return 2 * size / best
