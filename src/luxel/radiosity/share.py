"""Share: what one element receives of one shooter: the form factor, and how much of the shooter it sees.

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

import numpy as np

from luxel import jit
from luxel.jit import bits_float, float_bits, floor32
from luxel.radiosity.batch import ELEMENTS
from luxel.radiosity.element import AREA, FREE, LIFT, NX, NY, NZ, PX, PY, PZ, UX, VX, free_sample, point_of
from luxel.radiosity.occlusion import occluded
from luxel.radiosity.transfer import polygon_factor, spread_factor
from luxel.raster.constants import NOTHING

_F, _I = np.float32, np.int32
_FAR = _F(16.0)  # squared distance over squared radius beyond which a node is taken as a whole
FLAT = _F(9.0)
"""Squared distance over area within which an element is a parallelogram."""

_SIDES_NEAR = _F(3.0)  # sides of an element from a shooter within which rays tell what it sees
_LEVEL = _F(0.003)  # of a depth: what a pixel shows so near an element's tangent plane is the surface about the element
_FLUSH = _F(1e-8)  # squared sine over a shooter's plane within which a receiver lies in it, but for rounding
_BIAS = _F(1.0 - 1e-3)  # of a distance: rounding, and pixels' corners snapped
DEEPEST = 64


@jit.part
def _element_factor(j, x, y, z, nx, ny, nz, r2, cos_r, cos_s, corners, source):
    """Form factor from a point to element `j`; cosines times r."""
    area = source[AREA, j]
    if r2 > FLAT * area:
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
            if cos_s > _F(0.0) and cos_s * cos_s > _FLUSH * r2 and (cos_r > _F(0.0) or r2 < FLAT * area):
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
    """How much of element `j` a shooter sees, by rays to two samples of it; to two more if it sees only one of them."""
    seen, free = 0, np.int64(numbers[FREE, j])
    for k in (0, 2, 1, 3):  # the first two lie across from each other
        if k == 1 and seen != 1:
            return _F(seen) * _F(0.5)
        x, y, z = point_of(numbers, j, free_sample(free, k), LIFT)
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
    """How much of a shooter element `i` sees, 0..1, by rays from samples of the one to elements spread over the other."""
    seen, free = 0, np.int64(numbers[FREE, i])
    for k in range(rays):
        j = np.int64(span[0]) + (2 * k + 1) * np.int64(span[1] - span[0]) // (2 * rays)
        x, y, z = point_of(numbers, i, free_sample(free, k), LIFT)
        seen += not _hidden_from(scene, j, source, x, y, z)
    return _F(seen) / _F(rays)


@jit.part
def _near_fraction(node, rays, tree, source, scene, numbers, j, stack, corners):
    """The same for an element near the shooter: of what samples of it would receive, what they do, by a ray to each part of the shooter."""
    span, child, place = tree
    whole, seen, free = _F(0.0), _F(0.0), np.int64(numbers[FREE, j])
    nx, ny, nz = numbers[NX, j], numbers[NY, j], numbers[NZ, j]
    for k in range(rays):
        x, y, z = point_of(numbers, j, free_sample(free, k), LIFT)
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
