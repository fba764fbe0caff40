"""Which size of triangle keeps shading units busy when a polygon is triangulated: large ones leave units waiting at the end, small ones cost set-up.

A hexagon is cut into triangles in three ways and at many sizes, its coverage taken from one picture that luxel's rasteriser draws of it, and the
steps of every triangle counted by running a unit over its spans. Each of the units then takes the next triangle when it is done with its last.
"""

from __future__ import annotations

import heapq
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.raster.constants import NOTHING, SUBPIXEL
from luxel.studies.report import Report
from luxel.studies.shading.coverage import ids_of
from luxel.studies.shading.interpolators import run_rows
from luxel.studies.shading.schemes import CLASSICAL, INTERLEAVES, Machine, Scheme
from luxel.studies.shading.speed import plain_ticks
from luxel.studies.study import Context

Row = dict[str, Any]
UNITS = (1, 2, 4, 8, 16, 32, 64)
KINDS = ("regular", "Delaunay", "random")
TRIANGLE_SETUP = 6
"""Steps before a triangle's first row: its two slopes are divided out."""

_NEAR = 1.05  # of the fastest


def hexagon(radius: float) -> Array:
    """(6, 2) float64 corners, pixels, about (radius, radius)."""
    angle = np.arange(6) * np.pi / 3
    return radius + radius * np.stack([np.cos(angle), np.sin(angle)], 1)


def regular(radius: float, parts: int) -> tuple[Array, Array]:
    """A hexagon of 6 parts^2 equal triangles: points (n, 2) and (m, 3) corners."""
    corners = hexagon(radius)
    centre = np.full(2, radius)
    triangles = []
    for k in range(6):
        a, b = (corners[k] - centre) / parts, (corners[(k + 1) % 6] - centre) / parts
        i, j = (n.ravel() for n in np.meshgrid(np.arange(parts), np.arange(parts)))
        for moved, keep in ((((0, 0), (1, 0), (0, 1)), i + j < parts), (((1, 0), (1, 1), (0, 1)), i + j < parts - 1)):
            steps = np.array(moved)[None] + np.stack([i, j], 1)[keep][:, None]
            triangles.append(centre + steps[..., :1] * a + steps[..., 1:] * b)
    points = np.concatenate(triangles).reshape(-1, 2)
    return points, np.arange(len(points)).reshape(-1, 3)


