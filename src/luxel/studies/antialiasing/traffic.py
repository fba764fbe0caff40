"""Memory traffic of three ways to draw: immediate, tiled, and tiled with deferred shading; counted while they run.

Layers of small squares that fill the screen are drawn, in each place in an order of its own, as in a scene that nobody sorted. Every access to
a sample's colour or depth passes through a counter: in external memory for immediate drawing, in a tile's own memory for the other two,
which write nothing but resolved pixels out.

The loops over triangles are its own, because they are what is measured: luxel's rasteriser never touches a sample that it need not, so counters in it
would tell of luxel and not of the three ways, and counters have no place there. The edge functions and patterns are those of `luxel.raster`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.constants import sample_pattern
from luxel.raster.edge import edges
from luxel.studies.report import Report
from luxel.studies.study import Context

WAYS = ("immediate", "tiled", "tiled, deferred")
_TILE, _CELL = 32, 8
_COLOR_READ, _COLOR_WRITE, _DEPTH_READ, _DEPTH_WRITE, _CHIP, _SHADED = range(6)
_BYTES = 4  # of a colour, and of a depth


class Traffic(NamedTuple):
    """Bytes that went to and from external memory in a frame, bytes within tiles' memory, and how often a pixel was shaded."""

    color_read: int
    color_written: int
    depth_read: int
    depth_written: int
    on_chip: int
    shaded: int

    @property
    def external(self) -> int:
        """All bytes to and from external memory."""
        return self.color_read + self.color_written + self.depth_read + self.depth_written


def layers(size: int, overdraw: int, seed: int = 1) -> tuple[Array, Array]:
    """Squares of `_CELL` pixels, `overdraw` of them at each place, in layers that each fill the screen; in each place the depths are shuffled.

    Returns:
        (m, 3, 2) int64 corners of triangles in 1/256 pixel, and their (m,) float32 depths, larger is nearer.
    """
    rng = np.random.default_rng(seed)
    places = np.stack(np.meshgrid(np.arange(0, size, _CELL), np.arange(0, size, _CELL)), -1).reshape(-1, 1, 1, 2)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    pairs = 256 * (places + _CELL * square[[[0, 2, 1], [0, 3, 2]]])
    depths = rng.permuted(np.tile(np.arange(1, overdraw + 1, dtype=np.float32), (len(places), 1)), axis=1)
    return np.tile(pairs.reshape(-1, 3, 2), (overdraw, 1, 1)), np.repeat(depths.T.reshape(-1), 2)


@jit.inlined
def _box(corners, t, left, top, right, bottom):
    """The pixels of a rectangle that a triangle may cover: x0, y0, x1, y1."""
    low_x, low_y = min(corners[t, 0, 0], corners[t, 1, 0], corners[t, 2, 0]) >> 8, min(corners[t, 0, 1], corners[t, 1, 1], corners[t, 2, 1]) >> 8
    high_x, high_y = max(corners[t, 0, 0], corners[t, 1, 0], corners[t, 2, 0]) >> 8, max(corners[t, 0, 1], corners[t, 1, 1], corners[t, 2, 1]) >> 8
    return max(left, low_x), max(top, low_y), min(right, high_x + 1), min(bottom, high_y + 1)


@jit.inlined
def _inside(corners, t, x, y, pattern, s):
    a0, b0, c0, a1, b1, c1, a2, b2, c2 = edges(
        corners[t, 0, 0], corners[t, 0, 1], corners[t, 1, 0], corners[t, 1, 1], corners[t, 2, 0], corners[t, 2, 1], 0, 0
    )
    sx, sy = x * 256 + pattern[s, 0], y * 256 + pattern[s, 1]
    return (a0 * sx + b0 * sy + c0) | (a1 * sx + b1 * sy + c1) | (a2 * sx + b2 * sy + c2) >= 0


@jit.part
def _test_and_write(corners, depth_of, t, x, y, at, pattern, colors, depths, counters, on_chip, deferred):
    """One triangle at one pixel, whose samples begin at `at`: depth test, and the colour (the triangle's number) of what passes."""
    shaded = 0
    for s in range(len(pattern)):
        if not _inside(corners, t, x, y, pattern, s):
            continue
        counters[_CHIP if on_chip else _DEPTH_READ] += _BYTES
        if depth_of[t] > depths[at + s]:
            depths[at + s] = depth_of[t]
            counters[_CHIP if on_chip else _DEPTH_WRITE] += _BYTES
            colors[at + s] = t + 1
            if deferred:  # the number of what is seen; colours come when all is known
                counters[_CHIP] += _BYTES
            else:
                counters[_CHIP if on_chip else _COLOR_WRITE] += _BYTES
                shaded = 1
    counters[_SHADED] += shaded


