"""Resolve: from the colours of samples to pixels, by a reconstruction filter.

The box filter over one pixel is the plain average, and `shade` takes it on the way; this is for the wider filters, and for blended
layers, which must be composited per sample first. Colours are linear and premultiplied; weights sum to one, at the picture's border too.
Mitchell: Mitchell and Netravali 1988, B = C = 1/3. Blackman-Harris: Harris 1978, four terms.

A filter with negative lobes rings: beside a highlight fifty times as bright as white it would draw a black line. So its result is held, channel by
channel, within the range of the samples in its main lobe, those with a positive weight along both axes: what lies under a negative lobe alone can
no longer darken a pixel beyond what is there, and a pixel whose main lobe is all one colour has that colour. Scalers with negative lobes do
the same ("anti-ringing"); there is no parameter, and no light is cut off where it is.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.raster.shade import write_row

_F = np.float32
_INF = np.float32(np.inf)


def _mitchell(x: float) -> float:
    x = abs(x)
    if x < 1:
        return (21 * x**3 - 36 * x**2 + 16) / 18
    return (-7 * x**3 + 36 * x**2 - 60 * x + 32) / 18


def _blackman_harris(x: float) -> float:
    angle = math.pi * (x / 1.5 + 1)
    return 0.35875 - 0.48829 * math.cos(angle) + 0.14128 * math.cos(2 * angle) - 0.01168 * math.cos(3 * angle)


FILTERS = {
    "box": (0.5, lambda x: 1.0),
    "tent": (1.0, lambda x: 1 - abs(x)),
    "gaussian": (1.5, lambda x: math.exp(-2 * x * x) - math.exp(-4.5)),
    "mitchell": (2.0, _mitchell),
    "blackman-harris": (1.5, _blackman_harris),
}
"""Name: (radius in pixels, weight at a distance up to it along one axis)."""


def filter_taps(name: str, pattern: Array) -> tuple[Array, Array]:
    """The samples that a pixel's colour is made of.

    Args:
        name: One of FILTERS.
        pattern: (s, 2) int32 sample positions in 1/256 pixel.

    Returns:
        taps (k, 4) int32: pixel offset along x and y, sample, and 1 where the sample is one of those that hold the result in their range
        (in the main lobe of a filter that has negative ones), else 0; weights (k,) float32, summing to 1.

    Raises:
        InputError: No such filter.
    """
    if name not in FILTERS:
        raise InputError(f"filter: expected one of {', '.join(FILTERS)}; got {name!r}")
    radius, weight = FILTERS[name]
    reach = math.ceil(radius)
    rings = any(weight(radius * i / 64) < 0 for i in range(64))
    taps, weights = [], []
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            for s, (sx, sy) in enumerate(pattern / 256 - 0.5):
                x, y = dx + sx, dy + sy
                # A box holds its pixel's own samples; of the others, those on the rim weigh nothing.
                if (dx == dy == 0) if name == "box" else (abs(x) < radius and abs(y) < radius):
                    taps.append((dx, dy, s, int(rings and weight(x) > 0 and weight(y) > 0)))
                    weights.append(weight(x) * weight(y))
    if not taps or abs(sum(weights)) < 1e-6:
        raise InputError(f"filter {name}: the samples lie where it is zero")
    return np.array(taps, np.int32), (np.array(weights) / sum(weights)).astype(np.float32)


@jit.parallel_kernel
def _resolve(queue, first_row, last_row, first_column, last_column, width, height, band_top, band_rows, across, tile, samples, colors, taps,
             weights, left, top, exposure, background, color, linear):  # fmt: skip
    pixels, step = tile * tile, 256
    own = np.zeros(4 * step, np.float32)
    sums, color, linear = jit.borrow(own), jit.borrow(color), jit.borrow(linear)
    y = first_row + jit.take(queue)
    while y < last_row:
        for start in range(first_column, last_column, step):
            count = min(step, last_column - start)
            for i in range(count):
                x, total, held = start + i, _F(0.0), False
                red = green = blue = alpha = _F(0.0)
                lows, highs = (_INF, _INF, _INF, _INF), (-_INF, -_INF, -_INF, -_INF)
                for k in range(len(taps)):
                    sx, sy = x + taps[k, 0], y + taps[k, 1]
                    if sx < 0 or sy < 0 or sx >= width or sy >= height or sy < band_top or sy >= band_top + band_rows:
                        continue
                    slot = (sy // tile - band_top // tile) * across + sx // tile
                    p = taps[k, 2] * pixels + (sy % tile) * tile + sx % tile
                    plane, weight = samples * pixels, weights[k]
                    r, g, b, a = colors[slot, p], colors[slot, plane + p], colors[slot, 2 * plane + p], colors[slot, 3 * plane + p]
                    total += weight
                    red, green, blue, alpha = red + weight * r, green + weight * g, blue + weight * b, alpha + weight * a
                    if taps[k, 3]:
                        held = True
                        lows = min(lows[0], r), min(lows[1], g), min(lows[2], b), min(lows[3], a)
                        highs = max(highs[0], r), max(highs[1], g), max(highs[2], b), max(highs[3], a)
                inverse = _F(1.0) / total
                red, green, blue, alpha = red * inverse, green * inverse, blue * inverse, alpha * inverse
                if held:
                    red, green = min(max(red, lows[0]), highs[0]), min(max(green, lows[1]), highs[1])
                    blue, alpha = min(max(blue, lows[2]), highs[2]), min(max(alpha, lows[3]), highs[3])
                sums[i], sums[step + i], sums[2 * step + i] = red, green, blue
                sums[3 * step + i] = min(max(alpha, _F(0.0)), _F(1.0))
            write_row(sums, 0, step, top + y, left + start, count, exposure, background, color, linear)
        y = first_row + jit.take(queue)
    own[0] = 0  # the scratch must live until here: borrowing does not keep it


def resolve(first_row: int, last_row: int, first_column: int, last_column: int, width: int, height: int, band_top: int, band_rows: int,
            across: int, tile: int, samples: int, colors: Array, taps: Array, weights: Array, left: int, top: int, exposure: float,
            background: Array, color: Array, linear: Array, threads: int) -> None:  # fmt: skip
    """Filter the pixels of a window in rows first_row .. last_row - 1 and columns first_column .. last_column - 1.

    Args:
        width, height: Of the window; what lies outside has no weight.
        band_top, band_rows: The rows whose samples are in `colors`, whole tiles.
        colors: (tiles, 4 * samples * tile * tile) float32, premultiplied, planar.
        taps, weights: From `filter_taps`.
        left, top: Where the window lies in `color` and `linear`.
    """
    jit.run(
        _resolve, min(threads, last_row - first_row), first_row, last_row, first_column, last_column, width, height, band_top, band_rows,
        across, tile, samples, colors, taps, weights, left, top, _F(exposure), background, color, linear,
    )  # fmt: skip
