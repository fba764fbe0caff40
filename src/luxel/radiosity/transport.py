"""Rows of transport: what one shooter gives to every element, per unit of its radiosity.

For shooter s and element j the row holds K_j = F V: the form factor from the element's centre to the shooter, and how much of it is seen in
the shooter's hemicube. B_s K_j is the irradiance that j receives. Rows are stored as the upper half of a float32, rounded, which is enough
(0.2 %, without bias) and halves the memory to stream; where they are used, a scale puts the sum of a patch's right.

What elements near a light see of it is told by rays: they may see much of it where their middle, or its, sees none.

Visibility is blended from the four pixels about the element. What is drawn in a pixel hides the element only if it is in front of the element's
tangent plane there, in front of the element itself, and if its own plane parts the element from the shooter: so neither a flat surface nor one
bent inwards shadows itself, nor do walls darken the corners between them, whatever the resolution, and there is no bias to tune. Where a
pixel shows the element's own surface before the plane of an occluder (the floor before a wall), it says nothing of what is behind: there rays tell,
so no light passes below walls, however thin.

Form factors near a shooter are summed over the nodes of its tree, down to single elements, which up close are parallelograms under Lambert's
formula; see `transfer`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import bits_float, float_bits, floor32
from luxel.radiosity.batch import ELEMENTS
from luxel.radiosity.element import AREA, FREE, GX, LIFT, NX, NY, NZ, PX, PY, PZ, UX, VX, free_spot, point_of
from luxel.radiosity.hemicube import FACES, ItemBuffers, delta_form_factors
from luxel.radiosity.occlusion import Occlusion, occluded
from luxel.radiosity.patches import Tree
from luxel.radiosity.transfer import polygon_factor
from luxel.raster.constants import NOTHING

BLOCK = 128
"""Elements that a thread works on at a time; sums over rows are taken by so many."""

ROW_BYTES = 1 << 30
"""Rows of patches, and of spots, are kept up to this."""

_F, _I = np.float32, np.int32
_PER_PI = _F(1 / np.pi)
_FAR = _F(16.0)  # squared distance over squared radius beyond which a node is taken as a whole
_FLAT = _F(9.0)  # squared distance over area within which an element is a parallelogram
_SIDES_NEAR = _F(3.0)  # sides of an element from a shooter within which rays tell what it sees
_LEVEL = _F(0.003)  # of a depth: what a pixel shows so near an element's tangent plane is the surface about the element
_FLUSH = _F(1e-8)  # squared sine over a shooter's plane within which a receiver lies in it, but for rounding
_BIAS = _F(1.0 - 1e-3)  # of a distance: rounding, and pixels' corners snapped
DEEPEST = 64
MEETS, OUT, BACK = range(3)


class Elements(NamedTuple):
    """What receives light and sends it on, in the order of its tree.

    Attributes:
        numbers: (17, n) float32: position, normal (shading), normal of the surface, area, the element's sides u and v as vectors, metres, and
            which of its spots are free; see `element`.
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
        two_sided: (m,) bool.
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
        number: Spots of an element from which a ray goes to each part of the shooter; if for all pairs, rays; 0: none.
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


@jit.inlined
def spread_factor(cos_r, cos_s, cos_n, r2, area, spread):
    """Form factor from a point to a flat surface of mean square extent `spread` along its axes, right to the second order of extent over distance.

    cos_r and cos_s are times r. The integrand f = cos_r cos_s / r^2 has in the surface's plane the Laplacian (8 - 24 cos_s^2 - 8 cos_n cos_s /
    cos_r) f / r^2, of which half times `spread` is the difference of its mean from its value at the centre; straight ahead that is -4 spread / r^2,
    as of a disc.
    """
    base, inverse = cos_r * cos_s, _F(1.0) / r2
    bend = _F(4.0) * spread * inverse * (base - cos_s * cos_s * (_F(3.0) * base * inverse + cos_n))
    mean = base + bend if bend > _F(0.0) else base * base / (base - bend)
    return mean * area * (inverse * inverse * _PER_PI)


