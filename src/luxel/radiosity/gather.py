"""Gather: every element looks around for itself, once the patches' light is known.

Rows of transport give an element the mean radiosity of whole patches, seen from one point each. Here rays leave from many points of the
element, so narrow gaps and strips count as they are, and each ray brings the radiosity of the very element that it meets (final gathering:
Reichert 1992, "A two-pass radiosity method driven by lights and viewer position"). All elements cast the same directions in frames of their own:
neighbours agree, there is no noise, and what rays meet is kept, so light can be passed on again at the cost of a look-up each.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import float_bits
from luxel.radiosity import packet
from luxel.radiosity.directions import cosine_directions, turned
from luxel.radiosity.element import AREA, FREE, GX, GY, GZ, LIFT, NX, NZ, SPOTS, free_spot, point_of
from luxel.radiosity.hemicube import frames_of
from luxel.radiosity.lightmap import like
from luxel.radiosity.occlusion import Occlusion
from luxel.radiosity.packet import AT, DX, DY, DZ, FOUND, OX, OY, OZ, SLOPE, WIDTH
from luxel.raster.geometry import Geometry

if TYPE_CHECKING:
    from luxel.radiosity.luxels import Luxels

NOWHERE, BACK, LOST = -1, -2, -3
"""What a ray meets that meets no element: nothing; the back of something one-sided; or such a back so near that it tells nothing, as the ray began
behind it, where a surface bends or under something that stands on it."""

_CHUNK = 32
_RAYS_AT_ONCE = 1 << 22
_BORDER = 2  # texels


class Lookup(NamedTuple):
    """Which element lies at a point of a triangle.

    Attributes:
        maps: (m, 8) float32: of each triangle the affine map from a point of its plane, metres, to column and row in the lightmap, texels.
        page: (m,) int32, of each triangle.
        two_sided: (m,) bool, of each triangle.
        element: (2, pages, height, width) int32: of the front and of the back at each texel, `NOWHERE` if there is none.
    """

    maps: Array
    page: Array
    two_sided: Array
    element: Array


def texel_maps(geometry: Geometry, size: tuple[int, int]) -> Array:
    """`Lookup.maps`."""
    corners = geometry.positions.astype(np.float64)[geometry.triangles]
    uv = geometry.texcoords1.astype(np.float64)[geometry.triangles] * size
    a, e, f = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    ee, ef, ff = (e * e).sum(1), (e * f).sum(1), (f * f).sum(1)
    maps = np.empty((len(a), 2, 4))
    with np.errstate(all="ignore"):
        whole = (ee * ff - ef * ef)[:, None]
        s, t = (ff[:, None] * e - ef[:, None] * f) / whole, (ee[:, None] * f - ef[:, None] * e) / whole
        maps[:, :, :3] = (uv[:, 1] - uv[:, 0])[:, :, None] * s[:, None] + (uv[:, 2] - uv[:, 0])[:, :, None] * t[:, None]
        maps[:, :, 3] = uv[:, 0] - (maps[:, :, :3] * a[:, None]).sum(2)
    return np.nan_to_num(maps, nan=0.0, posinf=0.0, neginf=0.0).reshape(-1, 8).astype(np.float32)


@jit.part
def _element_at(hit, back, x, y, z, lookup):
    """The element on a side of triangle `hit` at a point."""
    if back and not lookup.two_sided[hit]:
        return np.int32(BACK)
    m = lookup.maps
    u, v = m[hit, 0] * x + m[hit, 1] * y + m[hit, 2] * z + m[hit, 3], m[hit, 4] * x + m[hit, 5] * y + m[hit, 6] * z + m[hit, 7]
    rows, columns = lookup.element.shape[2], lookup.element.shape[3]
    row, column = min(max(np.int64(np.floor(v)), 0), rows - 1), min(max(np.int64(np.floor(u)), 0), columns - 1)
    return lookup.element[back, lookup.page[hit], row, column]


@jit.part
def _start(numbers, frame, direction, i, point, reach, r, c):
    """Ray `r` of the packet starts at spot `point` of element `i`; it goes nowhere if the direction is below the surface."""
    c[OX + r], c[OY + r], c[OZ + r] = point_of(numbers, i, point, LIFT)
    dx, dy, dz = turned(frame, direction)
    c[DX + r], c[DY + r], c[DZ + r] = dx, dy, dz
    c[AT + r] = reach if numbers[GX, i] * dx + numbers[GY, i] * dy + numbers[GZ, i] * dz > np.float32(0.0) else np.float32(0.0)


@jit.parallel_kernel
def _look(queue, scene, numbers, frames, directions, reach, lookup, first, hits):
    own_c, own_stack, own_points = np.zeros(packet.SCRATCH, np.float32), np.zeros(packet.STACK, np.int32), np.zeros((WIDTH, SPOTS), np.int64)
    c, stack, points = jit.borrow(own_c), jit.borrow(own_stack), jit.borrow(own_points)
    scene, numbers, frames, directions = jit.borrow(scene), jit.borrow(numbers), jit.borrow(frames), jit.borrow(directions)
    lookup, hits = jit.borrow(lookup), jit.borrow(hits)
    count, rays = hits.shape
    chunk = jit.take(queue)
    while chunk * WIDTH < count:
        start = chunk * WIDTH
        width = min(WIDTH, count - start)
        for r in range(width):
            for k in range(SPOTS):
                points[r, k] = free_spot(np.int64(numbers[FREE, first + start + r]), k)
        for number in range(rays):
            for r in range(np.uint64(WIDTH)):
                k = min(start + np.int64(r), count - 1)  # the last packet is filled up with its last element's rays
                _start(numbers, frames[k], directions[number], first + k, points[k - start, number % SPOTS], reach, r, c)
            packet.meet_all(scene, c, stack)
            for r in range(np.uint64(width)):
                item, at = float_bits(c[FOUND + r]), c[AT + r]
                met = np.int32(NOWHERE)
                if item >= 0:
                    x, y, z = c[OX + r] + c[DX + r] * at, c[OY + r] + c[DY + r] * at, c[OZ + r] + c[DZ + r] * at
                    met = _element_at(scene.triangle[item], 1 if c[SLOPE + r] > np.float32(0.0) else 0, x, y, z, lookup)
                    if met == BACK and at * at < numbers[AREA, first + start + np.int64(r)]:
                        met = np.int32(LOST)
                hits[start + np.int64(r), number] = met
        chunk = jit.take(queue)
    own_c[0] = own_stack[0] + own_points[0, 0]  # they live until here


class Sight:
    """What the elements of a scene see.

    Args:
        scene: All that hides.
        numbers: (17, n) float32, of `Elements`.
        lookup: Which element lies where.
        rays: Of each element.
        reach: Metres: no ray goes farther.
        most_bytes: What is seen is kept up to this; beyond, it is looked again each time.
    """

    def __init__(self, scene: Occlusion, numbers: Array, lookup: Lookup, rays: int, reach: float, most_bytes: int) -> None:
        self.scene, self.numbers, self.lookup, self.reach = scene, numbers, lookup, np.float32(reach)
        self.directions = cosine_directions(rays).astype(np.float32)
        n, step = numbers.shape[1], max(1, _RAYS_AT_ONCE // (WIDTH * rays)) * WIDTH
        self.starts = [*range(0, n, step), n]
        self.hits = np.empty((min(n, most_bytes // (4 * rays * step) * step), rays), np.int32)
        self.seen = 0

    @property
    def whole(self) -> bool:
        """What every element sees is kept, in `hits` (n, rays) int32: the elements that its rays meet, `NOWHERE`, `BACK` or `LOST`."""
        return len(self.hits) == self.numbers.shape[1]

    def irradiance(self, radiosity: Array, threads: int, told: Callable[[float], None] | None = None) -> Array:
        """(3, n) float32 W/m2: what comes to the elements, from the radiosity of all, (n, 3) float32 W/m2. `told` hears the share that is done."""
        result = np.empty((3, self.numbers.shape[1]), np.float32)
        for first, last in pairwise(self.starts):
            kept = last <= len(self.hits)
            hits = self.hits[first:last] if kept else np.empty((last - first, len(self.directions)), np.int32)
            if not kept or first >= self.seen:
                frames = frames_of(self.numbers[NX : NZ + 1, first:last].T)
                jit.run(_look, threads, self.scene, self.numbers, frames, self.directions, self.reach, self.lookup, first, hits)
                self.seen = max(self.seen, last)
                if told:
                    told(last / self.starts[-1])
            mean_radiosity(hits, radiosity, first, result, threads)
        return result


@jit.parallel_kernel
def _mean(queue, hits, radiosity, first, result):
    hits, radiosity, result = jit.borrow(hits), jit.borrow(radiosity), jit.borrow(result)
    count, rays = hits.shape
    chunk = jit.take(queue)
    while chunk * _CHUNK < count:
        for k in range(chunk * _CHUNK, min(count, (chunk + 1) * _CHUNK)):
            red = green = blue = 0.0
            lost = 0
            for r in range(rays):
                e = hits[k, r]
                lost += e == LOST
                if e >= 0:
                    red, green, blue = red + radiosity[e, 0], green + radiosity[e, 1], blue + radiosity[e, 2]
            share = 1.0 / max(rays - lost, 1)
            result[0, first + k], result[1, first + k], result[2, first + k] = red * share, green * share, blue * share
        chunk = jit.take(queue)


def mean_radiosity(hits: Array, radiosity: Array, first: int, result: Array, threads: int) -> None:
    """Fill result (3, n) float32 from element `first` on: irradiance, W/m2, from `hits` (k, rays) and the radiosity of all, (n, 3) float32."""
    jit.run(_mean, threads, hits, radiosity, first, result)


def settle(gathered: Callable[[Array], Array], direct: Array, albedo: Array, irradiance: Array, tolerance: float, most: int = 64) -> Array:
    """Pass light on from element to element until it hardly changes any more.

    Args:
        gathered: From the radiosity (n, 3) float32 of all elements to what comes to them, (3, n).
        direct: (3, n) float32 irradiance that is there without it, W/m2.
        albedo: (3, n) float32.
        irradiance: (3, n) float32, to begin with.
        tolerance: By how much the sum may change in the last pass, of itself.
        most: Passes.

    Returns:
        (3, n) float32 irradiance, W/m2.
    """
    for _ in range(most):
        before = irradiance
        irradiance = direct + gathered(np.ascontiguousarray((albedo * before).T))
        if np.abs(irradiance - before).sum(dtype=np.float64) <= tolerance * irradiance.sum(dtype=np.float64):
            break
    return irradiance


def element_pages(luxels: Luxels, luxel: Array, back: Array) -> Array:
    """`Lookup.element`, of elements that are `back` (n,) bool or front of `luxel` (n,) int32.

    Luxels that are no elements, as their middle is inside a solid, are stood for by the nearest on their chart, and so is the chart's border.
    """
    pages = np.full((2, *luxels.shape), NOWHERE, np.int32)
    for side in (0, 1):
        number = np.full(len(luxels.area), NOWHERE, np.int32)
        here = np.flatnonzero(back == bool(side))
        number[luxel[here]] = here
        if side == 0:
            without = np.flatnonzero(number < 0)
            if len(without) and len(here):
                number[without] = number[like(luxels, without, number >= 0)]
        page, row, column = luxels.texel.T
        pages[side, page, row, column] = number
        for _ in range(_BORDER):
            _grow(pages[side])
    return pages


def _grow(pages: Array) -> None:
    """Give texels that have no element that of a neighbour."""
    before = np.pad(pages, ((0, 0), (1, 1), (1, 1)), constant_values=NOWHERE)
    h, w = pages.shape[1:]
    for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        empty = pages == NOWHERE
        pages[empty] = before[:, 1 + dy : 1 + dy + h, 1 + dx : 1 + dx + w][empty]