@jit.part
def _resolve(x, y, at, samples, colors, out, counters, on_chip, deferred):
    """The mean of a pixel's samples goes out; deferred, each triangle that is seen is shaded once."""
    total = np.float32(0.0)
    for s in range(samples):
        counters[_CHIP if on_chip else _COLOR_READ] += _BYTES
        total += np.float32(colors[at + s])
        if deferred:
            first = True
            for earlier in range(s):
                first = first and colors[at + earlier] != colors[at + s]
            if first and colors[at + s]:
                counters[_SHADED] += 1
    out[y, x] = total / np.float32(samples)
    if samples > 1 or on_chip:  # a single sample already lies where it is shown from
        counters[_COLOR_WRITE] += _BYTES


@jit.kernel
def _immediate(corners, depth_of, pattern, colors, depths, out, counters):
    height, width = out.shape
    samples = len(pattern)
    for at in range(len(colors)):  # the frame is cleared
        colors[at] = 0
        depths[at] = 0
        counters[_COLOR_WRITE] += _BYTES
        counters[_DEPTH_WRITE] += _BYTES
    for t in range(len(corners)):
        x0, y0, x1, y1 = _box(corners, t, 0, 0, width, height)
        for y in range(y0, y1):
            for x in range(x0, x1):
                _test_and_write(corners, depth_of, t, x, y, (y * width + x) * samples, pattern, colors, depths, counters, False, False)
    if samples == 1:
        for y in range(height):
            for x in range(width):
                out[y, x] = colors[y * width + x]
        return
    for y in range(height):
        for x in range(width):
            _resolve(x, y, (y * width + x) * samples, samples, colors, out, counters, False, False)


@jit.kernel
def _tiled(corners, depth_of, pattern, deferred, colors, depths, out, counters):
    """`colors` and `depths` are those of one tile."""
    height, width = out.shape
    samples = len(pattern)
    for top in range(0, height, _TILE):
        for left in range(0, width, _TILE):
            bottom, right = min(top + _TILE, height), min(left + _TILE, width)
            for at in range((bottom - top) * _TILE * samples):
                colors[at] = 0
                depths[at] = 0
                counters[_CHIP] += 2 * _BYTES
            for t in range(len(corners)):
                x0, y0, x1, y1 = _box(corners, t, left, top, right, bottom)
                for y in range(y0, y1):
                    for x in range(x0, x1):
                        at = ((y - top) * _TILE + x - left) * samples
                        _test_and_write(corners, depth_of, t, x, y, at, pattern, colors, depths, counters, True, deferred)
            for y in range(top, bottom):
                for x in range(left, right):
                    _resolve(x, y, ((y - top) * _TILE + x - left) * samples, samples, colors, out, counters, True, deferred)


def count(way: str, size: int, samples: int, overdraw: int) -> tuple[Array, Traffic]:
    """Draw one frame in one of WAYS: what it shows, and its traffic."""
    corners, depth_of = layers(size, overdraw)
    pattern = sample_pattern(samples).astype(np.int64)
    out, counters = np.empty((size, size), np.float32), np.zeros(6, np.int64)
    places = (size * size if way == "immediate" else _TILE * _TILE) * samples
    colors, depths = np.empty(places, np.int32), np.empty(places, np.float32)
    if way == "immediate":
        _immediate(corners, depth_of, pattern, colors, depths, out, counters)
    else:
        _tiled(corners, depth_of, pattern, way == "tiled, deferred", colors, depths, out, counters)
    return out, Traffic(*(int(n) for n in counters))


def run(context: Context, report: Report) -> None:
    """The traffic of every way, for 1, 4 and 8 samples and overdraw 1 to 8."""
    size = 64 if context.quick else 256
    rows: list[dict[str, Any]] = []
    for samples in (1, 4, 8):
        for overdraw in range(1, 9):
            for way in WAYS:
                _, traffic = count(way, size, samples, overdraw)
                pixels = size * size
                rows.append({"samples": samples, "overdraw": overdraw, "way": way, "colour read": traffic.color_read / pixels,
                             "colour written": traffic.color_written / pixels, "depth read": traffic.depth_read / pixels,
                             "depth written": traffic.depth_written / pixels, "all external": traffic.external / pixels,
                             "within tiles": traffic.on_chip / pixels, "shaded": traffic.shaded / pixels})  # fmt: skip
    report.table("traffic", "Memory traffic", rows, f"Bytes a pixel and frame, counted in a run at {size} x {size}: every access to a colour or a "
                 "depth, 4 bytes each, of small squares in shuffled depths. Shaded: how often a pixel is.")  # fmt: skip
    with report.figure("traffic", "External memory traffic, 4 samples a pixel") as axes:
        for way in WAYS:
            chosen = [row for row in rows if row["way"] == way and row["samples"] == 4]
            style = "s--" if way == "tiled, deferred" else "o-"
            axes.plot([row["overdraw"] for row in chosen], [row["all external"] for row in chosen], style, label=way)
        axes.set_xlabel("overdraw")
        axes.set_ylabel("bytes a pixel and frame")
        axes.set_ylim(0)
