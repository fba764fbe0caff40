"""How the work of the paper's rasteriser is shared among threads: its two static ways, and the two dynamic ones that it did not try.

The rasteriser is the paper's: every pixel of a triangle's box is tested at four samples, and `colour * count / 4` is written with the nearest depth.
It is the subject of the experiment and nothing else: luxel's own rasteriser decides by tiles and runs, has no ways to be shared out by row or by
sample, and would hide what is measured. What can be shared is: edge functions, depth planes, projection and patterns are those of
`luxel.raster`, and the frame that luxel itself draws of the scene, with true multisampling, is timed beside them.
"""

from __future__ import annotations

import statistics
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.constants import sample_pattern
from luxel.raster.edge import edges
from luxel.raster.project import View, Window, project
from luxel.raster.setup import depth_plane
from luxel.scene.builtin.paper import two_triangles
from luxel.studies.antialiasing import PAPER
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context

_TILE = 256, 16  # wide and low: each row of a large frame lies on a page of memory of its own, and 64 rows are more than a core finds at once
_BACKGROUND = np.float32(-1.0)
_COLORS = ((217, 238, 185), (185, 217, 238))
_PUBLISHED = {  # milliseconds, four threads: serial, by row, by child-point
    "large": {500: (1850.36, 1052.08, 933.34), 1000: (11049.3, 5253.35, 3910.35), 2000: (36279.9, 15682.3, 14951.2)},
    "small": {500: (1196.34, 662.555, 654.13), 1000: (6750.72, 2830.47, 2912.35), 2000: (25065.0, 10409.65, 10509.55)},
}
LUXEL = "luxel, MSAA 4"
WAYS = ("static by row", "static by child-point", "dynamic by row", "dynamic by tile")


class Screen(NamedTuple):
    """Triangles on the screen: (m, 3, 2) int64 corners in 1/256 pixel, (m, 3) float32 depths (larger is nearer), (m, 3) uint8 colours."""

    corners: Array
    depths: Array
    colors: Array


class Frame(NamedTuple):
    """(h, w, 3) uint8 colours and (h, w) float32 depths."""

    color: Array
    depth: Array


def scene(size: int, which: str = "both") -> Screen:
    """The paper's large triangle, its small one, or both, as a picture of `size` x `size` sees them."""
    made = two_triangles()
    camera = made.cameras[0]
    chosen = {"large": (0,), "small": (1,), "both": (0, 1)}[which]
    positions = np.concatenate([made.meshes[k].positions for k in chosen]).astype(np.float32)
    placed, _ = project(positions, View(camera.clip_from_world((size, size)), 0.0), Window(0, 0, size, size, size, size), 1)
    corners = placed[:, :2].astype(np.int64).reshape(-1, 3, 2)
    return Screen(corners, placed.view(np.float32)[:, 2].copy().reshape(-1, 3), np.array([_COLORS[k] for k in chosen], np.uint8))


@jit.inlined
def _corner_numbers(corners, depths, t):
    return (corners[t, 0, 0], corners[t, 0, 1], depths[t, 0], corners[t, 1, 0], corners[t, 1, 1], depths[t, 1],
            corners[t, 2, 0], corners[t, 2, 1], depths[t, 2])  # fmt: skip