@jit.part
def _element_factor(j, x, y, z, nx, ny, nz, r2, cos_r, cos_s, corners, source):
    """Form factor from a point to element `j`; cosines times r."""
    area = source[AREA, j]
    if r2 > _FLAT * area:
        cos_n = nx * source[NX, j] + ny * source[NY, j] + nz * source[NZ, j]
        return spread_factor(cos_r, cos_s, cos_n, r2, area, area * _F(1 / 12))
    for k in range(4):
        a = _F(0.5) if k == 1 or k == 2 else _F(-0.5)
        b = _F(0.5) if k >= 2 else _F(-0.5)
        for axis in range(3):
            corners[k, axis] = source[PX + axis, j] + a * source[UX + axis, j] + b * source[VX + axis, j]
    return _F(abs(polygon_factor(x, y, z, nx, ny, nz, corners, 4)))


@jit.part
def _hidden_from(scene, j, source, x, y, z):
    """Whether something stands between element `j` of a source and a point."""
    return occluded(scene, np.float64(source[PX, j]), np.float64(source[PY, j]), np.float64(source[PZ, j]), x, y, z, -1, -1)


@jit.part
def node_factor(root, x, y, z, nx, ny, nz, span, child, place, source, stack, corners, scene, ask):
    """Form factor from a point with unit normal n to all elements below node `root`; and, if `ask`, to those nodes or elements that a ray sees."""
    total, seen, depth = _F(0.0), _F(0.0), 1
    stack[0] = root
    while depth > 0:
        depth -= 1
        node = stack[depth]
        dx, dy, dz = place[node, 0] - x, place[node, 1] - y, place[node, 2] - z
        r2, radius, area = dx * dx + dy * dy + dz * dz, place[node, 3], place[node, 7]
        first = child[node]
        if first >= 0 and r2 < _FAR * radius * radius:
            stack[depth], stack[depth + 1] = first, first + 1
            depth += 2
            continue
        cos_r = nx * dx + ny * dy + nz * dz
        cos_s = -(place[node, 4] * dx + place[node, 5] * dy + place[node, 6] * dz)
        part, j = _F(0.0), np.int64((span[node, 0] + span[node, 1]) // 2)
        if first < 0:
            if cos_s > _F(0.0) and cos_s * cos_s > _FLUSH * r2 and (cos_r > _F(0.0) or r2 < _FLAT * area):
                part = _element_factor(j, x, y, z, nx, ny, nz, r2, cos_r, cos_s, corners, source)
        elif cos_r > _F(0.0) and cos_s > _F(0.0):
            cos_n = nx * place[node, 4] + ny * place[node, 5] + nz * place[node, 6]
            part = spread_factor(cos_r, cos_s, cos_n, r2, area, place[node, 8])
        total += part
        if ask and part > _F(0.0) and not _hidden_from(scene, j, source, x, y, z):
            seen += part
    return total, seen


# Scratch of a thread, rows of ELEMENTS numbers in one array, so that the compiler knows that they do not overlap and uses vector registers.
# Of each element: place, shading normal, surface normal, as in `Elements.numbers`.
# Of each element under one shooter: squared distance; form factor if far; 1 if it faces the shooter and is in front of it (int32);
_R2, _FACTOR, IN_FRONT = (np.uint64(ELEMENTS * row) for row in range(9, 12))
# the upper left of the four pixels about it (int32) and how far between them it lies; the depth up to which these see it: at that pixel, what it
# gains to the right and downwards, and its least.
CORNER, _WX, _WY, _LIMIT, _LIMIT_X, _LIMIT_Y, _LEAST = (np.uint64(ELEMENTS * row) for row in range(12, 19))
SCRATCH = 19 * ELEMENTS
_ROW = tuple(np.uint64(ELEMENTS * row) for row in range(9))
_X, _Y, _Z, _NX, _NY, _NZ, _GX, _GY, _GZ = _ROW


@jit.part
def aim(count, center, frame, place, resolution, near, c):
    """Put `count` elements under a shooter: fill the scratch."""
    r0, r1, r2, u0, u1, u2, n0, n1, n2 = (
        frame[0, 0], frame[0, 1], frame[0, 2], frame[1, 0], frame[1, 1], frame[1, 2], frame[2, 0], frame[2, 1], frame[2, 2],
    )  # fmt: skip
    cx, cy, cz, sx, sy, sz = center[0], center[1], center[2], place[0], place[1], place[2]
    mx, my, mz, area, spread = place[4], place[5], place[6], place[7], place[8]
    zero, half, one = _F(0.0), _F(0.5), _F(1.0)
    scale, step = _F(resolution) * half, _F(2.0) / _F(resolution)
    last, last_low, size = _F(resolution - 2), _F(resolution // 2 - 2), _I(resolution)
    limit = near / _BIAS
    for i in range(np.uint64(0), np.uint64(count)):
        x, y, z = c[_X + i] - sx, c[_Y + i] - sy, c[_Z + i] - sz
        square = x * x + y * y + z * z
        cos_r, cos_s = -(c[_NX + i] * x + c[_NY + i] * y + c[_NZ + i] * z), mx * x + my * y + mz * z
        cos_n = c[_NX + i] * mx + c[_NY + i] * my + c[_NZ + i] * mz
        c[_R2 + i], c[_FACTOR + i] = square, spread_factor(cos_r, cos_s, cos_n, square, area, spread)
        x, y, z, gx, gy, gz = c[_X + i] - cx, c[_Y + i] - cy, c[_Z + i] - cz, c[_GX + i], c[_GY + i], c[_GZ + i]
        plane = -(gx * x + gy * y + gz * z)
        lx, ly, lz = r0 * x + r1 * y + r2 * z, u0 * x + u1 * y + u2 * z, n0 * x + n1 * y + n2 * z
        nr, nu, na = r0 * gx + r1 * gy + r2 * gz, u0 * gx + u1 * gy + u2 * gz, n0 * gx + n1 * gy + n2 * gz
        ax, ay = abs(lx), abs(ly)
        top, flank = (lz >= ax) & (lz >= ay), ax >= ay
        axis = lz if top else (ax if flank else ay)
        right, up = (lx if top else (ly if flank else lx)), (ly if top else lz)
        fr, fu = (nr if top else (nu if flank else nr)), (nu if top else na)
        fa = na if top else ((nr if lx > zero else -nr) if flank else (nu if ly > zero else -nu))
        face = _I(0) if top else ((_I(1) if lx > zero else _I(2)) if flank else (_I(3) if ly > zero else _I(4)))
        near_by = one / axis
        px, py = right * near_by * scale + scale - half, scale - half - up * near_by * scale
        ix, iy = min(max(floor32(px), zero), last), min(max(floor32(py), zero), last if top else last_low)
        c[_WX + i], c[_WY + i] = min(max(px - ix, zero), one), min(max(py - iy, zero), one)
        c[CORNER + i] = bits_float(_I(_I(_I(face * size) + _I(iy)) * size) + _I(ix))
        over = limit / plane
        c[_LIMIT + i] = -(fr * ((ix + half) * step - one) + fu * (one - (iy + half) * step) + fa) * over
        c[_LIMIT_X + i], c[_LIMIT_Y + i], c[_LEAST + i] = -fr * step * over, fu * step * over, limit * near_by
        above = (cos_s > zero) & (cos_s * cos_s > _FLUSH * square) & (lz > zero)
        c[IN_FRONT + i] = bits_float(_I(1) if (cos_r > zero) & (plane > zero) & above else _I(0))


@jit.inlined
def _parted(plane, x, y, z, center, margin):
    """Whether a triangle's plane has the point and the shooter on either side, the point by more than `margin`."""
    point = plane[0] * x + plane[1] * y + plane[2] * z - plane[3]
    shooter = plane[0] * center[0] + plane[1] * center[1] + plane[2] * center[2] - plane[3]
    return (point < -margin and shooter > _F(0.0)) or (point > margin and shooter < _F(0.0))


@jit.part
def _beyond(plane, corner, k, depth, resolution, center, frame, near):
    """Whether what pixel `k` of the four from `corner` on shows, at this depth, lies beyond the plane of an occluder, seen from the shooter."""
    step, half = _F(2.0) / _F(resolution), _F(0.5)
    row, ix = corner // resolution, corner % resolution + k % 2
    face, iy = row // resolution, row % resolution + k // 2
    x, y = (_F(ix) + half) * step - _F(1.0), _F(1.0) - (_F(iy) + half) * step
    r = plane[0] * frame[0, 0] + plane[1] * frame[0, 1] + plane[2] * frame[0, 2]
    u = plane[0] * frame[1, 0] + plane[1] * frame[1, 1] + plane[2] * frame[1, 2]
    n = plane[0] * frame[2, 0] + plane[1] * frame[2, 1] + plane[2] * frame[2, 2]
    if face == 0:
        slope = r * x + u * y + n
    elif face <= 2:
        slope = u * x + n * y + (r if face == 1 else -r)
    else:
        slope = r * x + n * y + (u if face == 3 else -u)
    shooter = plane[0] * center[0] + plane[1] * center[1] + plane[2] * center[2] - plane[3]
    there = shooter + slope * near / depth
    return there < -near if shooter > _F(0.0) else there > near


@jit.part
def _hidden(scene, center, x, y, z):
    return occluded(scene, center[0], center[1], center[2], np.float64(x), np.float64(y), np.float64(z), -1, -1)


@jit.part
def _seen_by_rays(scene, center, numbers, j):
    """How much of element `j` a shooter sees, by rays to two spots of it; to two more if it sees only one of them."""
    seen, free = 0, np.int64(numbers[FREE, j])
    for k in (0, 2, 1, 3):  # the first two lie across from each other
        if k == 1 and seen != 1:
            return _F(seen) * _F(0.5)
        x, y, z = point_of(numbers, j, free_spot(free, k), LIFT)
        seen += not _hidden(scene, center, x, y, z)
    return _F(seen) * _F(0.25)


@jit.part
def _disputed(i, at, resolution, center, frame, near, c, depth, ids, planes, seen):
    """Whether a pixel that sees element `i` shows the surface about it before an occluder that hides the element in another of the four pixels.

    `seen` has a bit for each.
    """
    corner, size, last = np.int64(float_bits(c[CORNER + i])), np.int64(resolution), np.int32(NOTHING)
    for h in range(4):
        t = ids[at + np.uint64(h // 2) * np.uint64(resolution) + np.uint64(h % 2)]
        if seen & (1 << h) or t == last:
            continue
        last = t
        for k in range(4):
            here = at + np.uint64(k // 2) * np.uint64(resolution) + np.uint64(k % 2)
            own = abs(depth[here] - (c[_LIMIT + i] + _F(k % 2) * c[_LIMIT_X + i] + _F(k // 2) * c[_LIMIT_Y + i])) < _LEVEL * depth[here]
            if own and seen & (1 << k) and not _beyond(planes[t], corner, k, depth[here], size, center, frame, near):
                return True
    return False


@jit.inlined
def _seen_fraction(i, j, at, resolution, center, frame, near, c, depth, ids, planes, scene, numbers):
    """How much of element `i`, 0..1, is seen by the four pixels from element `at` of the item buffer on."""
    limit, across, down, least = c[_LIMIT + i], c[_LIMIT_X + i], c[_LIMIT_Y + i], c[_LEAST + i]
    below, one = at + np.uint64(resolution), np.uint64(1)
    s0, s1 = depth[at] <= max(limit, least), depth[at + one] <= max(limit + across, least)
    s2, s3 = depth[below] <= max(limit + down, least), depth[below + one] <= max(limit + across + down, least)
    if s0 & s1 & s2 & s3:  # at the first glance: the common case
        return _F(1.0)
    x, y, z = c[_X + i], c[_Y + i], c[_Z + i]
    t0, t1, t2, t3 = ids[at], ids[at + one], ids[below], ids[below + one]
    if (t0 == t1) & (t0 == t2) & (t0 == t3):  # and the next
        if not _parted(planes[t0], x, y, z, center, near):
            return _F(1.0)
        if not (s0 | s1 | s2 | s3):
            return _F(0.0)
    else:
        s0 = s0 or not _parted(planes[t0], x, y, z, center, near)
        s1 = s1 or not (t1 == t0 if not s0 and t0 == t1 else _parted(planes[t1], x, y, z, center, near))
        s2 = s2 or not (t2 == t0 if not s0 and t0 == t2 else _parted(planes[t2], x, y, z, center, near))
        s3 = s3 or not (t3 == t1 if not s1 and t3 == t1 else _parted(planes[t3], x, y, z, center, near))
    seen = (1 if s0 else 0) | (2 if s1 else 0) | (4 if s2 else 0) | (8 if s3 else 0)
    if seen == 0 or seen == 15:
        return _F(1.0) if seen else _F(0.0)
    if _disputed(i, at, resolution, center, frame, near, c, depth, ids, planes, seen):
        return _seen_by_rays(scene, center, numbers, j)
    wx, wy = c[_WX + i], c[_WY + i]
    upper = (_F(1.0) - wx if s0 else _F(0.0)) + (wx if s1 else _F(0.0))
    lower = (_F(1.0) - wx if s2 else _F(0.0)) + (wx if s3 else _F(0.0))
    return upper * (_F(1.0) - wy) + lower * wy


@jit.part
def _ray_fraction(scene, rays, span, source, numbers, i):
    """How much of a shooter element `i` sees, 0..1, by rays from spots of the one to elements spread over the other."""
    seen, free = 0, np.int64(numbers[FREE, i])
    for k in range(rays):
        j = np.int64(span[0]) + (2 * k + 1) * np.int64(span[1] - span[0]) // (2 * rays)
        x, y, z = point_of(numbers, i, free_spot(free, k), LIFT)
        seen += not _hidden_from(scene, j, source, x, y, z)
    return _F(seen) / _F(rays)


@jit.part
def _near_fraction(node, rays, tree, source, scene, numbers, j, stack, corners):
    """The same for an element near the shooter: of what spots of it would receive, what they do, by a ray to each part of the shooter."""
    span, child, place = tree
    whole, seen, free = _F(0.0), _F(0.0), np.int64(numbers[FREE, j])
    nx, ny, nz = numbers[NX, j], numbers[NY, j], numbers[NZ, j]
    for k in range(rays):
        x, y, z = point_of(numbers, j, free_spot(free, k), LIFT)
        given, part = node_factor(node, x, y, z, nx, ny, nz, span, child, place, source, stack, corners, scene, True)
        whole, seen = whole + given, seen + part
    return seen / whole if whole > _F(0.0) else _F(0.0)


@jit.inlined
def _may_meet(box, center, x, y, z):
    """Whether the segment from a shooter to a point may meet a box (its two corners): not if both ends are beyond one of its sides."""
    meets = (max(center[0], x) >= box[0]) & (min(center[0], x) <= box[3]) & (max(center[1], y) >= box[1]) & (min(center[1], y) <= box[4])
    return meets & (max(center[2], z) >= box[2]) & (min(center[2], z) <= box[5])


@jit.inlined
def share_of(i, j, at, node, resolution, center, frame, near, c, tree, source, seen, masked, scene, rays, always, numbers, stack, corners):
    """The entry in the row of a shooter, `node` of its tree, for element `j`, which is number `i` in the scratch and in front of it; its four
    pixels begin at `at`. `tree` are span, child and place, `seen` the depth and ids of hemicubes, and the planes of what is drawn there."""
    span, child, place = tree
    depth, ids, planes = seen
    x, y, z = c[_X + i], c[_Y + i], c[_Z + i]
    if always:
        v = _ray_fraction(scene, rays, span[node], source, numbers, j)
    elif rays > 0 and c[_R2 + i] < (_SIDES_NEAR * math.sqrt(numbers[AREA, j]) + place[node, 3]) ** 2:
        v = _near_fraction(node, rays, tree, source, scene, numbers, j, stack, corners)
    else:
        v = _seen_fraction(i, j, at, resolution, center, frame, near, c, depth, ids, planes, scene, numbers)
        if v > _F(0.0) and len(masked.link) > 0 and _may_meet(masked.box[0], center, x, y, z) and _hidden(masked, center, x, y, z):
            return np.uint16(0)
    if v == _F(0.0):
        return np.uint16(0)
    f = c[_FACTOR + i]
    if c[_R2 + i] < _FAR * place[node, 3] * place[node, 3]:
        f, _ = node_factor(node, x, y, z, c[_NX + i], c[_NY + i], c[_NZ + i], span, child, place, source, stack, corners, scene, False)
    f = min(f, place[node, 7] / numbers[AREA, j])  # none receives more than all, however near its middle is
    return np.uint16((np.uint32(float_bits(f * v)) + np.uint32(0x8000)) >> np.uint32(16))


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
