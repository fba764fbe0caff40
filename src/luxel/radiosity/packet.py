"""Packets: the first triangles that 16 rays meet, all at once, for gathering: rays that start near each other and go a like way.

Each node of the hierarchy is fetched once for all of them, and what is done with it is plain loops over the rays, which the compiler turns into
vector instructions (Wald, Slusallek, Benthin, Wagner, "Interactive rendering with coherent ray tracing", 2001). Single precision: a ray lost
or gained in a crack is no harm in a mean of many.

A back counts as deeper than it is by what rounding can amount to. So where two faces lie back to back in one place, as those of a wall without
thickness do, a ray meets the one that faces it, in whatever order it comes to them.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.jit import bits_float
from luxel.radiosity.batch import RAYS
from luxel.radiosity.occlusion import mask_is_opaque

WIDTH = RAYS
"""Rays of a packet."""

_F, _I = np.float32, np.int32
_MIDDLE = np.uint64(WIDTH // 2)
_CRACK = _F(1e-5)  # of a triangle: by so much it reaches beyond its sides
_DEEPEST = 192

# Rows of a packet's scratch, WIDTH numbers each: where rays start, their unit directions, how far they go, then what they met: how far away, the
# row of `Occlusion.corners` (int32) or -1, and the product of direction and normal; last, what the walk needs.
OX, OY, OZ, DX, DY, DZ, AT, FOUND, SLOPE, _IX, _IY, _IZ, _SX, _SY, _SZ, _NEW = (np.uint64(WIDTH * row) for row in range(16))
SCRATCH = 16 * WIDTH
STACK = _DEEPEST + 8


@jit.inlined
def _touched(box, node, c):
    """Whether any ray of a packet touches the box of a node before what it has met."""
    x0, y0, z0, x1, y1, z1 = box[node, 0], box[node, 1], box[node, 2], box[node, 3], box[node, 4], box[node, 5]
    count = _I(0)
    for r in range(np.uint64(WIDTH)):
        ax, bx = x0 * c[_IX + r] - c[_SX + r], x1 * c[_IX + r] - c[_SX + r]
        ay, by = y0 * c[_IY + r] - c[_SY + r], y1 * c[_IY + r] - c[_SY + r]
        az, bz = z0 * c[_IZ + r] - c[_SZ + r], z1 * c[_IZ + r] - c[_SZ + r]
        near = max(max(min(ax, bx), min(ay, by)), max(min(az, bz), _F(0.0)))
        far = min(min(max(ax, bx), max(ay, by)), min(max(az, bz), c[AT + r]))
        count = _I(count + (_I(1) if near <= far else _I(0)))
    return count > _I(0)


@jit.inlined
def _meet(corners, item, epsilon, c):
    """Let the rays meet a triangle: _NEW is how far along it is, a little more if that is its back, 0 if it is not met; returns whether any does."""
    x0, y0, z0 = corners[item, 0], corners[item, 1], corners[item, 2]
    ux, uy, uz = corners[item, 3] - x0, corners[item, 4] - y0, corners[item, 5] - z0
    vx, vy, vz = corners[item, 6] - x0, corners[item, 7] - y0, corners[item, 8] - z0
    nx, ny, nz = corners[item, 9], corners[item, 10], corners[item, 11]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    whole = uu * vv - uv * uv
    edge = -_CRACK * whole
    count = _I(0)
    for r in range(np.uint64(WIDTH)):
        ax, ay, az = x0 - c[OX + r], y0 - c[OY + r], z0 - c[OZ + r]
        dx, dy, dz = c[DX + r], c[DY + r], c[DZ + r]
        height, slope = nx * ax + ny * ay + nz * az, nx * dx + ny * dy + nz * dz
        at = height / slope
        deep = (height + (epsilon if slope > _F(0.0) else _F(0.0))) / slope
        px, py, pz = dx * at - ax, dy * at - ay, dz * at - az
        pu, pv = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
        s, t = pu * vv - pv * uv, pv * uu - pu * uv
        meets = (abs(height) > epsilon) & (at > _F(0.0)) & (deep < c[AT + r]) & (s >= edge) & (t >= edge) & (s + t <= whole - edge)
        c[_NEW + r] = deep if meets else _F(0.0)
        count = _I(count + (_I(1) if meets else _I(0)))
    return count > _I(0)


@jit.inlined
def _keep(corners, item, c):
    """What was met is what is nearest so far."""
    nx, ny, nz, found = corners[item, 9], corners[item, 10], corners[item, 11], bits_float(_I(item))
    for r in range(np.uint64(WIDTH)):
        at, slope = c[_NEW + r], nx * c[DX + r] + ny * c[DY + r] + nz * c[DZ + r]
        old_at, old_found, old_slope = c[AT + r], c[FOUND + r], c[SLOPE + r]
        met = at > _F(0.0)
        c[AT + r], c[FOUND + r], c[SLOPE + r] = at if met else old_at, found if met else old_found, slope if met else old_slope


@jit.part
def _see_through(scene, item, c):
    """Where a mask has a hole, the triangle is not met."""
    for r in range(np.uint64(WIDTH)):
        at = c[_NEW + r]
        if at > _F(0.0):
            x, y, z = c[OX + r] + c[DX + r] * at, c[OY + r] + c[DY + r] * at, c[OZ + r] + c[DZ + r] * at
            if not mask_is_opaque(scene, item, x, y, z):
                c[_NEW + r] = _F(0.0)


@jit.inlined
def _inverse(d):
    inverse = _F(1.0) / d
    return inverse if abs(d) > _F(1e-18) else _F(1e18)


@jit.part
def meet_all(scene, c, stack):
    """Trace a packet: rows OX .. AT of the scratch `c` (SCRATCH,) float32 are given, AT, FOUND and SLOPE are filled; `stack` (STACK,) int32."""
    for r in range(np.uint64(WIDTH)):
        c[FOUND + r], c[SLOPE + r] = bits_float(_I(-1)), _F(0.0)
        ix, iy, iz = _inverse(c[DX + r]), _inverse(c[DY + r]), _inverse(c[DZ + r])
        c[_IX + r], c[_IY + r], c[_IZ + r] = ix, iy, iz
        c[_SX + r], c[_SY + r], c[_SZ + r] = c[OX + r] * ix, c[OY + r] * iy, c[OZ + r] * iz
    mx, my, mz = c[DX + _MIDDLE], c[DY + _MIDDLE], c[DZ + _MIDDLE]
    box, link, corners, epsilon = scene.box, scene.link, scene.corners, _F(scene.epsilon[0])
    node, depth = np.uint64(0), 0
    if len(link) == 0 or not _touched(box, node, c):
        return
    while True:  # at a node that is touched
        leaf = link[node, 1]
        if leaf:
            for item in range(np.uint64(leaf >> 3), np.uint64((leaf >> 3) + (leaf & 7))):
                if _meet(corners, item, epsilon, c):
                    if scene.mask[item] >= 0:
                        _see_through(scene, item, c)
                    _keep(corners, item, c)
        else:
            one = node + np.uint64(1)
            other = np.uint64(link[one, 0])
            enters_one, enters_other = _touched(box, one, c), _touched(box, other, c)
            if enters_one & enters_other:
                along = _F(0.0)  # which of the two lies nearer along the packet's way; the other waits
                along += (box[other, 0] + box[other, 3] - box[one, 0] - box[one, 3]) * mx
                along += (box[other, 1] + box[other, 4] - box[one, 1] - box[one, 4]) * my
                along += (box[other, 2] + box[other, 5] - box[one, 2] - box[one, 5]) * mz
                stack[depth] = other if along > _F(0.0) else one
                depth += 1
                node = one if along > _F(0.0) else other
                continue
            if enters_one | enters_other:
                node = one if enters_one else other
                continue
        while True:  # what waits may by now lie behind what was met
            if depth == 0:
                return
            depth -= 1
            node = np.uint64(stack[depth])
            if _touched(box, node, c):
                break