@jit.parallel_kernel
def _draw(queue, items, corners, depths, colors, pattern, color, depth):
    """Clear and draw rectangles (x0, y0, x1, y1) of a frame."""
    item = jit.take(queue)
    while item < len(items):
        left, top, right, bottom = items[item, 0], items[item, 1], items[item, 2], items[item, 3]
        color[top:bottom, left:right] = 0
        depth[top:bottom, left:right] = _BACKGROUND
        for t in range(len(corners)):
            x0, y0, z0, x1, y1, z1, x2, y2, z2 = _corner_numbers(corners, depths, t)
            a0, b0, c0, a1, b1, c1, a2, b2, c2 = edges(x0, y0, x1, y1, x2, y2, 0, 0)
            z, zx, zy = depth_plane(x0, y0, z0, x1, y1, z1, x2, y2, z2)
            for y in range(max(top, min(y0, min(y1, y2)) >> 8), min(bottom, (max(y0, max(y1, y2)) >> 8) + 1)):
                for x in range(max(left, min(x0, min(x1, x2)) >> 8), min(right, (max(x0, max(x1, x2)) >> 8) + 1)):
                    count, nearest = 0, _BACKGROUND
                    for s in range(len(pattern)):
                        sx, sy = x * 256 + pattern[s, 0], y * 256 + pattern[s, 1]
                        if (a0 * sx + b0 * sy + c0) | (a1 * sx + b1 * sy + c1) | (a2 * sx + b2 * sy + c2) >= 0:
                            fx, fy = np.float32(sx / 256 - (x0 >> 8)), np.float32(sy / 256 - (y0 >> 8))
                            count += 1
                            nearest = max(nearest, z + zx * fx + zy * fy)
                    if count and nearest > depth[y, x]:
                        depth[y, x] = nearest
                        for channel in range(3):
                            color[y, x, channel] = colors[t, channel] * count // len(pattern)
        item = jit.take(queue)


@jit.parallel_kernel
def _draw_samples(queue, items, corners, depths, pattern, covered, nearest):
    """Clear and draw child-points (rows of `items`: their number): for each triangle a plane of what it covers, and of its depths."""
    item = jit.take(queue)
    height, width = covered.shape[2], covered.shape[3]
    while item < len(items):
        s = items[item, 0]
        covered[:, s] = 0
        for t in range(len(corners)):
            x0, y0, z0, x1, y1, z1, x2, y2, z2 = _corner_numbers(corners, depths, t)
            a0, b0, c0, a1, b1, c1, a2, b2, c2 = edges(x0, y0, x1, y1, x2, y2, 0, 0)
            z, zx, zy = depth_plane(x0, y0, z0, x1, y1, z1, x2, y2, z2)
            for y in range(max(0, min(y0, min(y1, y2)) >> 8), min(height, (max(y0, max(y1, y2)) >> 8) + 1)):
                for x in range(max(0, min(x0, min(x1, x2)) >> 8), min(width, (max(x0, max(x1, x2)) >> 8) + 1)):
                    sx, sy = x * 256 + pattern[s, 0], y * 256 + pattern[s, 1]
                    if (a0 * sx + b0 * sy + c0) | (a1 * sx + b1 * sy + c1) | (a2 * sx + b2 * sy + c2) >= 0:
                        fx, fy = np.float32(sx / 256 - (x0 >> 8)), np.float32(sy / 256 - (y0 >> 8))
                        covered[t, s, y, x] = 1
                        nearest[t, s, y, x] = z + zx * fx + zy * fy
        item = jit.take(queue)


@jit.parallel_kernel
def _join_samples(queue, items, colors, covered, nearest, color, depth):
    """From the child-points' planes to the frame, rectangles of it."""
    item = jit.take(queue)
    while item < len(items):
        for y in range(items[item, 1], items[item, 3]):
            for x in range(items[item, 0], items[item, 2]):
                depth[y, x] = _BACKGROUND
                color[y, x, 0] = color[y, x, 1] = color[y, x, 2] = 0
                for t in range(covered.shape[0]):
                    count, near = 0, _BACKGROUND
                    for s in range(covered.shape[1]):
                        if covered[t, s, y, x]:
                            count += 1
                            near = max(near, nearest[t, s, y, x])
                    if count and near > depth[y, x]:
                        depth[y, x] = near
                        for channel in range(3):
                            color[y, x, channel] = colors[t, channel] * count // covered.shape[1]
        item = jit.take(queue)


