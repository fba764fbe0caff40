"""Rows of transport: what one shooter gives to every element, per unit of its radiosity.

For shooter s and element j the row holds K_j = F V: the form factor from the element's centre to the shooter, and how much of it is seen in
the shooter's hemicube. B_s K_j is the irradiance that j receives. Rows are stored as the upper half of a float32, rounded, which is enough
(0.2 %, without bias) and halves the memory to stream; where they are used, a scale puts the sum of a patch's right.

An entry is made by `luxel.radiosity.share`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import bits_float, float_bits
from luxel.radiosity.batch import ELEMENTS
from luxel.radiosity.element import AREA, GX, PX
from luxel.radiosity.hemicube import FACES, ItemBuffers, delta_form_factors
from luxel.radiosity.occlusion import Occlusion
from luxel.radiosity.patches import Tree
from luxel.radiosity.share import CORNER, DEEPEST, IN_FRONT, SCRATCH, aim, share_of

BLOCK = 128
"""Elements that a thread works on at a time; sums over rows are taken by so many."""

ROW_BYTES = 1 << 30
"""Rows of patches, and of spots, are kept up to this."""

_F, _I = np.float32, np.int32
MEETS, OUT, BACK = range(3)


class Elements(NamedTuple):
    """What receives light and sends it on, in the order of its tree.

    Attributes:
        numbers: (17, n) float32: position, normal (shading), normal of the surface, area, the element's sides u and v as vectors, metres, and
            which of its samples are free; see `element`.
        bounds: (blocks, 8) float32: of each `BLOCK` of them: the centre and radius of a ball about their positions, and of their surfaces' normals.
    """

    numbers: Array
    bounds: Array


class Occluders(NamedTuple):
    """What is drawn into hemicubes.

    Attributes:
        positions: (3, v) float32.
        triangles: (m, 3) int32.
        planes: (m, 4) float32: unit normal n and offset d of each triangle, in front where n.x > d.
        two_sided: (m,) bool: it has two sides, or there is another back to back with it in the same place.
        masked: Alpha-masked triangles, which are not drawn but asked ray by ray, as their holes are finer than a hemicube's pixels.
    """

    positions: Array
    triangles: Array
    planes: Array
    two_sided: Array
    masked: Occlusion


class Visibility(NamedTuple):
    """Where rays are cast in place of what the hemicube says.

    Attributes:
        scene: All triangles.
        number: Samples of an element from which a ray goes to each part of the shooter; if for all pairs, rays; 0: none.
        always: For all pairs, for reference; False: for those that are near each other.
    """

    scene: Occlusion
    number: int
    always: bool


class Shooters(NamedTuple):
    """Who shoots.

    Attributes:
        node: (s,) int32, of the tree.
        centers: (s, 3) float32: where its hemicube stands.
        frames: (s, 3, 3) float32: rows right, up, normal.
    """

    node: Array
    centers: Array
    frames: Array


def elements_of(numbers: Array) -> Elements:
    """Elements with their bounds; `numbers` (17, n) float32."""
    starts = np.arange(0, numbers.shape[1], BLOCK)
    bounds = np.empty((len(starts), 8), np.float32)
    sizes = np.diff(np.append(starts, numbers.shape[1]))
    for first, column in ((PX, 0), (GX, 4)):
        values = numbers[first : first + 3].astype(np.float64)
        center = (np.minimum.reduceat(values, starts, 1) + np.maximum.reduceat(values, starts, 1)) / 2
        distance = np.sqrt(((values - np.repeat(center, sizes, 1)) ** 2).sum(0))
        bounds[:, column : column + 3] = center.T
        bounds[:, column + 3] = np.maximum.reduceat(distance, starts) * (1 + 1e-5) + 1e-6  # rounding included
    return Elements(numbers, bounds)


@jit.inlined
def all_averted(bounds, center, frame):
    """Whether no element of a block can be in front of the shooter and face it."""
    x, y, z, radius = bounds[0] - center[0], bounds[1] - center[1], bounds[2] - center[2], bounds[3]
    if frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z < -radius:
        return True
    facing = -(bounds[4] * x + bounds[5] * y + bounds[6] * z)
    length = math.sqrt(bounds[4] * bounds[4] + bounds[5] * bounds[5] + bounds[6] * bounds[6]) + bounds[7]
    return facing + bounds[7] * math.sqrt(x * x + y * y + z * z) + radius * length < _F(0.0)


@jit.inlined
def decoded(half):
    """The float32 whose upper half is given."""
    return bits_float(_I(np.uint32(half) << np.uint32(16)))


@jit.parallel_kernel
def _fill_rows(queue, numbers, bounds, span, child, place, source, nodes, centers, frames, start, resolutions, depth, ids, near,
               planes, masked, scene, rays, always, slots, rows, sums):  # fmt: skip
    n = numbers.shape[1]
    blocks = (n + BLOCK - 1) // BLOCK
    own_c, own_list = np.zeros(SCRATCH, np.float32), np.empty(BLOCK + 1, np.uint64)
    own_stack, own_corners = np.empty(DEEPEST, np.int32), np.empty((4, 3))
    c, listed, stack, corners = jit.borrow(own_c), jit.borrow(own_list), jit.borrow(own_stack), jit.borrow(own_corners)
    numbers, bounds, span, child, place = jit.borrow(numbers), jit.borrow(bounds), jit.borrow(span), jit.borrow(child), jit.borrow(place)
    source, depth, ids, planes, rows = jit.borrow(source), jit.borrow(depth), jit.borrow(ids), jit.borrow(planes), jit.borrow(rows)
    centers, frames, masked, scene = jit.borrow(centers), jit.borrow(frames), jit.borrow(masked), jit.borrow(scene)
    tree, seen = (span, child, place), (depth, ids, planes)
    block = jit.take(queue)
    while block < blocks:
        first = block * BLOCK
        count = min(BLOCK, n - first)
        for k in range(9):
            for i in range(count):
                c[k * ELEMENTS + i] = numbers[k, first + i]
        for s in range(len(nodes)):
            node, row, center, resolution, total = nodes[s], rows[slots[s]], centers[s], resolutions[s], 0.0
            for i in range(first, first + count):
                row[i] = 0
            if all_averted(bounds[block], center, frames[s]):
                sums[s, block] = 0.0
                continue
            aim(count, center, frames[s], place[node], resolution, near, c)
            found = np.uint64(0)
            for i in range(np.uint64(0), np.uint64(count)):
                listed[found] = i
                found += np.uint64(float_bits(c[IN_FRONT + i]))
            for k in range(np.uint64(0), found):
                i = listed[k]
                at = np.uint64(start[s]) + np.uint64(float_bits(c[CORNER + i]))
                j = np.uint64(first) + i
                half = share_of(i, j, at, node, resolution, center, frames[s], near, c, tree, source, seen, masked, scene, rays, always, numbers,
                                stack, corners)  # fmt: skip
                row[j] = half
                total += np.float64(decoded(half)) * np.float64(numbers[AREA, j])
            sums[s, block] = total
        block = jit.take(queue)
    own_c[0] = own_list[0] + own_stack[0] + own_corners[0, 0]  # they live until here


@jit.inlined
def fate(t, x, y, z, planes, two_sided):
    """What becomes of light through a pixel that shows triangle `t`: it `MEETS` a front or what has two, goes `OUT`, or meets a `BACK`."""
    if t < 0:
        return OUT
    return BACK if not two_sided[t] and planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z < planes[t, 3] else MEETS


@jit.parallel_kernel
def _escape(queue, centers, start, resolutions, ids, planes, two_sided, deltas, first_delta, escaped):
    """The share of a shooter's light that meets nothing, and the share that meets the back of something one-sided."""
    s = jit.take(queue)
    while s < len(centers):
        x, y, z = centers[s, 0], centers[s, 1], centers[s, 2]
        size = FACES * resolutions[s] * resolutions[s]
        out = back = 0.0
        for i in range(size):
            what = fate(ids[start[s] + i], x, y, z, planes, two_sided)
            share = deltas[first_delta[s] + i]
            if what == OUT:
                out += share
            elif what == BACK:
                back += share
        escaped[s, 0], escaped[s, 1] = out, back
        s = jit.take(queue)


