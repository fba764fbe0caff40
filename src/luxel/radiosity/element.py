"""Element: the numbers of one, and the samples on it from which it looks around.

Its samples are a grid over the parallelogram of its sides, a little above the surface: there a sample of a curved surface is in front of its
neighbours, and nothing that matters is that thin.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.nearest import nearest
from luxel.radiosity.occlusion import Occlusion, occluded

# Rows of `Elements.numbers`; FREE holds a bit for each sample that is not inside something that stands on the element, 0 if only the middle is not.
PX, PY, PZ, NX, NY, NZ, GX, GY, GZ, AREA, UX, UY, UZ, VX, VY, VZ, FREE = range(17)

_SIDE = 4
SAMPLES = _SIDE * _SIDE
"""Points of an element, row by row, that stand for its parts."""

LIFT = np.float32(0.025)
"""Of an element's side: how high above the surface its samples are."""

_ROOF = np.float32(0.1)  # of an element's side: what is so near above it lies on it, and lets no light in below
_CHUNK, _AT_ONCE = 512, 1 << 16
_QUARTER = 0b110011  # two samples of a row, and two below
_STRIDE = 7  # from sample to sample, so that those that follow each other are apart
_F, _HALF, _STEP = np.float32, np.float32(0.5), np.float32(1 / _SIDE)