def delaunay(radius: float, parts: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """About 6 parts^2 triangles: Delaunay's of random points within and of points along the sides."""
    from scipy.spatial import Delaunay

    corners = hexagon(radius)
    along = np.arange(parts)[:, None] / parts
    border = np.concatenate([corners[k] + along * (corners[(k + 1) % 6] - corners[k]) for k in range(6)])
    inner = rng.random((8 * parts * parts + 64, 2)) * 2 * radius
    normals = np.stack([np.cos(np.pi / 6 + np.arange(6) * np.pi / 3), np.sin(np.pi / 6 + np.arange(6) * np.pi / 3)])
    within = ((inner - radius) @ normals).max(1) < 0.999 * radius * np.sqrt(3) / 2
    points = np.concatenate([border, inner[within][: max(1, 3 * parts * parts - 3 * parts + 1)]])
    triangles = Delaunay(points).simplices
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return points, triangles[np.abs(area) > 1e-9]


def split_at_random(radius: float, parts: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """6 parts^2 triangles: a fan, of which triangles taken at random are split at random points, so that sizes and shapes are most uneven."""
    corners, many = hexagon(radius), 6 * parts * parts
    triangles = np.empty((many, 3, 2))
    triangles[:4] = [corners[[0, k, k + 1]] for k in range(1, 5)]
    weights = rng.dirichlet([1, 1, 1], many)
    chosen = rng.random(many)
    for count in range(4, many - 1, 2):
        k = int(chosen[count] * count)
        whole = triangles[k].copy()
        triangles[[k, count, count + 1]] = whole
        triangles[[k, count, count + 1], [0, 1, 2]] = weights[count] @ whole
    points = triangles.reshape(-1, 2)
    return points, np.arange(len(points)).reshape(-1, 3)


def triangulated(kind: str, radius: float, parts: int, seed: int = 0) -> Array:
    """(m, 3, 2) int64 corners in 1/256 pixel, in the order of their middles, left to right in rows: as a renderer may meet them."""
    rng = np.random.default_rng([seed, parts])
    points, triangles = (regular(radius, parts) if kind == "regular" else delaunay(radius, parts, rng) if kind == "Delaunay"
                         else split_at_random(radius, parts, rng))  # fmt: skip
    corners = np.round(points * SUBPIXEL).astype(np.int64)[triangles]
    middle = corners.sum(1)
    return corners[np.lexsort((middle[:, 0], middle[:, 1] // (64 * SUBPIXEL)))]


class Work(NamedTuple):
    """What a triangulation takes: (m,) pixels and steps of each triangle, and how often each pixel was written, (h, w)."""

    pixels: Array
    steps: Array
    writes: Array


def work_of(corners: Array, size: int, scheme: Scheme = CLASSICAL, machine: Machine | None = None) -> Work:
    """Run one unit over every triangle."""
    machine = machine or Machine()
    ids = ids_of(corners, size, size)
    y, x = np.nonzero(ids != NOTHING)
    owner = ids[y, x].astype(np.int64)
    key = owner * size + y
    order = np.argsort(key, kind="stable")  # x ascends within each row
    key, x = key[order], x[order]
    begins = np.nonzero(np.diff(key, prepend=-1))[0]
    ends = np.append(begins[1:], len(key)) - 1
    rows = np.stack([key[begins] % size, x[begins], x[ends]], 1).astype(np.int64)
    first = np.searchsorted(key[begins] // size, np.arange(len(corners) + 1)).astype(np.int64)
    none = np.zeros((len(rows), 0), np.int64)
    step, unit, writes = np.full((size, size), -1, np.int32), np.full((size, size), -1, np.int32), np.zeros((size, size), np.uint8)
    steps = np.zeros(len(corners), np.int64)
    run_rows(scheme.way, scheme.lanes, rows, first, none, none, none, none, 25, machine.edge + machine.divide, machine.overlapped, TRIANGLE_SETUP,
             step, unit, writes, np.zeros((0, size, size), np.int64), steps)  # fmt: skip
    return Work(np.bincount(owner, minlength=len(corners)), steps, writes)


def makespan(steps: Array, units: int) -> int:
    """Steps until all is done, when each unit takes the next triangle as soon as it is free."""
    free = [0] * units
    for taken in steps.tolist():
        heapq.heapreplace(free, free[0] + taken)
    return max(free)


def sweep(kind: str, radius: int, parts: list[int], seeds: int, schemes: tuple[Scheme, ...]) -> list[Row]:
    """Every number of units of every scheme on every size of triangles; what is random is done `seeds` times, and steps are means."""
    rows = []
    for part in parts:
        cut = [triangulated(kind, radius, part, seed) for seed in range(1 if kind == "regular" else seeds)]
        for scheme in schemes:
            works = [work_of(corners, 2 * radius, scheme) for corners in cut]
            triangles, pixels = (float(np.mean([n(work) for work in works])) for n in (lambda w: len(w.steps), lambda w: w.pixels.sum()))
            busy = float(np.mean([work.steps.sum() for work in works]))
            largest = float(np.mean([work.pixels.max() / work.pixels.mean() for work in works]))
            for units in UNITS:
                took = float(np.mean([makespan(work.steps, units) for work in works]))
                rows.append({"triangulation": kind, "unit": scheme.name, "triangles": triangles, "pixels a triangle": pixels / triangles,
                             "largest / mean": largest, "units": units, "steps": took, "pixels a step": pixels / took,
                             "idle, %": 100 * (1 - busy / (units * took)),
                             "set-up, %": 100 * (busy - pixels / scheme.lanes) / (units * took)})  # fmt: skip
    return rows


def best_rows(rows: list[Row]) -> list[Row]:
    """For each triangulation and number of units: the size that is fastest, and the range within 5% of it."""
    found = []
    for kind in KINDS:
        for units in UNITS:
            some = [row for row in rows if row["triangulation"] == kind and row["units"] == units]
            best = min(some, key=lambda row: row["steps"])
            near = [row["pixels a triangle"] for row in some if row["steps"] <= _NEAR * best["steps"]]
            found.append({"triangulation": kind, "units": units, "pixels a triangle": best["pixels a triangle"], "from": min(near), "to": max(near),
                          "triangles": best["triangles"], "triangles a unit": best["triangles"] / units, "pixels a step": best["pixels a step"],
                          "idle, %": best["idle, %"], "set-up, %": best["set-up, %"]})  # fmt: skip
    return found


def _by_units(rows: list[Row]) -> list[Row]:
    """A row for each triangulation, with a column for each number of units."""
    found: dict[tuple[str, int], Row] = {}
    for row in rows:
        cells = found.setdefault((row["triangulation"], row["triangles"]), {k: row[k] for k in ("triangulation", "triangles", "pixels a triangle",
                                                                                               "largest / mean")})  # fmt: skip
        cells[f"{row['units']} unit{'s' * (row['units'] > 1)}"] = row["pixels a step"]
    return list(found.values())


def run(context: Context, report: Report, facts: Row) -> None:
    """Three triangulations of a hexagon, many sizes, 1 to 64 units."""
    radius = 128 if context.quick else 384
    parts = [1, 2, 4, 8, 16, 32] if context.quick else [1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64]
    every = [row for kind in KINDS for row in sweep(kind, radius, parts, 2 if context.quick else 5, (CLASSICAL, INTERLEAVES[2]))]
    rows, four = ([row for row in every if row["unit"] == scheme.name] for scheme in (CLASSICAL, INTERLEAVES[2]))
    best = best_rows(rows)
    pixels = rows[0]["triangles"] * rows[0]["pixels a triangle"]
    report.table("balance", "The size of triangles that balances the load", best,
                 f"A hexagon of {pixels:,.0f} pixels. A unit is one classical interpolator: {TRIANGLE_SETUP} steps a triangle, 4 a row, then a "
                 "pixel a step; it takes the next triangle when it is free. `from` .. `to`: sizes within 5% of the fastest. `idle`: units with "
                 "no triangle left; `set-up`: units that have one and write nothing. Means of several random triangulations.")  # fmt: skip
    report.table("balance-four", "The same, of units of four interleaved interpolators", best_rows(four),
                 "`set-up` also has the interpolators that find no pixel at a span's end.")  # fmt: skip
    report.table("balance-all", "Pixels a step, of every size", _by_units(rows))
    for kind in KINDS:
        _figure(report, kind, [row for row in rows if row["triangulation"] == kind])
    facts |= {"balance": best}


def _figure(report: Report, kind: str, rows: list[Row]) -> None:
    note = "1 would be no idle unit and no set-up."
    with report.figure(f"balance-{kind.lower()}", f"Pixels a step and unit, {kind} triangulation", note, (9.0, 4.2)) as axes:
        for units in UNITS:
            some = [(row["pixels a triangle"], row["pixels a step"] / units) for row in rows if row["units"] == units]
            axes.plot(*zip(*some, strict=True), "o-", label=f"{units} unit{'s' * (units > 1)}", markersize=4)
        plain_ticks(axes, "x", [4**k for k in range(2, 9) if 4**k < 2 * rows[0]["pixels a triangle"]])
        axes.set_xlabel("pixels a triangle, mean")
        axes.set_ylabel("pixels / (steps x units)")
        axes.set_ylim(0, 1)