@jit.parallel_kernel
def _receive(queue, rows, touched, slots, powers, received):
    """Add to received (3, n) what shooters of radiosity powers (s, 3) give; blocks that a row does not touch are skipped."""
    n = received.shape[1]
    blocks = (n + BLOCK - 1) // BLOCK
    rows, touched, received = jit.borrow(rows), jit.borrow(touched), jit.borrow(received)
    block = jit.take(queue)
    while block < blocks:
        first = block * BLOCK
        red, green, blue = received[0, first : first + BLOCK], received[1, first : first + BLOCK], received[2, first : first + BLOCK]
        for s in range(len(slots)):
            if not touched[slots[s], block]:
                continue
            row = rows[slots[s], first : first + BLOCK]
            r, g, b = powers[s, 0], powers[s, 1], powers[s, 2]
            for i in range(np.uint64(0), np.uint64(len(red))):
                k = decoded(row[i])
                red[i] += k * r
                green[i] += k * g
                blue[i] += k * b
        block = jit.take(queue)


def fill_rows(elements: Elements, tree: Tree, source: Array, shooters: Shooters, seen: ItemBuffers, occluders: Occluders, rays: Visibility,
              slots: Array, rows: Array, threads: int) -> Array:  # fmt: skip
    """Compute the rows of s shooters.

    Args:
        elements: Of the receivers.
        tree: Of the shooters, whose elements' numbers are `source` (17, k).
        slots: (s,) int64: where each row goes.
        rows: (slots, n) uint16, written.

    Returns:
        (s, blocks) float64: sums over the row, by blocks, of area times K: in all the shooter's area, if nothing escapes.
    """
    count, n = len(shooters.node), elements.numbers.shape[1]
    sums = np.empty((count, -(-n // BLOCK)))
    jit.run(
        _fill_rows, threads, *elements, tree.span, tree.child, tree.place, source, *shooters, seen.start,
        seen.resolution, seen.depth, seen.ids, np.float32(seen.near), occluders.planes, occluders.masked,
        *rays, slots, rows, sums,
    )  # fmt: skip
    return sums


def escapes(centers: Array, seen: ItemBuffers, occluders: Occluders, threads: int) -> Array:
    """(s, 2) float64: the shares of hemicubes that meet nothing and the backs of one-sided surfaces, of s shooters at centers (s, 3)."""
    sizes = sorted(set(seen.resolution.tolist()))
    deltas = [delta_form_factors(size).ravel() for size in sizes]
    begin = dict(zip(sizes, np.cumsum([0] + [len(d) for d in deltas]).tolist(), strict=False))
    escaped = np.empty((len(centers), 2))
    jit.run(
        _escape, threads, centers, seen.start, seen.resolution, seen.ids, occluders.planes, occluders.two_sided,
        np.concatenate(deltas),
        np.array([begin[size] for size in seen.resolution.tolist()], np.int64), escaped,
    )  # fmt: skip
    return escaped


def receive(rows: Array, touched: Array, slots: Array, powers: Array, received: Array, threads: int) -> None:
    """received (3, n) float32 += the sum over the shooters, in their order, of powers (s, 3) float32 times rows[slots].

    `touched` (slots, blocks) bool tells which blocks of a row are not all zero.
    """
    jit.run(_receive, threads, rows, touched, slots, powers, received)
