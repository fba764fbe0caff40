"""Gather: every element looks around for itself, once the patches' light is known.

Rows of transport give an element the mean radiosity of whole patches, seen from one point each. Here rays leave from many points of the
element, so narrow gaps and strips count as they are, and each ray brings the radiosity of the very element that it meets (final gathering:
Reichert 1992, "A two-pass radiosity method driven by lights and viewer position"). All elements cast the same directions in frames of their own:
neighbours agree, there is no noise, and what rays meet is kept, so light is passed on again and again at the cost of a look-up each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import float_bits, floor32
from luxel.radiosity import packet
from luxel.radiosity.directions import cosine_directions, turned
from luxel.radiosity.element import AREA, FREE, GX, GY, GZ, LIFT, NX, NZ, PX, PY, PZ, SAMPLES, free_sample, point_of
from luxel.radiosity.hemicube import frames_of
from luxel.radiosity.lightmap import like
from luxel.radiosity.occlusion import Occlusion
from luxel.radiosity.packet import AT, DX, DY, DZ, FOUND, OX, OY, OZ, SLOPE, WIDTH
from luxel.radiosity.transport import BLOCK
from luxel.raster.geometry import Geometry

if TYPE_CHECKING:
    from luxel.radiosity.luxels import Luxels

NOWHERE, BACK, LOST = -1, -2, -3
"""What a ray meets that meets no element: nothing; the back of something one-sided; or such a back so near that it tells nothing, as the ray began
behind it, where a surface bends or under something that stands on it."""

_CHUNK = 32
_RAYS_AT_ONCE, _MOST_RAYS = 1 << 19, 1 << 22  # of each thread, of all: some seconds where neighbours see nothing alike; who interrupts waits so long
_BORDER = 2  # texels
_FEW = 16  # hardly any: less than one of so many
_BESIDE = 4.0  # squared, in sides of a luxel: how far from it what it stands for may lie
_MIXED = np.array([[73856093], [19349663], [83492791]], np.uint32)  # Teschner et al. 2003, "Optimized spatial hashing"
_TURN = 5  # samples, from one round of rays to the next; prime to their number, so that all come in turn


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
    row, column = min(max(np.int64(floor32(v)), 0), rows - 1), min(max(np.int64(floor32(u)), 0), columns - 1)
    return lookup.element[back, lookup.page[hit], row, column]


def _sample_of(number):
    """From which of an element's free samples ray `number` leaves. Every sixteenth ray lies in the same strip of the hemisphere, so each round
    of them begins at another sample: strips are seen from all."""
    return (number + _TURN * (number // SAMPLES)) % SAMPLES


sample_of = jit.part(_sample_of)


@jit.part
def start_ray(numbers, frame, direction, i, point, reach, r, c):
    """Ray `r` of the packet starts at sample `point` of element `i`; it goes nowhere if the direction is below the surface."""
    c[OX + r], c[OY + r], c[OZ + r] = point_of(numbers, i, point, LIFT)
    dx, dy, dz = turned(frame, direction)
    c[DX + r], c[DY + r], c[DZ + r] = dx, dy, dz
    c[AT + r] = reach if numbers[GX, i] * dx + numbers[GY, i] * dy + numbers[GZ, i] * dz > np.float32(0.0) else np.float32(0.0)


@jit.part
def element_at(r, scene, lookup, c):
    """What ray `r` of a traced packet has met: an element, or what there is in place of one."""
    item, at = float_bits(c[FOUND + r]), c[AT + r]
    if item < 0:
        return np.int32(NOWHERE if at > np.float32(0.0) else BACK)  # below the surface it meets its own back
    x, y, z = c[OX + r] + c[DX + r] * at, c[OY + r] + c[DY + r] * at, c[OZ + r] + c[DZ + r] * at
    return _element_at(scene.triangle[item], 1 if c[SLOPE + r] > np.float32(0.0) else 0, x, y, z, lookup)


@jit.part
def met_by(r, i, scene, numbers, lookup, c):
    """What ray `r` of a traced packet, a ray of element `i`, has met: as `element_at`, but a back that is too near to tell is `LOST`."""
    met = element_at(r, scene, lookup, c)
    near = c[AT + r] > np.float32(0.0) and c[AT + r] * c[AT + r] < numbers[AREA, i]
    return np.int32(LOST) if met == BACK and near else met


@jit.parallel_kernel
def _look(queue, scene, numbers, frames, directions, reach, lookup, first, hits):
    own_c, own_stack, own_points = np.zeros(packet.SCRATCH, np.float32), np.zeros(packet.STACK, np.int32), np.zeros((WIDTH, SAMPLES), np.int64)
    c, stack, points = jit.borrow(own_c), jit.borrow(own_stack), jit.borrow(own_points)
    scene, numbers, frames, directions = jit.borrow(scene), jit.borrow(numbers), jit.borrow(frames), jit.borrow(directions)
    lookup, hits = jit.borrow(lookup), jit.borrow(hits)
    count, rays = hits.shape
    chunk = jit.take(queue)
    while chunk * WIDTH < count:
        start = chunk * WIDTH
        width = min(WIDTH, count - start)
        for r in range(width):
            for k in range(SAMPLES):
                points[r, k] = free_sample(np.int64(numbers[FREE, first + start + r]), k)
        for number in range(rays):
            for r in range(np.uint64(WIDTH)):
                k = min(start + np.int64(r), count - 1)  # the last packet is filled up with its last element's rays
                start_ray(numbers, frames[k], directions[number], first + k, points[k - start, sample_of(number)], reach, r, c)
            packet.meet_all(scene, c, stack)
            for r in range(np.uint64(width)):
                hits[start + np.int64(r), number] = met_by(r, first + start + np.int64(r), scene, numbers, lookup, c)
        chunk = jit.take(queue)
    own_c[0] = own_stack[0] + own_points[0, 0]  # they live until here


@jit.inlined
def mean_light(hits, k, light):
    """The mean of `light`, which begins with that of `LOST`, over what the rays of element `k` meet."""
    rays, lost = hits.shape[1], 0
    red = green = blue = none = np.float32(0.0)  # four, as a vector register has them
    for r in range(np.uint64(rays)):
        e = hits[k, r]
        lost += e == LOST
        i = np.uint64(e + 3)
        red, green, blue, none = red + light[i, 0], green + light[i, 1], blue + light[i, 2], none + light[i, 3]
    share = np.float32(1.0) / np.float32(max(rays - lost, 1))
    return red * share, green * share, blue * share + none


@jit.parallel_kernel
def _mean(queue, hits, light, result):
    hits, light, result = jit.borrow(hits), jit.borrow(light), jit.borrow(result)
    count = len(hits)
    chunk = jit.take(queue)
    while chunk * _CHUNK < count:
        for k in range(chunk * _CHUNK, min(count, (chunk + 1) * _CHUNK)):
            result[0, k], result[1, k], result[2, k] = mean_light(hits, np.uint64(k), light)
        chunk = jit.take(queue)


class View(NamedTuple):
    """Where elements look.

    Attributes:
        scene: All that hides.
        numbers: (17, k) float32, of `Elements`: those that look.
        lookup: Which element lies where.
        reach: Metres: no ray goes farther.
        turned: Groups of neighbours cast directions of their own, lest the same err alike bounce after bounce: where nobody sees a single look.
    """

    scene: Occlusion
    numbers: Array
    lookup: Lookup
    reach: float
    turned: bool = False

    def frames(self, first: int = 0, last: int | None = None) -> Array:
        """(k, 3, 3) float32: of elements first .. last - 1, rows right, up, normal; `first` is a multiple of `WIDTH`."""
        numbers = self.numbers[:, first:last]
        frames = frames_of(numbers[NX : NZ + 1].T)
        if not self.turned:
            return frames
        bits = np.ascontiguousarray(numbers[PX : PZ + 1, ::WIDTH]).view(np.uint32) * _MIXED  # of where the group is: whoever has it knows that
        angle = np.repeat(np.bitwise_xor.reduce(bits, 0) * (2 * np.pi / 2**32), WIDTH)[: len(frames), None]
        cosine, sine = np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)
        right, up, normal = frames.transpose(1, 0, 2)
        return np.stack([cosine * right + sine * up, cosine * up - sine * right, normal], 1)

    def part(self, some: slice) -> View:
        """Of some of the elements."""
        return self._replace(numbers=np.ascontiguousarray(self.numbers[:, some]))

    def look(self, directions: Array, first: int, last: int, hits: Array, threads: int) -> None:
        """Fill `hits` (k, rays) int32: what elements first .. last - 1 see along `directions` (rays, 3) float32 of their frames."""
        jit.run(_look, threads, self.scene, self.numbers, self.frames(first, last), directions, np.float32(self.reach), self.lookup, first, hits)

    def chunks(self, rays: int, threads: int) -> Iterator[tuple[int, int]]:
        """First and last + 1 of elements that look at a time."""
        n, step = self.numbers.shape[1], max(1, min(threads * _RAYS_AT_ONCE, _MOST_RAYS) // (WIDTH * rays)) * WIDTH
        return pairwise([*range(0, n, step), n])

    def look_anew(self, rays: int, threads: int) -> Iterator[tuple[slice, Array]]:
        """Some elements after the other, and what `rays` of each meet, (k, rays) int32."""
        directions = cosine_directions(rays).astype(np.float32)
        for first, last in self.chunks(rays, threads):
            hits = np.empty((last - first, rays), np.int32)
            self.look(directions, first, last, hits, threads)
            yield slice(first, last), hits


class Spots(NamedTuple):
    """Elements so bright that they shoot, and what their patches give to all; see `luxel.radiosity.spots`.

    Attributes:
        element: (k,) int32: of each point of theirs, the element it is a part of; `area` (k,) float32 of each, m2.
        starts: (s + 1,) int64: where the points of each patch begin, and their end.
        rows, touched: Of the s patches, as in `luxel.radiosity.solve.Rows`.
    """

    element: Array
    area: Array
    starts: Array
    rows: Array
    touched: Array

    def apart(self, light: Array) -> tuple[Array, Array]:
        """The `light` (n, 3) of all other elements, and what patches send, (s, 3) float32."""
        rest, first = light.copy(), self.starts[:-1]
        rest[self.element] = 0
        power = np.add.reduceat(light[self.element] * self.area[:, None], first, 0)
        return rest, (power / np.add.reduceat(self.area, first)[:, None]).astype(np.float32)


def no_spots(elements: int) -> Spots:
    """For so many elements of this process."""
    empty = np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(1, np.int64)
    return Spots(*empty, np.zeros((0, elements), np.uint16), np.zeros((0, -(-elements // BLOCK)), np.bool_))


class Sight(NamedTuple):
    """What n elements see, kept: through it light is passed on without looking again.

    Attributes:
        hits: (n, rays) int32: the elements that the rays of each meet, `NOWHERE`, `BACK` or `LOST`.
        away: (n,) float64: area of each times the share of its rays that go nowhere, or meet the back of something one-sided, m2.
        blind: (n,) bool: hardly any ray of an element meets a front, or nothing: it is inside something, whatever its surroundings looked like.
        spots: Elements whose light comes by rows, if there are any.
    """

    hits: Array
    away: Array
    blind: Array
    spots: Spots | None = None


def gather(hits: Array, light: Array, threads: int) -> Array:
    """(3, k) float32: the mean of `light` (3 + n, 4), `padded`, over what the rays of k elements meet, `hits` (k, rays)."""
    result = np.empty((3, len(hits)), np.float32)
    jit.run(_mean, threads, hits, light, result)
    return result


@jit.part
def lit_around(k, hits, own, numbers, root):
    """How bright it is where element `k` of `own` (17, k) is seen: the mean of `root` (n,) float32, square roots of irradiance, over the surface
    that its rays meet, squared.

    Rays are as many as surface is large, seen from there; times the squared distance, as it is large. Roots, so that what is seen of a far
    brighter place through a door does not count for more than all of this one.
    """
    total = whole = 0.0
    for r in range(np.uint64(hits.shape[1])):
        e = hits[k, r]
        if e >= 0:
            dx, dy, dz = numbers[PX, e] - own[PX, k], numbers[PY, e] - own[PY, k], numbers[PZ, e] - own[PZ, k]
            square = np.float64(dx * dx + dy * dy + dz * dz)
            total, whole = total + square * np.float64(root[e]), whole + square
    mean = total / whole if whole > 0.0 else 0.0
    return mean * mean


@jit.parallel_kernel
def _lit_around(queue, hits, own, numbers, root, result):
    hits, own, numbers, root, result = jit.borrow(hits), jit.borrow(own), jit.borrow(numbers), jit.borrow(root), jit.borrow(result)
    chunk = jit.take(queue)
    while chunk * _CHUNK < len(hits):
        for k in range(chunk * _CHUNK, min(len(hits), (chunk + 1) * _CHUNK)):
            result[k] = lit_around(k, hits, own, numbers, root)
        chunk = jit.take(queue)


def brightness_around(hits: Array, own: Array, numbers: Array, irradiance: Array, threads: int) -> Array:
    """(k,) float64 W/m2: how bright it is where k elements, `own` (17, k), are seen (`lit_around`), of the irradiance (n,) of all (17, n)."""
    result = np.empty(len(hits))
    jit.run(_lit_around, threads, hits, own, numbers, np.sqrt(irradiance).astype(np.float32), result)
    return result


def padded(light: Array) -> Array:
    """(3 + n, 4) float32: the light of what is met, from `LOST` on."""
    result = np.zeros((len(light) + 3, 4), np.float32)
    result[3:, :3] = light
    return result


@jit.part
def away_and_blind(hits, k, area):
    """`Sight.away` and `Sight.blind` of element `k`."""
    rays, lost, nothing, backs = hits.shape[1], 0, 0, 0
    for r in range(rays):
        lost += hits[k, r] == LOST
        nothing += hits[k, r] == NOWHERE
        backs += hits[k, r] == BACK
    return np.float64(area) * (nothing + backs) / max(rays - lost, 1), (rays - lost - backs) * _FEW < rays


@jit.parallel_kernel
def _count(queue, hits, area, away, blind):
    hits, area, away, blind = jit.borrow(hits), jit.borrow(area), jit.borrow(away), jit.borrow(blind)
    chunk = jit.take(queue)
    while chunk * _CHUNK < len(hits):
        for k in range(chunk * _CHUNK, min(len(hits), (chunk + 1) * _CHUNK)):
            away[k], blind[k] = away_and_blind(hits, k, area[k])
        chunk = jit.take(queue)


@jit.parallel_kernel
def _exchange(queue, hits, group, starts, area, exchange):
    hits, group, starts, area, exchange = jit.borrow(hits), jit.borrow(group), jit.borrow(starts), jit.borrow(area), jit.borrow(exchange)
    rays = hits.shape[1]
    p = jit.take(queue)
    while p < len(exchange):
        for e in range(starts[p], starts[p + 1]):
            lost = 0
            for r in range(rays):
                lost += hits[e, r] == LOST
            share = area[e] / np.float32(max(rays - lost, 1))
            for r in range(rays):
                if hits[e, r] >= 0:
                    exchange[p, group[hits[e, r]]] += share
        p = jit.take(queue)


def exchange_of(hits: Array, starts: Array, area: Array, threads: int) -> Array:
    """(p, p) float32, m2: what groups of elements, starts[q] .. starts[q + 1] - 1, see of each other: area times form factor, made symmetric."""
    exchange = np.zeros((len(starts) - 1, len(starts) - 1), np.float32)
    group = np.repeat(np.arange(len(exchange), dtype=np.int32), np.diff(starts))
    jit.run(_exchange, threads, hits, group, starts, area, exchange)
    return np.asarray((exchange + exchange.T) / 2)


def see_around(view: View, rays: int, threads: int, told: Callable[[float], None]) -> Sight:
    """Let all elements look around; `told` hears which share of them has."""
    directions, area = cosine_directions(rays).astype(np.float32), view.numbers[AREA]
    hits, away, blind = np.empty((len(area), rays), np.int32), np.empty(len(area)), np.empty(len(area), np.bool_)
    for first, last in view.chunks(rays, threads):
        view.look(directions, first, last, hits[first:last], threads)
        jit.run(_count, threads, hits[first:last], area[first:last], away[first:last], blind[first:last])
        told(last / len(area))
    return Sight(hits, away, blind)


def element_pages(luxels: Luxels, luxel: Array, back: Array) -> Array:
    """`Lookup.element`, of elements that are `back` (n,) bool or front of `luxel` (n,) int32.

    Luxels that are no elements, as all of them is inside a solid, are stood for by a neighbour, and so is the chart's border. Who sees one from
    deeper inside is in there too, and what it would stand for may be a lawn in the sun around a house: that tells nothing.
    """
    pages = np.full((2, *luxels.shape), NOWHERE, np.int32)
    for side in (0, 1):
        number = np.full(len(luxels.area), NOWHERE, np.int32)
        here = np.flatnonzero(back == bool(side))
        number[luxel[here]] = here
        if side == 0:
            without = np.flatnonzero(number < 0)
            if len(without) and len(here):
                found = like(luxels, without, number >= 0)
                apart = ((luxels.position[found] - luxels.position[without]) ** 2).sum(1)
                number[without] = np.where(apart < _BESIDE * luxels.area[found], number[found], LOST)
        page, row, column = luxels.texel.T
        pages[side, page, row, column] = number
        for _ in range(_BORDER if len(here) else 0):
            _grow(pages[side])
    return pages


def _grow(pages: Array) -> None:
    """Give texels that have no element that of a neighbour."""
    h, w = pages.shape[1:]
    around, padded = np.full_like(pages, NOWHERE), np.pad(pages, ((0, 0), (1, 1), (1, 1)), constant_values=NOWHERE)
    for down in range(3):
        for right in range(3):
            np.maximum(around, padded[:, down : down + h, right : right + w], out=around)
    np.copyto(pages, around, where=pages == NOWHERE)
