"""What the schemes take on this processor, beside luxel's own tile kernel and its whole picture of the same triangles."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.raster.constants import SUBPIXEL
from luxel.studies.report import Report
from luxel.studies.shading import kernels
from luxel.studies.shading.coverage import binned, cover_tiles, coverage, ids_of, spans_of, tile_buffers
from luxel.studies.shading.fixed import VALUE_BITS
from luxel.studies.shading.speed import plain_ticks
from luxel.studies.study import Context

Row = dict[str, Any]
WIDTH, HEIGHT = 512, 512
_PAYS = 1.1  # times as fast
SPAN_WAYS = {
    "classical": kernels.ONE, "counter": kernels.COUNTER, "EC-DDA": kernels.CORRECTED, "interleaved 2": kernels.LANES_2,
    "interleaved 3": kernels.LANES_3, "interleaved 4": kernels.LANES_4, "interleaved 8": kernels.LANES_8, "interleaved 16": kernels.LANES_16,
    "classical, as the compiler likes": kernels.COMPILED,
}  # fmt: skip
LUXEL = ("luxel: tile kernel (depth and id)", "luxel: whole picture (float, sRGB)")


class Workload(NamedTuple):
    """A picture full of equal right triangles, two to a cell of `side` x `side` / 2 pixels, each with colours of its own.

    Attributes:
        corners: (m, 3, 2) int64, 1/256 pixel; every difference is an even number of pixels and no pixel's centre lies on an edge: midlines are exact.
        colors: (m, 3, 3) float64 RGB at the corners, 0 to 255.
        first: (m + 1,) int32: where each triangle's rows begin.
        rows: (n, 4) int32: first word, number of words, first and last column.
        values: (n, 6) int32: RGB at the first word, and its change along x; down: (m, 3) int32, along y; 8.16.
    """

    side: int
    corners: Array
    colors: Array
    first: Array
    rows: Array
    values: Array
    down: Array

    @property
    def pixels(self) -> int:
        """Of all triangles."""
        return int(self.rows[:, 1].sum())

    @property
    def span(self) -> float:
        """Mean number of pixels in a row."""
        return self.pixels / len(self.rows)


def workload(side: int, seed: int = 9) -> Workload:
    """Triangles `side` pixels wide, a multiple of 4 that divides 512, and half as high."""
    rng = np.random.default_rng(seed)
    halves = np.array([[[0, 0], [2, 0], [0, 1]], [[2, 1], [0, 1], [2, 0]]]) * side * SUBPIXEL // 2
    cells = np.stack(np.meshgrid(np.arange(0, WIDTH, side), np.arange(0, HEIGHT, side // 2)), -1).reshape(-1, 1, 1, 2) * SUBPIXEL
    corners = (cells + halves).reshape(-1, 3, 2)
    colors = rng.uniform(2, 253, (len(corners), 3, 3))
    ids = ids_of(corners, WIDTH, HEIGHT)
    spans, first = [], [0]
    at = [(spans_of(covered.mask), covered.x, covered.y) for covered in (coverage(half) for half in halves)]  # all are one of two, moved
    for k, (x, y) in enumerate((corners[:, 0] - np.tile(halves[:, 0], (len(corners) // 2, 1))) // SUBPIXEL):
        some, dx, dy = at[k % 2]
        spans.append(some + np.array([y + dy, x + dx, x + dx]))
        first.append(first[-1] + len(some))
    rows = np.concatenate(spans)
    owner = np.repeat(np.arange(len(corners)), np.diff(first))
    if not (np.array_equal(ids[rows[:, 0], rows[:, 1]], owner) and np.array_equal(ids[rows[:, 0], rows[:, 2]], owner)):
        raise AssertionError("the spans are not those of the picture's coverage")
    values, down = _values(corners, colors, owner, rows)
    words = np.stack([rows[:, 0] * WIDTH + rows[:, 1], rows[:, 2] - rows[:, 1] + 1, rows[:, 1], rows[:, 2]], 1)
    return Workload(side, corners, colors, np.array(first, np.int32), words.astype(np.int32), values, down)


def _values(corners: Array, colors: Array, owner: Array, rows: Array) -> tuple[Array, Array]:
    """What the interpolators begin with, from the triangles' planes."""
    origin = corners[:, 0] / SUBPIXEL
    edges = (corners[:, 1:] - corners[:, :1]) / SUBPIXEL
    slopes = np.linalg.solve(edges, colors[:, 1:] - colors[:, :1])  # (m, 2, 3)
    from_origin = rows[:, [1, 0]] + 0.5 - origin[owner]
    start = colors[owner, 0] + (from_origin[:, :, None] * slopes[owner]).sum(1)
    fixed = np.rint(np.concatenate([start, slopes[owner, 0]], 1) * 2**VALUE_BITS).astype(np.int32)
    return fixed, np.rint(slopes[:, 1] * 2**VALUE_BITS).astype(np.int32)


