"""How the numbers of `luxel.layout.fitted` and `luxel.layout.patches` were found: a (1 + 1) evolution on whole orders.

    python benchmarks/fit_costs.py amd --seconds 170     # fifo, amd, intel or nvidia (the patches): prints the numbers, and what they bring

Needs SciPy, and the models that `report.meshes` finds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from layout import Case, models
from luxel.layout import batch
from luxel.layout.adjacency import adjacency
from luxel.layout.fitted import FITTED, Cost, fitted_cost
from luxel.layout.gather import gather
from luxel.layout.greedy import LEFT_CELLS, OPEN_CELLS, greedy
from luxel.layout.partition import Regions
from luxel.layout.patches import HELD, NEW, START, patches
from luxel.scene.builtin import bumpy_sphere
from report import meshes

REAL = ("fandisk", "beetle", "lionstatue")
FIFOS = {"fifo": (12, 16), "amd": (11,), "intel": (128,)}


def hull(count: int, seed: int) -> Any:
    """Triangles between random points of a sphere: valences from 3 to 12."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    faces = ConvexHull(points).simplices.astype(np.int32)
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = (np.cross(b - a, c - a) * a).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return faces


def diagonals(n: int, seed: int) -> Any:
    """A grid of n x n squares, each cut along either diagonal."""
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    a = (i * (n + 1) + j).ravel()
    b, c, d = a + 1, a + n + 1, a + n + 2
    one = np.random.default_rng(seed).random(len(a))[:, None] < 0.5
    return np.where(one, np.stack([a, c, d, a, d, b], 1), np.stack([a, c, b, b, c, d], 1)).reshape(-1, 3).astype(np.int32)


def first_part(triangles: Any, size: int) -> Any:
    """A connected piece of a mesh, with vertices of its own."""
    members = Regions(triangles, adjacency(triangles, int(triangles.max()) + 1), size).members(0)
    return np.unique(triangles[members], return_inverse=True)[1].reshape(-1, 3).astype(np.int32)


def training(cases: list[Case]) -> list[Any]:
    """Meshes made by code, and pieces of some real ones."""
    apart = np.concatenate([diagonals(10, 3) + 121 * k for k in range(24)]).astype(np.int32)
    made = [bumpy_sphere(71).triangles, bumpy_sphere(40).triangles, hull(5000, 1), diagonals(70, 2), apart]
    return [np.ascontiguousarray(t, np.int32) for t in made] + [first_part(case.triangles, 13000) for case in cases if case.name in REAL]


def misses_of(target: str, numbers: Any, triangles: Any) -> list[float]:
    """Misses per triangle of the orders that these numbers give."""
    n = int(triangles.max()) + 1
    if target == "nvidia":
        new, held, fresh = (np.concatenate([[0], part]).astype(np.float32) for part in np.split(numbers, 3))
        model = batch.MODELS[target]
        order = patches(triangles, adjacency(triangles, n), model, new, held, fresh)
        return [batch.reuse(gather(triangles, order, n, model.cache)[0], target, n).acmr]
    cost = Cost(*np.split(numbers[:24], 4), numbers[24])  # type: ignore[arg-type]
    found = []
    for cache in FIFOS[target]:
        age, opened, left = np.ogrid[:cache, :OPEN_CELLS, 1 : LEFT_CELLS + 1]
        table = fitted_cost(cost, age, np.where(opened > 0, np.maximum(opened - left + 1, 0), 0), left, cache)
        order = greedy(triangles, n, cache, table)
        if target == "fifo":
            found.append(gather(triangles, order, n, cache)[1] / len(triangles))
        else:
            found.append(batch.reuse(gather(triangles, order, n, batch.MODELS[target].cache)[0], target, n).acmr)
    return found


def evolve(score: Callable[[Any], float], numbers: Any, seconds: float, seed: int) -> tuple[Any, float]:
    """Better numbers, and their score, which was 1: some are moved at a time, and what is no worse stays."""
    random, best, step = np.random.default_rng(seed), 1.0, 0.15
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        moved = random.random(len(numbers)) < random.choice([0.08, 0.25, 0.6])
        change = moved * random.normal(size=len(numbers)) * step * np.maximum(0.3, np.abs(numbers)) * random.choice([0.3, 1, 3])
        found = score(numbers + change)
        if found <= best:
            numbers, best, step = numbers + change, found, min(0.5, 1.3 * step)
        else:
            step = max(0.01, 0.985 * step)
    return numbers, best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", choices=[*FIFOS, "nvidia"])
    parser.add_argument("--seconds", type=float, default=170)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    folder = meshes()
    if folder is None:
        raise SystemExit("LUXEL_MESHES names no folder of models")
    cases = models(folder)[0]
    fitted, judges = training(cases), [case for case in cases if case.name not in REAL and len(case.triangles) < 200_000]
    if options.target == "nvidia":
        start = np.concatenate([NEW[1:], HELD[1:], START[1:]]).astype(np.float64)
    else:
        cost = FITTED.get(options.target, FITTED["fifo"])
        start = np.array([*cost.load, *cost.last, *cost.slope, *cost.curve, cost.gone])

    def all_misses(numbers: Any, group: list[Any]) -> Any:
        return np.concatenate([misses_of(options.target, numbers, triangles) for triangles in group])

    before, judged = all_misses(start, fitted), all_misses(start, [case.triangles for case in judges])
    numbers, best = evolve(lambda numbers: float((all_misses(numbers, fitted) / before).mean()), start, options.seconds, options.seed)
    after = all_misses(numbers, [case.triangles for case in judges])
    print(f"{options.target}: {best - 1:+.2%} on the meshes of the fit; on others:")
    steps = len(after) // len(judges)
    for case, ratio in zip(judges, (after / judged).reshape(-1, steps), strict=True):
        print(f"  {case.name}: {', '.join(f'{x - 1:+.2%}' for x in ratio)}")
    print(np.round(numbers, 3).tolist())


if __name__ == "__main__":
    main()