def _sample(k):
    """Where sample `k` is, in sides of the element from its middle, -1/2 .. 1/2; the middle for `SAMPLES`."""
    if k == SAMPLES:
        return _F(0.0), _F(0.0)
    return (_F(k % _SIDE) + _HALF) * _STEP - _HALF, (_F(k // _SIDE) + _HALF) * _STEP - _HALF


_sample_part = jit.part(_sample)


def _rectangles():
    """(100, 5) int64: the bits of the samples of each rectangle, and its first and behind its last column, and row; the largest first."""
    sides = list(itertools.combinations(range(_SIDE + 1), 2))
    found = [
        (sum(1 << (r * _SIDE + c) for r in range(top, low) for c in range(left, right)), left, right, top, low)
        for (top, low), (left, right) in itertools.product(sides, sides)
    ]
    return np.array(sorted(found, key=lambda rectangle: -rectangle[0].bit_count()))


_RECTANGLES = _rectangles()


@jit.part
def free_from(free, s):
    """The first free sample of an element from sample `s` on, of which `free` has the bits; the middle if there are none."""
    if free == 0:
        return SAMPLES
    while not free & (1 << s):
        s = (s + 1) % SAMPLES
    return s


@jit.part
def free_sample(free, k):
    """Number `k` in a walk around the free samples of an element."""
    return free_from(free, (k * _STRIDE) % SAMPLES)


@jit.part
def point_of(numbers, i, sample, lift):
    """A sample of element `i`, `lift` of its side above the surface; metres, float32."""
    a, b = _sample_part(sample)
    return _point_at(numbers, i, a, b, lift)


@jit.part
def quarter_of(numbers, i, k, free, lift):
    """The middle of quarter `k` of element `i`, of whose samples `free` has the bits; a free one in its place, if some there are not."""
    row, column = k // 2, k % 2
    first = 8 * row + 2 * column
    if (free >> first) & _QUARTER == _QUARTER:
        return _point_at(numbers, i, _F(column) * _HALF - _HALF * _HALF, _F(row) * _HALF - _HALF * _HALF, lift)
    return point_of(numbers, i, free_from(free, first), lift)


@jit.part
def _point_at(numbers, i, a, b, lift):
    """The point of element `i` at a and b of its sides from the middle."""
    lift *= math.sqrt(numbers[AREA, i])
    x = numbers[PX, i] + lift * numbers[GX, i] + a * numbers[UX, i] + b * numbers[VX, i]
    y = numbers[PY, i] + lift * numbers[GY, i] + a * numbers[UY, i] + b * numbers[VY, i]
    z = numbers[PZ, i] + lift * numbers[GZ, i] + a * numbers[UZ, i] + b * numbers[VZ, i]
    return x, y, z


def turned(numbers: Array) -> Array:
    """The other sides of elements (17, n), whose numbers are changed."""
    numbers[NX : GZ + 1] *= -1
    return numbers


def samples_on(position: Array, u: Array, v: Array) -> Array:
    """(samples, n, 3) float32: all samples of n elements with middles and sides, (n, 3) each, on the surface."""
    a, b = (np.array(at, np.float32)[:, None, None] for at in zip(*(_sample(k) for k in range(SAMPLES)), strict=True))
    return np.asarray(position + a * u + b * v, np.float32)


@jit.part
def _roofed(scene, charts, own, numbers, i, sample):
    """Whether something of another chart is close above a sample of element `i`."""
    height = np.float64(_ROOF) * math.sqrt(numbers[AREA, i])
    x, y, z = point_of(numbers, i, sample, _F(0.0))
    dx, dy, dz = height * numbers[GX, i], height * numbers[GY, i], height * numbers[GZ, i]
    ox, oy, oz = np.float64(x), np.float64(y), np.float64(z)
    met, _, _ = nearest(scene, ox, oy, oz, dx, dy, dz)
    return met >= 0 and charts[met] != own and occluded(scene, ox, oy, oz, ox + dx, oy + dy, oz + dz, -1, -1)  # not through a hole


@jit.part
def _largest(bits):
    """First and behind the last column, and row, of the largest rectangle of samples whose bits are set; all 0 if there is none."""
    for k in range(len(_RECTANGLES)):
        mask = _RECTANGLES[k, 0]
        if bits & mask == mask:
            return _RECTANGLES[k, 1], _RECTANGLES[k, 2], _RECTANGLES[k, 3], _RECTANGLES[k, 4]
    return 0, 0, 0, 0


@jit.part
def _crop(scene, charts, own, numbers, i):
    """Leave of element `i`, whose middle is close under something, the largest part that is not, if there is one."""
    bits, count = 0, 0
    for k in range(SAMPLES):
        if not _roofed(scene, charts, own, numbers, i, k):
            bits, count = bits | 1 << k, count + 1
    if count == 0:
        return
    left, right, top, low = _largest(bits)
    a, b = _HALF * _STEP * _F(left + right) - _HALF, _HALF * _STEP * _F(top + low) - _HALF
    for axis in range(3):
        u, v = numbers[UX + axis, i], numbers[VX + axis, i]
        numbers[PX + axis, i] += a * u + b * v
        numbers[UX + axis, i], numbers[VX + axis, i] = u * _STEP * _F(right - left), v * _STEP * _F(low - top)
    numbers[AREA, i] *= _F(count) / _F(SAMPLES)  # all that is open, though the sides are those of a part of it


@jit.parallel_kernel
def _find_free(queue, scene, charts, chart, numbers, begin, end):
    scene, charts, chart, numbers = jit.borrow(scene), jit.borrow(charts), jit.borrow(chart), jit.borrow(numbers)
    chunk = jit.take(queue)
    while begin + chunk * _CHUNK < end:
        for i in range(begin + chunk * _CHUNK, min(end, begin + (chunk + 1) * _CHUNK)):
            if _roofed(scene, charts, chart[i], numbers, i, SAMPLES):
                _crop(scene, charts, chart[i], numbers, i)
            mx, my, mz = point_of(numbers, i, SAMPLES, LIFT)
            free, hidden = 0, 0
            for k in range(SAMPLES):
                x, y, z = point_of(numbers, i, k, LIFT)
                met, _, _ = nearest(scene, np.float64(mx), np.float64(my), np.float64(mz), np.float64(x - mx), np.float64(y - my), np.float64(z - mz))
                if met < 0:
                    free |= 1 << k
                elif charts[met] != chart[i]:
                    hidden += 1
            numbers[FREE, i] = free
            numbers[AREA, i] *= np.float32(max(SAMPLES - hidden, 1)) / np.float32(SAMPLES)
        chunk = jit.take(queue)


def find_free(scene: Occlusion, charts: Array, chart: Array, numbers: Array, threads: int) -> None:
    """Fill the row FREE of elements, and take from their areas what is inside something that stands on them.

    An element whose middle is close under something that lies on it is first cropped to the part of it that is not.

    A sample is free if the middle sees it. If a triangle of the element's own chart is between them, the surface only bends: then the sample is not
    free, as it is behind the surface, but nothing of the area is lost.

    Args:
        scene: All triangles; `charts` (m,) int32 of each.
        chart: (n,) int32: of each element.
        numbers: (17, n) float32, changed.
    """
    count = numbers.shape[1]
    for begin in range(0, count, _AT_ONCE):  # whoever interrupts this need not wait for all of them
        jit.run(_find_free, threads, scene, charts, chart, numbers, begin, min(count, begin + _AT_ONCE))