class Team:
    """Threads that start together, and when each of them was done."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads)
        self._gate = threading.Barrier(threads)

    def close(self) -> None:
        """Let the threads go."""
        self._pool.shutdown()

    def all_do(self, work: Callable[[int], None]) -> tuple[float, list[float]]:
        """Seconds until the last of `work(0)`, `work(1)`, ... is done, and how long each thread then waited for it."""

        def one(k: int) -> tuple[float, float]:
            self._gate.wait()
            start = time.perf_counter()
            work(k)
            return start, time.perf_counter()

        times = list(self._pool.map(one, range(self.threads)))
        last = max(end for _, end in times)
        return last - min(start for start, _ in times), [last - end for _, end in times]


class Buffers(NamedTuple):
    """A frame, and (m, 4, h, w) planes of what each child-point sees of each triangle: made once, since touching new memory takes its time."""

    frame: Frame
    covered: Array
    nearest: Array

    @classmethod
    def of(cls, screen: Screen, size: int) -> Buffers:
        """For frames of `size` x `size`."""
        frame = Frame(np.zeros((size, size, 3), np.uint8), np.zeros((size, size), np.float32))
        planes = (len(screen.corners), 4, size, size)
        return cls(frame, np.zeros(planes, np.uint8), np.zeros(planes, np.float32))


def draw(screen: Screen, size: int, way: str, team: Team, buffers: Buffers | None = None) -> tuple[Frame, float, list[float]]:
    """Draw one frame in one of WAYS: the frame, the seconds it took, and the seconds each thread was idle."""
    buffers = buffers or Buffers.of(screen, size)
    frame = buffers.frame
    pattern = sample_pattern(4, "grid").astype(np.int64)
    slabs = [_bands(size, team.threads)[k : k + 1] for k in range(team.threads)]
    if way == "static by child-point":
        return _by_samples(screen, team, buffers, pattern, slabs)
    if way == "static by row":
        seconds, idle = team.all_do(lambda k: _draw(np.zeros(1, np.int64), slabs[k], *screen, pattern, *frame))
    else:
        items = _bands(size, size) if way == "dynamic by row" else _tiles(size)
        queue = np.zeros(1, np.int64)
        seconds, idle = team.all_do(lambda k: _draw(queue, items, *screen, pattern, *frame))
    return frame, seconds, idle


def _by_samples(screen: Screen, team: Team, buffers: Buffers, pattern: Array, slabs: list[Array]) -> tuple[Frame, float, list[float]]:
    frame, covered, nearest = buffers
    shares = [np.arange(k, 4, team.threads)[:, None] for k in range(team.threads)]
    first, idle = team.all_do(lambda k: _draw_samples(np.zeros(1, np.int64), shares[k], screen.corners, screen.depths, pattern, covered, nearest))
    second, more = team.all_do(lambda k: _join_samples(np.zeros(1, np.int64), slabs[k], screen.colors, covered, nearest, *frame))
    return frame, first + second, [a + b for a, b in zip(idle, more, strict=True)]


def _bands(size: int, count: int) -> Array:
    """Rows cut into `count` bands, as rectangles."""
    cuts = size * np.arange(count + 1) // count
    return np.stack([np.zeros(count, np.int64), cuts[:-1], np.full(count, size), cuts[1:]], -1)


def _tiles(size: int) -> Array:
    corner = np.stack(np.meshgrid(np.arange(0, size, _TILE[0]), np.arange(0, size, _TILE[1])), -1).reshape(-1, 2)
    return np.concatenate([corner, np.minimum(corner + _TILE, size)], 1)


def run(context: Context, report: Report) -> None:
    """Times of every way at every size, idle times, and the darkened edges."""
    report.say("## Sharing the work\n\nThe paper's rasteriser, `colour * count / 4` at four samples a pixel, one triangle at a time. By child-point "
               "means: a thread per sub-sample of the whole picture, then a pass that counts them. Beside it, what luxel takes to draw "
               "the same triangle with true multisampling, from the scene to the encoded picture.")  # fmt: skip
    rows, idles = _measured(context)
    for which, sizes in _PUBLISHED.items():
        for size, (serial, by_row, by_child) in sizes.items():
            row = {"triangle": which, "size": size, "threads": 4, "source": PAPER, "serial, ms": serial, "static by row, ms": by_row}
            rows.append(row | {"static by child-point, ms": by_child, "best static": f"{serial / min(by_row, by_child):.2f}x"})
    report.table("schedule", "Time of a frame", rows, "Medians here, means of ten frames in the paper (Intel i5-7300HQ).")
    report.table("idle", "Idle time of each thread", idles, "Milliseconds from when a thread was done to when the last one was; medians.")
    _figure(report, rows)
    _darkened(report, 500)


def _measured(context: Context) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    sizes = (200, 500) if context.quick else (500, 1000, 2000)
    rows: list[dict[str, Any]] = []
    idles: list[dict[str, Any]] = []
    teams = {n: Team(n) for n in sorted({1, *(2**k for k in range(1, 10) if 2**k < context.threads), context.threads})}
    for which in ("large", "small"):
        for size in sizes:
            cases = [(way, n) for way in (*WAYS, LUXEL) for n in teams if n > 1] + [("dynamic by row", 1), (LUXEL, 1)]
            times, idle = _alternated(which, size, cases, teams, 5 if context.quick else max(11, 30_000 // size))
            serial = times["dynamic by row", 1]
            for n in (n for n in teams if n > 1):
                row = {"triangle": which, "size": size, "threads": n, "source": HERE, "serial, ms": 1e3 * serial}
                row |= {f"{way}, ms": 1e3 * times[way, n] for way in WAYS}
                row |= {"best static": f"{serial / min(times[way, n] for way in WAYS[:2]):.2f}x"}
                row |= {"best dynamic": f"{serial / min(times[way, n] for way in WAYS[2:]):.2f}x"}
                rows.append(row | {f"{LUXEL}, one thread, ms": 1e3 * times[LUXEL, 1], f"{LUXEL}, ms": 1e3 * times[LUXEL, n]})
                idles += [{"triangle": which, "size": size, "threads": n, "way": way} | {f"thread {k}": 1e3 * t for k, t in enumerate(idle[way, n])}
                          for way in WAYS]  # fmt: skip
    for team in teams.values():
        team.close()
    return rows, idles


def _alternated(which: str, size: int, cases: list[tuple[str, int]], teams: dict[int, Team], repeats: int) -> tuple[Any, Any]:
    """Medians of the seconds and of the idle times of each case, run in turns."""
    taken: dict[tuple[str, int], list[tuple[float, list[float]]]] = {case: [] for case in cases}
    screen, shipped = scene(size, which), _shipped(which, size)
    buffers = Buffers.of(screen, size)
    idle: list[float]
    for turn in range(repeats + 1):
        for way, threads in cases:
            if way == LUXEL:
                start = time.perf_counter()
                shipped(threads)
                seconds, idle = time.perf_counter() - start, []
            else:
                _, seconds, idle = draw(screen, size, way, teams[threads], buffers)
            if turn:  # the first compiles
                taken[way, threads].append((seconds, idle))
    typical = {case: statistics.median(t for t, _ in runs) for case, runs in taken.items()}
    return typical, {case: [statistics.median(w) for w in zip(*(i for _, i in runs), strict=True)] for case, runs in taken.items()}


def _shipped(which: str, size: int) -> Callable[[int], object]:
    """What draws the same triangle as a user of luxel would, on so many threads."""
    import luxel

    made = two_triangles()
    number = ("large", "small").index(which)
    alone = luxel.Scene(name=which)
    alone.add(made.meshes[number], made.materials[0])
    prepared = luxel.prepare(alone)
    return lambda threads: luxel.render(prepared, made.cameras[0], (size, size), samples=4, pattern="grid", threads=threads)


def _figure(report: Report, rows: list[dict[str, Any]]) -> None:
    from luxel.studies.report import published

    with report.figure("schedule", "Speed-up over one thread, large triangle", size=(9.0, 4.2)) as axes:
        ours = [row for row in rows if row["source"] == HERE and row["triangle"] == "large"]
        most = max((row["threads"] for row in ours), default=0)
        ours = [row for row in ours if row["threads"] == most]
        for way in WAYS:
            axes.plot([r["size"] for r in ours], [r["serial, ms"] / r[f"{way}, ms"] for r in ours], "o-", label=f"{way}, {most} threads here")
        theirs = [row for row in rows if row["source"] == PAPER and row["triangle"] == "large"]
        for way in WAYS[:2]:
            published(axes, [r["size"] for r in theirs], [r["serial, ms"] / r[f"{way}, ms"] for r in theirs], f"{way}, 4 threads")
        axes.set_xlabel("pixels a side")
        axes.set_ylabel("serial time / time")


def darkened(size: int, background: tuple[int, int, int]) -> tuple[Array, Array, Array]:
    """The paper's formula and true multisampling, both in encoded values as the paper averages them, (h, w, 3) uint8; and where the first is darker.

    The paper's frame starts black, and what a pixel's uncovered samples show never enters; so a background is set after, where nothing was drawn.
    """
    import luxel

    team = Team(1)
    frame, _, _ = draw(scene(size), size, "dynamic by row", team)
    team.close()
    theirs = np.where((frame.depth == _BACKGROUND)[..., None], np.array(background, np.uint8), frame.color)
    ids = luxel.render(two_triangles(), size=(size * 2, size * 2), outputs="object").object  # its pixel centres are the grid's samples
    assert ids is not None
    shown = np.array([*_COLORS, background], np.float64)[ids]  # -1, nothing, is the last
    true = np.round(shown.reshape(size, 2, size, 2, 3).mean((1, 3))).astype(np.uint8)
    darker = (true.astype(int) - theirs).max(-1) > 2
    return theirs, true, darker


def _darkened(report: Report, size: int) -> None:
    rows = []
    for name, background in (("black", (0, 0, 0)), ("white", (255, 255, 255))):
        theirs, true, darker = darkened(size, background)
        edge = (np.abs(np.diff(true.astype(int), axis=0)).max(-1) > 0).sum() + (np.abs(np.diff(true.astype(int), axis=1)).max(-1) > 0).sum()
        lost = np.maximum(true.astype(int) - theirs, 0).max(-1)
        rows.append({"background": name, "size": size, "darker pixels": int(darker.sum()), "steps at edges": int(edge),
                     "most, of 255": int(lost.max()), "mean, of 255": float(lost[darker].mean()) if darker.any() else 0.0})  # fmt: skip
    report.table("darkened", "Edges that `colour * count / 4` darkens", rows, "Against true multisampling at the same four samples, in a frame of "
                 "both triangles: what lies behind a partly covered pixel is lost. On black only the edge between the triangles tells.")  # fmt: skip
    theirs, true, darker = darkened(size, (255, 255, 255))
    y, x = (int(v) for v in np.argwhere(darker)[darker.sum() // 2])
    y, x = min(max(y - 20, 0), size - 40), min(max(x - 20, 0), size - 40)
    zoom = [np.repeat(np.repeat(p[y : y + 40, x : x + 40], 9, 0), 9, 1) for p in (theirs, true)]
    marked = np.where(darker[..., None], np.array([220, 30, 30], np.uint8), theirs // 2 + 127)
    shown = np.concatenate([*zoom, np.repeat(np.repeat(marked[y : y + 40, x : x + 40], 9, 0), 9, 1)], 1)
    report.picture("darkened", "The paper's formula, true multisampling, and where the first is darker", shown, "40 x 40 pixels, enlarged.")
