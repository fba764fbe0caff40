"""Resolve: from the colours of samples to pixels, by a reconstruction filter.

The box filter over one pixel is the plain average, and `shade` takes it on the way; this is for the wider filters, and for blended
layers, which must be composited per sample first. Colours are linear and premultiplied; weights sum to one, at the picture's border too.
Mitchell: Mitchell and Netravali 1988, B = C = 1/3. Blackman-Harris: Harris 1978, four terms.

A filter with negative lobes rings: beside a highlight fifty times as bright as white it would draw a black line. Two limits keep it from
that, and leave alone what has neither values above white nor overshoot. Samples outside the main lobe (positive weights along both axes)
count, channel by channel, as no brighter than white or the main lobe's mean, whichever is more. And the result is held in the range
of the main lobe's samples: alpha as it is, colour where not premultiplied. Scalers with negative lobes do the latter too ("anti-ringing").
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
        taps (k, 4) int32: pixel offset along x and y, sample, and 1 in the main lobe (everywhere, for a filter without negative ones), which
        comes first, else 0; weights (k,) float32, summing to 1.

    Raises:
        InputError: No such filter.
    """
    if name not in FILTERS:
        raise InputError(f"filter: expected one of {', '.join(FILTERS)}; got {name!r}")
    radius, weight = FILTERS[name]
    reach = math.ceil(radius)
    taps, weights = [], []
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            for s, (sx, sy) in enumerate(pattern / 256 - 0.5):
                x, y = dx + sx, dy + sy
                # A box holds its pixel's own samples; of the others, those on the rim weigh nothing.
                if (dx == dy == 0) if name == "box" else (abs(x) < radius and abs(y) < radius):
                    taps.append((dx, dy, s, int(weight(x) > 0 and weight(y) > 0)))
                    weights.append(weight(x) * weight(y))
    if not taps or abs(sum(weights)) < 1e-6:
        raise InputError(f"filter {name}: the samples lie where it is zero")
    order = np.argsort([-tap[3] for tap in taps], kind="stable")
    return np.array(taps, np.int32)[order], (np.array(weights) / sum(weights)).astype(np.float32)[order]


@jit.part
def _ranges(lows, highs, r, g, b, a):
    """The least and largest colours (not premultiplied) and alphas, with those of one more sample."""
    if a > 0:
        r, g, b = r / a, g / a, b / a
        lows = min(lows[0], r), min(lows[1], g), min(lows[2], b), lows[3]
        highs = max(highs[0], r), max(highs[1], g), max(highs[2], b), highs[3]
    return (lows[0], lows[1], lows[2], min(lows[3], a)), (highs[0], highs[1], highs[2], max(highs[3], a))


@jit.part
def _held(r, g, b, a, lows, highs):
    """A premultiplied colour, held in the ranges."""
    a = min(max(a, lows[3]), highs[3])
    if not a > 0:
        return _F(0.0), _F(0.0), _F(0.0), _F(0.0)
    return min(max(r, a * lows[0]), a * highs[0]), min(max(g, a * lows[1]), a * highs[1]), min(max(b, a * lows[2]), a * highs[2]), a


@jit.part
def filtered(x, y, width, height, band_top, band_rows, across, tile, samples, colors, taps, weights, main, white):
    """The premultiplied colour of pixel (x, y), filtered; see `resolve`. `main` is the number of taps in the main lobe."""
    total, pixels = _F(0.0), tile * tile
    red = green = blue = alpha = _F(0.0)
    most, lows, highs = (_INF, _INF, _INF), (_INF, _INF, _INF, _INF), (-_INF, -_INF, -_INF, -_INF)
    for k in range(len(taps)):
        if k == main:
            most = max(white, red / total), max(white, green / total), max(white, blue / total)
        sx, sy = x + taps[k, 0], y + taps[k, 1]
        if sx < 0 or sy < 0 or sx >= width or sy >= height or sy < band_top or sy >= band_top + band_rows:
            continue
        slot = (sy // tile - band_top // tile) * across + sx // tile
        p = taps[k, 2] * pixels + (sy % tile) * tile + sx % tile
        plane, weight = samples * pixels, weights[k]
        r, g, b, a = colors[slot, p], colors[slot, plane + p], colors[slot, 2 * plane + p], colors[slot, 3 * plane + p]
        total += weight
        red += weight * min(r, most[0])
        green += weight * min(g, most[1])
        blue += weight * min(b, most[2])
        alpha += weight * a
        if main < len(taps) and k < main:
            lows, highs = _ranges(lows, highs, r, g, b, a)
    inverse = _F(1.0) / total
    red, green, blue, alpha = red * inverse, green * inverse, blue * inverse, alpha * inverse
    if main < len(taps):
        red, green, blue, alpha = _held(red, green, blue, alpha, lows, highs)
    return red, green, blue, min(max(alpha, _F(0.0)), _F(1.0))


@jit.parallel_kernel
def _resolve(queue, first_row, last_row, first_column, last_column, width, height, band_top, band_rows, across, tile, samples, colors, taps,
             weights, left, top, exposure, background, color, linear):  # fmt: skip
    step, main, white = 256, taps[:, 3].sum(), _F(1.0) / exposure
    own = np.zeros(4 * step, np.float32)
    sums, color, linear = jit.borrow(own), jit.borrow(color), jit.borrow(linear)
    y = first_row + jit.take(queue)
    while y < last_row:
        for start in range(first_column, last_column, step):
            count = min(step, last_column - start)
            for i in range(count):
                red, green, blue, alpha = filtered(
                    start + i, y, width, height, band_top, band_rows, across, tile, samples, colors, taps, weights, main, white
                )
                sums[i], sums[step + i], sums[2 * step + i] = red, green, blue
                sums[3 * step + i] = alpha
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
