"""Sky: its light on every element, from what elements see.

The rays by which elements look around lie one each in cells of equal weight of the hemisphere (Hammersley points). A cell whose neighbours agree with
it, for this element and those beside it, on whether the sky is there is taken as a whole; any other has sixteen rays more, from as many samples,
or four where so many cells are at edges (in foliage, say) that these are enough. What is much brighter than the rest, such as the sun, is left to
directional lights (`direct`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import float_bits
from luxel.radiosity import packet
from luxel.radiosity.directions import on_hemisphere, turned
from luxel.radiosity.element import FREE, free_from
from luxel.radiosity.gather import NOWHERE, View, start_ray
from luxel.radiosity.packet import AT, DX, DY, DZ, FOUND, OX, OY, OZ, WIDTH

_BRIGHT = 8.0  # times the mean: beyond, a pixel's light is directional lights'
_COARSE, _FINE = 16, 64  # rows of the pictures that cells, and parts of cells, are looked up in, at most
TOGETHER = 16  # elements that tell each other what they see: a window too small for the rays of one is found by those of others
_NO_SKY, _SKY, _EDGE = range(3)
_FINELY, _COARSELY = 4, 2  # parts along a side of a cell at an edge: where few cells are, and where many are
_FEW = 2  # few: at most one of so many


class Even(NamedTuple):
    """A sky without what is much brighter than the rest, as pictures to look up whole cells in, and parts of cells: (h, w, 3) float32, W/(m2 sr)."""

    coarse: Array
    fine: Array

    @property
    def mean(self) -> float:
        """Radiance over all directions and channels."""
        ring = np.sin((np.arange(len(self.fine)) + 0.5) / len(self.fine) * np.pi)
        return float(ring @ self.fine.mean((1, 2), dtype=np.float64) / ring.sum())


def split(sky: Array) -> tuple[Even, Array]:
    """A sky (3,) or (h, w, 3), W/(m2 sr), as what is even enough for cells, and the rest, (h, w, 3): the sun."""
    picture = np.asarray(sky, np.float64).reshape(1, 1, 3) if np.ndim(sky) == 1 else np.asarray(sky, np.float64)
    ring = np.sin((np.arange(len(picture)) + 0.5) / len(picture) * np.pi)[:, None]
    level = picture.sum(2)
    most = _BRIGHT * (level * ring).sum() / (ring.sum() * level.shape[1])
    even = picture * np.minimum(1.0, most / np.maximum(level, 1e-300))[:, :, None]
    return Even(_shrunk(even, _COARSE), _shrunk(even, _FINE)), picture - even


def _shrunk(picture: Array, rows: int) -> Array:
    """At most so many rows, and twice as many columns: (h, w, 3) float32 means, each row of pixels by its solid angle."""
    ring = np.sin((np.arange(len(picture)) + 0.5) / len(picture) * np.pi)[:, None, None]
    for axis, most in ((0, rows), (1, 2 * rows)):
        size = picture.shape[axis]
        if size > most:
            starts = np.arange(most) * size // most
            weight = np.broadcast_to(ring, picture.shape) if axis == 0 else np.ones_like(picture)
            picture = np.add.reduceat(picture * weight, starts, axis) / np.add.reduceat(weight, starts, axis)
    return np.ascontiguousarray(picture, np.float32)


@jit.part
def _pixel(picture, dx, dy, dz):
    """Row and column of a picture all around: +y up, the middle column along -z."""
    rows, columns = picture.shape[0], picture.shape[1]
    row = np.int64(math.acos(min(max(dy, -1.0), 1.0)) / math.pi * rows)
    column = np.int64((math.atan2(dx, -dz) / (2 * math.pi) + 0.5) * columns)
    return min(row, rows - 1), min(column, columns - 1)


@jit.part
def _part(r, numbers, frame, i, sample, a, b, part, side, wide, high, reach, local, c):
    """Ray `r` of the packet goes from a sample of element `i` through a part of a cell that has `side` times `side` of them."""
    local[0], local[1], local[2] = on_hemisphere((a + (part % side + 0.5) / side) / wide, (b + (part // side + 0.5) / side) / high)
    start_ray(numbers, frame, local, i, sample, reach, r, c)


@jit.part
def _sample_of_part(part, side):
    """The sample from which a part of an edge's cell is looked through: an orthogonal array, the same in all cells, so that they fit together.

    Samples' rows and columns are sums in the field of four elements of those of the parts, so each row and each column of the one meets each of the
    other once.
    """
    step = (_FINELY - 1) // (side - 1)
    a, b = part % side * step, part // side * step
    twice = (b << 1) ^ ((b >> 1) * 7)  # in that field, whose polynomial is x^2 + x + 1
    return (a ^ twice) * 4 + (a ^ b)


@jit.part
def rays_to_nowhere(first, c):
    """Let the rays of a packet from `first` on go nowhere."""
    for r in range(first, WIDTH):
        for row in (OX, OY, OZ, DX, DY, DZ):
            c[row + np.uint64(r)] = c[row]
        c[AT + np.uint64(r)] = np.float32(0.0)


@jit.part
def _parts_light(rays, light, scene, fine, c, stack):
    """`light` (red, green, blue) and what the first `rays` of a packet bring, one after the other."""
    rays_to_nowhere(rays, c)
    packet.meet_all(scene, c, stack)
    red, green, blue = light
    for r in range(np.uint64(rays)):
        if float_bits(c[FOUND + r]) < 0 and c[AT + r] > np.float32(0.0):
            row, column = _pixel(fine, c[DX + r], c[DY + r], c[DZ + r])
            red, green, blue = red + fine[row, column, 0], green + fine[row, column, 1], blue + fine[row, column, 2]
    return red, green, blue


@jit.part
def classify(hits, cell, first, last, wide, high, seen, kind):
    """Whether each cell of neighbouring elements is sky, no sky, or at an edge: where some of them, or some cells about it, disagree."""
    seen[:] = 0
    for i in range(first, last):
        for k in range(len(cell)):
            if hits[i, k] == NOWHERE:
                seen[cell[k, 0], cell[k, 1]] += 1
    some, every = False, last - first
    for a in range(wide):
        for b in range(high):
            least, most = every, 0
            for r in range(max(a - 1, 0), min(a + 2, wide)):
                for s in range(max(b - 1, 0), min(b + 2, high)):
                    least, most = min(least, seen[r, s]), max(most, seen[r, s])
            kind[a, b] = _NO_SKY if most == 0 else (_SKY if least == every else _EDGE)
            some |= most > 0
    return some


@jit.part
def light_of(i, some, kind, scene, numbers, frame, reach, coarse, fine, local, c, stack):
    """The light of the sky on element `i`, (red, green, blue) W/m2, through cells of each `kind` (wide, high), of which `some` are not dark."""
    wide, high = kind.shape
    red = green = blue = 0.0
    cut, edges, rays = (0.0, 0.0, 0.0), 0, 0
    free = np.int64(numbers[FREE, i])
    for a in range(wide if some else 0):
        for b in range(high):
            edges += kind[a, b] == _EDGE
    side = _FINELY if edges * _FEW <= wide * high else _COARSELY
    weight = 1.0 / (side * side)
    for a in range(wide if some else 0):
        for b in range(high):
            if kind[a, b] == _SKY:
                local[0], local[1], local[2] = on_hemisphere((a + 0.5) / wide, (b + 0.5) / high)
                dx, dy, dz = turned(frame, local)
                row, column = _pixel(coarse, dx, dy, dz)
                red, green, blue = red + coarse[row, column, 0], green + coarse[row, column, 1], blue + coarse[row, column, 2]
            elif kind[a, b] == _EDGE:
                for part in range(side * side):
                    sample = free_from(free, _sample_of_part(part, side))
                    _part(np.uint64(rays), numbers, frame, i, sample, a, b, part, side, wide, high, reach, local, c)
                    rays += 1
                    if rays == WIDTH:
                        cut, rays = _parts_light(rays, cut, scene, fine, c, stack), 0
    if rays > 0:
        cut = _parts_light(rays, cut, scene, fine, c, stack)
    share = math.pi / (wide * high)
    return (red + weight * cut[0]) * share, (green + weight * cut[1]) * share, (blue + weight * cut[2]) * share


@jit.parallel_kernel
def _gather(queue, scene, numbers, frames, reach, hits, cell, wide, high, coarse, fine, result):
    own_c, own_stack = np.zeros(packet.SCRATCH, np.float32), np.zeros(packet.STACK, np.int32)
    own_seen, own_kind, own_local = np.zeros((wide, high), np.int32), np.zeros((wide, high), np.int32), np.zeros(3)
    c, stack, seen, kind, local = jit.borrow(own_c), jit.borrow(own_stack), jit.borrow(own_seen), jit.borrow(own_kind), jit.borrow(own_local)
    scene, numbers, frames, hits, cell = jit.borrow(scene), jit.borrow(numbers), jit.borrow(frames), jit.borrow(hits), jit.borrow(cell)
    coarse, fine, result = jit.borrow(coarse), jit.borrow(fine), jit.borrow(result)
    chunk = jit.take(queue)
    while chunk * TOGETHER < len(hits):
        first, last = chunk * TOGETHER, min(len(hits), (chunk + 1) * TOGETHER)
        some = classify(hits, cell, first, last, wide, high, seen, kind)
        for i in range(first, last):
            red, green, blue = light_of(i, some, kind, scene, numbers, frames[i], reach, coarse, fine, local, c, stack)
            result[0, i], result[1, i], result[2, i] = red, green, blue
        chunk = jit.take(queue)
    own_c[0] = own_stack[0] + own_seen[0, 0] + own_kind[0, 0] + own_local[0]  # they live until here


def cells(rays: int) -> tuple[Array, int, int]:
    """The cell of each of so many rays, a power of two: (rays, 2) int32; and how many cells there are along each side of the square."""
    bits = rays.bit_length() - 1
    wide, high = 1 << bits // 2, 1 << (bits + 1) // 2
    i = np.arange(rays)
    turned_round = np.zeros(rays, np.int64)
    for bit in range(bits):
        turned_round |= ((i >> bit) & 1) << (bits - 1 - bit)
    return np.stack([i * wide // rays, turned_round * high // rays], 1).astype(np.int32), wide, high


def shine_sky(view: View, hits: Array, sky: Even, threads: int) -> Array:
    """(3, k) float32: irradiance, W/m2, that a sky gives to the k elements of `view`, which see `hits` (k, rays), rays a power of two."""
    cell, wide, high = cells(hits.shape[1])
    result = np.empty((3, len(hits)), np.float32)
    jit.run(_gather, threads, view.scene, view.numbers, view.frames(), np.float32(view.reach), hits, cell, wide, high, *sky, result)
    return result