class Midlines(NamedTuple):
    """The same triangles as templates, what `kernels.fill_midlines` takes: the template is the quarter at the first corner."""

    first: Array
    spans: Array
    values: Array
    copies: Array
    constants: Array


def midlines_of(work: Workload) -> Midlines:
    """Templates of a workload, their spans, and where their copies lie."""
    a, b, c = (work.corners[:, k] for k in range(3))
    quarters = np.stack([a, (a + b) // 2, (a + c) // 2], 1)
    spans, first = [], [0]
    for moved in quarters:
        covered = coverage(moved)
        some = spans_of(covered.mask) + np.array([covered.y, covered.x, covered.x])
        spans.append(some)
        first.append(first[-1] + len(some))
    rows = np.concatenate(spans)
    owner = np.repeat(np.arange(len(a)), np.diff(first))
    values, _ = _values(work.corners, work.colors, owner, rows)
    words = np.stack([rows[:, 0] * WIDTH + rows[:, 1], rows[:, 2] - rows[:, 1] + 1], 1)
    move = [(to - a) // (2 * SUBPIXEL) for to in (b, c)]
    turn = (2 * a + b + c) // (2 * SUBPIXEL) - 1
    copies = np.stack([xy[:, 1] * WIDTH + xy[:, 0] for xy in (*move, turn)], 1)
    ca, cb, cc = (work.colors[:, k] for k in range(3))
    constants = np.concatenate([(cb - ca) / 2, (cc - ca) / 2, ca + (cb + cc) / 2], 1)
    return Midlines(np.array(first, np.int32), words.astype(np.int32), values, copies.astype(np.int32),
                    np.rint(constants * 2**VALUE_BITS).astype(np.int32))  # fmt: skip


class Waves:
    """The wave's scratch: stamps need no clearing, because every run has a number of its own."""

    def __init__(self, work: Workload) -> None:
        self.work, self.run = work, 0
        self.stamps = np.zeros(WIDTH * HEIGHT + kernels.SPARE, np.int32)
        self.queue = np.empty((work.side * work.side, 5), np.int32)

    def fill(self, picture: Array) -> None:
        """Fill every triangle."""
        self.run += 1
        work = self.work
        kernels.fill_waves(work.first, work.rows, work.values, work.down, self.run, self.stamps, self.queue, picture)


def jobs(work: Workload, picture: Array, whole: bool) -> dict[str, Callable[[], object]]:
    """Every way to fill the workload, by name, with luxel's `whole` picture or not; `picture` is (WIDTH * HEIGHT + SPARE,) int32."""
    spans, templates = np.ascontiguousarray(work.rows[:, :2]), midlines_of(work)
    found: dict[str, Callable[[], object]] = {}
    for name, way in SPAN_WAYS.items():
        found[name] = partial(kernels.fill_spans, way, spans, work.values, picture)
    found["midlines"] = partial(kernels.fill_midlines, *templates, False, picture)
    found["midlines of interleaved 8"] = partial(kernels.fill_midlines, *templates, True, picture)
    found["wave"] = partial(Waves(work).fill, picture)
    ready = binned(work.corners, WIDTH, HEIGHT)
    found[LUXEL[0]] = partial(cover_tiles, ready, *tile_buffers(ready))
    if whole:
        found[LUXEL[1]] = picture_of(work)
    return found


def measured(named: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median seconds of this thread's processor time of each job, run in turns; the first turn is not counted."""
    taken: dict[str, list[float]] = {name: [] for name in named}
    for turn in range(repeats + 1):
        for name, job in named.items():
            start = time.thread_time()
            job()
            if turn:
                taken[name].append(time.thread_time() - start)
    return {name: statistics.median(times) for name, times in taken.items()}


def picture_of(work: Workload) -> Callable[[], object]:
    """luxel's renderer on the workload, one thread: projected, binned, covered, and shaded with vertex colours, unlit."""
    import luxel

    positions = np.concatenate([work.corners.reshape(-1, 2) / SUBPIXEL * [1, -1] + [-WIDTH / 2, HEIGHT / 2], np.zeros((3 * len(work.corners), 1))], 1)
    colors = np.concatenate([work.colors.reshape(-1, 3) / 255, np.ones((len(positions), 1))], 1)
    scene = luxel.Scene()
    mesh = luxel.Mesh(positions, np.arange(len(positions)).reshape(-1, 3), colors=colors)
    scene.add(mesh, luxel.Material(base_color=(1.0, 1.0, 1.0, 1.0), shading="unlit", double_sided=True))
    camera = luxel.Camera.look_at((0, 0, 2), (0, 0, 0), yfov=None, height=HEIGHT, near=0.1, far=10)
    ready = luxel.prepare(scene)
    return lambda: luxel.render(ready, camera, (WIDTH, HEIGHT), threads=1)


def rows_of(sides: list[int], repeats: int, whole: bool) -> list[Row]:
    """Nanoseconds a pixel of every way, by the size of the triangles."""
    rows = []
    for side in sides:
        work = workload(side)
        taken = measured(jobs(work, np.zeros(WIDTH * HEIGHT + kernels.SPARE, np.int32), whole), repeats)
        for name, seconds in taken.items():
            each = 1e9 * seconds / work.pixels
            rows.append({"pixels a span": work.span, "way": name, "ns a pixel": each, "speed-up": taken["classical"] / seconds})
    return rows


def verdicts(rows: list[Row]) -> list[Row]:
    """Times by the length of spans, a row for each way, and whether it pays: where it is a tenth faster than one interpolator."""
    found = []
    for name in dict.fromkeys(row["way"] for row in rows):
        some = [row for row in rows if row["way"] == name]
        faster = [row["pixels a span"] for row in some if row["speed-up"] > _PAYS]
        pays = "no" if not faster else "always" if len(faster) == len(some) else f"from {min(faster):.0f} pixels"
        pays = "" if name in (*LUXEL, "classical") else pays
        times = {f"{row['pixels a span']:.0f} pixels, ns": row["ns a pixel"] for row in some}
        found.append({"way": name} | times | {"speed-up, shortest": some[0]["speed-up"], "longest": some[-1]["speed-up"], "pays": pays})
    return found


def run(context: Context, report: Report, facts: Row) -> None:
    """All ways, all sizes."""
    sides = [16, 64, 256] if context.quick else [8, 16, 32, 64, 128, 256, 512]
    rows = rows_of(sides, 7 if context.quick else 41, whole=not context.quick)  # a renderer that is not compiled yet is not quick
    report.table("cpu", "The schemes on this processor", verdicts(rows),
                 f"Nanoseconds a pixel, by the mean length of spans: RGB in 8.16, packed into the words of a picture of {WIDTH} x {HEIGHT}, one "
                 "thread, spans known before; medians of processor time. `classical` is kept from being vectorised; `as the compiler likes` is "
                 "the same loop without that. luxel's tile kernel finds the spans of the same triangles, tests depth and writes depth and id; "
                 "its whole picture also projects, sorts into tiles, interpolates in floats, perspective-correct, and encodes sRGB.")  # fmt: skip
    with report.figure("cpu", "Time a pixel on this processor", size=(9.0, 4.6)) as axes:
        for k, name in enumerate(dict.fromkeys(row["way"] for row in rows)):
            some = [(row["pixels a span"], row["ns a pixel"]) for row in rows if row["way"] == name]
            style = "s--" if name in LUXEL else "^:" if "compiler" in name else "o-" if k < 10 else "v-"
            axes.plot(*zip(*some, strict=True), style, color=f"C{k % 10}", label=name, markersize=4)
        plain_ticks(axes, "x", [side // 2 for side in sides])
        axes.set_yscale("log")
        axes.set_xlabel("pixels in a span, mean")
        axes.set_ylabel("ns a pixel")
    facts |= {"cpu": rows}
